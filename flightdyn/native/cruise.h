/* From tick to tick, and over the guidance steps on the way, while nobody has anything else to do. */
#ifndef CRUISE_H
#define CRUISE_H

#include "guidance.h"
#include "strapdown.h"

/* A tick of the physics, sampled by the IMU; its rates go to the inner loops. */
static inline int tick(Imu *imu, Inner *inner, Object run, double *values)
{
    return call(imu->python, run) && sample(imu, values) && feed(inner, imu->rates);
}

static int64_t cruise(Loop *loop, Object run, int64_t ticks, Increment *sums, const Guidance *guidance)
{
    const int64_t noted = guidance->memory->noted;
    for (int64_t flown = 0; flown < ticks;) {
        if (!tick(loop->imu, loop->inner, run, loop->samples + AXES * loop->taken)) return -1;
        flown++;
        if (++loop->taken < loop->interval) continue;
        integrate((const Sample *)loop->samples, loop->interval, loop->dt, sums++, loop->carried);
        loop->taken = 0;
        if (flown == ticks) break;
        if (!guide(guidance, loop->carried, loop->inner)) return -1;
        if (guidance->memory->noted != noted) return flown;
    }
    return ticks;
}

#endif
