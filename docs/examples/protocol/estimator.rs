// An estimator that asks for its samples, so that its bias is found exactly: rustc -O estimator.rs
// EstimateMean of Kirk & Arvo 1991, Fig. 1: the mean of 4 samples if they are equal, else the costly true mean.
use std::io::{self, BufRead, Write};

struct Truemean {
    lines: io::Lines<io::StdinLock<'static>>,
}

impl Truemean {
    fn read(&mut self) -> Option<String> {
        self.lines.next().and_then(Result::ok)
    }

    fn say(&self, line: &str) {
        println!("{line}");
        io::stdout().flush().unwrap();
    }

    /// Indices of `n` values of the pixel.
    fn draw(&mut self, n: usize) -> Vec<usize> {
        self.say(&format!("draw {n}"));
        let answer = self.read().unwrap_or_default();
        answer.split_whitespace().map(|index| index.parse().unwrap()).collect()
    }
}

fn estimate(truemean: &mut Truemean, weights: &[f64], values: &[f64]) -> f64 {
    let samples: Vec<f64> = truemean.draw(4).into_iter().map(|index| values[index]).collect();
    if samples.iter().all(|sample| *sample == samples[0]) {
        samples[0]
    } else {
        weights.iter().zip(values).map(|(weight, value)| weight * value).sum()
    }
}

fn main() {
    let mut truemean = Truemean { lines: io::stdin().lock().lines() };
    let (mut weights, mut values) = (Vec::new(), Vec::new());
    while let Some(line) = truemean.read() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["truemean", _] => truemean.say("truemean 1 asks"),
            ["pixel", k, channels] => {
                let rows: Vec<String> = (0..k.parse().unwrap()).filter_map(|_| truemean.read()).collect();
                let number = |row: &String, i| row.split_whitespace().nth(i).unwrap().parse::<f64>().unwrap();
                weights = rows.iter().map(|row| number(row, 0)).collect();
                values = rows.iter().map(|row| number(row, 1)).collect();
                truemean.say(if channels == "1" { "ok" } else { "unsupported colours" });
            }
            ["ask"] => {
                let mean = estimate(&mut truemean, &weights, &values);
                truemean.say(&format!("estimate {mean}"));
            }
            _ => {}
        }
    }
}
