/* Radio among buildings: line of sight, path loss of 3GPP TR 38.901 (V19) and TR 36.777 (V15), and
   shadowing as a field over the places of the aircraft. Metres, dB, GHz. */
#ifndef CITY_H
#define CITY_H

#include "normal.h"

/* Prisms with flat floors and roofs; the walls of inner courtyards are walls like the others. */
typedef struct {
    int64_t count;
    const double (*walls)[4]; /* both ends of each, x and y; a building's follow each other */
    const int64_t *first;     /* (count + 1) the first wall of each */
    const double (*boxes)[4]; /* least x and y, largest x and y of each */
    const double *floors;     /* height of each; -inf: it stands on the ground */
    const double *roofs;
} Buildings;

enum { WAVES = 200 };
static const double PI = 3.14159265358979323846;

/* A sum of plane waves of random direction and phase: nearly a normal field, of variance 1. */
typedef struct {
    double east[WAVES], north[WAVES], phase[WAVES]; /* turns a correlation distance, turns */
} Field;

typedef struct {
    const double (*devices)[3];  /* places of the senders */
    const Field (*fields)[2];    /* of the shadowing in sight of each and without, or NULL: none */
    const double *entries;       /* loss of the wall of each, for those within a building */
    Buildings buildings;
    double carrier;
    int64_t macro; /* UMa, else UMi */
} City;

static inline double larger(double a, double b) { return a > b ? a : b; }

/* Whether the straight line from a to b passes through building i. `leaves`: the share of the line at
   which it leaves it for the first time if a is within it, else 0. */
static int passes(const Buildings *all, int64_t i, const double a[3], const double b[3], double *leaves)
{
    /* Where along the line it is between floor and roof: from `begin` to `end`. */
    const double floor = all->floors[i], roof = all->roofs[i], *box = all->boxes[i];
    double begin = 0, end = 1, wall = 1;
    *leaves = 0;
    if ((a[2] >= roof && b[2] >= roof) || (a[2] <= floor && b[2] <= floor)) return 0;
    if (a[2] >= roof) begin = (a[2] - roof) / (a[2] - b[2]);
    if (a[2] <= floor) begin = (floor - a[2]) / (b[2] - a[2]);
    if (b[2] >= roof) end = (roof - a[2]) / (b[2] - a[2]);
    if (b[2] <= floor) end = (a[2] - floor) / (a[2] - b[2]);
    const double dx = b[0] - a[0], dy = b[1] - a[1];
    const double px = a[0] + begin * dx, py = a[1] + begin * dy;
    const double qx = a[0] + end * dx, qy = a[1] + end * dy;
    if ((px < box[0] && qx < box[0]) || (px > box[2] && qx > box[2])) return 0;
    if ((py < box[1] && qy < box[1]) || (py > box[3] && qy > box[3])) return 0;
    int within = 0, met = 0; /* within: whether p is, by the walls east of it */
    for (int64_t j = all->first[i]; j < all->first[i + 1]; j++) {
        const double *w = all->walls[j], ex = w[2] - w[0], ey = w[3] - w[1];
        if ((w[1] > py) != (w[3] > py) && px < w[0] + (py - w[1]) / ey * ex) within = !within;
        const double one = ex * (py - w[1]) - ey * (px - w[0]);
        const double two = ex * (qy - w[1]) - ey * (qx - w[0]);
        const double from = (qx - px) * (w[1] - py) - (qy - py) * (w[0] - px);
        const double to = (qx - px) * (w[3] - py) - (qy - py) * (w[2] - px);
        if ((one > 0) == (two > 0) || (from > 0) == (to > 0)) continue;
        met = 1;
        wall = one / (one - two) < wall ? one / (one - two) : wall;
    }
    if (within && begin == 0) *leaves = wall * end;
    return within || met;
}

/* The share of the line at which it leaves the buildings around a; 0 if a is outdoors. */
static double way_out(const Buildings *all, const double a[3], const double b[3])
{
    double last = 0, leaves;
    for (int64_t i = 0; i < all->count; i++)
        if (passes(all, i, a, b, &leaves)) last = larger(last, leaves);
    return last;
}

static int hidden(const Buildings *all, const double a[3], const double b[3])
{
    double leaves;
    for (int64_t i = 0; i < all->count; i++)
        if (passes(all, i, a, b, &leaves)) return 1;
    return 0;
}

/* Up to a quarter turn exact to 1e-16, by -1 / 2!, 1 / 4! ... from the last on. The same digits on
   every machine, as those of elementary.h. Without a loop, so that compilers take several at once. */
static inline double cosine_of_turns(double turns)
{
    double t = turns - ((turns + 0x1.8p52) - 0x1.8p52); /* less the nearest whole number */
    t = t < 0 ? -t : t;
    const double a = 2 * PI * (t > 0.25 ? 0.5 - t : t), z = a * a;
    double sum = 1.0 / 2432902008176640000.0;
    sum = sum * z - 1.0 / 6402373705728000.0;
    sum = sum * z + 1.0 / 20922789888000.0;
    sum = sum * z - 1.0 / 87178291200.0;
    sum = sum * z + 1.0 / 479001600.0;
    sum = sum * z - 1.0 / 3628800.0;
    sum = sum * z + 1.0 / 40320.0;
    sum = sum * z - 1.0 / 720.0;
    sum = sum * z + 1.0 / 24.0;
    sum = sum * z - 0.5;
    sum = sum * z + 1.0;
    return t > 0.25 ? -sum : sum;
}

static double field_at(const Field *field, double x, double y)
{
    double sum = 0, waves[WAVES]; /* which are summed apart: several are computed at once */
    for (int k = 0; k < WAVES; k++)
        waves[k] = cosine_of_turns(field->east[k] * x + field->north[k] * y + field->phase[k]);
    for (int k = 0; k < WAVES; k++) sum += waves[k];
    return sum * sqrt(2.0 / WAVES);
}

static inline double log10_of(double x) { return log_of(x, 0) * 0.43429448190325182765; }
/* Below 22.5 m the aircraft is TR 38.901's base station and the device its terminal; above it is the
   terminal of TR 36.777, whose base stations are not that high. Nearer than 10 m its formulas are
   continued. */
static double path_loss(const City *at, double flat, double height, double device, int sight)
{
    const double far = larger(size3(flat, height - device, 0), 1), d = log10_of(far);
    const double f = 20 * log10_of(at->carrier), slope = at->macro ? 22 : 21;
    const double base = (at->macro ? 28 : 32.4) + f;
    if (height <= 22.5) {
        const double over = larger(height - 1, 0.5), above = larger(device - 1, 0.5);
        const double corner = 4 * over * above * at->carrier / 0.299792458; /* d'_BP */
        const double rise = height - device, bend = log10_of(corner * corner + rise * rise);
        const double seen = flat < corner ? base + slope * d
                                          : base + 40 * d - (at->macro ? 9 : 9.5) * bend;
        if (sight) return seen;
        const double unseen =
            at->macro ? 13.54 + 39.08 * d + f - 0.6 * (device - 1.5)
                      : 22.4 + 35.3 * d + 1.065 * f - 0.3 * (device - 1.5);
        return larger(seen, unseen);
    }
    const double up = log10_of(height < 300 ? height : 300);
    if (at->macro) {
        if (sight) return base + 22 * d;
        const double low = height < 100 ? up : 2; /* all is in sight above that */
        return -17.5 + (46 - 7 * low) * d + f + 20 * log10_of(40 * PI / 3);
    }
    const double free_space = 20 * log10_of(40 * PI / 2.99792458) + 20 * d + f;
    const double seen = larger(free_space, 30.9 + (22.25 - 0.5 * up) * d + f);
    return sight ? seen : larger(seen, 32.4 + (43.2 - 7.6 * up) * d + f);
}

/* Standard deviation of the shadowing, and its correlation distance (TR 38.901, table 7.5-6). */
static double shadowing(const City *at, double height, int sight, int indoors, double *correlation)
{
    *correlation = indoors ? 7 : at->macro ? (sight ? 37 : 50) : (sight ? 10 : 13);
    if (indoors) return 7;
    if (height <= 22.5) return sight ? 4 : at->macro ? 6 : 7.82;
    if (!sight) return at->macro ? 6 : 8;
    const double fades = exp_of_negative(-(at->macro ? 0.0066 : 0.01) * height);
    return at->macro ? 4.64 * fades : larger(5 * fades, 2);
}

/* A path from a sender to the aircraft. */
typedef struct {
    double gain, deviation; /* of the shadowing */
    int seen, indoors;      /* seen: nothing is in the way but the building that the sender is in */
} Path;

static Path path_of(const City *city, int64_t sender, const double to[3])
{
    const double *from = city->devices[sender], height = larger(to[2], 0);
    const double x = to[0] - from[0], y = to[1] - from[1], z = to[2] - from[2];
    const double flat = size3(x, y, 0), out = way_out(&city->buildings, from, to);
    /* The outdoor part begins a micrometre behind the wall, so that this one is not in its way. */
    const double at = out + (out > 0 ? 1e-6 / larger(size3(x, y, z), 1e-6) : 0);
    const double wall[3] = {from[0] + at * x, from[1] + at * y, from[2] + at * z};
    double correlation;
    Path path = {.seen = at >= 1 || !hidden(&city->buildings, wall, to), .indoors = out > 0};
    path.gain = -path_loss(city, flat, height, from[2], path.seen);
    path.deviation = shadowing(city, height, path.seen, path.indoors, &correlation);
    if (path.indoors) path.gain -= city->entries[sender] + 0.5 * out * flat;
    if (city->fields) {
        const Field *field = &city->fields[sender][!path.seen && !path.indoors];
        path.gain += path.deviation * field_at(field, to[0] / correlation, to[1] / correlation);
    }
    return path;
}

#endif
