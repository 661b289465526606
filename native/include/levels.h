/* Which of the levels that a library is compiled for this processor can run: 0 baseline, 1 AVX2
   with FMA, 2 AVX-512 (on x86-64; elsewhere there is one). And the table of functions of each. */
#ifndef LEVELS_H
#define LEVELS_H

#include "exported.h"
#include <stdint.h>

#if defined(__x86_64__)
#include <cpuid.h>

/* The vector registers that the operating system saves. */
static uint64_t saved_registers(void)
{
    uint32_t low, high;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (uint64_t)high << 32 | low;
}

EXPORTED int best_level(void)
{
    uint32_t a, b, c, d;
    const uint32_t xsave = 1u << 27, avx = 1u << 28, fma = 1u << 12;
    const uint32_t avx2 = 1u << 5, avx512 = 1u << 16 | 1u << 17 | 1u << 30 | 1u << 31; /* F DQ BW VL */
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & (xsave | avx | fma)) != (xsave | avx | fma)) return 0;
    if ((saved_registers() & 0x06) != 0x06) return 0;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & avx2)) return 0;
    return (b & avx512) == avx512 && (saved_registers() & 0xe6) == 0xe6 ? 2 : 1;
}

#define HANDED_OUT(Table, name) \
    extern const Table name##_baseline, name##_avx2, name##_avx512; \
    EXPORTED const Table *at_level(int level) \
    { \
        static const Table *const LEVELS[] = {&name##_baseline, &name##_avx2, &name##_avx512}; \
        return LEVELS[level]; \
    }
#else
EXPORTED int best_level(void) { return 0; }

#define HANDED_OUT(Table, name) \
    extern const Table name##_baseline; \
    EXPORTED const Table *at_level(int level) { return level ? 0 : &name##_baseline; }
#endif

#endif
