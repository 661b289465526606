/* What Python and the library hand each other; Python reads it here (`native.headers`). */
#ifndef PLANNER_H
#define PLANNER_H

#include "airspace.h"
#include "channel.h"
#include "trajectory.h"

/* Success of packets at places on a grid, bilinear between them and beyond its edge as there. */
typedef struct {
    const double *success; /* (K, rows, columns) */
    int64_t rows, columns; /* northwards, eastwards; at least 2 */
    Point first;           /* the south-western place */
    double cell;           /* metres */
} Grid;

/* The devices worth something, in coordinates with the start at the origin. */
typedef struct {
    int64_t count;       /* K */
    const Point *at;     /* (K,) metres */
    const double *delta; /* (K,) importance, above 0 */
    const double *price; /* (K,) what serving each costs, below delta; or NULL: nothing */
    const double *hover; /* (K,) metres of the length that go while each sends; or NULL: hovers do not count */
    const double *after; /* (K,) most metres from its turn on, hovers included: of time; NULL as `hover` is */
    const double *sends; /* (K,) metres that could be flown in the time for which each sends; NULL as `hover` is */
    int64_t rows;
    const double *table; /* (rows, 3) f, f', f'' of the channel, one row a metre */
    const Grid *grid;    /* of their success, in its place; or NULL */
} Devices;

/* When a search may end: no plan is better by more than the relative gap, or than so much. `scale` is the
   size of a value that bounds are worked out for; 0: that of the plan. */
typedef struct {
    double gap, slack, scale;
} Target;

/* Metres that a stop takes beyond its leg: at least, and as many more from a leg of that length on. */
typedef struct {
    double least, brake;
} Stopping;

/* What a plan may use. */
typedef struct {
    int64_t steps;    /* N */
    int64_t per_step; /* K_bar */
    double length;    /* L_max, metres */
    Stopping stop;    /* of the length */
    Stopping turn;    /* of what comes after a device's turn: the length may be one of energy */
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

/* What is counted of a flight: seconds, joules, metres, seconds of hover, radians of turns. */
enum { SECONDS, JOULES, METRES, HOVERED, TURNED, COUNTED };

/* A limit of a round: at most so much, of which a flight takes so much for each that is counted. */
typedef struct {
    double most, of[COUNTED];
} Limit;

enum { MOST_LIMITS = 8 };

/* How fast, how sharply and at what power is flown, and what a round may take. */
typedef struct {
    int64_t guided; /* 0: always at its speed, as where nothing is flown */
    Steering steering;
    Air air; /* x, y and up */
    double speed, widest;         /* m/s; acceptance radius at most */
    /* Times the guidance's own seconds; those from its end to rest, on the way and at the last stop. */
    double pace, stopping, settling;
    double ahead, ahead_share;    /* by which a flight may be ahead of what was foreseen */
    int64_t limits;
    Limit limit[MOST_LIMITS];
} Flying;

/* A round as its plans are judged; see `mission.planner.problem.RoundProblem`. */
typedef struct {
    int64_t devices, steps, per_step; /* K, N, K_bar */
    const Point *at;                  /* (K,) area coordinates */
    const double *importance;         /* (K,) 0 or more */
    const double *price;              /* (K,) what serving each costs: others bring it; or NULL */
    const double *upload, *ready;     /* (K,) seconds, or NULL */
    const Channel *channel;
    double altitude;
    const Grid *grid; /* of success, in place of the channel's; or NULL */
    const Airspace *space; /* NULL: everywhere may be flown */
    int64_t radii;
    const double *radius;  /* (radii,) acceptance radii, the widest first */
    double hold;           /* seconds of hover at every stop */
    const Flying *flying;  /* NULL: metres alone count */
} Round;

/* A plan of such a round. */
typedef struct {
    int64_t points;
    Point *route;            /* (points,) waypoints, and the corners between them */
    int64_t *at;             /* (N,) which of them are the waypoints, rising */
    uint8_t *schedule;       /* (N, K) who sends as each step is passed */
    double value;            /* what that earns */
    double wait;             /* seconds of hover at the start, before it leaves */
} CandidatePlan;

/* What a flight takes; of a round that has none, stops alone. */
typedef struct {
    double radius, share;  /* acceptance radius, share of the limits */
    int64_t *stop;         /* (points,) of each point */
    double *hold, *offset; /* (points,) hover at each stop, (N,) when steps begin after arrival there */
    double *begins;        /* (N,) when they begin at the earliest, in seconds into the round */
} Evaluation;

/* Why a search has ended: the gap is met, or nothing is left to divide; after all of its nodes; or at
   a pace at which the rest of them would not do. */
enum Ended { DONE, OUT_OF_NODES, TOO_SLOW };

enum { MOST_DEVICES = 40 }; /* of a search: its masks have a bit for every gap of an order */
enum { HOPE_PERCENT = 1 };  /* of success: with less nobody is asked to send */
enum { MOST_AIRCRAFT = 20 };

/* The same functions for every kind of processor. Where memory is short they give back NaN or -1. */
typedef struct {
    /* The best plan found after building paths towards `starts` devices and changing them `tries`
       times; into `way` (N,) and `assigned` (K,), -1 for a device that is not served. Returns what
       it earns. */
    double (*explore)(const Devices *, const Limits *, int64_t starts, int64_t tries, Point *way,
                      int64_t *assigned);
    /* Improve on a plan of A aircraft, each in coordinates with its own start at the origin, until none can
       be better by more than the target says, or `max_nodes` have been looked into; at most `max_open` are
       open. `way` is (A, N), and `assigned` (K,) numbers steps through all aircraft, which have the same
       devices, steps and places a step, and relaxations with the same radii and promises; `alike` (A,) has the
       first one that each is equal to. Needs 1 to MOST_DEVICES devices, a positive length, and a plan of a
       value above 0 or a scale; where hovers count, one aircraft. Writes the bound and why it ended; returns
       the nodes looked into. */
    int64_t (*search_orders)(int64_t aircraft, const Devices *, const Limits *, const Relaxation *,
                             const int64_t *alike, const Target *, int64_t max_nodes, int64_t max_open,
                             double *value, Point *way, int64_t *assigned, double *bound,
                             int64_t *ended);
    /* The same for one aircraft by branching on where the stops are, which is for few of them and any number
       of devices. */
    int64_t (*search_places)(const Devices *, const Limits *, const Target *, int64_t max_nodes,
                             int64_t max_open, double *value, Point *way, int64_t *assigned,
                             double *bound, int64_t *ended);

    /* The best plan of A aircraft near their paths: assignment and ascent in turns. Returns what it earns. */
    double (*polish)(int64_t aircraft, const Devices *, const Limits *, Point *way, int64_t *assigned);

    /* Assign each of the devices to a step or to none (-1), at most `per_step` to each, so that the
       most of `worth` (devices, steps) is earned; 0, or -1 where memory is short. */
    int (*assign)(int64_t devices, int64_t steps, int64_t per_step, const double *worth,
                  int64_t *assigned);
    /* Assign devices to the points of `way` so that the most is earned; returns that. */
    double (*match)(const Devices *, const Limits *, Point *way, int64_t *assigned);

    /* The plan along the way through `waypoint` (N,), cut to so many metres and, if `limited`, to what
       fits; 0 where it is worth no more than `above`, 1 otherwise, -1 where memory is short. Its route
       has room for N (V + 2) points. */
    int (*fit)(const Round *, const Point *waypoint, CandidatePlan *, double metres, double above,
               int limited);
    /* The best plan that so many changes at random lead to, of which those are kept that make the present
       one worth more, or less by a share of `tolerance` that falls to nothing: 0, or -1. */
    int (*vary)(const Round *, CandidatePlan *, double metres, int64_t changes, double tolerance,
                int64_t seed, int limited);
    /* The plan without devices for which there is no time: 0, or -1. */
    int (*leave_out)(const Round *, CandidatePlan *);
    /* What is asked of a plan's flight: 0, or -1. */
    int (*judge)(const Round *, const CandidatePlan *, Evaluation *);
    /* When each of `count` stops is reached, and what is counted of the flight (COUNTED,): 0, or -1. */
    int (*foresee)(const Flying *, int64_t count, const Point *stops, const double *hold,
                   double radius, double *arrived, double *counted);
    /* Where such a flight is every `step` seconds from its start, into `at` (count,): 0, or -1. */
    int (*follow)(const Flying *, int64_t stops, const Point *stop, const double *hold, double radius,
                  double step, int64_t count, Point *at);
} Planner;

#endif
