/* ArduPilot's JSON interface: pulses come in, a line of text goes out. */
#ifndef JSON_H
#define JSON_H

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "bridge.h"

enum { MAGIC_16 = 18458, MAGIC_32 = 29569, IDLE_US = 1000, SPAN_US = 1000 };

/* Whether a datagram is a request, and its number. */
static int is_request(Json *link, const uint8_t *data, int64_t size, uint32_t *count)
{
    uint16_t magic = 0;
    if (size >= 2) memcpy(&magic, data, 2);
    const int channels = magic == MAGIC_16 ? 16 : magic == MAGIC_32 ? 32 : 0;
    if (channels == 0 || size != 8 + 2 * channels) {
        link->length = size;
        link->magic = magic;
        return 0;
    }
    memcpy(count, data + 4, 4);
    return 1;
}

static void take_pulses(Json *link, const uint8_t *request)
{
    uint16_t pulses[4];
    memcpy(pulses, request + 8, sizeof pulses);
    for (int i = 0; i < 4; i++) link->motors[i] = (pulses[i] - IDLE_US) / (double)SPAN_US;
}

static char *put_text(char *at, const char *text)
{
    const size_t size = strlen(text);
    memcpy(at, text, size);
    return at + size;
}

/* A number with `decimals` of them, as printf writes it but for the rounding of ties. */
static char *put_number(char *at, double value, int decimals)
{
    static const double SHIFT[] = {1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8};
    const double shifted = nearbyint(fabs(value) * SHIFT[decimals]);
    if (!(shifted < 1e17)) return at + snprintf(at, 32, "%.9g", value); /* no position, or none */
    char digits[24];
    uint64_t rest = (uint64_t)shifted;
    int count = 0;
    for (; rest > 0 || count <= decimals; rest /= 10) digits[count++] = (char)('0' + rest % 10);
    if (signbit(value)) *at++ = '-';
    while (count > 0) {
        if (count == decimals) *at++ = '.';
        *at++ = digits[--count];
    }
    return at;
}

static char *put_triple(char *at, const char *name, const double values[3], int decimals)
{
    at = put_text(at, name);
    for (int i = 0; i < 3; i++) {
        *at++ = i == 0 ? '[' : ','; /* ArduPilot looks for numbers without spaces between */
        at = put_number(at, values[i], decimals);
    }
    *at++ = ']';
    return at;
}

static void put_state(Json *link)
{
    double places[6];
    for (int i = 0; i < 6; i++) places[i] = link->state[i] + link->errors[i];
    char *at = put_text((char *)link->reply, "\n{\"timestamp\":");
    at = put_number(at, (double)link->world.t_ns * 1e-9, 6);
    at = put_triple(at, ",\"imu\":{\"gyro\":", link->sample, 8);
    at = put_triple(at, ",\"accel_body\":", link->sample + 3, 7);
    at = put_triple(at, "},\"position\":", places, 5);
    at = put_triple(at, ",\"velocity\":", places + 3, 5);
    at = put_triple(at, ",\"attitude\":", link->state + 6, 7);
    at = put_text(at, ",\"no_time_sync\":1}\n");
    link->size = at - (char *)link->reply;
}

#endif
