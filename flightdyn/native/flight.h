/* What Python and the library hand each other; Python reads it here (`native.headers`). SI units, axes
   as in `flightdyn.inertial`: NED and FRD. */
#ifndef FLIGHT_H
#define FLIGHT_H

#include "ticks.h"
#include "trajectory.h"
#include <stdint.h>

/* Error state, by `flightdyn.navigation.error_model`: where its parts begin. */
enum { POS = 0, VEL = 3, ATT = 6, BG = 9, BA = 12, STATES = 22 };

/* Rows of the measurement: GNSS position and velocity, height, heading. */
enum { ROWS = 8, KINDS = 4 };

/* One tick of the IMU. */
typedef struct {
    double rate[3], force[3]; /* rad/s, m/s2; body axes */
} Sample;

/* Samples summed over `dt`: rotation (rad) and velocity gained (m/s), body axes. */
typedef struct {
    double dt, angle[3], velocity[3];
} Increment;

typedef struct {
    double gyro[3], accel[3];
} ImuBias;

typedef struct {
    double gravity, rate_north, rate_down; /* m/s2, rad/s */
} Earth;

/* Position and velocity (NED), attitude body to NED (w, x, y, z). */
typedef struct {
    double p[3], v[3], q[4];
} State;

/* A state that is carried on by increments. */
typedef struct {
    State state;
    ImuBias bias; /* to be taken off the increments */
    Earth earth;
    double gained[3]; /* velocity (NED), without gravity, by the increments carried last */
    double force[3];  /* mean specific force (body) of the last of them */
    double down[];    /* p[2] after each of them */
} Strapdown;

/* Of the outer loop, `flightdyn.guidance.control`; `full` is the thrust over mass at collective 1. */
typedef struct {
    double dt, gravity, full, slope, idle, position, velocity, integral, integral_limit, lead,
        drag_lag, drag_limit, thrust_lag, motor_lag, most_thrust, yaw_rate;
} Gains;

enum { NOTHING, TRACK, TARGET, ATTITUDE };                 /* what is ordered */
enum { FINISHED = 1, STALLED = 2, LIMITED = 4, NEAR = 8 }; /* what there is to note of it */

/* The guidance's memory, its orders and what comes of them. */
typedef struct {
    /* By Python; what is 0 or 1 is a whole number: */
    int64_t mode, armed;
    int64_t course, interested; /* whether to look along the course, or at a place */
    double interest[3];
    double yaw_order, spin;     /* heading to turn to (rad), which turns by itself (rad/s) */
    int64_t path, too_fast;     /* whether the trajectory is a path; beyond the limits */
    double soon, late, corner[3], normal[3]; /* of the next corner: when it may and when it must have
                                                been passed, its plane or zeros */
    int64_t oriented;                  /* whether an attitude is ordered, or rates alone */
    double q[4], rates[3], thrust_order, climb; /* of an attitude; thrust may be NaN */
    /* The reference: */
    int64_t pointed; /* whether there is a setpoint */
    double p[3], v[3], a[3];
    double yaw, yaw_rate;
    double t, rate, smooth_rate, room, along[3]; /* on the trajectory's clock */
    double waited, went, over, missed;
    int64_t finished, stalled;
    /* The controller: */
    int64_t saturated;
    double integral[3], drag[2], lagged, effectiveness, thrust[3], wanted_yaw;
    /* To the inner loops and the land detector: */
    double error[3], feed[3], collective, lift, descend, sink, knock;
    /* The land detector: seconds of quiet, and what it believes. */
    double quiet;
    int64_t touching, contact, landed;
    int64_t noted; /* of the trajectory, at the last step */
} Guide;

enum { TRACE = 31, ACTUATORS = 7 };

/* What is believed and ordered at every so many guidance steps while armed, a row each: its time in
   ns; attitude, body rates; attitude and body rates that are wanted; thrust; motors; position,
   velocity, acceleration, heading and its rate of the setpoint, NaN where there is none. */
typedef struct {
    double (*rows)[TRACE];
    const Gauge *gauges; /* (7,) wanted rates, duty cycles */
    int64_t room, every, count, steps, step_ns;
} Trace;

typedef struct {
    Guide *memory;
    const Gains *gains;
    const Trajectory *path; /* may be missing where none is tracked */
    Trace *trace;           /* may be missing */
} Guidance;

enum { READINGS = 128 };

/* A sensor that is read at every so many ticks. */
typedef struct {
    const Gauge *gauge;
    int64_t every, waited, count;
    double values[READINGS];
} Probe;

/* What carries a state from guidance step to guidance step: so many ticks of the IMU lie between
   them, `dt` each, of whose samples so many are taken. */
typedef struct {
    Imu *imu;
    Inner *inner;
    Strapdown *carried;
    Strapdown *ahead; /* for the state between steps; may be missing: no corner is looked for */
    Probe *probe;     /* may be missing */
    double *samples; /* (interval, 6): the newest ones */
    int64_t interval, taken;
    double dt;
} Loop;

typedef struct {
    /* Sum samples (count,), each held for `dt`; biases are left in. Carry a state by the sum, if
       there is one. */
    void (*integrate)(const Sample *, int64_t count, double dt, Increment *, Strapdown *);
    /* Carry a state over increments (count,). */
    void (*carry)(Strapdown *, const Increment *, int64_t count);
    /* Write what of the transition `f` depends on the flight: over `dt` from the attitude `q` on,
       with the velocity gained. */
    void (*transition)(double f[STATES][STATES], const double q[4], const double gained[3],
                       double dt);
    /* Innovations z of the rows of h, with the covariance p of the error state and r of the
       measurement: their standard deviations, and the normalised square of each kind's. */
    void (*innovate)(const double p[STATES][STATES], const double h[ROWS][STATES],
                     const double r[ROWS][ROWS], const double z[ROWS], double std[ROWS],
                     double nis[KINDS]);
    /* Position, velocity and acceleration (9) of a trajectory at `t`, the acceleration of `lead`
       later. */
    void (*reference)(const Trajectory *, double t, double lead, double *pva);
    /* A guidance step from where a state was carried to, handed on to the inner loops. Whether it
       went well: where not, Python has an error set. */
    int (*guide)(const Guidance *, const Strapdown *, Inner *);
    /* The land detector's part of it, `dt` after the last. */
    void (*land)(Guide *, double dt);
    /* Whether the next corner has been passed at a place with a velocity. */
    int (*passed)(const Guide *, const double p[3], const double v[3]);
    /* So many ticks, and the guidance steps between them, but none after the last tick. It ends
       before, with a guidance step, where that notes something else, and where a corner is passed.
       Sums of the samples up to each step are left in `sums`. Returns the ticks, -1 where Python has
       an error set. */
    int64_t (*cruise)(Loop *, Object run, int64_t ticks, Increment *sums, const Guidance *);
    /* `compute_trajectory` and the times of `foresee_path` (trajectory.h). */
    double (*compute_trajectory)(PathProfile *, const Steering *, const double velocity[3],
                                 int braking);
    void (*pass_points)(PathProfile *, const Steering *, double *passed);
    /* Watts (count,) at speeds through the air and sizes of acceleration. */
    void (*power)(const Air *, int64_t count, const double *speed, const double *accel,
                  double *watts);
    /* These say whether it went well; where not, Python has an error set. */
    int (*read_gauges)(const Interpreter *, const Gauge *, int64_t count, double *values);
    int (*sample)(Imu *, double values[AXES]);
    /* A tick of an aircraft that another brain drives. */
    int (*drive)(Driven *, const double motors[4], double values[AXES]);
} Flight;

#endif
