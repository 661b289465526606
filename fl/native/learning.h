/* What Python and the library hand each other; Python reads it here (`native.headers`). */
#ifndef LEARNING_H
#define LEARNING_H

#include "channel.h"
#include "city.h"
#include <stdint.h>

enum { MOST_BLOCKS = 8, MOST_LAYERS = 8 };

/* (Convolution, 2x2 max-pooling, ReLU) blocks, then dense layers with ReLU between. Parameters lie
   in one flat vector: weights (out, in, row, column) or (out, in), then biases, layer by layer. */
typedef struct {
    int64_t height, width, channels; /* of the images */
    int64_t blocks;
    int64_t maps[MOST_BLOCKS];    /* channels after each block */
    int64_t kernel[MOST_BLOCKS];  /* 3 or 5 */
    int64_t padding[MOST_BLOCKS]; /* less than the kernel */
    int64_t layers;
    int64_t outputs[MOST_LAYERS]; /* the classes last */
} Network;

/* Images (count, height, width, channels), and pixels to numbers by channel: scale x + shift. */
typedef struct {
    int64_t count;
    const uint8_t *bytes; /* the pixels, or NULL */
    const float *floats;  /* the pixels where they are no bytes */
    const int64_t *labels;
    const float *scale, *shift;
} Images;

typedef struct {
    float learning_rate, momentum, mu; /* mu / 2 |w - w_global|^2 is added to the loss */
} Rates;

/* The same functions for every kind of processor; 0, or -1 where memory is short. */
typedef struct {
    /* Steps of SGD from the global `model` (P,), with the batches of `order` (steps, batch): -1
       behind the last image of a smaller one. `correction` (P,), or NULL, is added to every
       gradient. Writes the `weights` (P,) and the mean cross-entropy over the steps. */
    int (*train)(const Network *, const Images *, const int64_t *order, int64_t steps,
                 int64_t batch, const float *model, const float *correction, const Rates *,
                 float *weights, double *loss);
    /* Add to `correct` (classes,) how many images of each class the weights get right. */
    int (*count_correct)(const Network *, const Images *, const float *weights, int64_t *correct);
    /* The average packet error rate (count,) at horizontal distances and heights. */
    int (*average_per)(const Channel *, int64_t count, const double *distance, const double *height,
                       double *per);
    /* The `Path` (count,) from senders, by their numbers, to places (count, 3). */
    int (*gains)(const City *, int64_t count, const int64_t *sender, const double (*places)[3],
                 double *gain, double *deviation, uint8_t *seen, uint8_t *indoors);
    /* The share (count,) of the normal distribution under each value. */
    int (*normal_shares)(int64_t count, const double *value, double *share);
} Learning;

#endif
