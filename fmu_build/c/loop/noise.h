/* White noise: NumPy's streams of normal numbers, PCG64 with the ziggurat of `ziggurat.h`.

   A number has NumPy's bits; in the tail, beyond 3.65, where NumPy calls the C library's logarithm, it may differ in the
   last one. */
#ifndef NOISE_H
#define NOISE_H

#include <stdint.h>

#include "elementary.h"
#include "ziggurat.h"

/* A state of 128 bits and its increment, each with the upper half first. */
typedef struct {
    uint64_t high, low, increment_high, increment_low;
} stream;

/* upper half of a product of 64 bits */
static inline uint64_t upper(uint64_t a, uint64_t b)
{
#if WIDTH > 1 && defined(__SIZEOF_INT128__)
    return (uint64_t)((unsigned __int128)a * b >> 64);
#endif
    uint64_t a1 = a >> 32, a0 = a & 0xffffffffu, b1 = b >> 32, b0 = b & 0xffffffffu;
    uint64_t low = a0 * b0, middle = a1 * b0 + (low >> 32), other = a0 * b1 + (middle & 0xffffffffu);
    return a1 * b1 + (middle >> 32) + (other >> 32);
}

static inline uint64_t next_word(stream *s)
{
    uint64_t high = upper(s->low, MULTIPLIER_LOW) + s->high * MULTIPLIER_LOW + s->low * MULTIPLIER_HIGH;
    uint64_t low = s->low * MULTIPLIER_LOW, sum = low + s->increment_low;
    s->high = high + s->increment_high + (sum < low);
    s->low = sum;
    uint64_t mixed = s->high ^ s->low, turn = s->high >> 58;
    return mixed >> turn | mixed << (-turn & 63);
}

/* The mixing of NumPy's SeedSequence (O'Neill, Developing a seed_seq alternative, 2015), 32 bits at a time. */
#define POOL 4

static inline uint32_t hashed(uint32_t x, uint32_t *constant, uint32_t factor)
{
    x ^= *constant;
    *constant *= factor;
    x *= *constant;
    return x ^ x >> 16;
}

static inline uint32_t mixed(uint32_t x, uint32_t y)
{
    uint32_t found = 0xca01f9ddu * x - 0x4973f715u * y;
    return found ^ found >> 16;
}

/* The stream of PCG64 from `n` words of entropy and spawn keys, as SeedSequence assembles them. */
static stream seeded(const uint32_t *entropy, int64_t n)
{
    uint32_t pool[POOL], constant = 0x43b0d7e5u, half[8];
    uint64_t whole[4];
    for (int i = 0; i < POOL; i++)
        pool[i] = hashed(i < n ? entropy[i] : 0, &constant, 0x931e8875u);
    for (int from = 0; from < POOL; from++)
        for (int to = 0; to < POOL; to++)
            if (from != to)
                pool[to] = mixed(pool[to], hashed(pool[from], &constant, 0x931e8875u));
    for (int64_t from = POOL; from < n; from++)
        for (int to = 0; to < POOL; to++)
            pool[to] = mixed(pool[to], hashed(entropy[from], &constant, 0x931e8875u));
    constant = 0x8b51f9ddu;
    for (int i = 0; i < 8; i++)
        half[i] = hashed(pool[i % POOL], &constant, 0x58f38dedu);
    for (int i = 0; i < 4; i++)
        whole[i] = (uint64_t)half[2 * i + 1] << 32 | half[2 * i];
    /* PCG64: from zero one step, plus the first two words, one step; the other two, doubled plus one, are the increment */
    stream s = {0, 0, whole[2] << 1 | whole[3] >> 63, whole[3] << 1 | 1};
    next_word(&s);
    uint64_t low = s.low + whole[1];
    s.high += whole[0] + (low < s.low);
    s.low = low;
    next_word(&s);
    return s;
}

/* from 0 to 1, without 1 */
static inline double next_share(stream *s)
{
    return (double)(next_word(s) >> 11) * 0x1p-53;
}

/* log(1 - u) of a share: 1 - u = 2^k (1 + f) is exact, and log(1 + f) = 2 artanh(s) with s = f / (2 + f), |s| < 0.172 */
static double log_of_rest(double u)
{
    double y = 1 - u;
    int k = 0;
    while (y < 0.70710678118654752) {
        y *= 2;
        k--;
    }
    double f = y - 1, s = f / (2 + f), z = s * s, sum = 0, half = 0.5 * f * f;
    for (int n = 12; n > 0; n--)
        sum = z * (2.0 / (2 * n + 1) + sum);
    /* log(1 + f) = f - (f^2 / 2 - s (f^2 / 2 + sum)) */
    return k * 0x1.62e42feep-1 - ((half - (s * (half + sum) + k * 0x1.a39ef35793c76p-33)) - f);
}

static double exponential_of_one(double x)
{
    lanes y = exponential((lanes)x);
    return LANE(y, 0);
}

/* A standard normal number. */
static double next_normal(stream *s)
{
    for (;;) {
        uint64_t word = next_word(s), k = word >> 9 & 0xfffffffffffffu;
        int layer = (int)(word & 0xff);
        double x = (double)k * WIDTHS[layer];
        x = word >> 8 & 1 ? -x : x;
        if (k < LIMITS[layer])
            return x;
        if (layer) {
            double height = (HEIGHTS[layer - 1] - HEIGHTS[layer]) * next_share(s) + HEIGHTS[layer];
            if (height < exponential_of_one(-0.5 * x * x))
                return x;
            continue;
        }
        for (;;) {
            double beyond = -TAIL_INVERSE * log_of_rest(next_share(s)), y = -log_of_rest(next_share(s));
            if (y + y > beyond * beyond)
                return k >> 8 & 1 ? -(TAIL + beyond) : TAIL + beyond;
        }
    }
}

#endif
