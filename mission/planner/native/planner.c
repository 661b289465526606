/* What Python calls: the functions of a level that `best_level` or what is below it names. */

#include "planner.h"
#include "levels.h"

SIZE_OF(Airspace);
SIZE_OF(Grid);
SIZE_OF(Devices);
SIZE_OF(Limits);
SIZE_OF(Relaxation);
SIZE_OF(Flying);
SIZE_OF(Round);
SIZE_OF(CandidatePlan);
SIZE_OF(Evaluation);
SIZE_OF(Planner);

EXPORTED const Planner *at_level(int level)
{
#if defined(__x86_64__)
    static const Planner *const LEVELS[] = {&planner_baseline, &planner_avx2, &planner_avx512};
    return LEVELS[level];
#else
    (void)level;
    return &planner_baseline;
#endif
}
