/* The average packet error rate of `fl/radio/channel.py`, the same digits on every machine. */
#ifndef CHANNEL_H
#define CHANNEL_H

#include "normal.h"

/* Constants of a channel; of each segment what is lost to the threshold at 1 m, the path-loss exponent
   and the standard deviation of the shadowing, in natural logarithms. */
typedef struct {
    double a1, a2;  /* of the probability of line of sight */
    double nearest; /* metres: shorter distances count as this */
    double los_margin, los_alpha, los_sigma, nlos_margin, nlos_alpha, nlos_sigma;
} Channel;

/* 1 / (1 + e^-x) */
static inline double logistic(double x)
{
    const double e = exp_of_negative(x < 0.0 ? x : -x);
    return (x < 0.0 ? e : 1.0) / (1.0 + e);
}

/* At a horizontal distance >= 0 and a height >= 0, in metres. */
static inline double per_at(const Channel *channel, double r, double height)
{
    const double rho = logistic(channel->a1 * arc_tangent2(height, r) - channel->a2);
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
