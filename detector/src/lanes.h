/* Four numbers at a time, as processors without extensions have them, in the vectors of gcc and clang. */

#ifndef MARKERGEN_LANES_H
#define MARKERGEN_LANES_H

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { LANES = 4 };
typedef float Lanes __attribute__((vector_size(4 * LANES)));
typedef int32_t Flags __attribute__((vector_size(4 * LANES))); /* -1 or 0 from comparisons */

static inline Lanes all(float x) { return (Lanes){x, x, x, x}; }
static inline Lanes pick(Flags which, Lanes a, Lanes b) { return (Lanes)((which & (Flags)a) | (~which & (Flags)b)); }
static inline Lanes magnitude(Lanes x) { return (Lanes)((Flags)x & INT32_MAX); }
static inline Lanes most_of(Lanes a, Lanes b) { return pick(a > b, a, b); }
static inline Lanes least_of(Lanes a, Lanes b) { return pick(a < b, a, b); }

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

static inline double sum_of(Lanes x) { return (double)((x[0] + x[1]) + (x[2] + x[3])); }

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

#endif
