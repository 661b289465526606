/* One number of each of some images, side by side in a register.

   Every image of a batch goes through the same network with the same weights, so that a vector of
   one feature of 16 images needs no shuffling anywhere: a weight times such a vector is one
   instruction for every register that it fills. Those are worked on apart, which leaves registers
   for more sums; all operations round the same, however long registers are, and products are fused
   with sums only where `multiply_add` says so. */
#ifndef LANES_H
#define LANES_H

#include <stdint.h>
#include <string.h>

#if defined(__AVX512F__) || defined(__AVX2__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#define INLINE static inline __attribute__((always_inline))

enum { WIDTH = 16 };

/* Of a register, in numbers; that many registers hold the 16. */
#if defined(__AVX512F__)
enum { LENGTH = 16 };
#elif defined(__AVX2__)
enum { LENGTH = 8 };
#else
enum { LENGTH = 4 };
#endif
enum { PARTS = WIDTH / LENGTH };

typedef float Lanes __attribute__((vector_size(4 * LENGTH)));
typedef float Stored __attribute__((vector_size(4 * LENGTH), aligned(4), may_alias));
typedef int32_t Mask __attribute__((vector_size(4 * LENGTH)));

#if !defined(__AVX512F__) && !defined(__AVX2__) && !defined(__aarch64__)
typedef double Wide __attribute__((vector_size(8 * LENGTH)));
typedef int64_t WideMask __attribute__((vector_size(8 * LENGTH)));

/* a b + c of processors that cannot: the product is exact in double precision, and so is what
   the sum loses (Knuth's TwoSum). A sum rounded to odd can be rounded once more without harm
   (Boldo and Melquiond 2008). */
static __attribute__((noinline)) Lanes fused(Lanes a, Lanes b, Lanes c)
{
    Wide p = __builtin_convertvector(a, Wide) * __builtin_convertvector(b, Wide);
    Wide d = __builtin_convertvector(c, Wide);
    Wide sum = p + d, t = sum - p, lost = (p - (sum - t)) + (d - t);
    WideMask bits = (WideMask)sum, even = (bits & 1) - 1;
    WideMask more = (WideMask)(lost > 0.0), less = (WideMask)(lost < 0.0);
    WideMask away = more ^ (WideMask)(sum < 0.0); /* the sum is nearer to 0 than it should be */
    WideMask step = (more | less) & (~away | 1);
    return __builtin_convertvector((Wide)(bits + (even & step)), Lanes);
}
#endif

/* a b + c, rounded once. */
INLINE Lanes multiply_add(Lanes a, Lanes b, Lanes c)
{
#if defined(__AVX512F__)
    return (Lanes)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c);
#elif defined(__AVX2__)
    return (Lanes)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
#elif defined(__aarch64__)
    return (Lanes)vfmaq_f32((float32x4_t)c, (float32x4_t)a, (float32x4_t)b);
#else
    return fused(a, b, c);
#endif
}

INLINE Lanes load(const float *at) { return *(const Stored *)at; }

INLINE void store(float *at, Lanes lanes) { *(Stored *)at = lanes; }

/* One number in all lanes. */
INLINE Lanes splat(float number)
{
    return number - (Lanes){0}; /* not +, which would lose the sign of -0 */
}

INLINE Lanes choose(Mask mask, Lanes yes, Lanes no)
{
    return (Lanes)((mask & (Mask)yes) | (~mask & (Mask)no));
}

/* In each lane, the third where the first is greater than the second, else the fourth. */
INLINE Lanes if_greater(Lanes a, Lanes b, Lanes yes, Lanes no)
{
    return choose((Mask)(a > b), yes, no);
}

/* The same where they are equal. */
INLINE Lanes if_equal(Lanes a, Lanes b, Lanes yes, Lanes no)
{
    return choose((Mask)(a == b), yes, no);
}

/* The sum over 16 lanes, in pairs: lane i and i + 8, then i and i + 4, ... */
INLINE float total(const float *at)
{
    float number[WIDTH / 2];
    for (int i = 0; i < WIDTH / 2; i++) number[i] = at[i] + at[i + WIDTH / 2];
    for (int width = WIDTH / 4; width > 0; width /= 2)
        for (int i = 0; i < width; i++) number[i] += number[i + width];
    return number[0];
}

#endif
