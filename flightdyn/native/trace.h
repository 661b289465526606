/* Rows for the log of what is believed and ordered. */
#ifndef TRACE_H
#define TRACE_H

#include "flight.h"
#include "strapdown.h"

/* Add a row where it is time to. Whether it went well; where not, Python has an error set. */
static int note(Trace *trace, const Guide *g, const State *nav, const Inner *inner)
{
    const int64_t step = ++trace->steps;
    if (!g->armed || step % trace->every || trace->count == trace->room) return 1;
    double *row = trace->rows[trace->count], turn[4], seen[ACTUATORS];
    if (!read_gauges(inner->python, trace->gauges, ACTUATORS, seen)) return 0;
    rotation(turn, g->error);
    *row++ = (double)step;
    for (int i = 0; i < 4; i++) row[i] = nav->q[i];
    for (int i = 0; i < 3; i++) row[4 + i] = inner->rate[i];
    product(row + 7, nav->q, turn);
    for (int i = 0; i < 3; i++) row[11 + i] = seen[i];
    row[14] = g->collective;
    for (int i = 0; i < 4; i++) row[15 + i] = seen[3 + i];
    for (int i = 0; i < 3; i++) {
        row[19 + i] = g->p[i];
        row[22 + i] = g->v[i];
        row[25 + i] = g->a[i];
    }
    row[28] = g->yaw;
    row[29] = g->yaw_rate;
    for (int i = 19; i < 30 && !g->pointed; i++) row[i] = __builtin_nan("");
    trace->count++;
    return 1;
}

#endif
