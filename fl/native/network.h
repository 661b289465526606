/* A network for 16 images: there and back. */
#ifndef NETWORK_H
#define NETWORK_H

#include "arena.h"
#include "convolution.h"
#include "dense.h"
#include "elementary.h"
#include "learning.h"

/* A block of the network with what passes through it. */
typedef struct {
    int64_t kernel, padding;
    const float *weights, *bias;       /* within the flat vector of parameters */
    float *weight_gradients, *bias_gradients;
    Maps input;                        /* with a border of zeros, `padding` wide */
    Maps winner;                       /* which of 2x2 places went through */
    Maps before;                       /* gradients before pooling, with a border of zeros */
    Maps back;                         /* gradients in the input; not of the first block */
    float *turned;                     /* weights */
} Block;

typedef struct {
    int64_t inputs, outputs;
    const float *weights, *bias;
    float *weight_gradients, *bias_gradients;
    float *features, *gradients; /* (inputs, lane); the outputs follow */
} Layer;

typedef struct {
    Block block[MOST_BLOCKS];
    Layer layer[MOST_LAYERS];
    int64_t blocks, layers, classes, parameters;
    Maps image;              /* where the images go, with a border */
    int64_t border;
    float *gradients, *velocity; /* (parameters,) */
    float *logits, *logit_gradients; /* (classes, lane) */
    float *turned;                /* features, see `turn_features` */
    int64_t labels[WIDTH];        /* of the images, -1 where there is none */
    Arena arena;
} Passage;

static float *claim_floats(Arena *arena, int64_t count) { return claim(arena, count, sizeof(float)); }

static Maps claim_maps(Arena *arena, int64_t channels, int64_t height, int64_t width)
{
    return (Maps){claim_floats(arena, channels * height * width * WIDTH), channels, height, width};
}

static int64_t padded(int64_t count) { return (count + WIDTH - 1) / WIDTH * WIDTH; }

static float *offset(float *at, int64_t count) { return at ? at + count : NULL; }

static void lay_out_block(Passage *net, const Network *shape, int64_t b, Arena *arena, Maps from)
{
    Block *block = &net->block[b];
    const int64_t kernel = shape->kernel[b], padding = shape->padding[b], maps = shape->maps[b];
    const int64_t height = (from.height + 2 * padding - kernel + 1) / 2;
    const int64_t width = (from.width + 2 * padding - kernel + 1) / 2;
    const int64_t even_height = from.height + from.height % 2, even_width = from.width + from.width % 2;
    block->kernel = kernel;
    block->padding = padding;
    block->input =
        claim_maps(arena, from.channels, from.height + 2 * padding, from.width + 2 * padding);
    block->winner = claim_maps(arena, maps, height, width);
    if (b == 0) {
        block->before = claim_maps(arena, maps, 2 * height, 2 * width);
        return;
    }
    block->before = claim_maps(arena, maps, even_height + kernel - 1, even_width + kernel - 1);
    block->back = claim_maps(arena, from.channels, even_height, even_width);
    block->turned = claim_floats(arena, from.channels * maps * kernel * kernel);
}

static void lay_out(Passage *net, const Network *shape, Arena *arena)
{
    Maps from = {NULL, shape->channels, shape->height, shape->width};
    net->blocks = shape->blocks;
    net->layers = shape->layers;
    net->parameters = 0;
    for (int64_t b = 0; b < shape->blocks; b++) {
        lay_out_block(net, shape, b, arena, from);
        net->parameters += shape->maps[b] * (from.channels * shape->kernel[b] * shape->kernel[b] + 1);
        from = net->block[b].winner;
    }
    const int64_t pooled = from.channels * from.height * from.width;
    int64_t rows = pooled, widest = pooled, inputs = pooled;
    for (int64_t i = 0; i < shape->layers; i++) {
        const int64_t outputs = shape->outputs[i];
        net->layer[i].inputs = inputs;
        net->layer[i].outputs = outputs;
        net->parameters += outputs * (inputs + 1);
        rows += outputs;
        widest = inputs > widest ? inputs : widest;
        inputs = outputs;
    }
    net->classes = inputs;
    float *features = claim_floats(arena, rows * WIDTH), *gradients = claim_floats(arena, rows * WIDTH);
    for (int64_t i = 0; i < shape->layers; i++) {
        net->layer[i].features = features;
        net->layer[i].gradients = gradients;
        features = offset(features, net->layer[i].inputs * WIDTH);
        gradients = offset(gradients, net->layer[i].inputs * WIDTH);
    }
    net->logits = features;
    net->logit_gradients = gradients;
    net->image = shape->blocks ? net->block[0].input
                               : (Maps){net->layer[0].features, from.channels, from.height, from.width};
    net->border = shape->blocks ? shape->padding[0] : 0;
    net->turned = claim_floats(arena, padded(widest) * WIDTH);
    net->gradients = claim_floats(arena, net->parameters);
    net->velocity = claim_floats(arena, net->parameters);
}

static void place_parameters(Passage *net, const float *weights)
{
    float *gradients = net->gradients;
    for (int64_t b = 0; b < net->blocks; b++) {
        Block *block = &net->block[b];
        const int64_t maps = block->winner.channels;
        const int64_t size = maps * block->input.channels * block->kernel * block->kernel;
        block->weights = weights;
        block->weight_gradients = gradients;
        block->bias = weights + size;
        block->bias_gradients = gradients + size;
        weights += size + maps;
        gradients += size + maps;
    }
    for (int64_t i = 0; i < net->layers; i++) {
        Layer *layer = &net->layer[i];
        const int64_t size = layer->inputs * layer->outputs;
        layer->weights = weights;
        layer->weight_gradients = gradients;
        layer->bias = weights + size;
        layer->bias_gradients = gradients + size;
        weights += size + layer->outputs;
        gradients += size + layer->outputs;
    }
}

/* A network with weights (P,) that stay the caller's; 0 where there is too little memory. */
static int open_passage(Passage *net, const Network *shape, const float *weights)
{
    memset(net, 0, sizeof *net);
    lay_out(net, shape, &net->arena);
    if (!provide(&net->arena)) return 0;
    lay_out(net, shape, &net->arena);
    place_parameters(net, weights);
    return 1;
}

static void close_passage(Passage *net) { release(&net->arena); }

INLINE void fill_pixels(const Passage *net, const Images *images, const int64_t *chosen, int bytes)
{
    const Maps *maps = &net->image;
    const int64_t depth = maps->channels;
    const int64_t height = maps->height - 2 * net->border, width = maps->width - 2 * net->border;
    /* Row by row, so that what is written 16 times stays in the nearest cache. */
    for (int64_t y = 0; y < height; y++)
        for (int64_t c = 0; c < depth; c++) {
            float *out = place(maps, c, y + net->border, net->border);
            const Lanes a = splat(images->scale[c]), b = splat(images->shift[c]);
            for (int lane = 0; lane < WIDTH; lane++) {
                if (chosen[lane] < 0) continue;
                const int64_t at = ((chosen[lane] * height + y) * width) * depth + c;
                for (int64_t x = 0; x < width; x++)
                    out[x * WIDTH + lane] =
                        bytes ? (float)images->bytes[at + x * depth] : images->floats[at + x * depth];
            }
            for (int64_t i = 0; i < width * WIDTH; i += LENGTH)
                store(out + i, multiply_add(load(out + i), a, b));
        }
}

/* Scaled images of the indices `chosen` (16,); what is in the lanes of negative ones does not
   matter, nobody looks there. */
static void fill(Passage *net, const Images *images, const int64_t *chosen)
{
    if (images->bytes)
        fill_pixels(net, images, chosen, 1);
    else
        fill_pixels(net, images, chosen, 0);
    for (int lane = 0; lane < WIDTH; lane++)
        net->labels[lane] = chosen[lane] < 0 ? -1 : images->labels[chosen[lane]];
}

/* From the images to the logits. */
static void forward(const Passage *net)
{
    for (int64_t b = 0; b < net->blocks; b++) {
        const Block *block = &net->block[b];
        const Maps *winner = &block->winner;
        if (b + 1 < net->blocks)
            convolve((int)block->kernel, &block->input, block->weights, block->bias,
                     block[1].padding, &block[1].input, winner);
        else {
            Maps pooled = {net->layer[0].features, winner->channels, winner->height, winner->width};
            convolve((int)block->kernel, &block->input, block->weights, block->bias, 0, &pooled,
                     winner);
        }
    }
    for (int64_t i = 0; i < net->layers; i++) {
        const Layer *layer = &net->layer[i];
        dense_forward(layer->outputs, layer->inputs, layer->features, layer->weights, layer->bias,
                      i + 1 < net->layers, layer->features + layer->inputs * WIDTH);
    }
}

/* Sum of `share` times the cross-entropy of the images whose label is not negative; its gradients
   go to the logits'. */
static double loss(const Passage *net, double share)
{
    double value = 0.0;
    for (int lane = 0; lane < WIDTH; lane++) {
        const float *logit = net->logits + lane;
        float *gradient = net->logit_gradients + lane;
        const int64_t label = net->labels[lane];
        if (label < 0) {
            for (int64_t j = 0; j < net->classes; j++) gradient[j * WIDTH] = 0.0f;
            continue;
        }
        double top = logit[0], sum = 0.0;
        for (int64_t j = 1; j < net->classes; j++)
            if (logit[j * WIDTH] > top) top = logit[j * WIDTH];
        for (int64_t j = 0; j < net->classes; j++) sum += exp_of_negative(logit[j * WIDTH] - top);
        value += share * (top + log_of(sum, 0) - logit[label * WIDTH]);
        for (int64_t j = 0; j < net->classes; j++) {
            double part = exp_of_negative(logit[j * WIDTH] - top) / sum;
            gradient[j * WIDTH] = (float)(share * (j == label ? part - 1.0 : part));
        }
    }
    return value;
}

/* From the gradients in the logits to those in the weights, which are added to. */
static void backward(const Passage *net)
{
    for (int64_t i = net->layers - 1; i >= 0; i--) {
        const Layer *layer = &net->layer[i];
        const float *down = layer->gradients + layer->inputs * WIDTH;
        add_dense_gradients(layer->outputs, layer->inputs, layer->features, down, net->turned,
                            layer->weight_gradients, layer->bias_gradients);
        if (i == 0 && net->blocks == 0) return;
        dense_input_gradients(layer->outputs, layer->inputs, down, layer->weights, layer->gradients);
        if (i > 0) stop_gradients(layer->inputs, layer->features, layer->gradients);
    }
    for (int64_t b = net->blocks - 1; b >= 0; b--) {
        const Block *block = &net->block[b];
        const int kernel = (int)block->kernel;
        const Maps *winner = &block->winner;
        const Maps pooled = {net->layer[0].gradients, winner->channels, winner->height, winner->width};
        const int64_t border = b ? block->kernel - 1 - block->padding : 0;
        unpool(b + 1 < net->blocks ? &block[1].back : &pooled, winner, border, &block->before,
               block->bias_gradients);
        add_kernel_gradients(kernel, &block->input, &block->before, border, 2 * winner->height,
                             2 * winner->width, block->weight_gradients);
        if (b == 0) return;
        turn(kernel, winner->channels, block->input.channels, block->weights, block->turned);
        correlate(kernel, &block->before, block->turned, &block->back);
    }
}

#endif
