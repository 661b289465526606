/* The Kalman filter's two steps on the covariance of the error state. R. E. Kalman, A new approach to
   linear filtering and prediction problems (1960); the correction in P. D. Joseph's form, which keeps
   the covariance positive whatever is rounded. */
#ifndef KALMAN_H
#define KALMAN_H

#include <string.h>

#include "flight.h"

/* a = F b; most of F is zero. */
static void times(double a[STATES][STATES], const double f[STATES][STATES],
                  const double b[STATES][STATES])
{
    memset(a, 0, sizeof(double[STATES][STATES]));
    for (int i = 0; i < STATES; i++)
        for (int k = 0; k < STATES; k++) {
            if (f[i][k] == 0) continue;
            for (int j = 0; j < STATES; j++) a[i][j] += f[i][k] * b[k][j];
        }
}

static void transpose(double a[STATES][STATES], const double b[STATES][STATES])
{
    for (int i = 0; i < STATES; i++)
        for (int j = 0; j < STATES; j++) a[i][j] = b[j][i];
}

static void predict(double p[STATES][STATES], const double f[STATES][STATES],
                    const double q[STATES][STATES])
{
    double a[STATES][STATES], b[STATES][STATES];
    times(a, f, p);
    transpose(b, a);
    times(p, f, b); /* F (F P)', and P is its own transpose */
    for (int i = 0; i < STATES; i++)
        for (int j = 0; j < STATES; j++) p[i][j] += q[i][j];
}

/* out[m] = h[rows[m]] p: (count, 22). */
static void measured(double out[ROWS][STATES], const double h[ROWS][STATES], const int64_t *rows,
                     int64_t count, const double p[STATES][STATES])
{
    memset(out, 0, sizeof(double[ROWS][STATES]));
    for (int m = 0; m < count; m++)
        for (int k = 0; k < STATES; k++) {
            const double weight = h[rows[m]][k];
            if (weight == 0) continue;
            for (int j = 0; j < STATES; j++) out[m][j] += weight * p[k][j];
        }
}

/* Cholesky's factor of a symmetric matrix; 0 where it is not positive definite. */
static int factor(double l[ROWS][ROWS], const double s[ROWS][ROWS], int64_t count)
{
    for (int i = 0; i < count; i++)
        for (int j = 0; j <= i; j++) {
            double rest = s[i][j];
            for (int k = 0; k < j; k++) rest -= l[i][k] * l[j][k];
            if (i == j && !(rest > 0)) return 0;
            l[i][j] = i == j ? __builtin_sqrt(rest) : rest / l[j][j];
        }
    return 1;
}

/* p -= K g, with the gain by its columns. */
static void less(double p[STATES][STATES], double gain[ROWS][STATES], double g[ROWS][STATES],
                 int64_t count)
{
    for (int i = 0; i < STATES; i++)
        for (int m = 0; m < count; m++)
            for (int j = 0; j < STATES; j++) p[i][j] -= gain[m][i] * g[m][j];
}

static int correct(double p[STATES][STATES], const double h[ROWS][STATES],
                   const double r[ROWS][ROWS], const double z[ROWS], const int64_t *rows,
                   int64_t count, double x[STATES])
{
    double hp[ROWS][STATES], s[ROWS][ROWS], l[ROWS][ROWS], gain[ROWS][STATES], noise[ROWS][STATES];
    double turned[STATES][STATES];
    measured(hp, h, rows, count, p);
    for (int m = 0; m < count; m++)
        for (int n = 0; n < count; n++) {
            double sum = r[rows[m]][rows[n]];
            for (int k = 0; k < STATES; k++) sum += hp[m][k] * h[rows[n]][k];
            s[m][n] = sum;
        }
    if (!factor(l, s, count)) return 0;
    /* The gain K = P H' / S by its columns, by forward and backward substitution. */
    memcpy(gain, hp, sizeof gain);
    for (int m = 0; m < count; m++)
        for (int j = 0; j < STATES; j++) {
            for (int k = 0; k < m; k++) gain[m][j] -= l[m][k] * gain[k][j];
            gain[m][j] /= l[m][m];
        }
    for (int m = (int)count - 1; m >= 0; m--)
        for (int j = 0; j < STATES; j++) {
            for (int k = m + 1; k < count; k++) gain[m][j] -= l[k][m] * gain[k][j];
            gain[m][j] /= l[m][m];
        }
    memset(x, 0, sizeof(double[STATES]));
    for (int m = 0; m < count; m++)
        for (int j = 0; j < STATES; j++) x[j] += gain[m][j] * z[rows[m]];
    /* P = (I - K H) P (I - K H)' + K R K', the first product as (I - K H) ((I - K H) P)'. */
    less(p, gain, hp, count);
    transpose(turned, p);
    measured(hp, h, rows, count, turned);
    less(turned, gain, hp, count);
    memset(noise, 0, sizeof noise); /* R K' */
    for (int m = 0; m < count; m++)
        for (int n = 0; n < count; n++)
            for (int j = 0; j < STATES; j++) noise[m][j] -= r[rows[m]][rows[n]] * gain[n][j];
    less(turned, gain, noise, count);
    memcpy(p, turned, sizeof turned);
    return 1;
}

#endif
