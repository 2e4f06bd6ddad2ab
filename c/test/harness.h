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

/* A virtual arm in a process of its own, the line to it, and the bytes that went over it. */
typedef struct Port {
    int fd;
    /* The most bytes of one write: fewer than a frame has, to test what is left of it. */
    size_t write_most;
    uint64_t out;
    uint64_t in;
    int process;
    FILE *says;
    /* What the arm said last. */
    char last[300];
} Port;

/* Starts `armwire sim` with these words, up to a NULL. `last` says where the arm is. */
Port arm_start(const char *armwire, const char *const *words);
/* Ends the arm, and on a serial line checks that both count the same bytes. */
void arm_end(Port *port);
/* Writes the name of the arm's port. */
void arm_name(const Port *port, char *name, size_t size);
/* Starts an arm and connects to it. */
Port port_open(const char *armwire, const char *const *words);
/* Another connection to the same arm, after it has closed the first one. */
void port_reopen(Port *port);
/* Takes what is still on its way, and ends the arm. */
void port_close(Port *port);
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
