/* Convolutions over 16 images at once, forward with pooling and ReLU, and backward.

   Maps are (channel, row, column, lane), weights (out, in, row, column). A few output channels and
   2x2 places at a time: their sums stay in registers, each number read serves several of them.
   Kernels are 3 or 5 wide; each width is compiled by itself, so that its loop is unrolled. */
#ifndef CONVOLUTION_H
#define CONVOLUTION_H

#include "lanes.h"

typedef struct {
    float *at;
    int64_t channels, height, width;
} Maps;

INLINE float *place(const Maps *maps, int64_t channel, int64_t y, int64_t x)
{
    return maps->at + ((channel * maps->height + y) * maps->width + x) * WIDTH;
}

/* Output channels at a time: as many sums as registers hold. */
enum { GROUP = LENGTH == 16 ? 4 : 1, PLACES = 4 };

/* Calls OF(size, o) for channels o, o + 1, ... in groups as large as can be. */
#define IN_GROUPS(channels, OF)                                            \
    do {                                                                   \
        int64_t o = 0;                                                     \
        for (; o + GROUP <= (channels); o += GROUP) OF(GROUP, o);          \
        for (; GROUP > 2 && o + 2 <= (channels); o += 2) OF(2, o);         \
        for (; o < (channels); o++) OF(1, o);                              \
    } while (0)

typedef struct {
    Lanes sum[GROUP][PLACES];
} Tile;

/* `count` channels of the convolution at (y, x), (y, x+1), (y+1, x), (y+1, x+1); `weights` are
   those of the first of them. */
INLINE Tile tile(int kernel, int count, const Maps *maps, const float *weights, int64_t y, int64_t x)
{
    const int64_t size = kernel * kernel, stride = maps->channels * size;
    Tile tile;
#pragma GCC unroll 4
    for (int n = 0; n < count; n++)
#pragma GCC unroll 4
        for (int q = 0; q < PLACES; q++) tile.sum[n][q] = splat(0.0f);
    for (int64_t c = 0; c < maps->channels; c++) {
        for (int i = 0; i < kernel; i++) {
            const float *upper = place(maps, c, y + i, x), *lower = upper + maps->width * WIDTH;
            const float *row = weights + c * size + i * kernel;
#pragma GCC unroll 8
            for (int j = 0; j < kernel; j++) {
                Lanes v0 = load(upper + j * WIDTH), v1 = load(upper + (j + 1) * WIDTH);
                Lanes v2 = load(lower + j * WIDTH), v3 = load(lower + (j + 1) * WIDTH);
#pragma GCC unroll 4
                for (int n = 0; n < count; n++) {
                    Lanes w = splat(row[n * stride + j]);
                    tile.sum[n][0] = multiply_add(w, v0, tile.sum[n][0]);
                    tile.sum[n][1] = multiply_add(w, v1, tile.sum[n][1]);
                    tile.sum[n][2] = multiply_add(w, v2, tile.sum[n][2]);
                    tile.sum[n][3] = multiply_add(w, v3, tile.sum[n][3]);
                }
            }
        }
    }
    return tile;
}

static const float DEAD = -1.0f; /* in place of a winner: ReLU lets nothing through */

/* ReLU of the largest plus bias, and which of the four it is (the first of equals). */
INLINE void pool(const Lanes *sums, float bias, float *out, float *winner)
{
    const Lanes zero = splat(0.0f);
    Lanes best = sums[0], which = zero;
#pragma GCC unroll 4
    for (int q = 1; q < PLACES; q++) {
        which = if_greater(sums[q], best, splat((float)q), which);
        best = if_greater(sums[q], best, sums[q], best);
    }
    best = add(best, splat(bias));
    store(winner, if_greater(best, zero, which, splat(DEAD)));
    store(out, if_greater(best, zero, best, zero));
}

INLINE void forward_group(
    int kernel, int count, const Maps *maps, const float *weights, const float *bias, int64_t o,
    int64_t border, const Maps *out, const Maps *winner, int64_t y, int64_t x)
{
    Tile sums = tile(
        kernel, count, maps, weights + o * maps->channels * kernel * kernel, 2 * y, 2 * x);
#pragma GCC unroll 4
    for (int n = 0; n < count; n++)
        pool(sums.sum[n], bias[o + n], place(out, o + n, y + border, x + border),
             place(winner, o + n, y, x));
}

INLINE void forward_of_width(
    int kernel, const Maps *maps, const float *weights, const float *bias, int64_t border,
    const Maps *out, const Maps *winner)
{
#define FORWARD(count, o) \
    forward_group(kernel, count, maps, weights, bias, o, border, out, winner, y, x)
    for (int64_t y = 0; y < winner->height; y++)
        for (int64_t x = 0; x < winner->width; x++) IN_GROUPS(winner->channels, FORWARD);
#undef FORWARD
}

/* Convolution, 2x2 max-pooling, bias and ReLU; `out` has a border, `winner` none. */
static void convolve(
    int kernel, const Maps *maps, const float *weights, const float *bias, int64_t border,
    const Maps *out, const Maps *winner)
{
    if (kernel == 3)
        forward_of_width(3, maps, weights, bias, border, out, winner);
    else
        forward_of_width(5, maps, weights, bias, border, out, winner);
}

/* The gradients of the loss behind pooling and ReLU, back at the places before; adds the bias'.
   `gradient` may be wider and higher than `winner`. */
static void unpool(
    const Maps *gradient, const Maps *winner, int64_t border, const Maps *out, float *bias_gradient)
{
    const Lanes zero = splat(0.0f);
    for (int64_t o = 0; o < winner->channels; o++) {
        Lanes here = zero;
        for (int64_t y = 0; y < winner->height; y++)
            for (int64_t x = 0; x < winner->width; x++) {
                Lanes which = load(place(winner, o, y, x));
                Lanes value = if_equal(which, splat(DEAD), zero, load(place(gradient, o, y, x)));
                here = add(value, here);
                for (int q = 0; q < PLACES; q++)
                    store(
                        place(out, o, 2 * y + q / 2 + border, 2 * x + q % 2 + border),
                        if_equal(which, splat((float)q), value, zero));
            }
        bias_gradient[o] += total(here);
    }
}

INLINE void weight_gradients_of_group(
    int kernel, int count, const Maps *maps, const Maps *gradient, int64_t border, int64_t height,
    int64_t width, int64_t o, float *out)
{
    for (int64_t c = 0; c < maps->channels; c++)
        for (int i = 0; i < kernel; i++) {
            Lanes sum[GROUP][5];
#pragma GCC unroll 4
            for (int n = 0; n < count; n++)
#pragma GCC unroll 8
                for (int j = 0; j < kernel; j++) sum[n][j] = splat(0.0f);
            for (int64_t y = 0; y < height; y++) {
                const float *map = place(maps, c, y + i, 0);
                const float *down = place(gradient, o, y + border, border);
                const int64_t plane = gradient->height * gradient->width * WIDTH;
                for (int64_t x = 0; x < width; x++, map += WIDTH, down += WIDTH) {
#pragma GCC unroll 4
                    for (int n = 0; n < count; n++) {
                        Lanes s = load(down + n * plane);
#pragma GCC unroll 8
                        for (int j = 0; j < kernel; j++)
                            sum[n][j] = multiply_add(s, load(map + j * WIDTH), sum[n][j]);
                    }
                }
            }
#pragma GCC unroll 4
            for (int n = 0; n < count; n++)
#pragma GCC unroll 8
                for (int j = 0; j < kernel; j++)
                    out[(((o + n) * maps->channels + c) * kernel + i) * kernel + j] +=
                        total(sum[n][j]);
        }
}

INLINE void weight_gradients_of_width(
    int kernel, const Maps *maps, const Maps *gradient, int64_t border, int64_t height,
    int64_t width, float *out)
{
#define ADD(count, o) \
    weight_gradients_of_group(kernel, count, maps, gradient, border, height, width, o, out)
    IN_GROUPS(gradient->channels, ADD);
#undef ADD
}

/* Add the gradients of the weights, given those of the convolution's (height, width) output. */
static void add_kernel_gradients(
    int kernel, const Maps *maps, const Maps *gradient, int64_t border, int64_t height,
    int64_t width, float *out)
{
    if (kernel == 3)
        weight_gradients_of_width(3, maps, gradient, border, height, width, out);
    else
        weight_gradients_of_width(5, maps, gradient, border, height, width, out);
}

/* (out, in, i, j) to (in, out, last - i, last - j): what carries gradients back to the inputs. */
static void turn(int64_t kernel, int64_t outputs, int64_t inputs, const float *weights, float *out)
{
    const int64_t size = kernel * kernel;
    for (int64_t o = 0; o < outputs; o++)
        for (int64_t c = 0; c < inputs; c++)
            for (int64_t i = 0; i < size; i++)
                out[(c * outputs + o) * size + size - 1 - i] = weights[(o * inputs + c) * size + i];
}

INLINE void correlate_group(
    int kernel, int count, const Maps *maps, const float *weights, int64_t o, const Maps *out,
    int64_t y, int64_t x)
{
    Tile sums = tile(kernel, count, maps, weights + o * maps->channels * kernel * kernel, y, x);
#pragma GCC unroll 4
    for (int n = 0; n < count; n++)
#pragma GCC unroll 4
        for (int q = 0; q < PLACES; q++)
            store(place(out, o + n, y + q / 2, x + q % 2), sums.sum[n][q]);
}

INLINE void correlate_of_width(int kernel, const Maps *maps, const float *weights, const Maps *out)
{
#define CORRELATE(count, o) correlate_group(kernel, count, maps, weights, o, out, y, x)
    for (int64_t y = 0; y < out->height; y += 2)
        for (int64_t x = 0; x < out->width; x += 2) IN_GROUPS(out->channels, CORRELATE);
#undef CORRELATE
}

/* The bare convolution; rows and columns of `out` are even in number. */
static void correlate(int kernel, const Maps *maps, const float *weights, const Maps *out)
{
    if (kernel == 3)
        correlate_of_width(3, maps, weights, out);
    else
        correlate_of_width(5, maps, weights, out);
}

#endif
