/* PX4's simulator protocol: the two MAVLink messages that go each way at every tick. */
#ifndef HIL_H
#define HIL_H

#include <string.h>

#include "bridge.h"

enum {
    V1 = 0xfe, V2 = 0xfd,
    SYSTEM = 142, COMPONENT = 1, /* of the simulator; PX4 looks at neither */
    SENSOR_ID = 107, SENSOR_SIZE = 64, SENSOR_EXTRA = 108,
    GPS_ID = 113, GPS_SIZE = 36, GPS_EXTRA = 124,
    CONTROLS_ID = 93, CONTROLS_EXTRA = 47,
    ACCEL_GYRO = 0x3f, /* of HIL_SENSOR.fields_updated */
    LOCKSTEP = 1 /* of HIL_ACTUATOR_CONTROLS.flags */
};

/* CRC-16/MCRF4XX, and the byte that each message adds. */
static uint16_t checksum(const uint8_t *data, int64_t size, uint8_t extra)
{
    uint16_t crc = 0xffff;
    for (int64_t i = 0; i <= size; i++) {
        uint8_t byte = (i < size ? data[i] : extra) ^ (uint8_t)crc;
        byte ^= (uint8_t)(byte << 4);
        crc = (uint16_t)((crc >> 8) ^ (byte << 8) ^ (byte << 3) ^ (byte >> 4));
    }
    return crc;
}

static uint8_t *put_floats(uint8_t *at, const double *values, int count)
{
    for (int i = 0; i < count; i++, at += 4) {
        const float value = (float)values[i];
        memcpy(at, &value, 4);
    }
    return at;
}

/* A payload, its zeros at the end kept, as a frame; where that ends. Numbers are the processor's,
   little-endian as on every one that we build for. */
static uint8_t *put_frame(Hil *link, uint8_t *frame, uint8_t id, const uint8_t *payload, int size,
                          uint8_t extra)
{
    const uint8_t head[10] = {
        V2, (uint8_t)size, 0, 0, (uint8_t)link->sequence++, SYSTEM, COMPONENT, id};
    memcpy(frame, head, 10);
    memcpy(frame + 10, payload, (size_t)size);
    const uint16_t crc = checksum(frame + 1, 9 + size, extra);
    memcpy(frame + 10 + size, &crc, 2);
    return frame + 12 + size;
}

static uint8_t *put_sensor(Hil *link, uint8_t *frame)
{
    HilSensor *s = &link->sensor;
    const uint32_t fields = (uint32_t)s->fields | ACCEL_GYRO;
    const double differential_hpa = 0.0; /* there is no such sensor: `fields` never says so */
    uint8_t payload[SENSOR_SIZE] = {0};
    memcpy(payload, &s->t_us, 8);
    uint8_t *at = put_floats(payload + 8, s->sample + 3, 3);
    at = put_floats(at, s->sample, 3);
    at = put_floats(at, s->field_gauss, 3);
    at = put_floats(at, &s->pressure_hpa, 1);
    at = put_floats(at, &differential_hpa, 1);
    at = put_floats(at, &s->height_m, 1);
    at = put_floats(at, &s->temperature_c, 1);
    memcpy(at, &fields, 4);
    s->fields = 0;
    memset(s->field_gauss, 0, sizeof s->field_gauss);
    s->pressure_hpa = s->height_m = 0;
    return put_frame(link, frame, SENSOR_ID, payload, SENSOR_SIZE, SENSOR_EXTRA);
}

/* Of the whole frame at `at`; 0 where it is another message, or damaged. */
static int read_controls(Hil *link, const uint8_t *at, int *lockstep)
{
    const int64_t end = 10 + at[1];
    uint8_t payload[255] = {0}; /* MAVLink 2 leaves zeros at the end out */
    uint16_t crc;
    memcpy(&crc, at + end, 2);
    if (checksum(at + 1, end - 1, CONTROLS_EXTRA) != crc) return 0;
    memcpy(payload, at + 10, at[1]);
    uint64_t flags;
    float controls[4];
    memcpy(&link->answered_us, payload, 8);
    memcpy(&flags, payload + 8, 8);
    memcpy(controls, payload + 16, sizeof controls);
    for (int i = 0; i < 4; i++) link->motors[i] = (double)controls[i];
    *lockstep = (flags & LOCKSTEP) != 0;
    return 1;
}

/* Read what is in the stream; all but controls, whole or damaged, is passed over. */
static int take_controls(Hil *link)
{
    const uint8_t *at = link->stream, *const end = at + link->size;
    int lockstep = 1;
    for (;;) {
        while (at < end && *at != V1 && *at != V2) at++;
        if (end - at < 12) break;
        const int64_t size = at[1] + (*at == V1 ? 8 : 12 + 13 * (at[2] & 1));
        if (end - at < size) break;
        const int controls =
            *at == V2 && at[7] == CONTROLS_ID && at[8] == 0 && at[9] == 0;
        if (!controls || read_controls(link, at, &lockstep)) at += size;
        else at++; /* damaged: the next frame may begin inside of it */
        if (!lockstep) return FREE_RUNNING;
    }
    link->size = end - at;
    memmove(link->stream, at, (size_t)link->size);
    return link->answered_us >= link->sent_us ? ORDERED : NOTHING;
}

#endif
