/* What Python calls: the functions of a level that `best_level` or what is below it names, and ticks,
   which hardly compute. */

#include "flight.h"
#include "levels.h"
#include "ticks.h"

SIZE_OF(Flight);
SIZE_OF(Strapdown);
SIZE_OF(Trajectory);
SIZE_OF(Guide);
SIZE_OF(Guidance);
SIZE_OF(Trace);
SIZE_OF(Loop);
SIZE_OF(Steering);
SIZE_OF(Vertex);
SIZE_OF(PathProfile);
SIZE_OF(Air);
SIZE_OF(Interpreter);
SIZE_OF(Gauge);
SIZE_OF(Imu);
SIZE_OF(Inner);
SIZE_OF(Driven);
SIZE_OF(Ticks);

EXPORTED const Ticks *ticks(void)
{
    static const Ticks TICKS = {read_gauges, sample, drive_tick};
    return &TICKS;
}

EXPORTED const Flight *at_level(int level)
{
#if defined(__x86_64__)
    static const Flight *const LEVELS[] = {&flight_baseline, &flight_avx2, &flight_avx512};
    return LEVELS[level];
#else
    (void)level;
    return &flight_baseline;
#endif
}
