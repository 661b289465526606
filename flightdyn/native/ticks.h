/* What is done at every tick of the physics: step JSBSim, read the IMU, and end the inner loops, which
   run in JSBSim's FCS and are told rates and orders; or drive the motors where it is another brain
   than ours that flies. Each function returns whether it went well; where not, Python has an error
   set. */
#ifndef TICKS_H
#define TICKS_H

#include "interpreter.h"

enum { AXES = 6 }; /* body rates (rad/s), specific force (m/s2) */

typedef struct {
    const Interpreter *python;
    const Gauge *gauges;         /* (6,) */
    const double (*errors)[AXES]; /* of the ticks to come: as many as will be asked for */
    double fault[AXES];          /* constants on top */
    double rates[3];             /* gyroscopes, as read last */
} Imu;

typedef struct { /* motors that a brain other than ours drives */
    Imu *imu;
    Object run, set_motors[4];
    double motors[4]; /* duty cycles, as ordered last */
} Driven;

/* The IMU's sample of this tick. The force that JSBSim shows is that of the tick before: the rates
   of then go with it. */
static inline int sample(Imu *imu, double *values)
{
    double now[AXES];
    if (!read_gauges(imu->python, imu->gauges, AXES, now)) return 0;
    const double *errors = *imu->errors++;
    for (int i = 0; i < AXES; i++) now[i] += errors[i] + imu->fault[i];
    for (int i = 0; i < 3; i++) {
        values[i] = imu->rates[i];
        values[3 + i] = now[3 + i];
        imu->rates[i] = now[i];
    }
    return 1;
}

static inline int drive_tick(Driven *driven, const double motors[4], double *values)
{
    const Interpreter *python = driven->imu->python;
    for (int i = 0; i < 4; i++) {
        const double duty = motors[i] >= 0 ? (motors[i] <= 1 ? motors[i] : 1) : 0;
        if (duty == driven->motors[i]) continue;
        if (!set(python, driven->set_motors[i], duty)) return 0;
        driven->motors[i] = duty;
    }
    return call(python, driven->run) && sample(driven->imu, values);
}

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
