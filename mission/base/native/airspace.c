/* What Python calls: `airspace.h` for many places at a time. */

#include "airspace.h"
#include "exported.h"

/* Which legs are further than `away` from every outline. */
EXPORTED void keep_away(
    const Airspace *space, int64_t count, const Point *from, const Point *to, double away,
    uint8_t *kept)
{
    for (int64_t i = 0; i < count; i++) kept[i] = (uint8_t)keeps(space, from[i], to[i], away);
}

EXPORTED void allow(const Airspace *space, int64_t count, const Point *place, uint8_t *allowed)
{
    for (int64_t i = 0; i < count; i++) allowed[i] = (uint8_t)is_allowed(space, place[i]);
}

EXPORTED void measure_away(const Airspace *space, int64_t count, const Point *place, double *metres)
{
    for (int64_t i = 0; i < count; i++) metres[i] = away_from(space, place[i]);
}

/* How many have been moved, or are free, before the first that cannot. */
EXPORTED int64_t move_all(const Airspace *space, int64_t count, Point *place)
{
    for (int64_t i = 0; i < count; i++)
        if (!move_out(space, place + i)) return i;
    return count;
}

EXPORTED void find_ways(const Airspace *space) { fill_ways(space); }

EXPORTED int64_t find_route(
    const Airspace *space, int64_t count, const Point *waypoint, Point *route, int64_t *at,
    double *spare)
{
    return route_through(space, count, waypoint, route, at, spare);
}
