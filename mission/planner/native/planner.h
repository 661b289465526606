/* What Python and the library hand each other; `library.py` says the same in ctypes. */
#ifndef PLANNER_H
#define PLANNER_H

#include <stdint.h>

typedef struct {
    double x, y;
} Point;

/* The devices worth something, in coordinates with the start at the origin. */
typedef struct {
    int64_t count;       /* K */
    const Point *at;     /* (K,) metres */
    const double *delta; /* (K,) importance, above 0 */
    const double *hover; /* (K,) metres that could be flown in the time for which each sends */
    const double *after; /* (K,) most metres from its turn on, hovers included */
    int64_t rows;
    const double *table; /* (rows, 3) f, f', f'' of the channel, one row a metre */
} Devices;

/* What a plan may use. */
typedef struct {
    int64_t steps;    /* N */
    int64_t per_step; /* K_bar */
    double length;    /* L_max, metres */
    int64_t timed;    /* whether hovers and turns count; for bounds only */
    double stop;      /* metres that a stop takes at least, beyond its leg, */
    double brake;     /* and from a leg of this length on, as many more */
} Limits;

/* Tables of the dual bound; see `mission.planner.reward.Conjugates`. */
typedef struct {
    int64_t radii;              /* B */
    int64_t splines;            /* S + 3 */
    const double *coefficients; /* (rows, S + 3) of H, one row a distance interval */
    const double *spacing;      /* (rows,) */
    const int64_t *ends;        /* (rows, 2) its radii, as indices */
    const int64_t *row;         /* (B, B) the interval between two radii */
    const int64_t *ladder;      /* (B,) the radius that is decided about after this one */
    const double *radius_m;     /* (B,) */
    const double *promise;      /* (K, B) bound of delta f for a device out of reach of radius b */
} Relaxation;

/* Why a search has ended: the gap is met, or nothing is left to divide; after all of its nodes; or at
   a pace at which the rest of them would not do. */
enum Ended { DONE, OUT_OF_NODES, TOO_SLOW };

enum { MOST_DEVICES = 40 }; /* of a search: its masks have a bit for every gap of an order */

/* The same functions for every kind of processor. Where memory is short they give back NaN or -1. */
typedef struct {
    /* The best plan found after building paths towards `starts` devices and changing them `tries`
       times; into `way` (N,) and `assigned` (K,), -1 for a device that is not served. Returns what
       it earns. */
    double (*explore)(const Devices *, const Limits *, int64_t starts, int64_t tries, Point *way,
                      int64_t *assigned);
    /* Improve on a plan, of a value above 0, until none can be better by more than the relative
       gap, or `max_nodes` have been looked into; at most `max_open` are open. Needs 1 to
       MOST_DEVICES devices and a positive length. Writes the bound and why it ended; returns the nodes
       looked into. */
    int64_t (*search_orders)(const Devices *, const Limits *, const Relaxation *, double gap,
                             int64_t max_nodes, int64_t max_open, double *value, Point *way,
                             int64_t *assigned, double *bound, int64_t *ended);
    /* The same by branching on where the stops are, which is for few of them and any number of
       devices. */
    int64_t (*search_places)(const Devices *, const Limits *, double gap, int64_t max_nodes,
                             int64_t max_open, double *value, Point *way, int64_t *assigned,
                             double *bound, int64_t *ended);

    /* Assign each of the devices to a step or to none (-1), at most `per_step` to each, so that the
       most of `worth` (devices, steps) is earned; 0, or -1 where memory is short. */
    int (*assign)(int64_t devices, int64_t steps, int64_t per_step, const double *worth,
                  int64_t *assigned);

    /* Parts that are tested by themselves. */

    /* Assign devices to the points of `way` so that the most is earned; returns that. */
    double (*match)(const Devices *, const Limits *, Point *way, int64_t *assigned);
    /* The least bound of the order in which the devices stand, with the rows of their distance
       intervals, and 1 where a stop is one with the one before; -1 if its steps did not end well. */
    double (*order_bound)(const Devices *, const Limits *, const Relaxation *,
                          const int64_t *interval, const int64_t *merged, double eps);
    /* Bound of what a stop somewhere in a square can earn. */
    double (*square_bound)(const Devices *, const Limits *, double x, double y, double half);
    /* H of a distance interval at s >= 0. */
    double (*conjugate)(const Relaxation *, int64_t row, double s);
} Planner;

extern const Planner planner_baseline, planner_avx2, planner_avx512;

#endif
