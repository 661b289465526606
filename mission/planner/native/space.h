/* Branch and bound on where the stops are, for plans of few stops.

   A node's zones get smaller squares while their size is what makes its bound too high, or there are
   few of them; otherwise one of them is cut in two where the relaxed chains lie farthest apart.
   Squares that no good plan passes are dropped on the way. */
#ifndef SPACE_H
#define SPACE_H

#include "ascent.h"
#include "queue.h"
#include "zones.h"

enum {
    MOST_CELLS = 60000,
    MOST_SQUARES = 20000, /* in one node */
    ROOT_TURNS = 60,
    TURNS = 8,
};
static const double ACROSS = 8.0; /* squares at first, at most */
static const int64_t CELL_MEMORY = 256 << 20; /* bytes for what devices bring in cells */
static const double LEAST_HALF = 0.02; /* metres: half the side of the smallest square */
static const double BY_SIZE = 0.5; /* share of an excess that refines, if it is due to size */
/* Pairs of squares of neighbouring stops: more are rather cut than refined, or never refined. */
static const double MANY_PAIRS = 3e3, MOST_PAIRS = 3e4;
static const double WIDE = 2.0; /* halves of a square's side: a spread that is worth a cut */

/* Memory for a search. */
typedef struct {
    Programme programme;
    Queue queue;
    unsigned char *kept; /* (MOST_SQUARES,) whether a good plan may pass a square of the node */
    Point *points;       /* (N,) */
    Polish polish;
    Plan made;
    Proof proof;
} Space;

static void lay_out_space(
    Space *all, Arena *arena, const Devices *devices, const Limits *limits, int64_t most_open)
{
    const int64_t cells = CELL_MEMORY / (int64_t)sizeof(Corners) / devices->count;
    all->programme =
        lay_out_programme(arena, devices, limits, MOST_SQUARES, fewer(cells, MOST_CELLS));
    all->queue = (Queue){claim(arena, most_open, sizeof(double *)), 0, most_open};
    all->kept = claim(arena, MOST_SQUARES, 1);
    all->points = claim(arena, limits->steps, sizeof(Point));
    all->polish = lay_out_polish(arena, devices->count, limits, limits->steps);
    all->made = lay_out_plan(arena, devices->count, limits->steps);
}

/* The box that holds start and devices: no stop need be outside, as moving all of them to their
   nearest points of the box lengthens no leg, nor any way to a device. */
static void box_of(const Devices *devices, Point *low, Point *high)
{
    *low = *high = (Point){0.0, 0.0};
    for (int64_t k = 0; k < devices->count; k++) {
        const Point u = devices->at[k];
        *low = (Point){least(low->x, u.x), least(low->y, u.y)};
        *high = (Point){most(high->x, u.x), most(high->y, u.y)};
    }
}

/* Zones of every place in reach. */
static Zones *everywhere(Programme *all)
{
    Point low, high;
    box_of(&all->cells.devices, &low, &high);
    double half = LARGEST_HALF;
    while (ACROSS * 2.0 * half < most(high.x - low.x, high.y - low.y)) half *= 2.0;
    const int64_t across = 1 + (int64_t)((high.x - low.x) / (2.0 * half));
    const int64_t up = 1 + (int64_t)((high.y - low.y) / (2.0 * half));
    all->cells.count = 1; /* number 0 is nobody's quarter */
    for (int64_t i = 0; i < across * up; i++) {
        const Point middle = {
            low.x + half * (double)(2 * (i % across) + 1),
            low.y + half * (double)(2 * (i / across) + 1)};
        if (from_start(middle, half, -1.0) <= all->sizes.length)
            add_cell(&all->cells, middle.x, middle.y, half);
    }
    const int64_t count = all->cells.count - 1;
    Zones *zones = new_zones(&all->sizes, count * all->sizes.stops);
    if (!zones) return NULL;
    for (int64_t n = 0; n < all->sizes.stops; n++) {
        zones->first[n + 1] = (n + 1) * count;
        for (int64_t j = 0; j < count; j++) zones->square[n * count + j] = (int32_t)(j + 1);
    }
    for (int64_t k = 0; k < all->sizes.devices; k++) zones->price[k] = cost_of(&all->cells.devices, k);
    zones->bound = INFINITY;
    zones->share = 1.0;
    return zones;
}

/* Whether the way from the start to the first stop can be no longer than to the last; plans of
   which it is not need not be looked at: from the last stop on, they are shorter backwards. */
static void drop_reversed(const Zones *zones, Space *all)
{
    const Programme *work = &all->programme;
    const int64_t *first = zones->first, last = work->sizes.stops - 1;
    double near = INFINITY, far = 0.0;
    for (int64_t j = 0; j < first[1]; j++)
        if (all->kept[j]) near = least(near, from_start(centre(work, j), work->half[j], -1.0));
    for (int64_t j = first[last]; j < first[last + 1]; j++)
        if (all->kept[j]) far = most(far, from_start(centre(work, j), work->half[j], 1.0));
    for (int64_t j = 0; j < first[1]; j++)
        if (from_start(centre(work, j), work->half[j], -1.0) > far) all->kept[j] = 0;
    for (int64_t j = first[last]; j < first[last + 1]; j++)
        if (from_start(centre(work, j), work->half[j], 1.0) < near) all->kept[j] = 0;
}

/* Keep the squares that a plan of more than `enough` may pass; the others are closed. */
static void sift(const Zones *zones, double enough, Space *all)
{
    Programme *work = &all->programme;
    bound_of(zones, work);
    look_back(zones, work);
    const double fixed = beside(zones, work);
    for (int64_t j = 0; j < zones->first[work->sizes.stops]; j++) {
        const double bound = fixed + work->ahead[j] + work->behind[j];
        all->kept[j] = bound > enough;
        if (!all->kept[j]) all->proof.bound = most(all->proof.bound, least(bound, zones->bound));
    }
    if (work->sizes.stops > 1) drop_reversed(zones, all);
}

static int64_t kept_of(const Zones *zones, const Space *all, int64_t stop)
{
    int64_t count = 0;
    for (int64_t j = zones->first[stop]; j < zones->first[stop + 1]; j++) count += all->kept[j];
    return count;
}

static int64_t all_kept(const Zones *zones, const Space *all)
{
    int64_t count = 0;
    for (int64_t n = 0; n < all->programme.sizes.stops; n++) count += kept_of(zones, all, n);
    return count;
}

/* Pairs of kept squares, of stops one after the other; 0 if a stop has none left. */
static double pairs_of(const Zones *zones, const Space *all)
{
    double pairs = 0.0, before = 1.0;
    for (int64_t n = 0; n < all->programme.sizes.stops; n++) {
        const double here = (double)kept_of(zones, all, n);
        if (here == 0.0) return 0.0;
        pairs += before * here;
        before = here;
    }
    return pairs;
}

/* A line across one of the zones. */
typedef struct {
    int64_t stop; /* -1: there is none */
    int by_x;
    double at;
} Cut;

static int beyond(const Space *all, Cut cut, int64_t j)
{
    return (cut.by_x ? all->programme.x[j] : all->programme.y[j]) > cut.at;
}

/* Whether there are kept squares on both sides. */
static int parts(const Zones *zones, const Space *all, Cut cut)
{
    int64_t sides[2] = {0, 0};
    if (cut.stop < 0) return 0;
    for (int64_t j = zones->first[cut.stop]; j < zones->first[cut.stop + 1]; j++)
        if (all->kept[j]) sides[beyond(all, cut, j)]++;
    return sides[0] > 0 && sides[1] > 0;
}

/* Through the mean of the stop whose places in the relaxed chains lie farthest apart. */
static Cut cut_spread(const Zones *zones, const Space *all, double turns)
{
    const Programme *work = &all->programme;
    Cut cut = {-1, 0, 0.0};
    double widest = 0.0;
    for (int64_t n = 0; n < work->sizes.stops; n++) {
        const Spread *s = work->spread + n;
        const double x = s->sum.x / turns, y = s->sum.y / turns;
        const double across = s->squares.x / turns - x * x, up = s->squares.y / turns - y * y;
        double half = 0.0;
        for (int64_t j = zones->first[n]; j < zones->first[n + 1]; j++)
            if (all->kept[j]) half = most(half, work->half[j]);
        if (most(across, up) > most(widest, WIDE * WIDE * half * half)) {
            widest = most(across, up);
            cut = (Cut){n, across > up, across > up ? x : y};
        }
    }
    return cut;
}

/* Through the middle of the widest zone. */
static Cut cut_widest(const Zones *zones, const Space *all)
{
    const Programme *work = &all->programme;
    Cut cut = {-1, 0, 0.0};
    double widest = 0.0;
    for (int64_t n = 0; n < work->sizes.stops; n++) {
        Point low = {INFINITY, INFINITY}, high = {-INFINITY, -INFINITY};
        for (int64_t j = zones->first[n]; j < zones->first[n + 1]; j++)
            if (all->kept[j]) {
                low = (Point){least(low.x, work->x[j]), least(low.y, work->y[j])};
                high = (Point){most(high.x, work->x[j]), most(high.y, work->y[j])};
            }
        const Point extent = less(high, low);
        if (most(extent.x, extent.y) > widest) {
            widest = most(extent.x, extent.y);
            cut.stop = n;
            cut.by_x = extent.x > extent.y;
            cut.at = cut.by_x ? 0.5 * (low.x + high.x) : 0.5 * (low.y + high.y);
        }
    }
    return cut;
}

/* The kept squares, those of the stop that is cut on one side only. */
static Zones *part_of(const Zones *zones, const Space *all, Cut cut, int side)
{
    const Sizes *sizes = &all->programme.sizes;
    Zones *part = new_zones(sizes, all_kept(zones, all));
    if (!part) return NULL;
    inherit(sizes, zones, part);
    int64_t count = 0;
    for (int64_t n = 0; n < sizes->stops; n++) {
        for (int64_t j = zones->first[n]; j < zones->first[n + 1]; j++)
            if (all->kept[j] && (n != cut.stop || beyond(all, cut, j) == side))
                part->square[count++] = zones->square[j];
        part->first[n + 1] = count;
    }
    return part;
}

/* The kept squares, the largest ones of every stop in quarters; NULL where there is no room, or
   nothing to quarter. */
static Zones *finer(const Zones *zones, Space *all)
{
    Programme *work = &all->programme;
    const int64_t stops = work->sizes.stops;
    Zones *fine = new_zones(&work->sizes, 4 * all_kept(zones, all));
    if (!fine) return NULL;
    inherit(&work->sizes, zones, fine);
    int64_t count = 0, quartered = 0;
    for (int64_t n = 0; n < stops; n++) {
        double most_half = LEAST_HALF;
        for (int64_t j = zones->first[n]; j < zones->first[n + 1]; j++)
            if (all->kept[j]) most_half = most(most_half, work->half[j]);
        for (int64_t j = zones->first[n]; j < zones->first[n + 1]; j++) {
            if (!all->kept[j]) continue;
            if (work->half[j] < most_half) {
                fine->square[count++] = zones->square[j];
                continue;
            }
            const int64_t quarter = quarters(&work->cells, zones->square[j]);
            if (quarter < 0) {
                free(fine);
                return NULL;
            }
            quartered++;
            for (int i = 0; i < 4; i++) fine->square[count++] = (int32_t)(quarter + i);
        }
        fine->first[n + 1] = count;
    }
    if (quartered && count <= work->most) return fine;
    free(fine);
    return NULL;
}

/* Take a node further: smaller squares, or two parts. */
static void divide(const Zones *zones, double enough, Space *all)
{
    Programme *work = &all->programme;
    sift(zones, enough, all);
    const double pairs = pairs_of(zones, all);
    if (pairs == 0.0) return;
    const double due_to_size = zones->bound - centre_value(zones, work);
    Cut cut = {-1, 0, 0.0};
    if (pairs > MANY_PAIRS || due_to_size <= BY_SIZE * (zones->bound - enough))
        cut = cut_spread(zones, all, TURNS - 1);
    if (cut.stop < 0 && pairs <= MOST_PAIRS) {
        Zones *fine = finer(zones, all);
        if (fine) {
            leave_open(&all->queue, fine, zones->bound, &all->proof.bound);
            return;
        }
    }
    if (!parts(zones, all, cut)) cut = cut_widest(zones, all);
    if (!parts(zones, all, cut)) {
        all->proof.bound = most(all->proof.bound, zones->bound);
        return;
    }
    for (int side = 0; side < 2; side++)
        leave_open(
            &all->queue, part_of(zones, all, cut, side), zones->bound, &all->proof.bound);
}

/* Put the best chain of a node to use. */
static void use_chain(const Programme *work, const Limits *limits, Plan *plan, Space *all)
{
    all->points[0] = (Point){0.0, 0.0};
    for (int64_t n = 0; n < work->sizes.stops; n++)
        all->points[n + 1] = centre(work, work->chain[n]);
    polish(
        all->points, limits->steps, limits, &work->cells.devices, 0.0, FINE, &all->made,
        &all->polish);
    if (all->made.value > plan->value)
        copy_plan(&all->made, plan, work->sizes.devices, limits->steps);
}

/* Improve on a plan until none can be better by more than the target says, or the nodes run out. */
static void search_space(
    const Devices *devices, const Limits *limits, const Target *target, int64_t max_nodes, Plan *plan,
    Space *all)
{
    Programme *work = &all->programme;
    Queue *queue = &all->queue;
    all->proof = (Proof){plan->value, 0, DONE};
    fill_rises(&work->cells);
    for (int64_t k = 0; k < devices->count; k++)
        work->at_start[k] =
            devices->delta[k] * upper_from(&work->cells, between(devices->at[k], (Point){0.0, 0.0}));
    leave_open(queue, everywhere(work), INFINITY, &all->proof.bound);
    while (queue->count > 0) {
        double enough = enough_for(target, plan->value);
        if (*queue->open[0] <= enough || all->proof.nodes >= max_nodes) {
            if (*queue->open[0] > enough) all->proof.ended = OUT_OF_NODES;
            all->proof.bound = most(all->proof.bound, *queue->open[0]);
            break;
        }
        Zones *zones = dequeue(queue);
        load_squares(zones, work);
        lower_bound(zones, plan->value, enough, all->proof.nodes++ ? TURNS : ROOT_TURNS, work);
        use_chain(work, limits, plan, all);
        enough = enough_for(target, plan->value);
        if (zones->bound > enough)
            divide(zones, enough, all);
        else
            all->proof.bound = most(all->proof.bound, zones->bound);
        free(zones);
    }
    close_all(queue);
}

#endif
