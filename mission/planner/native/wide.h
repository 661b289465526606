/* As many numbers at a time as registers hold: what comes out is the same for any number of them.
   Rows that are read so are filled up to a multiple. */
#ifndef WIDE_H
#define WIDE_H

#include <stdint.h>

#if defined(__AVX512F__)
enum { LENGTH = 8 };
#define LANE_NUMBERS {0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0}
#elif defined(__AVX2__)
enum { LENGTH = 4 };
#define LANE_NUMBERS {0.0, 1.0, 2.0, 3.0}
#else
enum { LENGTH = 2 };
#define LANE_NUMBERS {0.0, 1.0}
#endif

typedef double Wide __attribute__((vector_size(8 * LENGTH)));
typedef int64_t Mask __attribute__((vector_size(8 * LENGTH)));

static inline int64_t wides(int64_t count) { return (count + LENGTH - 1) / LENGTH; }

static inline Wide all_of(double number) { return number - (Wide){0.0}; }

static inline Wide choose(Mask mask, Wide yes, Wide no)
{
    return (Wide)((mask & (Mask)yes) | (~mask & (Mask)no));
}

/* The least of what has been offered, and the first index of it. */
typedef struct {
    Wide value, index, here;
} Least;

static inline Least begin_least(double value)
{
    return (Least){all_of(value), all_of(-1.0), LANE_NUMBERS};
}

/* Offer the next numbers, where the mask is set. */
static inline void offer_wide(Least *all, Wide values, Mask mask)
{
    const Mask less = (Mask)(values < all->value) & mask;
    all->value = choose(less, values, all->value);
    all->index = choose(less, all->here, all->index);
    all->here += (double)LENGTH;
}

/* The index, -1 where nothing was under the value at the beginning, and the value. */
static inline int64_t end_least(const Least *all, double *value)
{
    double index = all->index[0];
    *value = all->value[0];
    for (int i = 1; i < LENGTH; i++)
        if (all->value[i] < *value || (all->value[i] == *value && all->index[i] < index)) {
            *value = all->value[i];
            index = all->index[i];
        }
    return (int64_t)index;
}

#endif
