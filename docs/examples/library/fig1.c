/* An estimator that asks for its samples, so that its bias is found exactly:
       cc -O2 -shared -fPIC -I adapters/c -o libfig1.so fig1.c
       truemean judge lib:./libfig1.so:fig1 --tolerance 1%
   EstimateMean of Kirk & Arvo 1991, Fig. 1: the mean of 4 samples if they are equal, else the costly true mean. */
#include "truemean.h"

static double true_mean(const truemean_pixel *pixel) {
    double sum = 0;
    for (int i = 0; i < pixel->count; i++) sum += pixel->weights[i] * pixel->values[i];
    return sum;
}

TRUEMEAN_EXPORT int32_t fig1(const truemean_pixel *pixel, truemean_source *source, double *estimate) {
    if (pixel->channels != 1) return TRUEMEAN_UNSUPPORTED;
    double first = truemean_sample(pixel, source), sum = first;
    int easy = 1;
    for (int i = 1; i < 4; i++) {
        double sample = truemean_sample(pixel, source);
        if (sample != first) easy = 0;
        sum += sample;
    }
    *estimate = easy ? sum / 4 : true_mean(pixel);
    return TRUEMEAN_OK;
}

TRUEMEAN_ASKS(fig1)
