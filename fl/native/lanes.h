/* One number of each of 16 images, side by side.

   Every image of a batch goes through the same network with the same weights, so that a vector of
   one feature of 16 images needs no shuffling anywhere: a weight times such a vector is one
   instruction. Vectors are as long as the processor's registers; all operations round the same,
   whatever their length, and products are fused with sums only where `multiply_add` says so. */
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

/* Of a register, in numbers. A vector of 16 is one to four of them, named one by one: compilers
   keep an array of them in memory. */
#if defined(__AVX512F__)
enum { LENGTH = 16 };
#define EACH_PART(OF) OF(p0)
#elif defined(__AVX2__)
enum { LENGTH = 8 };
#define EACH_PART(OF) OF(p0) OF(p1)
#else
enum { LENGTH = 4 };
#define EACH_PART(OF) OF(p0) OF(p1) OF(p2) OF(p3)
#endif

typedef float Part __attribute__((vector_size(4 * LENGTH)));
typedef float Stored __attribute__((vector_size(4 * LENGTH), aligned(4), may_alias));
typedef int32_t Mask __attribute__((vector_size(4 * LENGTH)));

typedef struct {
#define DECLARE(p) Part p;
    EACH_PART(DECLARE)
#undef DECLARE
} Lanes;

#if !defined(__AVX512F__) && !defined(__AVX2__) && !defined(__aarch64__)
typedef double Wide __attribute__((vector_size(8 * LENGTH)));
typedef int64_t WideMask __attribute__((vector_size(8 * LENGTH)));

/* a b + c of processors that cannot: the product is exact in double precision, and so is what
   the sum loses (Knuth's TwoSum). A sum rounded to odd can be rounded once more without harm
   (Boldo and Melquiond 2008). */
static __attribute__((noinline)) Part fused(Part a, Part b, Part c)
{
    Wide p = __builtin_convertvector(a, Wide) * __builtin_convertvector(b, Wide);
    Wide d = __builtin_convertvector(c, Wide);
    Wide sum = p + d, t = sum - p, lost = (p - (sum - t)) + (d - t);
    WideMask bits = (WideMask)sum, even = (bits & 1) - 1;
    WideMask more = (WideMask)(lost > 0.0), less = (WideMask)(lost < 0.0);
    WideMask away = more ^ (WideMask)(sum < 0.0); /* the sum is nearer to 0 than it should be */
    WideMask step = (more | less) & (~away | 1);
    return __builtin_convertvector((Wide)(bits + (even & step)), Part);
}
#endif

INLINE Part fused_part(Part a, Part b, Part c)
{
#if defined(__AVX512F__)
    return (Part)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c);
#elif defined(__AVX2__)
    return (Part)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
#elif defined(__aarch64__)
    return (Part)vfmaq_f32((float32x4_t)c, (float32x4_t)a, (float32x4_t)b);
#else
    return fused(a, b, c);
#endif
}

INLINE Lanes load(const float *at)
{
    Lanes lanes;
    const Stored *from = (const Stored *)at;
#define LOAD(p) lanes.p = *from++;
    EACH_PART(LOAD)
    return lanes;
}

INLINE void store(float *at, Lanes lanes)
{
    Stored *to = (Stored *)at;
#define STORE(p) *to++ = lanes.p;
    EACH_PART(STORE)
}

/* One number in all lanes. */
INLINE Lanes splat(float number)
{
    Lanes lanes;
#define SPLAT(p) lanes.p = number - (Part){0}; /* not +, which would lose the sign of -0 */
    EACH_PART(SPLAT)
    return lanes;
}

/* a b + c, rounded once. */
INLINE Lanes multiply_add(Lanes a, Lanes b, Lanes c)
{
#define MULTIPLY_ADD(p) c.p = fused_part(a.p, b.p, c.p);
    EACH_PART(MULTIPLY_ADD)
    return c;
}

INLINE Lanes add(Lanes a, Lanes b)
{
#define ADD_PART(p) a.p += b.p;
    EACH_PART(ADD_PART)
    return a;
}

INLINE Lanes subtract(Lanes a, Lanes b)
{
#define SUBTRACT(p) a.p -= b.p;
    EACH_PART(SUBTRACT)
    return a;
}

INLINE Part choose(Mask mask, Part yes, Part no)
{
    return (Part)((mask & (Mask)yes) | (~mask & (Mask)no));
}

/* In each lane, the third where the first is greater than the second, else the fourth. */
INLINE Lanes if_greater(Lanes a, Lanes b, Lanes yes, Lanes no)
{
#define GREATER(p) a.p = choose((Mask)(a.p > b.p), yes.p, no.p);
    EACH_PART(GREATER)
    return a;
}

/* The same where they are equal. */
INLINE Lanes if_equal(Lanes a, Lanes b, Lanes yes, Lanes no)
{
#define EQUAL(p) a.p = choose((Mask)(a.p == b.p), yes.p, no.p);
    EACH_PART(EQUAL)
    return a;
}

/* The sum over the lanes, in pairs: lane i and i + 8, then i and i + 4, ... */
INLINE float total(Lanes lanes)
{
    float number[WIDTH];
    store(number, lanes);
    for (int width = WIDTH / 2; width > 0; width /= 2)
        for (int i = 0; i < width; i++) number[i] += number[i + width];
    return number[0];
}

#endif
