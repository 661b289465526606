/* The normal distribution, the same digits on every machine. */
#ifndef NORMAL_H
#define NORMAL_H

#include "elementary.h"

/* ln(erfc(x) / t) + x^2 over t = 2 / (2 + x), x >= 0, in Chebyshev polynomials of 2 t - 1: the sum
   of the rest is under 1e-17. */
static const double ERFC[] = {
    -1.3026537197817094, 0.6419697923564902, 0.019476473204185836, -0.009561514786808632,
    -0.0009465953444820369, 0.00036683949785276145, 4.252332480690777e-05, -2.0278578112534242e-05,
    -1.6242900046470256e-06, 1.3036558355805232e-06, 1.5626441722066142e-08, -8.523809591492654e-08,
    6.5290544390988515e-09, 5.059343495551469e-09, -9.91364156493033e-10, -2.273651222931836e-10,
    9.646791102015527e-11, 2.3940380830391146e-12, -6.886027526497553e-12, 8.944879273090725e-13,
    3.130921399342958e-13, -1.1270822361367252e-13, 3.810905255189232e-16, 7.106097613609237e-15,
    -1.5230282014571043e-15, -9.457494571291233e-17, 1.210237189224279e-16, -2.816663087747177e-17,
};

/* erfc(x) / 2 for x >= 0, to 1e-15. */
static inline double half_erfc(double x)
{
    const double t = 2.0 / (2.0 + x), u = 4.0 * t - 2.0;
    double b = 0.0, before = 0.0;
    for (int j = (int)(sizeof ERFC / sizeof *ERFC) - 1; j > 0; j--) { /* Clenshaw's recurrence */
        const double next = u * b - before + ERFC[j];
        before = b;
        b = next;
    }
    return 0.5 * t * exp_of_negative(-x * x + 0.5 * (u * b + ERFC[0]) - before);
}

/* The share of the normal distribution under x. */
static inline double normal_share(double x)
{
    if (x > 9.0) return 1.0; /* as below, to the last digit */
    const double tail = half_erfc((x < 0.0 ? -x : x) * 0.70710678118654752440);
    return x < 0.0 ? tail : 1.0 - tail;
}

#endif
