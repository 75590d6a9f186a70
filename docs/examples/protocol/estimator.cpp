// An estimator as a program, with binary batches: c++ -std=c++17 -O2 -o estimator estimator.cpp
// The cure of Kirk & Arvo 1991, section 4: the pilot decides and is thrown away, so nothing is biased.
#include <algorithm>
#include <cstdint>
#include <iostream>
#include <numeric>
#include <random>
#include <sstream>
#include <string>
#include <vector>

using Colour = std::vector<double>;

struct Pixel { std::vector<double> weights; std::vector<Colour> values; };

Colour estimate(const Pixel &pixel, std::uint64_t seed) {
    std::mt19937_64 generator(seed);
    std::discrete_distribution<int> draw(pixel.weights.begin(), pixel.weights.end());
    int pilot[4];
    for (int &index : pilot) index = draw(generator);
    int n = std::count(pilot, pilot + 4, pilot[0]) == 4 ? 4 : 12;
    Colour mean(pixel.values[0].size());
    for (int i = 0; i < n; i++) {
        const Colour &sample = pixel.values[draw(generator)];
        for (std::size_t c = 0; c < mean.size(); c++) mean[c] += sample[c] / n;
    }
    return mean;
}

int main() {
    std::ios::sync_with_stdio(false);
    Pixel pixel;
    for (std::string line; std::getline(std::cin, line);) {
        std::istringstream words(line);
        std::string word;
        std::int64_t n = 0, channels = 0;
        words >> word >> n >> channels;
        if (word == "truemean") {
            std::cout << "truemean 1 binary\n";
        } else if (word == "pixel") {
            pixel = {std::vector<double>(n), std::vector<Colour>(n, Colour(channels))};
            for (int i = 0; i < n; i++) {
                std::cin >> pixel.weights[i];
                for (double &channel : pixel.values[i]) std::cin >> channel;
            }
            std::cin.ignore();
            std::cout << "ok\n";
        } else if (word == "batch") { // little-endian, as nearly every machine is
            std::vector<std::uint64_t> seeds(n);
            std::cin.read(reinterpret_cast<char *>(seeds.data()), 8 * n);
            for (std::uint64_t seed : seeds) {
                Colour mean = estimate(pixel, seed);
                std::cout.write(reinterpret_cast<const char *>(mean.data()), 8 * mean.size());
            }
        }
        std::cout.flush();
    }
}
