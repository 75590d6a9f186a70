//! The mean of 8 samples, as a function of seeds: rustc -O --crate-type cdylib fixed.rs
//! truemean judge lib:./libfixed.so:fixed --tolerance 1%
use std::slice::from_raw_parts;

/// `truemean_pixel` of truemean.h.
#[repr(C)]
pub struct Pixel {
    count: i32,
    channels: i32,
    values: *const f64,
    weights: *const f64,
}

struct SplitMix64(u64);

impl SplitMix64 {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn index(&mut self, weights: &[f64]) -> usize {
        let mut left = self.uniform();
        for (i, weight) in weights.iter().enumerate() {
            if left < *weight {
                return i;
            }
            left -= weight;
        }
        weights.len() - 1
    }
}

/// # Safety
/// The pointers are those of truemean.h.
#[no_mangle]
pub unsafe extern "C" fn fixed(
    pixel: &Pixel, count: i64, seeds: *const u64, estimates: *mut f64, _costs: *mut f64,
) -> i32 {
    let (n, channels) = (pixel.count as usize, pixel.channels as usize);
    let (weights, values) = (from_raw_parts(pixel.weights, n), from_raw_parts(pixel.values, n * channels));
    for i in 0..count as usize {
        let mut random = SplitMix64((*seeds.add(i)).wrapping_mul(0xD134_2543_DE82_EF95));
        let mut sums = vec![0.0; channels];
        for _ in 0..8 {
            let value = &values[random.index(weights) * channels..];
            sums.iter_mut().zip(value).for_each(|(sum, channel)| *sum += channel);
        }
        for (c, sum) in sums.iter().enumerate() {
            *estimates.add(i * channels + c) = sum / 8.0;
        }
    }
    0
}
