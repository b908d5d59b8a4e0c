/* White noise: a standard normal number for each stream, reading and element, in any order and without a state.

   Words: Philox4x32 of ten rounds (Salmon, Moraes, Dror, Shaw, Parallel random numbers: as easy as 1, 2, 3, SC11, 2011).
   The 128 bits of a stream are its key and the upper half of its counter; the lower half is the reading and the block of
   four elements. Normal numbers: the inverse of their distribution by Wichura's rational functions (algorithm AS 241,
   PPND7, Appl. Stat. 37(3), 1988), with a relative error of 1e-7; of a word of 32 bits the largest is 6.34.

   Nothing but +, -, *, / and IEEE's sqrt, so that every build has the same bits. */
#ifndef NOISE_H
#define NOISE_H

#include "vectors.h"

/* elements in a block */
#define IN_BLOCK 4
#define LOW_WORD UINT64_C(0xffffffff)

/* Four words of 32 bits, in numbers of 64, of a counter. */
static inline void philox(const words key[2], words x[IN_BLOCK])
{
    words first = key[0], second = key[1];
    for (int round = 0; round < 10; round++) {
        words p = x[0] * UINT64_C(0xd2511f53), q = x[2] * UINT64_C(0xcd9e8d57);
        x[0] = (q >> 32) ^ x[1] ^ first;
        x[1] = q & LOW_WORD;
        x[2] = (p >> 32) ^ x[3] ^ second;
        x[3] = p & LOW_WORD;
        first = (first + UINT64_C(0x9e3779b9)) & LOW_WORD;
        second = (second + UINT64_C(0xbb67ae85)) & LOW_WORD;
    }
}

/* ln(p) of normal p > 0 to 1e-10: p = 2^k m with sqrt(1/2) <= m < sqrt(2), ln(m) = 2 artanh(s), s = (m - 1) / (m + 1) */
static inline lanes logarithm(lanes p)
{
    mask k = (bits(p) - INT64_C(0x3fe6a09e667f3bcd)) >> 52;
    lanes m = number(bits(p) - shifted(k, 52)), power = number(bits((lanes)0x1.8p52) + k) - 0x1.8p52;
    lanes s = (m - 1) / (m + 1), z = s * s;
    lanes series = 1 + z * (0x1.5555555555555p-2 + z * (0.2 + z * (0x1.2492492492492p-3 + z * (0x1.c71c71c71c71cp-4 + z * 0x1.745d1745d1746p-4))));
    return power * 0.6931471805599453 + 2 * s * series;
}

/* The standard normal number x with the probability p = (word + 1/2) / 2^32 below it. */
static inline lanes normal_of(words word)
{
    /* the word as the last bits of a number of 2^52 */
    lanes p = (number((mask)(word | UINT64_C(0x4330000000000000))) - 0x1.fffffffffffffp51) * 0x1p-32;
    lanes q = p - 0.5, r = 0.180625 - q * q;
    lanes centre = q * (((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179) /
                   (((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1);
    lanes t = rounded_square_root(-logarithm(choose(q < 0, p, 1 - p))) - 1.6;
    lanes tail = (((0.17023821103 * t + 1.3067284816) * t + 2.7568153900) * t + 1.4234372777) /
                 ((0.12021132975 * t + 0.73700164250) * t + 1);
    return choose(magnitude(q) <= 0.425, centre, choose(q < 0, -tail, tail));
}

/* Elements `first` to before `first + n` of a reading, of the streams (4) of the members of a vector. */
static void normals(const words stream[4], int64_t reading, int64_t first, int64_t n, lanes x[])
{
    words block[IN_BLOCK];
    for (int64_t i = 0; i < n; i++) {
        uint64_t element = (uint64_t)(first + i), k = (uint64_t)reading;
        if (i == 0 || element % IN_BLOCK == 0) {
            block[0] = (words)(k & LOW_WORD);
            block[1] = (words)((k >> 32 << 16 | element / IN_BLOCK) & LOW_WORD);
            block[2] = stream[2];
            block[3] = stream[3];
            philox(stream, block);
        }
        x[i] = normal_of(block[element % IN_BLOCK]);
    }
}

#endif
