/* The firmwares' ends of a tick: wait for what is ordered, send what the sensors say.

   One call each way and tick, with what is sent and read in structures that Python fills and reads
   (`library.py`). Sockets are blocking; the kernel ends a wait after a while (SO_RCVTIMEO). */
#ifndef BRIDGE_H
#define BRIDGE_H

#include <stdint.h>

enum { NOTHING, ORDERED, GONE, FREE_RUNNING, FOREIGN }; /* what came of a call */

typedef struct { /* HIL_SENSOR; SI units but where it has others */
    uint64_t t_us;
    double rates[3], forces[3];
    double field_gauss[3], pressure_hpa, height_m; /* used where `fields` says so */
    double temperature_c;
    uint64_t fields; /* ordered for the next frame only, besides rates and forces */
} HilSensor;

typedef struct { /* PX4 behind a TCP connection */
    HilSensor sensor;
    double motors[4]; /* duty cycles; all 0 while disarmed */
    uint64_t sent_us, answered_us;
    int64_t socket, error, sequence;
    int64_t size; /* of what is in the stream */
    uint8_t stream[4096];
} Hil;

typedef struct { /* ArduPilot behind a connected UDP socket */
    double t_s, rates[3], forces[3], position[3], velocity[3], attitude[3];
    double motors[4]; /* duty cycles */
    int64_t count; /* of the request */
    int64_t socket, length, magic; /* of a request that is none */
    int64_t size; /* of the reply */
    uint8_t reply[1024];
} Json;

/* ORDERED where the last tick is answered, NOTHING where not yet; GONE, with `error`;
   FREE_RUNNING where the firmware does not wait for our clock. */
int hil_wait(Hil *link, int blocking);
/* The sensors' frame, after one with a payload of HIL_GPS if there is one; NOTHING, or GONE. */
int hil_send(Hil *link, const uint8_t *gps);

/* ORDERED, NOTHING, or FOREIGN where it is no request of ArduPilot. */
int json_wait(Json *link);
void json_send(Json *link);
void json_repeat(Json *link); /* the reply that was sent last */

#endif
