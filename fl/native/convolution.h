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

/* Output channels at a time, as many sums as registers hold: with four places each, and with the
   places of a kernel's row. OF_COUNTS calls OF for every number of channels that there can be. */
enum { PLACES = 4 };
#if defined(__AVX512F__) || defined(__aarch64__)
enum { GROUP = 4, ROW_GROUP = 4 };
#define OF_COUNTS(OF, kernel) OF(kernel, 1) OF(kernel, 2) OF(kernel, 3) OF(kernel, 4)
#else
enum { GROUP = 3, ROW_GROUP = 2 };
#define OF_COUNTS(OF, kernel) OF(kernel, 1) OF(kernel, 2) OF(kernel, 3)
#endif

/* How many of the channels that are left come next: as many as can be, but one is not left alone. */
static int64_t group(int64_t left, int64_t most)
{
    return left == most + 1 ? most - 1 : left < most ? left : most;
}

typedef struct {
    Lanes sum[GROUP][PLACES];
} Tile;

INLINE void tile_of(
    int kernel, int count, const Maps *maps, const float *weights, const float *at, Tile *out)
{
    const int64_t stride = maps->channels * kernel * kernel, row = maps->width * WIDTH;
    Lanes sum[GROUP][PLACES];
#pragma GCC unroll 4
    for (int n = 0; n < count; n++)
#pragma GCC unroll 4
        for (int q = 0; q < PLACES; q++) sum[n][q] = splat(0.0f);
    for (int64_t c = 0; c < maps->channels; c++, at += (maps->height - kernel) * row)
        for (int i = 0; i < kernel; i++, at += row, weights += kernel)
#pragma GCC unroll 8
            for (int j = 0; j < kernel; j++) {
                Lanes w[GROUP];
#pragma GCC unroll 4
                for (int n = 0; n < count; n++) w[n] = splat(weights[n * stride + j]);
#pragma GCC unroll 4
                for (int q = 0; q < PLACES; q++) {
                    Lanes v = load(at + q / 2 * row + (j + q % 2) * WIDTH);
#pragma GCC unroll 4
                    for (int n = 0; n < count; n++) sum[n][q] = multiply_add(w[n], v, sum[n][q]);
                }
                /* Or compilers keep what the next place reads again, and put sums into memory. */
                __asm__ volatile("" : "+r"(at));
            }
#pragma GCC unroll 4
    for (int n = 0; n < count; n++)
#pragma GCC unroll 4
        for (int q = 0; q < PLACES; q++) out->sum[n][q] = sum[n][q];
}

/* `count` channels of the convolution at the place `at`, right of it, below, and below on the right;
   `weights` are those of the first channel. A function by itself, as all registers are needed. */
static __attribute__((noinline)) void tile(
    int64_t kernel, int64_t count, const Maps *maps, const float *weights, const float *at, Tile *out)
{
#define TILE(k, n) \
    if (kernel == k && count == n) tile_of(k, n, maps, weights, at, out);
    OF_COUNTS(TILE, 3)
    OF_COUNTS(TILE, 5)
#undef TILE
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
    best += splat(bias);
    store(winner, if_greater(best, zero, which, splat(DEAD)));
    store(out, if_greater(best, zero, best, zero));
}

/* Convolution, 2x2 max-pooling, bias and ReLU; `out` has a border, `winner` none. */
static void convolve(
    int64_t kernel, const Maps *maps, const float *weights, const float *bias, int64_t border,
    const Maps *out, const Maps *winner)
{
    const int64_t size = maps->channels * kernel * kernel;
    for (int64_t y = 0; y < winner->height; y++)
        for (int64_t x = 0; x < winner->width; x++)
            for (int64_t o = 0, count; o < winner->channels; o += count) {
                count = group(winner->channels - o, GROUP);
                for (int64_t lane = 0; lane < WIDTH; lane += LENGTH) {
                    Tile sums;
                    tile(kernel, count, maps, weights + o * size,
                         place(maps, 0, 2 * y, 2 * x) + lane, &sums);
                    for (int64_t n = 0; n < count; n++)
                        pool(sums.sum[n], bias[o + n],
                             place(out, o + n, y + border, x + border) + lane,
                             place(winner, o + n, y, x) + lane);
                }
            }
}

/* The gradients of the loss behind pooling and ReLU, back at the places before; adds the bias'.
   `gradient` may be wider and higher than `winner`. */
static void unpool(
    const Maps *gradient, const Maps *winner, int64_t border, const Maps *out, float *bias_gradient)
{
    const Lanes zero = splat(0.0f);
    for (int64_t o = 0; o < winner->channels; o++) {
        float here[WIDTH];
        Lanes sum[PARTS];
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++) sum[p] = zero;
        for (int64_t y = 0; y < winner->height; y++)
            for (int64_t x = 0; x < winner->width; x++)
#pragma GCC unroll 4
                for (int p = 0; p < PARTS; p++) {
                    Lanes which = load(place(winner, o, y, x) + p * LENGTH);
                    Lanes down = load(place(gradient, o, y, x) + p * LENGTH);
                    Lanes value = if_equal(which, splat(DEAD), zero, down);
                    float *at = place(out, o, 2 * y + border, 2 * x + border) + p * LENGTH;
                    sum[p] += value;
#pragma GCC unroll 4
                    for (int q = 0; q < PLACES; q++)
                        store(at + (q / 2 * out->width + q % 2) * WIDTH,
                              if_equal(which, splat((float)q), value, zero));
                }
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++) store(here + p * LENGTH, sum[p]);
        bias_gradient[o] += total(here);
    }
}

/* Of `count` rows of weights, (count, 5, lane): sums over a convolution's (height, width) output. */
INLINE void row_of(
    int kernel, int count, const Maps *maps, const Maps *gradient, const float *map,
    const float *down, int64_t height, int64_t width, float (*out)[5][WIDTH])
{
    const int64_t plane = gradient->height * gradient->width * WIDTH;
    const int64_t map_end = (maps->width - width) * WIDTH, down_end = (gradient->width - width) * WIDTH;
    Lanes sum[ROW_GROUP][5];
#pragma GCC unroll 4
    for (int n = 0; n < count; n++)
#pragma GCC unroll 8
        for (int j = 0; j < kernel; j++) sum[n][j] = splat(0.0f);
    for (int64_t y = 0; y < height; y++, map += map_end, down += down_end)
        for (int64_t x = 0; x < width; x++, map += WIDTH, down += WIDTH) {
            Lanes s[ROW_GROUP];
#pragma GCC unroll 4
            for (int n = 0; n < count; n++) s[n] = load(down + n * plane);
#pragma GCC unroll 8
            for (int j = 0; j < kernel; j++) {
                Lanes v = load(map + j * WIDTH);
#pragma GCC unroll 4
                for (int n = 0; n < count; n++) sum[n][j] = multiply_add(s[n], v, sum[n][j]);
            }
        }
#pragma GCC unroll 4
    for (int n = 0; n < count; n++)
#pragma GCC unroll 8
        for (int j = 0; j < kernel; j++) store(out[n][j], sum[n][j]);
}

static __attribute__((noinline)) void row(
    int64_t kernel, int64_t count, const Maps *maps, const Maps *gradient, const float *map,
    const float *down, int64_t height, int64_t width, float (*out)[5][WIDTH])
{
#define ROW(k, n) \
    if (n <= ROW_GROUP && kernel == k && count == n) \
        row_of(k, n, maps, gradient, map, down, height, width, out);
    OF_COUNTS(ROW, 3)
    OF_COUNTS(ROW, 5)
#undef ROW
}

/* Add the gradients of the weights, given those of the convolution's (height, width) output. */
static void add_kernel_gradients(
    int64_t kernel, const Maps *maps, const Maps *gradient, int64_t border, int64_t height,
    int64_t width, float *out)
{
    for (int64_t o = 0, count; o < gradient->channels; o += count) {
        count = group(gradient->channels - o, ROW_GROUP);
        for (int64_t c = 0; c < maps->channels; c++)
            for (int64_t i = 0; i < kernel; i++) {
                float sums[ROW_GROUP][5][WIDTH];
                for (int64_t lane = 0; lane < WIDTH; lane += LENGTH)
                    row(kernel, count, maps, gradient, place(maps, c, i, 0) + lane,
                        place(gradient, o, border, border) + lane, height, width,
                        (float (*)[5][WIDTH])&sums[0][0][lane]);
                for (int64_t n = 0; n < count; n++)
                    for (int64_t j = 0; j < kernel; j++)
                        out[(((o + n) * maps->channels + c) * kernel + i) * kernel + j] +=
                            total(sums[n][j]);
            }
    }
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

/* The bare convolution; rows and columns of `out` are even in number. */
static void correlate(int64_t kernel, const Maps *maps, const float *weights, const Maps *out)
{
    const int64_t size = maps->channels * kernel * kernel;
    for (int64_t y = 0; y < out->height; y += 2)
        for (int64_t x = 0; x < out->width; x += 2)
            for (int64_t o = 0, count; o < out->channels; o += count) {
                count = group(out->channels - o, GROUP);
                for (int64_t lane = 0; lane < WIDTH; lane += LENGTH) {
                    Tile sums;
                    tile(kernel, count, maps, weights + o * size, place(maps, 0, y, x) + lane,
                         &sums);
                    for (int64_t n = 0; n < count; n++)
                        for (int64_t q = 0; q < PLACES; q++)
                            store(place(out, o + n, y + q / 2, x + q % 2) + lane, sums.sum[n][q]);
                }
            }
}

#endif
