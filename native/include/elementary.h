/* exp, log and arctan from additions, multiplications and divisions alone: the same digits on every
   machine, which the platform's own do not promise. exp and log are within 2 units in the last place. */
#ifndef ELEMENTARY_H
#define ELEMENTARY_H

#include <math.h>
#include <stdint.h>
#include <string.h>

static const double LN2_HIGH = 6.93147180369123816490e-01; /* 33 bits, so that k LN2_HIGH is exact */
static const double LN2_LOW = 1.90821492927058770002e-10;

static inline double of_bits(uint64_t bits)
{
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline uint64_t bits_of(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* e^x for x <= 0; 0 where the result is no normal number. NaN gives NaN. */
static inline double exp_of_negative(double x)
{
    if (x < -708.0) return 0.0;
    if (!(x <= 0.0)) return x == x ? 1.0 : x;
    int64_t k = (int64_t)(x * 1.44269504088896338700 - 0.5); /* rounds to the nearest */
    double r = (x - (double)k * LN2_HIGH) - (double)k * LN2_LOW; /* |r| <= ln 2 / 2 */
    double sum = 1.0 / 6227020800.0; /* Taylor's series up to r^13: exact to 1e-17 */
    sum = sum * r + 1.0 / 479001600.0;
    sum = sum * r + 1.0 / 39916800.0;
    sum = sum * r + 1.0 / 3628800.0;
    sum = sum * r + 1.0 / 362880.0;
    sum = sum * r + 1.0 / 40320.0;
    sum = sum * r + 1.0 / 5040.0;
    sum = sum * r + 1.0 / 720.0;
    sum = sum * r + 1.0 / 120.0;
    sum = sum * r + 1.0 / 24.0;
    sum = sum * r + 1.0 / 6.0;
    sum = sum * r + 0.5;
    sum = sum * (r * r) + r;
    return (1.0 + sum) * of_bits((uint64_t)(k + 1023) << 52);
}

/* A positive normal number as mantissa, in [1, 2), and power of two, which is added to. */
static inline double split(double x, int64_t *power)
{
    uint64_t bits = bits_of(x);
    *power += (int64_t)(bits >> 52) - 1023;
    return of_bits((bits & 0x000fffffffffffffu) | 0x3ff0000000000000u);
}

/* log(m 2^power) for a normal number m > 0. */
static inline double log_of(double m, int64_t power)
{
    m = split(m, &power);
    if (m > 1.41421356237309504880) {
        m *= 0.5;
        power += 1;
    }
    double f = m - 1.0, s = f / (2.0 + f), z = s * s; /* log m = 2 artanh s, |s| <= 0.172 */
    double sum = 2.0 / 23.0;
    sum = sum * z + 2.0 / 21.0;
    sum = sum * z + 2.0 / 19.0;
    sum = sum * z + 2.0 / 17.0;
    sum = sum * z + 2.0 / 15.0;
    sum = sum * z + 2.0 / 13.0;
    sum = sum * z + 2.0 / 11.0;
    sum = sum * z + 2.0 / 9.0;
    sum = sum * z + 2.0 / 7.0;
    sum = sum * z + 2.0 / 5.0;
    sum = sum * z + 2.0 / 3.0;
    double half = 0.5 * f * f; /* 2 s = f - s f, and s f = f^2/2 - s f^2/2 */
    double small = s * (half + z * sum);
    double k = (double)power;
    return k * LN2_HIGH - ((half - (small + k * LN2_LOW)) - f);
}

static const double INVERSE_ODD[] = {
    1.0 / 45, 1.0 / 43, 1.0 / 41, 1.0 / 39, 1.0 / 37, 1.0 / 35, 1.0 / 33, 1.0 / 31,
    1.0 / 29, 1.0 / 27, 1.0 / 25, 1.0 / 23, 1.0 / 21, 1.0 / 19, 1.0 / 17, 1.0 / 15,
    1.0 / 13, 1.0 / 11, 1.0 / 9,  1.0 / 7,  1.0 / 5,  1.0 / 3,  1.0,
};

/* The angle of (x, y) from the x axis: ratios up to tan(pi / 8) by their series, others by the half
   angle before it. */
static inline double arc_tangent2(double y, double x)
{
    const double PI = 3.14159265358979323846;
    const double ax = x < 0 ? -x : x, ay = y < 0 ? -y : y;
    double low = ax < ay ? ax : ay, high = ax < ay ? ay : ax, angle = 0;
    if (high == 0) return 0;
    if (low > 0.41421356237309503 * high) { /* atan r = pi / 4 - atan((1 - r) / (1 + r)) */
        const double sum = high + low;
        low = low - high;
        high = sum;
        angle = PI / 4;
    }
    const double r = low / high, z = r * r;
    double sum = 0;
    for (int k = 0; k < 23; k++) sum = INVERSE_ODD[k] - z * sum;
    angle += r * sum;
    if (ay > ax) angle = PI / 2 - angle;
    if (x < 0) angle = PI - angle;
    return y < 0 ? -angle : angle;
}

static inline double size3(double x, double y, double z) { return sqrt(x * x + y * y + z * z); }

#endif
