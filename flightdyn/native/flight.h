/* What Python and the library hand each other; `library.py` says the same in ctypes. SI units, axes
   as in `flightdyn.inertial`: NED and FRD. */
#ifndef FLIGHT_H
#define FLIGHT_H

#include <stdint.h>

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
} Flight;

extern const Flight flight_baseline, flight_avx2, flight_avx512;

#endif
