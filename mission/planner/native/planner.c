/* What Python calls: the functions of a level that `best_level` or what is below it names. */

#include "planner.h"
#include "levels.h"

HANDED_OUT(Planner, planner)
