/* Numbers of eight devices, and maxima made smooth by (1 + x / 16)^16 in place of e^x, which is 0
   from -16 on. */
#ifndef EIGHTS_H
#define EIGHTS_H

#include "rewards.h"

enum { EIGHT = 8, SOFT = 16 };

/* They are summed in the same order on every machine, and stored in single precision, which halves
   what is read and written. */
typedef double Eight __attribute__((vector_size(8 * EIGHT)));
typedef int64_t EightBits __attribute__((vector_size(8 * EIGHT)));
typedef float Stored __attribute__((vector_size(4 * EIGHT)));

static inline Eight taken(Stored a) { return __builtin_convertvector(a, Eight); }

static inline Stored stored(Eight a) { return __builtin_convertvector(a, Stored); }

static inline Eight eight(double a) { return a - (Eight){0.0}; }

static inline int any_above(Eight a, double limit)
{
    const EightBits more = (EightBits)(a > limit);
    int64_t any = 0;
    for (int i = 0; i < EIGHT; i++) any |= more[i];
    return any != 0;
}

static inline double sum_of_eight(Eight a)
{
    return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]));
}

static inline Eight absolute(Eight a)
{
    return (Eight)((EightBits)a & (INT64_MAX - (EightBits){0}));
}

static inline Eight with_signs(double size, Eight of)
{
    return (Eight)((EightBits)eight(size) | ((EightBits)of & (INT64_MIN - (EightBits){0})));
}

static inline Eight root_of_eight(Eight a)
{
    for (int i = 0; i < EIGHT; i++) a[i] = sqrt(a[i]);
    return a;
}

/* a where it is above 0 and at most b; else the nearer of these. */
static inline Eight between_zero_and(Eight a, Eight b)
{
    a = (Eight)((EightBits)(a > 0.0) & (EightBits)a);
    const EightBits over = (EightBits)(a > b);
    return (Eight)((over & (EightBits)b) | (~over & (EightBits)a));
}

static inline Eight soft_eight(Eight x)
{
    Eight y = 1.0 + x * (1.0 / SOFT);
    y = (Eight)((EightBits)(y > 0.0) & (EightBits)y);
    y *= y;
    y *= y;
    y *= y;
    return y * y;
}

static inline double soft(double x)
{
    double y = most(0.0, 1.0 + x * (1.0 / SOFT));
    y *= y;
    y *= y;
    y *= y;
    return y * y;
}

#endif
