/* What Python calls. See bridge.h. */

#include "bridge.h"
#include "exported.h"

#include <errno.h>
#include <netinet/in.h>
#include <string.h>
#include <sys/socket.h>

#include "hil.h"
#include "json.h"

/* Datagrams that are looked at in a call: nobody who sends many keeps it from returning. */
enum { AT_ONCE = 64 };

static int gone(Hil *link, int error)
{
    link->error = error;
    return GONE;
}

/* Whether an error of a socket says no more than that a moment has passed. */
static int moment(int error)
{
    return error == EAGAIN || error == EWOULDBLOCK || error == EINTR;
}

/* Send what is to be sent: ORDERED, NOTHING where PX4 takes no more of it for now, or GONE. */
static int flush(Hil *link)
{
    while (link->left > 0) {
        const ssize_t sent = send((int)link->socket, link->out, (size_t)link->left, 0);
        if (sent < 0) return moment(errno) ? NOTHING : gone(link, errno);
        link->left -= sent;
        memmove(link->out, link->out + sent, (size_t)link->left);
    }
    return ORDERED;
}

EXPORTED int hil_wait(Hil *link, int blocking)
{
    const int sent = flush(link);
    if (sent != ORDERED) return sent;
    if (link->answered_us >= link->sent_us && link->sent_us > 0) return ORDERED;
    uint8_t *end = link->stream + link->size;
    const size_t room = sizeof link->stream - (size_t)link->size;
    const ssize_t size = recv((int)link->socket, end, room, blocking ? 0 : MSG_DONTWAIT);
    if (size == 0) return gone(link, 0);
    if (size < 0) return moment(errno) ? NOTHING : gone(link, errno);
    link->size += size;
    return take_controls(link);
}

/* The next frames, after all those before them. */
static void put_frames(Hil *link, const uint8_t *gps)
{
    uint8_t *end = link->out;
    link->sensor.t_us = (uint64_t)(link->world.t_ns / 1000);
    if (gps) end = put_frame(link, end, GPS_ID, gps, GPS_SIZE, GPS_EXTRA);
    end = put_sensor(link, end);
    link->left = end - link->out;
    link->sent_us = link->sensor.t_us;
}

EXPORTED int hil_send(Hil *link, const uint8_t *gps)
{
    put_frames(link, gps);
    return flush(link);
}

/* The truth of this instant. A row is whole before it is the newest. */
static int keep(World *world, const double motors[MOTORS])
{
    Ring *ring = world->ring;
    const int64_t number = world->t_ns / ring->interval_ns, slot = number % ring->count;
    ring->instants[slot] = world->t_ns;
    if (!world->read_gauges(world->interpreter, world->gauges, TRUTHS, ring->rows[slot])) return 0;
    memcpy(ring->rows[slot] + TRUTHS, motors, MOTORS * sizeof *motors);
    ring->newest = number;
    return 1;
}

static int step(World *world, const double motors[MOTORS], double sample[6])
{
    world->t_ns += world->dt_ns;
    if (!world->drive(world->driven, motors, sample)) return 0;
    return world->t_ns % world->ring->interval_ns != 0 || keep(world, motors);
}

EXPORTED int hil_tick(Hil *link)
{
    return step(&link->world, link->motors, link->sensor.sample);
}

EXPORTED int hil_run(Hil *link, int64_t ticks)
{
    for (int64_t done = 0;; done++) {
        if (done == ticks) return (int)done;
        if (done > 0) put_frames(link, NULL);
        void *lock = link->world.let_go();
        link->came = hil_wait(link, 1);
        link->world.take(lock);
        if (link->came == ORDERED && !hil_tick(link)) link->came = FAILED;
        if (link->came != ORDERED) return (int)done;
    }
}

static void json_repeat(Json *link)
{
    const struct sockaddr_in to = {.sin_family = AF_INET,
                                   .sin_port = (uint16_t)link->peer,
                                   .sin_addr.s_addr = (uint32_t)(link->peer >> 16)};
    /* A firmware that has just ended is told of by its process. */
    sendto((int)link->socket, link->reply, (size_t)link->size, 0, (const struct sockaddr *)&to,
           sizeof to);
}

EXPORTED int json_wait(Json *link)
{
    for (int i = 0; i < AT_ONCE; i++) {
        uint8_t data[256];
        struct sockaddr_in from = {0};
        socklen_t length = sizeof from;
        const ssize_t size =
            recvfrom((int)link->socket, data, sizeof data, 0, (struct sockaddr *)&from, &length);
        uint32_t count;
        if (size < 0) return NOTHING;
        if (!is_request(link, data, size, &count)) continue;
        const int64_t peer = (int64_t)from.sin_addr.s_addr << 16 | from.sin_port;
        const int other = link->peer != 0 && peer != link->peer;
        if (other && count > 0) continue; /* was left behind: a process that begins counts from 0 */
        link->peer = peer;
        if (other) return RESTARTED;
        link->count = count;
        take_pulses(link, data);
        if (link->count > link->answered) return ORDERED;
        if (link->count < link->answered) return RESTARTED;
        json_repeat(link); /* the reply was lost */
    }
    return NOTHING;
}

EXPORTED void json_send(Json *link)
{
    put_state(link);
    json_repeat(link);
}

EXPORTED int json_run(Json *link, int64_t ticks)
{
    World *world = &link->world;
    for (int64_t done = 0;; done++) {
        if (done == ticks) return (int)done;
        void *lock = world->let_go();
        if (done > 0) json_send(link);
        link->came = link->asked ? ORDERED : json_wait(link);
        world->take(lock);
        if (link->came != ORDERED) return (int)done;
        link->answered = link->count;
        link->asked = 0;
        if (!step(world, link->motors, link->sample) ||
            !world->read_gauges(world->interpreter, world->gauges, 9, link->state)) {
            link->came = FAILED;
            return (int)done;
        }
    }
}
