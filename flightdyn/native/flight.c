/* What Python calls: the functions of a level that `best_level` or what is below it names. */

#include "flight.h"
#include "levels.h"

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
