/* What Python calls: the functions of a level that `best_level` or what is below it names. */

#include "flight.h"
#include "levels.h"

HANDED_OUT(Flight, flight)
