/* What the processor and the system can do: the level of x86-64 [x86-64 psABI, 3.1.1] that they support, 1 to 4; 0 on
   other processors. */
#define WIDTH 1
#include "vectors.h"

#if defined(__x86_64__)
#include <cpuid.h>

/* The registers that the system saves: SSE and AVX; with those of AVX-512, too. */
enum { SAVES_AVX = 0x6, SAVES_AVX512 = 0xe6 };

#define BIT(k) (1u << (k))

static int has_all(uint64_t bits, uint64_t needed) { return (bits & needed) == needed; }

static uint64_t saved_registers(void)
{
    uint32_t low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (uint64_t)high << 32 | low;
}

OFFERED int processor_level(void)
{
    unsigned a, b, c, d, b7 = 0, c_extended = 0, unused;
    if (!__get_cpuid(1, &a, &b, &c, &d))
        return 1;
    (void)__get_cpuid_count(7, 0, &unused, &b7, &unused, &unused);
    (void)__get_cpuid(0x80000001u, &unused, &unused, &c_extended, &unused);
    /* SSE3, SSSE3, CMPXCHG16B, SSE4.1, SSE4.2, POPCNT; LAHF */
    if (!has_all(c, BIT(0) | BIT(9) | BIT(13) | BIT(19) | BIT(20) | BIT(23)) || !has_all(c_extended, BIT(0)))
        return 1;
    /* FMA, MOVBE, XSAVE enabled by the system, AVX, F16C; LZCNT; BMI1, AVX2, BMI2 */
    if (!has_all(c, BIT(12) | BIT(22) | BIT(27) | BIT(28) | BIT(29)) || !has_all(c_extended, BIT(5)) ||
        !has_all(b7, BIT(3) | BIT(5) | BIT(8)) || !has_all(saved_registers(), SAVES_AVX))
        return 2;
    /* AVX-512 F, DQ, CD, BW, VL */
    int is_wide = has_all(b7, BIT(16) | BIT(17) | BIT(28) | BIT(30) | BIT(31)) && has_all(saved_registers(), SAVES_AVX512);
    return is_wide ? 4 : 3;
}

#else

OFFERED int processor_level(void) { return 0; }

#endif
