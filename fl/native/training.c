/* What one device does: local training; and what a model gets right. Compiled once for every kind
   of processor, as LEVEL names it. */

#include "exported.h"
#include "network.h"

/* What the steps of a training change and keep, (P,) each. */
typedef struct {
    float *weights, *velocity, *gradients;
    const float *anchor, *correction; /* the global model; NULL, or added to every gradient */
} Vectors;

/* v = m v + g + mu (w - w_global), w -= eta v, and g = 0, for a register of parameters. */
INLINE void descend_lanes(const Vectors *vectors, const Rates *rates, int64_t i)
{
    const Lanes weight = load(vectors->weights + i);
    Lanes gradient = load(vectors->gradients + i);
    if (vectors->correction) gradient += load(vectors->correction + i);
    gradient = multiply_add(splat(rates->mu), weight - load(vectors->anchor + i), gradient);
    const Lanes velocity = multiply_add(splat(rates->momentum), load(vectors->velocity + i), gradient);
    store(vectors->velocity + i, velocity);
    store(vectors->weights + i, multiply_add(splat(-rates->learning_rate), velocity, weight));
    store(vectors->gradients + i, splat(0.0f));
}

/* The same for all parameters; those behind the last whole vector take turns in one of their own. */
static void descend(const Vectors *vectors, const Rates *rates, int64_t parameters)
{
    const int64_t whole = parameters - parameters % WIDTH;
    const size_t left = (size_t)(parameters - whole) * sizeof(float);
    float weights[WIDTH] = {0}, velocity[WIDTH] = {0}, gradients[WIDTH] = {0};
    float anchor[WIDTH] = {0}, correction[WIDTH] = {0};
    const Vectors rest = {
        weights, velocity, gradients, anchor, vectors->correction ? correction : NULL};
    for (int64_t i = 0; i < whole; i += LENGTH) descend_lanes(vectors, rates, i);
    memcpy(weights, vectors->weights + whole, left);
    memcpy(velocity, vectors->velocity + whole, left);
    memcpy(gradients, vectors->gradients + whole, left);
    memcpy(anchor, vectors->anchor + whole, left);
    if (vectors->correction) memcpy(correction, vectors->correction + whole, left);
    for (int64_t i = 0; i < WIDTH; i += LENGTH) descend_lanes(&rest, rates, i);
    memcpy(vectors->weights + whole, weights, left);
    memcpy(vectors->velocity + whole, velocity, left);
    memcpy(vectors->gradients + whole, gradients, left);
}

static int train(const Network *shape, const Images *images, const int64_t *order, int64_t steps,
                 int64_t batch, const float *model, const float *correction, const Rates *rates,
                 float *weights, double *mean)
{
    Passage net;
    double sum = 0.0;
    if (!open_passage(&net, shape, weights)) return -1;
    const Vectors vectors = {weights, net.velocity, net.gradients, model, correction};
    memcpy(weights, model, (size_t)net.parameters * sizeof(float));
    for (int64_t step = 0; step < steps; step++, order += batch) {
        int64_t real = 0;
        while (real < batch && order[real] >= 0) real++;
        for (int64_t start = 0; start < real; start += WIDTH) {
            int64_t chosen[WIDTH];
            for (int64_t lane = 0; lane < WIDTH; lane++)
                chosen[lane] = start + lane < real ? order[start + lane] : -1;
            fill(&net, images, chosen);
            forward(&net);
            sum += loss(&net, 1.0 / (double)real);
            backward(&net);
        }
        descend(&vectors, rates, net.parameters);
    }
    close_passage(&net);
    *mean = sum / (double)steps;
    return 0;
}

static int count_correct(const Network *shape, const Images *images, const float *weights,
                         int64_t *correct)
{
    Passage net;
    if (!open_passage(&net, shape, weights)) return -1;
    for (int64_t start = 0; start < images->count; start += WIDTH) {
        int64_t chosen[WIDTH];
        for (int64_t lane = 0; lane < WIDTH; lane++)
            chosen[lane] = start + lane < images->count ? start + lane : -1;
        fill(&net, images, chosen);
        forward(&net);
        for (int lane = 0; lane < WIDTH && chosen[lane] >= 0; lane++) {
            int64_t best = 0;
            for (int64_t j = 1; j < net.classes; j++)
                if (net.logits[j * WIDTH + lane] > net.logits[best * WIDTH + lane]) best = j;
            correct[net.labels[lane]] += best == net.labels[lane];
        }
    }
    close_passage(&net);
    return 0;
}

static int average_per(const Channel *channel, int64_t count, const double *distance,
                       const double *height, double *per)
{
    for (int64_t i = 0; i < count; i++) per[i] = per_at(channel, distance[i], height[i]);
    return 0;
}

static int gains(const City *city, int64_t count, const int64_t *sender,
                 const double (*places)[3], double *gain, double *deviation, uint8_t *seen,
                 uint8_t *indoors)
{
    for (int64_t i = 0; i < count; i++) {
        const Path path = path_of(city, sender[i], places[i]);
        gain[i] = path.gain;
        deviation[i] = path.deviation;
        seen[i] = (uint8_t)path.seen;
        indoors[i] = (uint8_t)path.indoors;
    }
    return 0;
}

static int normal_shares(int64_t count, const double *value, double *share)
{
    for (int64_t i = 0; i < count; i++) share[i] = normal_share(value[i]);
    return 0;
}

const Learning NAMED(learning) = {
    .train = train, .count_correct = count_correct, .average_per = average_per, .gains = gains,
    .normal_shares = normal_shares};
