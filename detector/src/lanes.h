/* Four numbers at a time, as processors without extensions have them, in the vectors of gcc and clang. */

#ifndef MARKERGEN_LANES_H
#define MARKERGEN_LANES_H

#include <math.h>
#include <stdint.h>
#include <string.h>
#ifdef __SSE__
#include <xmmintrin.h>
#endif

enum { LANES = 4 };
typedef float Lanes __attribute__((vector_size(4 * LANES)));
typedef int32_t Flags __attribute__((vector_size(4 * LANES))); /* -1 or 0 from comparisons */

static inline Lanes all(float x) { return (Lanes){x, x, x, x}; }
static inline Lanes pick(Flags which, Lanes a, Lanes b) { return (Lanes)((which & (Flags)a) | (~which & (Flags)b)); }
static inline Lanes magnitude(Lanes x) { return (Lanes)((Flags)x & INT32_MAX); }

/* The larger and the smaller number, b where they do not compare. */
#ifdef __SSE__
static inline Lanes most_of(Lanes a, Lanes b) { return _mm_max_ps(a, b); }
static inline Lanes least_of(Lanes a, Lanes b) { return _mm_min_ps(a, b); }
#else
static inline Lanes most_of(Lanes a, Lanes b) { return pick(a > b, a, b); }
static inline Lanes least_of(Lanes a, Lanes b) { return pick(a < b, a, b); }
#endif

static inline Lanes root_of(Lanes x)
{
    Lanes root;
    for (int k = 0; k < LANES; k++)
        root[k] = sqrtf(x[k]);
    return root;
}

static inline Lanes read(const float *from)
{
    Lanes x;
    memcpy(&x, from, sizeof x);
    return x;
}

static inline void write(float *to, Lanes x) { memcpy(to, &x, sizeof x); }

static inline int any(Flags which)
{
    int64_t halves[2];
    memcpy(halves, &which, sizeof halves);
    return (halves[0] | halves[1]) != 0;
}

static inline float largest_of(Lanes x)
{
    const float a = x[0] > x[1] ? x[0] : x[1], b = x[2] > x[3] ? x[2] : x[3];
    return a > b ? a : b;
}

static inline double sum_of(Lanes x) { return (double)((x[0] + x[1]) + (x[2] + x[3])); }

/* 2^x for x from -120 to 0, within 3e-7 of it. */
static inline Lanes power_of_2(Lanes x)
{
    const Flags whole = __builtin_convertvector(x, Flags);
    const Lanes part = x - __builtin_convertvector(whole, Lanes);
    return (Lanes)((whole + 127) << 23) * (1 + part * (0.69314217f + part * (0.24017159f + part * (0.05527814f +
                                               part * (0.009186874f + part * 0.0009381165f)))));
}

/* The normal distribution F(t), and its density f: F by formula 26.2.17 of Abramowitz and Stegun, within 1e-7. */
static inline Lanes normal_at(Lanes t, Lanes *density)
{
    const Lanes k = 1 / (1 + 0.2316419f * magnitude(t)), f = 0.39894228f * power_of_2(most_of(-0.72134752f * t * t, all(-120)));
    const Lanes beyond = f * k * (0.31938153f + k * (-0.356563782f + k * (1.781477937f + k * (-1.821255978f +
                                  k * 1.330274429f))));
    *density = f;
    return pick(t > 0, 1 - beyond, beyond);
}

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

#endif
