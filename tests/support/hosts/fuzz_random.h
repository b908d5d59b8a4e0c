/* Reproducible random numbers, mild and hostile (Marsaglia, "Xorshift RNGs", 2003; output scrambled by a product). */
#ifndef FUZZ_RANDOM_H
#define FUZZ_RANDOM_H

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>

extern uint64_t random_state; /* never 0 */

static inline uint64_t random_bits(void)
{
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return random_state * UINT64_C(2685821657736338717);
}

static inline void seed_random(uint64_t seed, uint64_t sequence)
{
    random_state = (seed * UINT64_C(0x9E3779B97F4A7C15)) ^ (sequence * UINT64_C(0xD1B54A32D192ED03)) ^ 1;
    if (random_state == 0)
        random_state = 1;
    for (int k = 0; k < 8; k++) /* neighbours have nothing in common */
        random_bits();
}

/* 0 to n - 1 */
static inline size_t below(size_t n)
{
    return (size_t)((random_bits() >> 11) % n);
}

/* 0 to 1 */
static inline double fraction(void)
{
    return (double)(random_bits() >> 11) * 0x1p-53;
}

static inline int chance(double probability)
{
    return fraction() < probability;
}

static inline double between(double a, double b)
{
    return a + (b - a) * fraction();
}

static inline double hostile_number(void)
{
    static const double numbers[] = {NAN,     INFINITY, -INFINITY, 1e308,  -1e308,   DBL_MAX, 1e30,    -1e30,  1.1e30,
                                     1e-300,  -0.0,     0.0,       5e-324, -5e-324,  1e-308,  DBL_MIN, 1e15,   -1e15};
    return numbers[below(sizeof numbers / sizeof numbers[0])];
}

/* Any size that a machine, or a mistake in units, might have. */
static inline double number_of_any_size(void)
{
    return (chance(0.5) ? -1 : 1) * pow(10, between(-12, 12));
}

#endif
