/* What Python calls: the functions of a level that `best_level` or what is below it names. */

#include "learning.h"
#include "levels.h"

SIZE_OF(Network);
SIZE_OF(Images);
SIZE_OF(Rates);
SIZE_OF(City);
SIZE_OF(Field);
SIZE_OF(Learning);

EXPORTED const Learning *at_level(int level)
{
#if defined(__x86_64__)
    static const Learning *const LEVELS[] = {
        &learning_baseline, &learning_avx2, &learning_avx512};
    return LEVELS[level];
#else
    (void)level;
    return &learning_baseline;
#endif
}
