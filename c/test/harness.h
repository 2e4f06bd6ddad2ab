/* What the tests share: checks, a clock, a port, and calls over it. */
#ifndef HARNESS_H
#define HARNESS_H

#include "armwire.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Ends the test unless the condition holds. */
#define CHECK(condition)                                                                                              \
    do {                                                                                                              \
        if (!(condition)) {                                                                                           \
            fprintf(stderr, "%s:%d: failed: %s\n", __FILE__, __LINE__, #condition);                                   \
            exit(1);                                                                                                  \
        }                                                                                                             \
    } while (0)

#define CHECK_OK(call) CHECK((call) == ARMWIRE_STATUS_OK)

/* Random numbers, the same in every run. */
typedef struct Random {
    uint64_t state;
} Random;

uint32_t random_below(Random *random, uint32_t bound);

/* A line to an arm, and the bytes that went over it. */
typedef struct Port {
    int fd;
    /* The most bytes of one write: fewer than a frame has, to test what is left of it. */
    size_t write_most;
    uint64_t out;
    uint64_t in;
} Port;

/* A serial port or pseudo-terminal by its path, or a TCP connection by ADDRESS:PORT. */
Port port_open(const char *name);
/* Takes what has arrived, which nobody waits for, until the line has been silent for this long, and closes the port. */
void port_close(Port *port, unsigned silence_ms);
size_t port_write(Port *port, const uint8_t *bytes, size_t len);
/* Waits for bytes until this time, and returns how many came: 0 if none did. */
size_t port_read(Port *port, uint8_t *room, size_t len, uint64_t until_us);

/* Microseconds of a clock that does not go back. */
uint64_t now_us(void);

/* Events that end no request. */
typedef struct Others {
    unsigned noise, late, unsolicited, echo, unknown;
} Others;

/* Counts an event, and says whether it ends the request in flight. */
bool ends_request(const ArmwireEvent *event, Others *others);

/* Defines NAME_call, which does what the client says until its request has ended. */
#define DEFINE_CALL(name, Name)                                                                                       \
    static ArmwireEvent name##_call(Armwire##Name##Client *client, Port *port, Armwire##Name##Response *response,    \
                                    Others *others)                                                                   \
    {                                                                                                                 \
        for (;;) {                                                                                                    \
            ArmwireEvent event;                                                                                       \
            CHECK_OK(armwire_##name##_client_poll(client, now_us(), &event, response));                               \
            if (event.kind == ARMWIRE_EVENT_KIND_TRANSMIT) {                                                          \
                size_t sent = port_write(port, event.bytes, event.len);                                               \
                CHECK_OK(armwire_##name##_client_transmitted(client, now_us(), sent));                                \
            } else if (event.kind == ARMWIRE_EVENT_KIND_WAIT) {                                                       \
                uint8_t *room;                                                                                        \
                size_t len;                                                                                           \
                CHECK(event.until_us != UINT64_MAX);                                                                  \
                CHECK_OK(armwire_##name##_client_space(client, &room, &len));                                         \
                CHECK(len > 0);                                                                                       \
                size_t got = port_read(port, room, len, event.until_us);                                              \
                CHECK_OK(armwire_##name##_client_received(client, now_us(), got));                                    \
            } else if (ends_request(&event, others)) {                                                                \
                return event;                                                                                         \
            }                                                                                                         \
        }                                                                                                             \
    }

#endif
