/* Eight members at once, as vectors of clang; or one, with WIDTH 1, as plain C99 that every compiler has.

   A mask is of a comparison: its lowest bit counts, -1 or 1 where true. Both widths execute the same operations in the
   same order; with one member nothing depends on the C library but IEEE's sqrt and fabs. */
#ifndef VECTORS_H
#define VECTORS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

/* what a library of vectors exports */
#if defined(_WIN32)
#define OFFERED __declspec(dllexport)
#else
#define OFFERED __attribute__((visibility("default")))
#endif

#ifndef WIDTH
#define WIDTH 8
#endif

#if WIDTH == 1

typedef double lanes;
typedef int64_t mask;
typedef uint64_t words;
typedef double anywhere;
typedef int64_t mask_anywhere;

/* the number of a member, and whether a mask holds for it */
#define LANE(x, lane) (*(&(x) + (lane)))
#define HOLDS(which, lane) (((which) >> (lane)) & 1)

static inline mask bits(lanes x)
{
    mask pattern;
    memcpy(&pattern, &x, sizeof pattern);
    return pattern;
}

static inline lanes number(mask x)
{
    lanes value;
    memcpy(&value, &x, sizeof value);
    return value;
}

static inline int any(mask which) { return which & 1; }
static inline lanes choose(mask which, lanes yes, lanes no) { return which & 1 ? yes : no; }
static inline mask shifted(mask x, int by) { return (mask)((uint64_t)x << by); }
static inline lanes magnitude(lanes x) { return fabs(x); }
static inline lanes reciprocal(lanes x) { return 1 / x; }
static inline lanes square_root(lanes x) { return sqrt(x); }
static inline lanes rounded_square_root(lanes x) { return sqrt(x); }

/* of two the even one; larger numbers are whole, and NaN stays */
static inline lanes nearest(lanes x) { return fabs(x) < 0x1p51 ? (x + 0x1.8p52) - 0x1.8p52 : x; }
static inline lanes from_whole(mask x) { return (lanes)x; }
static inline mask to_whole(lanes x) { return (mask)x; }

#else

#ifdef __AVX512F__
#include <immintrin.h>
#endif

typedef double lanes __attribute__((ext_vector_type(WIDTH)));
/* its integers are long or long long, by the system */
typedef __typeof__((lanes)0.0 == (lanes)0.0) mask;
typedef __typeof__(((mask)0)[0]) whole;
typedef double anywhere __attribute__((ext_vector_type(WIDTH), aligned(8)));
typedef whole mask_anywhere __attribute__((ext_vector_type(WIDTH), aligned(8)));
typedef uint64_t words __attribute__((ext_vector_type(WIDTH)));

#define LANE(x, lane) (x)[lane]
#define HOLDS(which, lane) (which)[lane]

static inline mask bits(lanes x) { return __builtin_bit_cast(mask, x); }
static inline lanes number(mask x) { return __builtin_bit_cast(lanes, x); }
static inline int any(mask which) { return __builtin_reduce_or(which) != 0; }

static inline lanes choose(mask which, lanes yes, lanes no)
{
    return number((which & bits(yes)) | (~which & bits(no)));
}

static inline mask shifted(mask x, int by) { return x << by; }
static inline lanes magnitude(lanes x) { return __builtin_elementwise_abs(x); }

#ifdef __AVX512F__
/* an estimate of 14 bits and two Newton iterations; a division takes four times as long */
static inline lanes reciprocal(lanes x)
{
    lanes r = (lanes)_mm512_rcp14_pd((__m512d)x);
    r = r + r * (1 - x * r);
    return r + r * (1 - x * r);
}

/* 0 is returned unchanged, since its estimate is infinite */
static inline lanes square_root(lanes x)
{
    lanes r = (lanes)_mm512_rsqrt14_pd((__m512d)x);
    lanes s = x * r, half = 0.5 * r;
    lanes e = 0.5 - s * half;
    s = s + s * e;
    half = half + half * e;
    s = s + half * (x - s * s);
    return choose(x == 0, x, s);
}
#else
static inline lanes reciprocal(lanes x) { return 1 / x; }
static inline lanes square_root(lanes x) { return __builtin_elementwise_sqrt(x); }
#endif

/* as IEEE rounds it, at the price of a division */
static inline lanes rounded_square_root(lanes x) { return __builtin_elementwise_sqrt(x); }

/* of two the even one */
static inline lanes nearest(lanes x) { return __builtin_elementwise_roundeven(x); }
static inline lanes from_whole(mask x) { return __builtin_convertvector(x, lanes); }
static inline mask to_whole(lanes x) { return __builtin_convertvector(x, mask); }

#endif

static inline lanes smaller_of(lanes a, lanes b) { return choose(a < b, a, b); }
static inline lanes larger_of(lanes a, lanes b) { return choose(a > b, a, b); }
static inline lanes get(const double *from) { return *(const anywhere *)from; }
static inline void put(double *to, lanes x) { *(anywhere *)to = x; }

#endif
