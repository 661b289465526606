/* What Python and the library hand each other; `library.py` says the same in ctypes. SI units, axes
   as in `flightdyn.inertial`: NED and FRD. */
#ifndef FLIGHT_H
#define FLIGHT_H

#include <stdint.h>

/* Error state, by `flightdyn.error_model`: where its parts begin. */
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

typedef struct {
    /* Sum samples (count,), each held for `dt`; biases are left in. */
    void (*integrate)(const Sample *, int64_t count, double dt, Increment *);
    /* Carry a state over increments (count,). Writes the velocity (NED) gained without gravity,
       and p[2] after each increment (count,). */
    void (*carry)(State *, const Increment *, int64_t count, const ImuBias *, const Earth *,
                  double gained[3], double *down);
    /* Write what of the transition `f` depends on the flight: over `dt` from the attitude `q` on,
       with the velocity gained. */
    void (*transition)(double f[STATES][STATES], const double q[4], const double gained[3],
                       double dt);
    /* Innovations z of the rows of h, with the covariance p of the error state and r of the
       measurement: their standard deviations, and the normalised square of each kind's. */
    void (*innovate)(const double p[STATES][STATES], const double h[ROWS][STATES],
                     const double r[ROWS][ROWS], const double z[ROWS], double std[ROWS],
                     double nis[KINDS]);
} Flight;

extern const Flight flight_baseline, flight_avx2, flight_avx512;

#endif
