#include "processor.h"

#if defined(__x86_64__)
#include <cpuid.h>
#include <stdint.h>

/* The registers that the system saves: SSE and AVX; with those of AVX-512, too. */
enum { SAVES_AVX = 0x6, SAVES_AVX512 = 0xe6 };

static int has_all(unsigned found, const int bits[], int n)
{
    for (int k = 0; k < n; k++) {
        if ((found >> bits[k] & 1u) == 0)
            return 0;
    }
    return 1;
}
#define HAS_ALL(found, ...) has_all(found, (const int[]){__VA_ARGS__}, (int)(sizeof((int[]){__VA_ARGS__}) / sizeof(int)))

static uint64_t saved_registers(void)
{
    uint32_t low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (uint64_t)high << 32 | low;
}

int processor_level(void)
{
    unsigned a, b, c, d, b7 = 0, c_extended = 0, unused;
    if (!__get_cpuid(1, &a, &b, &c, &d))
        return 1;
    (void)__get_cpuid_count(7, 0, &unused, &b7, &unused, &unused);
    (void)__get_cpuid(0x80000001u, &unused, &unused, &c_extended, &unused);
    /* SSE3, SSSE3, CMPXCHG16B, SSE4.1, SSE4.2, POPCNT; LAHF */
    if (!(HAS_ALL(c, 0, 9, 13, 19, 20, 23) && HAS_ALL(c_extended, 0)))
        return 1;
    /* FMA, MOVBE, XSAVE enabled by the system, AVX, F16C; LZCNT; BMI1, AVX2, BMI2 */
    if (!(HAS_ALL(c, 12, 22, 27, 28, 29) && HAS_ALL(c_extended, 5) && HAS_ALL(b7, 3, 5, 8)))
        return 2;
    uint64_t saved = saved_registers();
    if ((saved & SAVES_AVX) != SAVES_AVX)
        return 2;
    /* AVX-512 F, DQ, CD, BW, VL */
    return HAS_ALL(b7, 16, 17, 28, 30, 31) && (saved & SAVES_AVX512) == SAVES_AVX512 ? 4 : 3;
}

#else

int processor_level(void) { return 0; }

#endif
