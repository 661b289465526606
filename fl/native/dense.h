/* Dense layers over 16 images at once: features are (feature, lane), weights (out, in). */
#ifndef DENSE_H
#define DENSE_H

#include "lanes.h"

/* Sums in registers at a time. */
enum { ROWS = LENGTH == 16 ? 8 : 4 };

INLINE void dense_rows(
    int count, int64_t width, const float *features, const float *weights, const float *bias,
    int relu, float *out)
{
    Lanes sum[ROWS][PARTS];
#pragma GCC unroll 8
    for (int n = 0; n < count; n++)
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++) sum[n][p] = splat(bias[n]);
    for (int64_t i = 0; i < width; i++) {
#pragma GCC unroll 8
        for (int n = 0; n < count; n++)
#pragma GCC unroll 4
            for (int p = 0; p < PARTS; p++)
                sum[n][p] = multiply_add(
                    splat(weights[n * width + i]), load(features + i * WIDTH + p * LENGTH), sum[n][p]);
    }
    const Lanes zero = splat(0.0f);
#pragma GCC unroll 8
    for (int n = 0; n < count; n++)
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++)
            store(out + n * WIDTH + p * LENGTH,
                  relu ? if_greater(sum[n][p], zero, sum[n][p], zero) : sum[n][p]);
}

/* Weights times features plus bias, through a ReLU if asked. */
static void dense_forward(
    int64_t count, int64_t width, const float *features, const float *weights, const float *bias,
    int relu, float *out)
{
    const int64_t whole = count - count % ROWS;
    for (int64_t j = 0; j < whole; j += ROWS)
        dense_rows(ROWS, width, features, weights + j * width, bias + j, relu, out + j * WIDTH);
    for (int64_t j = whole; j < count; j++)
        dense_rows(1, width, features, weights + j * width, bias + j, relu, out + j * WIDTH);
}

INLINE void dense_columns(
    int columns, int64_t count, int64_t width, const float *gradient, const float *weights, float *out)
{
    Lanes sum[ROWS][PARTS];
#pragma GCC unroll 8
    for (int n = 0; n < columns; n++)
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++) sum[n][p] = splat(0.0f);
    for (int64_t j = 0; j < count; j++) {
#pragma GCC unroll 8
        for (int n = 0; n < columns; n++)
#pragma GCC unroll 4
            for (int p = 0; p < PARTS; p++)
                sum[n][p] = multiply_add(
                    splat(weights[j * width + n]), load(gradient + j * WIDTH + p * LENGTH), sum[n][p]);
    }
#pragma GCC unroll 8
    for (int n = 0; n < columns; n++)
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++) store(out + n * WIDTH + p * LENGTH, sum[n][p]);
}

/* The gradients of the loss in the layer's inputs, given those in its outputs. */
static void dense_input_gradients(
    int64_t count, int64_t width, const float *gradient, const float *weights, float *out)
{
    const int64_t whole = width - width % ROWS;
    for (int64_t i = 0; i < whole; i += ROWS)
        dense_columns(ROWS, count, width, gradient, weights + i, out + i * WIDTH);
    for (int64_t i = whole; i < width; i++)
        dense_columns(1, count, width, gradient, weights + i, out + i * WIDTH);
}

/* Zero the gradients of features at which a ReLU let nothing through. */
static void stop_gradients(int64_t count, const float *features, float *gradient)
{
    const Lanes zero = splat(0.0f);
    for (int64_t i = 0; i < count * WIDTH; i += LENGTH)
        store(gradient + i, if_greater(load(features + i), zero, load(gradient + i), zero));
}

/* Features in tables of 16 by 16: (input / 16, lane, input % 16), so that a vector holds 16 inputs
   of one image. What stands behind the last input of the last table does not matter. */
static void turn_features(int64_t width, const float *features, float *turned)
{
    for (int64_t i = 0; i < width; i++)
        for (int64_t lane = 0; lane < WIDTH; lane++)
            turned[(i / WIDTH * WIDTH + lane) * WIDTH + i % WIDTH] = features[i * WIDTH + lane];
}

/* Add what the 16 images say to the gradients of 16 weights. */
INLINE void add_products(const Lanes *down, const float *table, float *out)
{
    Lanes sum[PARTS];
#pragma GCC unroll 4
    for (int p = 0; p < PARTS; p++) sum[p] = load(out + p * LENGTH);
#pragma GCC unroll 16
    for (int lane = 0; lane < WIDTH; lane++)
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++)
            sum[p] = multiply_add(down[lane], load(table + lane * WIDTH + p * LENGTH), sum[p]);
#pragma GCC unroll 4
    for (int p = 0; p < PARTS; p++) store(out + p * LENGTH, sum[p]);
}

/* Add the gradients of weights and bias; `turned` is memory for `turn_features`. */
static void add_dense_gradients(
    int64_t count, int64_t width, const float *features, const float *gradient, float *turned,
    float *out, float *bias_gradient)
{
    const int64_t whole = width - width % WIDTH;
    turn_features(width, features, turned);
    for (int64_t j = 0; j < count; j++) {
        float *row = out + j * width, rest[WIDTH] = {0};
        const size_t left = (size_t)(width - whole) * sizeof(float);
        const float *table = turned;
        Lanes down[WIDTH];
        bias_gradient[j] += total(gradient + j * WIDTH);
#pragma GCC unroll 16
        for (int lane = 0; lane < WIDTH; lane++) down[lane] = splat(gradient[j * WIDTH + lane]);
        for (int64_t i = 0; i < whole; i += WIDTH, table += WIDTH * WIDTH)
            add_products(down, table, row + i);
        if (!left) continue;
        memcpy(rest, row + whole, left);
        add_products(down, table, rest);
        memcpy(row + whole, rest, left);
    }
}

#endif
