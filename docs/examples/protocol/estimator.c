/* A two-stage estimator as a program: cc -O2 -o estimator estimator.c; truemean judge exec:./estimator --tolerance 1%
   A pilot of 4 samples, 12 more where they differ, and the mean of all: the bias of Kirk & Arvo 1991. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static double values[4096], ends[4096]; /* one channel; ends of the weights in [0, 1] */
static int count;
static uint64_t state;

static double uniform(void) { /* SplitMix64 */
    uint64_t z = (state += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static double draw(void) {
    double u = uniform();
    int i = 0;
    while (i < count - 1 && u >= ends[i]) i++;
    return values[i];
}

static void replicate(uint64_t seed) {
    state = seed * 0xD1342543DE82EF95u;
    double first = draw(), sum = first;
    int n = 4;
    for (int i = 1; i < 4; i++) {
        double x = draw();
        if (x != first) n = 16;
        sum += x;
    }
    for (int i = 4; i < n; i++) sum += draw();
    printf("%.17g %d\n", sum / n, n);
}

int main(void) {
    char word[64];
    while (scanf("%63s", word) == 1) {
        int n, channels;
        uint64_t seed;
        if (!strcmp(word, "truemean") && scanf("%d", &n) == 1) {
            printf("truemean 1 costs\n");
        } else if (!strcmp(word, "pixel") && scanf("%d %d", &count, &channels) == 2) {
            for (int i = 0; i < count; i++) {
                if (scanf("%lf", &ends[i]) != 1) return 1;
                for (int c = 0; c < channels; c++)
                    if (scanf("%lf", &values[i]) != 1) return 1;
                if (i) ends[i] += ends[i - 1];
            }
            printf(channels == 1 ? "ok\n" : "unsupported colours\n");
        } else if (!strcmp(word, "run") && scanf("%d", &n) == 1) {
            while (n-- && scanf("%" SCNu64, &seed) == 1) replicate(seed);
        }
        fflush(stdout);
    }
    return 0;
}
