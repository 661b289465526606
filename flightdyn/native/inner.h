/* The inner loops' end: they run in JSBSim's FCS, which is told rates and orders. Each function
   returns whether it went well; where not, Python has an error set. */
#ifndef INNER_H
#define INNER_H

#include "interpreter.h"

typedef struct { /* the inner loops' end, `Multirotor.inner_loops` */
    const Interpreter *python;
    Object set_rates[3], set_errors[3], set_feeds[3], set_collective;
    double bias[3];            /* to be taken off the rates */
    double rate[3];            /* believed, of this tick */
    double error[3], feed[3];  /* rotation still to be made (rad), rate fed forward (rad/s) */
    double collective;         /* thrust per rotor (1 = full) */
    double dt;
} Inner;

/* Believed rates of this tick to the inner loops; the wanted rotation is carried on with them. */
static inline int feed(Inner *inner, const double rates[3])
{
    const Interpreter *python = inner->python;
    for (int i = 0; i < 3; i++) {
        const double rate = inner->rate[i] = rates[i] - inner->bias[i];
        inner->error[i] -= (rate - inner->feed[i]) * inner->dt;
        if (!set(python, inner->set_rates[i], rate)) return 0;
        if (!set(python, inner->set_errors[i], inner->error[i])) return 0;
    }
    return 1;
}

/* Hand on what the outer loop orders. */
static inline int order(Inner *inner, const double error[3], const double feed[3],
                        double collective)
{
    const Interpreter *python = inner->python;
    for (int i = 0; i < 3; i++) {
        inner->error[i] = error[i];
        inner->feed[i] = feed[i];
        if (!set(python, inner->set_errors[i], inner->error[i]) ||
            !set(python, inner->set_feeds[i], inner->feed[i]))
            return 0;
    }
    inner->collective = collective;
    return set(python, inner->set_collective, inner->collective);
}

#endif
