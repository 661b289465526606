/* The functions of elementary.h over arrays, for their test. */
#include "elementary.h"
#include "exported.h"

EXPORTED void exp_of(const double *x, double *out, int64_t count)
{
    for (int64_t i = 0; i < count; i++) out[i] = exp_of_negative(x[i]);
}

EXPORTED void log_of_power(const double *m, const int64_t *power, double *out, int64_t count)
{
    for (int64_t i = 0; i < count; i++) out[i] = log_of(m[i], power[i]);
}

EXPORTED void angle_of(const double *y, const double *x, double *out, int64_t count)
{
    for (int64_t i = 0; i < count; i++) out[i] = arc_tangent2(y[i], x[i]);
}
