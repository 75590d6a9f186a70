/* truemean.h, version 1: an estimator as a function of a shared library. C99, also C++; no dependency.
 *
 * A function of one of two forms, exported under any name, is judged by
 *
 *     truemean judge lib:./libmine.so:my_estimator --tolerance 1%
 *
 * TRUEMEAN_EXPORT before it makes sure of the name, in C++ and on Windows too.
 *
 * 1. Of seeds: one estimate for each, and the same seed gives the same estimate.
 *
 *     int32_t my_estimator(const truemean_pixel *pixel, int64_t count, const uint64_t *seeds,
 *                          double *estimates, double *costs);
 *
 *    `estimates` has room for count * channels, replicate by replicate; `costs` for count samples drawn, or is left.
 *
 * 2. Of answers: one estimate, of samples that it asks for. Its exact expected value is found by answering every
 *    request in every way, so it may depend on nothing else.
 *
 *     int32_t my_estimator(const truemean_pixel *pixel, truemean_source *source, double *estimate);
 *
 *    Say so in the subject, lib:./libmine.so:my_estimator?asks=1, or put TRUEMEAN_ASKS(my_estimator) after it, once and
 *    without a semicolon: then the loop over all answers is compiled too, and some ten times faster.
 *
 * Both return 0, or 1 for a pixel that they don't support, or anything else for a failure.
 */
#ifndef TRUEMEAN_H
#define TRUEMEAN_H

#include <stdint.h>

#define TRUEMEAN_ABI 1
#define TRUEMEAN_OK 0
#define TRUEMEAN_UNSUPPORTED 1

#ifdef __cplusplus
#define TRUEMEAN_C extern "C"
#else
#define TRUEMEAN_C extern
#endif

/* Before a function: its name is found in the library, from C++ too. */
#ifdef _WIN32
#define TRUEMEAN_EXPORT TRUEMEAN_C __declspec(dllexport)
#else
#define TRUEMEAN_EXPORT TRUEMEAN_C __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* X: `count` values, each of `channels` numbers, and their weights, which sum to 1. */
typedef struct truemean_pixel {
    int32_t count;
    int32_t channels;
    const double *values;  /* [count * channels], value by value */
    const double *weights; /* [count] */
} truemean_pixel;

/* Where samples come from. */
typedef struct truemean_source truemean_source;
struct truemean_source {
    /* The index of the value of one sample, 0 to count - 1. */
    int32_t (*draw)(truemean_source *source);
    /* The index of one of n alternatives of the estimator's own, of these probabilities. */
    int32_t (*pick)(truemean_source *source, int32_t n, const double *weights);
};

/* One sample of a pixel of one channel. */
static inline double truemean_sample(const truemean_pixel *pixel, truemean_source *source) {
    return pixel->values[source->draw(source)];
}

/* ---- the loop over all answers; what follows is of interest to adapters alone --------------------------------- */

/* An odometer over sequences of answers. `key` counts each value drawn: stride[i] is added for each sample of value i. */
typedef struct truemean_walk {
    truemean_source source;
    int32_t *given;         /* [capacity] the answers of this path */
    const uint64_t *stride; /* [values] */
    int32_t values;
    int32_t capacity;
    int32_t length;
    int32_t used;
    uint64_t key;
    int32_t failed; /* 1: more answers than capacity; 2: a choice of its own, which this loop has none for; 3: fewer than before */
} truemean_walk;

/* Any answer, in no order, so that a loop that waits for one of them ends. */
static inline int32_t truemean_walk_fail(truemean_walk *walk, int32_t failed, int32_t n) {
    walk->failed = failed;
    walk->key = walk->key * 6364136223846793005u + 1442695040888963407u;
    return n > 0 ? (int32_t)((walk->key >> 33) % (uint64_t)n) : 0;
}

static inline int32_t truemean_walk_draw(truemean_source *source) {
    truemean_walk *walk = (truemean_walk *)source;
    int32_t at = walk->used, value;
    if (at >= walk->capacity) return truemean_walk_fail(walk, 1, walk->values);
    walk->used = at + 1;
    if (at >= walk->length) {
        walk->given[at] = 0;
        walk->length = at + 1;
    }
    value = walk->given[at];
    walk->key += walk->stride[value];
    return value;
}

static inline int32_t truemean_walk_pick(truemean_source *source, int32_t n, const double *weights) {
    (void)weights;
    return truemean_walk_fail((truemean_walk *)source, 2, n);
}

typedef int32_t (*truemean_asking)(const truemean_pixel *pixel, truemean_source *source, double *estimate);

/* Runs up to `most` paths; returns how many, with their estimates and keys. The walk is over when its length is 0. */
static inline int64_t truemean_walk_on(truemean_asking estimator, const truemean_pixel *pixel, truemean_walk *walk,
                                       int64_t most, double *estimates, uint64_t *keys, int32_t *status) {
    int64_t path;
    walk->source.draw = truemean_walk_draw;
    walk->source.pick = truemean_walk_pick;
    for (path = 0; path < most;) {
        walk->used = 0;
        walk->key = 0;
        *status = estimator(pixel, &walk->source, estimates + path * pixel->channels);
        if (walk->used < walk->length) walk->failed = walk->failed ? walk->failed : 3;
        if (*status || walk->failed) return path;
        keys[path++] = walk->key;
        while (walk->length && walk->given[walk->length - 1] == walk->values - 1) walk->length--;
        if (!walk->length) return path;
        walk->given[walk->length - 1]++;
    }
    return path;
}

/* After an estimator of the second form: exports its loop. */
#define TRUEMEAN_ASKS(name)                                                                                           \
    TRUEMEAN_EXPORT int64_t name##_paths(const truemean_pixel *pixel, truemean_walk *walk, int64_t most,              \
                                         double *estimates, uint64_t *keys, int32_t *status);                         \
    TRUEMEAN_EXPORT int64_t name##_paths(const truemean_pixel *pixel, truemean_walk *walk, int64_t most,              \
                                         double *estimates, uint64_t *keys, int32_t *status) {                        \
        return truemean_walk_on(name, pixel, walk, most, estimates, keys, status);                                    \
    }

#ifdef __cplusplus
}
#endif

#endif
