// A two-stage estimator of seeds: c++ -std=c++17 -O2 -shared -fPIC -I adapters/c -o libtwo_stage.so two_stage.cpp
// A pilot of 4 samples, 12 more where they differ, and the mean of all: the bias of Kirk & Arvo 1991. It tells its costs.
#include "truemean.h"

#include <algorithm>
#include <random>
#include <vector>

namespace {

using Colour = std::vector<double>;

struct Sampler {
    const truemean_pixel &pixel;
    std::mt19937_64 generator;
    std::discrete_distribution<int> index;

    Sampler(const truemean_pixel &given, std::uint64_t seed)
        : pixel(given), generator(seed), index(given.weights, given.weights + given.count) {}

    Colour draw() {
        const double *value = pixel.values + index(generator) * pixel.channels;
        return Colour(value, value + pixel.channels);
    }
};

std::vector<Colour> replicate(const truemean_pixel &pixel, std::uint64_t seed) {
    Sampler sampler(pixel, seed);
    std::vector<Colour> samples;
    while (samples.size() < 4) samples.push_back(sampler.draw());
    if (std::count(samples.begin(), samples.end(), samples[0]) < 4)
        while (samples.size() < 16) samples.push_back(sampler.draw());
    return samples;
}

} // namespace

TRUEMEAN_EXPORT int32_t two_stage(const truemean_pixel *pixel, int64_t count, const uint64_t *seeds,
                                  double *estimates, double *costs) {
    for (int64_t i = 0; i < count; i++) {
        const std::vector<Colour> samples = replicate(*pixel, seeds[i]);
        for (int32_t c = 0; c < pixel->channels; c++) {
            double sum = 0;
            for (const Colour &sample : samples) sum += sample[c];
            *estimates++ = sum / samples.size();
        }
        costs[i] = samples.size();
    }
    return TRUEMEAN_OK;
}
