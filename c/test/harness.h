/* Shared by the tests: checks, a clock, a port, and calls over it. */
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

/* A virtual arm in its own process, the line to it, and the number of bytes on the line. */
typedef struct Port {
    int fd;
    /* Maximum number of bytes per write: less than a frame, to test partial writes. */
    size_t max_write;
    uint64_t out;
    uint64_t in;
    int process;
    FILE *output;
    /* The last line of the output. */
    char line[300];
} Port;

/* Starts `armwire sim` with these arguments, up to a NULL. `line` names the arm's port. */
Port arm_start(const char *armwire, const char *const *words);
/* Ends the arm. On a serial line, checks that both ends counted the same bytes. */
void arm_end(Port *port);
/* Writes the name of the arm's port. */
void arm_name(const Port *port, char *name, size_t size);
/* Starts an arm and connects to it. */
Port port_open(const char *armwire, const char *const *words);
/* Connects to the same arm again, after it closed the first connection. */
void port_reopen(Port *port);
/* Reads the remaining bytes, and ends the arm. */
void port_close(Port *port);
size_t port_write(Port *port, const uint8_t *bytes, size_t len);
/* Waits for bytes until this time, and returns their number. */
size_t port_read(Port *port, uint8_t *room, size_t len, uint64_t until_us);

/* Microseconds of a monotonic clock. */
uint64_t now_us(void);

/* Counts of events that do not end a request. */
typedef struct Others {
    unsigned noise, late, unsolicited, echo, unknown;
} Others;

/* Counts an event. Returns true if it ends the request in flight. */
bool ends_request(const ArmwireEvent *event, Others *others);

/* Defines NAME_call, which performs the actions of the client until its request has ended. */
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
            } else if (event.kind == ARMWIRE_EVENT_KIND_WAIT || event.kind == ARMWIRE_EVENT_KIND_RECEIVE) {           \
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
