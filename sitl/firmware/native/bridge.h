/* The firmwares' ends of a tick: wait for what is ordered, have the aircraft stepped, send what the
   sensors say.

   Many ticks a call, with what is sent and read in structures that Python fills and reads
   (`library.py`). Sockets are blocking; the kernel ends a wait after a while (SO_RCVTIMEO,
   SO_SNDTIMEO). */
#ifndef BRIDGE_H
#define BRIDGE_H

#include <stdint.h>

/* What came of a call. */
enum { NOTHING, ORDERED, GONE, FREE_RUNNING, RESTARTED, FAILED };

enum { MOST_FRAME = 280 };

enum { TRUTHS = 15, MOTORS = 4 }; /* numbers of a row, one after the other */

/* The truth at the end of each interval: by its number, modulo the number of rows. */
typedef struct {
    double (*rows)[TRUTHS + MOTORS];
    int64_t *instants; /* ns */
    int64_t count, interval_ns, newest;
} Ring;

/* The aircraft, by what the library of `flightdyn` exports; and Python's lock, which stepping it
   takes and waiting must not keep. */
typedef struct {
    int (*drive)(void *driven, const double motors[4], double sample[6]);
    int (*read_gauges)(const void *interpreter, const void *gauges, int64_t count, double *values);
    void *(*let_go)(void);
    void (*take)(void *);
    void *driven;
    const void *interpreter, *gauges; /* (15,) position, velocity, Euler angles first */
    Ring *ring;
    int64_t t_ns, dt_ns; /* of the last tick, of each */
} World;

typedef struct { /* HIL_SENSOR; SI units but where it has others */
    uint64_t t_us;
    double sample[6]; /* body rates, specific force */
    double field_gauss[3], pressure_hpa, height_m; /* used where `fields` says so */
    double temperature_c;
    uint64_t fields; /* ordered for the next frame only, besides rates and forces */
} HilSensor;

typedef struct { /* PX4 behind a TCP connection */
    World world;
    HilSensor sensor;
    double motors[4]; /* duty cycles; all 0 while disarmed */
    uint64_t sent_us, answered_us;
    int64_t socket, error, sequence;
    int64_t came; /* of the ticks that were asked for last */
    int64_t size; /* of what is in the stream */
    int64_t left; /* of what is to be sent, at its beginning */
    uint8_t stream[4096], out[2 * MOST_FRAME];
} Hil;

typedef struct { /* ArduPilot behind a UDP socket */
    World world;
    double sample[6], state[9]; /* the IMU's; position, velocity, attitude without errors */
    double errors[6];           /* of position and velocity */
    double motors[4];           /* duty cycles */
    int64_t count, answered;    /* of the request, and of the one that was answered last */
    int64_t asked;              /* whether the request came while time stood still */
    int64_t came;               /* of the ticks that were asked for last */
    int64_t socket, peer;       /* address and port that are answered; 0: nobody has asked yet */
    int64_t length, magic;      /* of the newest datagram that was no request; length -1: none */
    int64_t size;               /* of the reply */
    uint8_t reply[1024];
} Json;

/* Both of these take ticks, each when the firmware asks for it, and answer all but the last. They
   return how many were taken; `came` becomes ORDERED, or why there were no more: NOTHING for a moment;
   GONE, with `error`; FREE_RUNNING where the firmware does not wait for our clock; RESTARTED; FAILED
   where the aircraft could not be stepped. */
int hil_run(Hil *link, int64_t ticks);
int json_run(Json *link, int64_t ticks);

/* ORDERED where the last tick is answered; else as above. */
int hil_wait(Hil *link, int blocking);
/* A tick that PX4 has not asked for: it boots. Whether the aircraft could be stepped. */
int hil_tick(Hil *link);
/* The sensors' frame, after one with a payload of HIL_GPS if there is one; ORDERED, NOTHING where
   the kernel has not taken all of it yet, or GONE. */
int hil_send(Hil *link, const uint8_t *gps);

int json_wait(Json *link);
void json_send(Json *link);

#endif
