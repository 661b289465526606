/* What one device does: local training; and what a model gets right. Compiled once for every kind
   of processor, as LEVEL names it. */

#include "levelled.h"
#include "network.h"
#include "normal.h"

/* v = m v + g + mu (w - w_global), w -= eta v, and g = 0. */
static void descend(const Passage *net, const float *correction, Rates rates)
{
    const Lanes mu = splat(rates.mu), momentum = splat(rates.momentum);
    const Lanes down = splat(-rates.learning_rate), zero = splat(0.0f);
    for (int64_t i = 0; correction && i < net->parameters; i++) net->slopes[i] += correction[i];
    for (int64_t i = 0; i < net->parameters; i += WIDTH) {
        Lanes weight = load(net->weights + i);
        Lanes slope =
            multiply_add(mu, subtract(weight, load(net->anchor + i)), load(net->slopes + i));
        Lanes velocity = multiply_add(momentum, load(net->velocity + i), slope);
        store(net->velocity + i, velocity);
        store(net->weights + i, multiply_add(down, velocity, weight));
        store(net->slopes + i, zero);
    }
}

static int train(const Network *shape, const Images *images, const int64_t *order, int64_t steps,
                 int64_t batch, const float *correction, const Rates *rates, float *weights,
                 double *mean)
{
    Passage net;
    double sum = 0.0;
    if (!open_passage(&net, shape, weights)) return -1;
    memcpy(net.anchor, net.weights, (size_t)net.parameters * sizeof(float));
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
        descend(&net, correction, *rates);
    }
    memcpy(weights, net.weights, (size_t)net.parameters * sizeof(float));
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

static int normal_shares(int64_t count, double *numbers)
{
    for (int64_t i = 0; i < count; i++) numbers[i] = normal_share(numbers[i]);
    return 0;
}

const Learning NAMED(learning) = {train, count_correct, normal_shares};
