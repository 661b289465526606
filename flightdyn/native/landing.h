/* Is the aircraft on the ground? Told from the belief and the thrust alone: ground contact, then
   landed; in the air again once the thrust lifts the aircraft. */
#ifndef LANDING_H
#define LANDING_H

#include "flight.h"

static const double TOUCH_S = 0.08;  /* the descent has stopped: the legs may be on the ground */
static const double CONTACT_S = 0.4; /* no descent in spite of the order */
static const double SETTLED_S = 0.3; /* and still none with the motors idling */
static const double DESCENT_ORDER_MPS = 0.15;
static const double STILL_MPS = 0.25;
static const double FALLING_MPS = 0.9; /* motors idle and sinking that fast: not the ground */
static const double KNOCK_MPS2 = 8.0;  /* specific force beyond the thrust: legs on something hard */

static void feel_ground(Guide *g, double dt)
{
    const int still = (g->sink < 0 ? -g->sink : g->sink) < STILL_MPS;
    const int ordered = g->descend > DESCENT_ORDER_MPS;
    if (g->landed) {
        /* Lift beyond weight leaves the ground; a climb tells it too. */
        if (g->armed && (g->lift > 1.02 || g->sink < -0.5)) g->contact = g->landed = g->quiet = 0;
    } else if (!g->armed) {
        g->quiet = still ? g->quiet + dt : 0;
        g->contact = g->landed = g->quiet >= CONTACT_S;
    } else if (g->contact) {
        g->quiet = still ? g->quiet + dt : 0;
        if (g->sink > FALLING_MPS || !ordered) g->contact = g->quiet = 0;
        g->landed = g->contact && g->quiet >= SETTLED_S;
    } else {
        g->quiet = ordered && still && g->lift < 0.95 ? g->quiet + dt : 0;
        if (g->quiet >= CONTACT_S || (ordered && g->knock > KNOCK_MPS2)) {
            g->contact = 1;
            g->quiet = 0;
        }
    }
}

static void land(Guide *g, double dt)
{
    feel_ground(g, dt);
    /* The legs may be on the ground: no leaning, no learning from what the sensors feel. */
    g->touching = g->contact || g->quiet >= TOUCH_S;
}

#endif
