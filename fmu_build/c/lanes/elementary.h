/* Elementary functions of eight numbers at once, or of one, for the generated kernels. NaN stays NaN; no calls, no branches.

   Errors, measured against long double over the ranges where they are used (tests/fmu_build/test_lanes.py), in units of
   2^-53 = 1.1e-16: sin and cos 1.5 absolute for angles up to LARGEST_ANGLE, NaN beyond; tanh 4 relative for all
   numbers; 1/x and sqrt 2 relative.

   Polynomials: interpolation at Chebyshev nodes in rational arithmetic, rounded once. */
#ifndef ELEMENTARY_H
#define ELEMENTARY_H

#include "vectors.h"

/* for larger angles the number of quarter turns could be wrong */
#define LARGEST_ANGLE 1e6

static inline lanes sq(lanes x) { return x * x; }

/* Adding it leaves the nearest integer in the last bits of the sum. */
#define ROUNDER 0x1.8p52

/* x minus the nearest multiple of a quarter turn, |r| <= pi/4; the multiple is in the last bits */
static inline lanes without_quarters(lanes x, mask *quarters)
{
    lanes sum = x * 0.6366197723675814 + ROUNDER, k = sum - ROUNDER;
    lanes r = x - k * 1.5707963267948966;
    r = r - k * 6.123233995736766e-17;
    r = r - k * -1.4973849048591698e-33;
    *quarters = bits(sum);
    return choose(magnitude(x) <= LARGEST_ANGLE, r, (lanes)NAN);
}

/* sin(r + (number of quarter turns) pi/2) */
static inline lanes wave(lanes r, mask quarters)
{
    lanes z = r * r;
    lanes s = r + r * z * (-0.16666666666666666 + z * (0.008333333333330948 + z * (-0.00019841269836756774 +
                           z * (2.7557316101617874e-06 + z * (-2.505113165023518e-08 + z * 1.5918115263265974e-10)))));
    lanes c = 1 - 0.5 * z + z * z * (0.041666666666666664 + z * (-0.0013888888888887398 + z * (2.480158729876456e-05 +
              z * (-2.7557317271145144e-07 + z * (2.087614614655861e-09 + z * -1.1382623647474604e-11)))));
    lanes w = choose((quarters & 1) != 0, c, s);
    return number(bits(w) ^ shifted(quarters & 2, 62));
}

/* sin(x + quarters_ahead pi/2) */
static inline lanes sine(lanes x, int quarters_ahead)
{
    mask quarters;
    lanes r = without_quarters(x, &quarters);
    return wave(r, quarters + quarters_ahead);
}

/* exp(r) - 1, |r| <= ln(2)/2 */
static inline lanes growth(lanes r)
{
    return r + r * r * (0.5000000000000001 + r * (0.16666666666666669 + r * (0.04166666666662413 +
                   r * (0.008333333333330062 + r * (0.0013888888917213717 + r * (0.00019841269863053618 +
                   r * (2.4801521295954376e-05 + r * (2.7557268459997064e-06 +
                   r * (2.7620088445409746e-07 + r * 2.510038549551032e-08)))))))));
}

/* y = k ln(2) + r, and 2^k */
static inline lanes without_powers(lanes y, lanes *power)
{
    lanes sum = y * 1.4426950408889634 + ROUNDER, k = sum - ROUNDER;
    lanes r = y - k * 0.6931471805599453;
    *power = number(shifted(bits(sum) + 1023, 52));
    return r - k * 2.3190468138462996e-17;
}

/* from -700 to 700; beyond, as there, so that exp(-inf) is 1e-304 */
static inline lanes exponential(lanes x)
{
    lanes y = choose(x < -700, (lanes)-700.0, choose(x > 700, (lanes)700.0, x)), power;
    lanes p = growth(without_powers(y, &power));
    return power + power * p;
}

/* e / (e + 2) with e = exp(2 |x|) - 1 = 2^k (exp(r) - 1) + 2^k - 1, |r| <= ln(2)/2; equals 1 from |x| = 20 on */
static inline lanes hyperbolic_tangent(lanes x)
{
    lanes size = magnitude(x), power;
    lanes p = growth(without_powers(2 * choose(size > 20, (lanes)20.0, size), &power));
    lanes e = power * p + (power - 1);
    lanes t = e * reciprocal(e + 2);
    return number(bits(t) | (bits(x) & INT64_MIN));
}

/* 1 where a mask holds, else 0: the truth values of the generated code */
static inline lanes truth(mask which) { return choose(which, (lanes)1.0, (lanes)0.0); }
static inline lanes is_less(lanes a, lanes b) { return truth(a < b); }
static inline lanes is_at_most(lanes a, lanes b) { return truth(a <= b); }
static inline lanes is_equal(lanes a, lanes b) { return truth(a == b); }
static inline lanes is_other(lanes a, lanes b) { return truth(a != b); }
static inline lanes is_not(lanes a) { return truth(a == 0); }
static inline lanes both(lanes a, lanes b) { return truth((a != 0) & (b != 0)); }
static inline lanes either(lanes a, lanes b) { return truth((a != 0) | (b != 0)); }

/* x where a holds, else 0, whatever x is there */
static inline lanes if_so(lanes a, lanes x) { return choose(a != 0, x, (lanes)0.0); }

/* -1, 0 or 1 */
static inline lanes sign_of(lanes x) { return truth(x > 0) - truth(x < 0); }

/* x minus the nearest multiple of y, of two the even one */
static inline lanes remainder_of(lanes x, lanes y) { return x - nearest(x / y) * y; }

/* the names in the generated code; it may want those of the C library */
#define sign(x) sign_of(x)
#ifndef WITH_C_LIBRARY
#define sqrt(x) square_root(x)
#define sin(x) sine(x, 0)
#define cos(x) sine(x, 1)
#define tanh(x) hyperbolic_tangent(x)
#define exp(x) exponential(x)
#define fabs(x) magnitude(x)
#define fmin(x, y) smaller_of(x, y)
#define fmax(x, y) larger_of(x, y)
#define remainder(x, y) remainder_of(x, y)
#endif

#endif
