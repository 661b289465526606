/* What Python calls. See bridge.h. */

#include "bridge.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

#define EXPORTED __attribute__((visibility("default")))

#include "hil.h"
#include "json.h"

/* All of it, however often the kernel takes a part; 0, or errno. */
static int send_all(int socket, const uint8_t *data, size_t size)
{
    while (size > 0) {
        const ssize_t sent = send(socket, data, size, 0);
        if (sent < 0 && errno != EINTR) return errno;
        if (sent > 0) {
            data += sent;
            size -= (size_t)sent;
        }
    }
    return 0;
}

static int gone(Hil *link, int error)
{
    link->error = error;
    return GONE;
}

EXPORTED int hil_wait(Hil *link, int blocking)
{
    if (link->answered_us >= link->sent_us && link->sent_us > 0) return ORDERED;
    uint8_t *end = link->stream + link->size;
    const size_t room = sizeof link->stream - (size_t)link->size;
    const ssize_t size = recv((int)link->socket, end, room, blocking ? 0 : MSG_DONTWAIT);
    if (size == 0) return gone(link, 0);
    if (size < 0) {
        const int nothing = errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
        return nothing ? NOTHING : gone(link, errno);
    }
    link->size += size;
    return take_controls(link);
}

EXPORTED int hil_send(Hil *link, const uint8_t *gps)
{
    uint8_t frames[2 * MOST_FRAME];
    uint8_t *end = frames;
    if (gps) end = put_frame(link, end, GPS_ID, gps, GPS_SIZE, GPS_EXTRA);
    end = put_sensor(link, end);
    link->sent_us = link->sensor.t_us;
    const int failed = send_all((int)link->socket, frames, (size_t)(end - frames));
    return failed ? gone(link, failed) : NOTHING;
}

EXPORTED int json_wait(Json *link)
{
    uint8_t request[256];
    const ssize_t size = recv((int)link->socket, request, sizeof request, 0);
    return size < 0 ? NOTHING : take_request(link, request, size);
}

EXPORTED void json_send(Json *link)
{
    put_state(link);
    json_repeat(link);
}

EXPORTED void json_repeat(Json *link)
{
    /* A firmware that has just ended is told of by its process. */
    send((int)link->socket, link->reply, (size_t)link->size, 0);
}
