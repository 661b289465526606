/* What of the error-state filter is done beside filterpy: the blocks of its transition that depend
   on the flight, and the innovations before they are believed. Equations:
   `flightdyn.navigation.error_model`. */
#ifndef ERROR_STATE_H
#define ERROR_STATE_H

#include "flight.h"
#include "vectors.h"

static void transition(double f[STATES][STATES], const double q[4], const double gained[3],
                       double dt)
{
    const double *g = gained;
    const double s[3][3] = {{0, g[2], -g[1]}, {-g[2], 0, g[0]}, {g[1], -g[0], 0}}; /* -[gained x] */
    double r[3][3];
    matrix(r, q);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            double turned = 0;
            for (int k = 0; k < 3; k++) turned += s[i][k] * -r[k][j];
            f[VEL + i][ATT + j] = s[i][j];
            f[POS + i][ATT + j] = s[i][j] * (dt / 2);
            f[VEL + i][BA + j] = f[ATT + i][BG + j] = -r[i][j] * dt;
            f[POS + i][BA + j] = -r[i][j] * (dt * dt / 2);
            f[VEL + i][BG + j] = turned * (dt / 2);
        }
    }
}

/* The values squared, in units of their covariance, positive definite: by Cholesky factors. */
static double squared_norm(double s[ROWS][ROWS], const double *z, int first, int count)
{
    double l[3][3], sum = 0, y[3];
    for (int i = 0; i < count; i++) {
        y[i] = z[first + i];
        for (int j = 0; j <= i; j++) {
            double rest = s[first + i][first + j];
            for (int k = 0; k < j; k++) rest -= l[i][k] * l[j][k];
            l[i][j] = i == j ? __builtin_sqrt(rest) : rest / l[j][j];
        }
        for (int j = 0; j < i; j++) y[i] -= l[i][j] * y[j];
        y[i] /= l[i][i];
        sum += y[i] * y[i];
    }
    return sum;
}

static void innovate(const double p[STATES][STATES], const double h[ROWS][STATES],
                     const double r[ROWS][ROWS], const double z[ROWS], double std[ROWS],
                     double nis[KINDS])
{
    double ph[STATES][ROWS], s[ROWS][ROWS];
    for (int i = 0; i < STATES; i++)
        for (int j = 0; j < ROWS; j++) {
            double sum = 0;
            for (int k = 0; k < STATES; k++) sum += p[i][k] * h[j][k];
            ph[i][j] = sum;
        }
    for (int i = 0; i < ROWS; i++)
        for (int j = 0; j < ROWS; j++) {
            double sum = r[i][j];
            for (int k = 0; k < STATES; k++) sum += h[i][k] * ph[k][j];
            s[i][j] = sum;
        }
    for (int i = 0; i < ROWS; i++) std[i] = __builtin_sqrt(s[i][i]);
    nis[0] = squared_norm(s, z, 0, 3);
    nis[1] = squared_norm(s, z, 3, 3);
    nis[2] = squared_norm(s, z, 6, 1);
    nis[3] = squared_norm(s, z, 7, 1);
}

#endif
