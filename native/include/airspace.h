/* Where may be flown, and the shortest ways around what must not be (`mission.base.airspace`): over
   points about the outlines' corners, each of which sees the next. */
#ifndef AIRSPACE_H
#define AIRSPACE_H

#include <math.h>
#include <stdint.h>

typedef struct {
    double x, y;
} Point;

/* Outlines turned so that the free side is on the left of their edges. */
typedef struct {
    int64_t outlines, fenced;      /* of which the last one is a fence, or none */
    const int64_t *first;          /* (outlines + 1,) where the corners of each begin */
    const Point *corner;           /* the last joins the first */
    const Point *low, *high;       /* (outlines,) the boxes around them */
    double clear, touching;        /* metres that are free from an outline, and that are on it */
    double beside;                 /* where a place is that is moved to the side of an outline */
    int64_t vertices, places;      /* V; and places beyond them that may be free */
    const Point *vertex;           /* (V + places,) */
    int64_t shifts;
    const Point *shift;            /* (shifts,) to places about one that is not free, the nearest first */
    double *length;                /* (V, V) of the shortest ways from one vertex to another */
    int32_t *before;               /* (V, V) the vertex before the other on it */
} Airspace;

static inline double least(double a, double b) { return b < a ? b : a; }
static inline double most(double a, double b) { return b > a ? b : a; }

static inline double square_between(Point a, Point b)
{
    const double x = b.x - a.x, y = b.y - a.y;
    return x * x + y * y;
}

/* The point so far on the way from one to another. */
static inline Point between_at(Point from, Point to, double share)
{
    return (Point){from.x + share * (to.x - from.x), from.y + share * (to.y - from.y)};
}

/* How much of a segment lies before its point that is nearest to a place. */
static inline double share_before(Point place, Point from, Point to)
{
    const double x = to.x - from.x, y = to.y - from.y, square = x * x + y * y;
    return square > 0 ? least(1, most(0, ((place.x - from.x) * x + (place.y - from.y) * y) / square)) : 0;
}

/* The point of a segment that is nearest to a place. */
static inline Point foot_of(Point place, Point from, Point to)
{
    return between_at(from, to, share_before(place, from, to));
}

/* Twice the area of a triangle, above 0 where c is on the left of the way from a to b. */
static inline double turn_of(Point a, Point b, Point c)
{
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/* Whether a segment may be nearer than `away` to what lies in a box. */
static inline int is_near(Point a, Point b, Point low, Point high, double away)
{
    return most(a.x, b.x) + away >= low.x && least(a.x, b.x) - away <= high.x &&
           most(a.y, b.y) + away >= low.y && least(a.y, b.y) - away <= high.y;
}

static const double BEYOND = 1e-9; /* relative: further is no rounding */

/* Whether two segments are so near, or cross. */
static inline int are_within(Point a, Point b, Point c, Point d, double away)
{
    const double square = away * away;
    const Point low = {least(c.x, d.x), least(c.y, d.y)}, high = {most(c.x, d.x), most(c.y, d.y)};
    if (!is_near(a, b, low, high, away)) return 0;
    const double left = turn_of(a, b, c), right = turn_of(a, b, d);
    /* Beyond that distance from the whole line, on one side: most are. */
    const double beside = square * square_between(a, b) * (1 + BEYOND);
    if (left * right > 0 && left * left > beside && right * right > beside) return 0;
    if (left * right < 0 && turn_of(c, d, a) * turn_of(c, d, b) < 0) return 1;
    return square_between(a, foot_of(a, c, d)) <= square || square_between(b, foot_of(b, c, d)) <= square ||
           square_between(c, foot_of(c, a, b)) <= square || square_between(d, foot_of(d, a, b)) <= square;
}

/* Whether a leg is further than `away` from every outline. */
static inline int keeps(const Airspace *space, Point a, Point b, double away)
{
    for (int64_t i = 0; i < space->outlines; i++) {
        if (!is_near(a, b, space->low[i], space->high[i], away)) continue;
        Point c = space->corner[space->first[i + 1] - 1];
        for (int64_t n = space->first[i]; n < space->first[i + 1]; n++) {
            const Point d = space->corner[n];
            if (are_within(a, b, c, d, away)) return 0;
            c = d;
        }
    }
    return 1;
}

/* Whether a place is outside of what must not be flown, to which outlines belong. */
static inline int is_allowed(const Airspace *space, Point p)
{
    for (int64_t i = 0; i < space->outlines; i++) {
        int inside = 0;
        Point c = space->corner[space->first[i + 1] - 1];
        for (int64_t n = space->first[i]; n < space->first[i + 1]; n++) {
            const Point d = space->corner[n], foot = foot_of(p, c, d);
            if (foot.x == p.x && foot.y == p.y) return 0;
            if ((c.y > p.y) != (d.y > p.y)) inside ^= (turn_of(c, d, p) > 0) == (d.y > c.y);
            c = d;
        }
        if (inside != (space->fenced && i == space->outlines - 1)) return 0;
    }
    return 1;
}

static inline int is_free(const Airspace *space, Point p)
{
    return keeps(space, p, p, space->clear) && is_allowed(space, p);
}

/* Metres from a place to where may be flown, margin or not. */
static inline double away_from(const Airspace *space, Point p)
{
    double nearest = INFINITY;
    if (is_allowed(space, p)) return 0;
    for (int64_t i = 0; i < space->outlines; i++) {
        Point c = space->corner[space->first[i + 1] - 1];
        for (int64_t n = space->first[i]; n < space->first[i + 1]; n++) {
            nearest = least(nearest, square_between(p, foot_of(p, c, space->corner[n])));
            c = space->corner[n];
        }
    }
    return sqrt(nearest);
}

/* Take a place for the best one where it is nearer and free; from an allowed one, if it is on the same side
   of every outline. */
static inline void try_place(
    const Airspace *space, Point from, int outside, Point place, double *nearest, Point *best)
{
    const double square = square_between(from, place);
    if (!(square < *nearest) || !is_free(space, place)) return;
    if (outside && !keeps(space, from, place, space->touching)) return;
    *nearest = square;
    *best = place;
}

/* Move a place to the nearest that is free: beside an edge or a corner, or one of the shifts. 0 where none
   is. */
static inline int move_out(const Airspace *space, Point *p)
{
    const Point from = *p;
    double nearest = INFINITY;
    if (is_free(space, from)) return 1;
    const int outside = is_allowed(space, from) && keeps(space, from, from, space->touching);
    for (int64_t i = 0; i < space->outlines; i++) {
        const int64_t first = space->first[i], end = space->first[i + 1];
        for (int64_t n = first; n < end; n++) {
            const Point c = space->corner[n], d = space->corner[n + 1 < end ? n + 1 : first];
            const Point foot = foot_of(from, c, d);
            const double left = space->beside / sqrt(square_between(c, d));
            const double away = space->beside / most(sqrt(square_between(foot, from)), space->touching);
            const Point beside[] = {
                {foot.x - (d.y - c.y) * left, foot.y + (d.x - c.x) * left},
                {foot.x + (from.x - foot.x) * away, foot.y + (from.y - foot.y) * away}};
            for (int side = 0; side < 2; side++)
                try_place(space, from, outside, beside[side], &nearest, p);
        }
    }
    for (int64_t i = 0; i < space->vertices + space->places; i++)
        try_place(space, from, outside, space->vertex[i], &nearest, p);
    for (int64_t i = 0; i < space->shifts; i++) {
        const double x = space->beside * space->shift[i].x, y = space->beside * space->shift[i].y;
        if (x * x + y * y > nearest) break;
        try_place(space, from, outside, (Point){from.x + x, from.y + y}, &nearest, p);
    }
    return nearest < INFINITY;
}

/* Fill in the shortest ways between vertices (Floyd and Warshall). */
static inline void fill_ways(const Airspace *space)
{
    const int64_t count = space->vertices;
    double *length = space->length;
    for (int64_t i = 0; i < count; i++)
        for (int64_t j = 0; j < count; j++) {
            const Point a = space->vertex[i], b = space->vertex[j];
            const int seen = j < i ? !isinf(length[j * count + i]) : keeps(space, a, b, space->clear);
            length[i * count + j] = seen ? sqrt(square_between(a, b)) : INFINITY;
            space->before[i * count + j] = (int32_t)i;
        }
    for (int64_t by = 0; by < count; by++)
        for (int64_t i = 0; i < count; i++)
            for (int64_t j = 0; j < count; j++) {
                const double other = length[i * count + by] + length[by * count + j];
                if (!(other < length[i * count + j])) continue;
                length[i * count + j] = other;
                space->before[i * count + j] = space->before[by * count + j];
            }
}

/* The points of the shortest way after its first, `spare` has room for 2 V; returns how many, V + 2 at
   most, or 0 where there is none. A start that is not free leaves to the nearest place that is; the
   end has to be free. */
static inline int64_t way_to(const Airspace *space, Point from, Point to, Point *way, double *spare)
{
    const int64_t count = space->vertices;
    double *here = spare, *there = spare + count, shortest = INFINITY;
    int64_t first = -1, last = -1, points = 0, seen = 0;
    if (keeps(space, from, to, space->clear)) {
        way[0] = to;
        return 1;
    }
    for (int64_t i = 0; i < count; i++) {
        const Point v = space->vertex[i];
        here[i] = keeps(space, from, v, space->clear) ? sqrt(square_between(from, v)) : INFINITY;
        there[i] = keeps(space, v, to, space->clear) ? sqrt(square_between(v, to)) : INFINITY;
        seen |= !isinf(here[i]);
    }
    /* From where nothing is seen it may have to get out first. */
    if (!seen && !is_free(space, from)) {
        if (!move_out(space, &from)) return 0;
        way[0] = from;
        points = way_to(space, from, to, way + 1, spare);
        return points ? points + 1 : 0;
    }
    for (int64_t i = 0; i < count; i++)
        for (int64_t j = 0; !isinf(here[i]) && j < count; j++) {
            const double whole = here[i] + space->length[i * count + j] + there[j];
            if (!(whole < shortest)) continue;
            shortest = whole;
            first = i;
            last = j;
        }
    if (first < 0) return 0;
    for (int64_t i = last; i != first; i = space->before[first * count + i]) points++;
    way[points + 1] = to;
    for (int64_t i = last, n = points; n >= 0; n--) {
        way[n] = space->vertex[i];
        i = space->before[first * count + i];
    }
    return points + 2;
}

/* The points after its first of the way to a waypoint, which is moved to where may be flown; where no way
   leads there, the place where it begins. Returns how many, V + 2 at most. */
static inline int64_t way_towards(const Airspace *space, Point from, Point to, Point *way, double *spare)
{
    const int64_t points = move_out(space, &to) ? way_to(space, from, to, way, spare) : 0;
    if (points) return points;
    way[0] = from;
    return 1;
}

/* The route through waypoints (count,), which are moved to where may be flown, and around areas; `at`
   (count,) is which of its points they are. Returns how many it has, count (V + 2) at most. The start
   stays; a waypoint to which no way leads is where the one before it is. */
static inline int64_t route_through(
    const Airspace *space, int64_t count, const Point *waypoint, Point *route, int64_t *at,
    double *spare)
{
    int64_t points = 1;
    route[0] = waypoint[0];
    at[0] = 0;
    for (int64_t n = 1; n < count; n++) {
        points += way_towards(space, route[points - 1], waypoint[n], route + points, spare);
        at[n] = points - 1;
    }
    return points;
}

#endif
