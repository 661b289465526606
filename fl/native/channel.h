/* The average packet error rate of `fl/radio/channel.py`, the same digits on every machine. */
#ifndef CHANNEL_H
#define CHANNEL_H

#include <math.h>

#include "learning.h"
#include "normal.h"

/* arctan(x) for 0 <= x <= 1, to 2e-16: halved twice, then Taylor's series. */
static inline double arctan(double x)
{
    for (int i = 0; i < 2; i++) x /= 1.0 + sqrt(1.0 + x * x);
    const double z = -x * x;
    double sum = 0.0;
    for (int n = 21; n >= 1; n -= 2) sum = sum * z + 1.0 / (double)n;
    return 4.0 * x * sum;
}

/* 1 / (1 + e^-x) */
static inline double logistic(double x)
{
    const double e = exp_of_negative(x < 0.0 ? x : -x);
    return (x < 0.0 ? e : 1.0) / (1.0 + e);
}

/* At a horizontal distance >= 0 and a height >= 0, in metres. */
static inline double per_at(const Channel *channel, double r, double height)
{
    const int low = r > height || height == 0.0; /* on the ground the elevation is 0 */
    const double theta =
        low ? arctan(r > 0.0 ? height / r : 0.0) : 1.57079632679489661923 - arctan(r / height);
    const double rho = logistic(channel->a1 * theta - channel->a2);
    double d = sqrt(r * r + height * height);
    d = d > channel->nearest ? d : channel->nearest;
    const double log_d = log_of(d < 1e300 ? d : 1e300, 0);
    const double los = channel->los_margin + channel->los_alpha * log_d;
    const double nlos = channel->nlos_margin + channel->nlos_alpha * log_d;
    const double per = rho * normal_share(los / channel->los_sigma) +
                       (1.0 - rho) * normal_share(nlos / channel->nlos_sigma);
    return per > 1.0 ? 1.0 : per; /* the weights may sum to 1 and a unit in the last place */
}

#endif
