/* Vectors and rotations. */
#ifndef VECTORS_H
#define VECTORS_H

#include "elementary.h"

/* a x b */
static inline void cross(double out[3], const double a[3], const double b[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double limited(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

/* An angle in [-pi, pi). */
static inline double wrapped(double angle)
{
    const double PI = 3.14159265358979323846, turns = (angle + PI) / (2 * PI);
    double whole = (double)(int64_t)turns;
    if (turns < whole) whole -= 1;
    return angle - 2 * PI * whole;
}

/* The matrix that turns body vectors into NED, of an attitude (w, x, y, z). */
static inline void matrix(double r[3][3], const double q[4])
{
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    r[0][0] = 1 - 2 * (y * y + z * z);
    r[0][1] = 2 * (x * y - w * z);
    r[0][2] = 2 * (x * z + w * y);
    r[1][0] = 2 * (x * y + w * z);
    r[1][1] = 1 - 2 * (x * x + z * z);
    r[1][2] = 2 * (y * z - w * x);
    r[2][0] = 2 * (x * z - w * y);
    r[2][1] = 2 * (y * z + w * x);
    r[2][2] = 1 - 2 * (x * x + y * y);
}

#endif
