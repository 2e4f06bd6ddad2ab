#define _POSIX_C_SOURCE 200809L
#define _DEFAULT_SOURCE

#include "harness.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

uint32_t random_below(Random *random, uint32_t bound)
{
    random->state = random->state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((random->state >> 33) % bound);
}

uint64_t now_us(void)
{
    struct timespec now;
    CHECK(clock_gettime(CLOCK_MONOTONIC, &now) == 0);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

static int open_tcp(const char *name, const char *colon)
{
    char host[64];
    size_t len = (size_t)(colon - name);
    CHECK(len < sizeof host);
    memcpy(host, name, len);
    host[len] = '\0';
    struct sockaddr_in address;
    memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    address.sin_port = htons((uint16_t)strtoul(colon + 1, NULL, 10));
    CHECK(inet_pton(AF_INET, host, &address.sin_addr) == 1);
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    CHECK(fd >= 0);
    CHECK(connect(fd, (struct sockaddr *)&address, sizeof address) == 0);
    int on = 1;
    CHECK(setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on) == 0);
    return fd;
}

static int open_serial(const char *path)
{
    int fd = open(path, O_RDWR | O_NOCTTY);
    CHECK(fd >= 0);
    struct termios settings;
    CHECK(tcgetattr(fd, &settings) == 0);
    cfmakeraw(&settings);
    CHECK(tcsetattr(fd, TCSANOW, &settings) == 0);
    return fd;
}

Port port_open(const char *name)
{
    const char *colon = strchr(name, ':');
    Port port = {colon != NULL ? open_tcp(name, colon) : open_serial(name), SIZE_MAX, 0, 0};
    return port;
}

void port_close(Port *port, unsigned silence_ms)
{
    uint8_t rest[256];
    while (port_read(port, rest, sizeof rest, now_us() + silence_ms * 1000u) > 0) {
    }
    CHECK(close(port->fd) == 0);
}

size_t port_write(Port *port, const uint8_t *bytes, size_t len)
{
    ssize_t sent = write(port->fd, bytes, len < port->write_most ? len : port->write_most);
    CHECK(sent > 0);
    port->out += (uint64_t)sent;
    return (size_t)sent;
}

size_t port_read(Port *port, uint8_t *room, size_t len, uint64_t until_us)
{
    uint64_t now = now_us();
    uint64_t wait_us = until_us > now ? until_us - now : 0;
    struct pollfd events = {port->fd, POLLIN, 0};
    int ready = poll(&events, 1, wait_us > 3600000000u ? -1 : (int)((wait_us + 999u) / 1000u));
    CHECK(ready >= 0);
    if (ready == 0) {
        return 0;
    }
    ssize_t got = read(port->fd, room, len);
    CHECK(got >= 0);
    port->in += (uint64_t)got;
    return (size_t)got;
}

bool ends_request(const ArmwireEvent *event, Others *others)
{
    switch (event->kind) {
    case ARMWIRE_EVENT_KIND_ANSWER:
    case ARMWIRE_EVENT_KIND_SENT:
    case ARMWIRE_EVENT_KIND_TIMED_OUT:
    case ARMWIRE_EVENT_KIND_UNACCEPTABLE:
    case ARMWIRE_EVENT_KIND_BROKEN:
        return true;
    case ARMWIRE_EVENT_KIND_NOISE:
        CHECK(event->bytes != NULL && event->len > 0 && event->fault.code != ARMWIRE_FAULT_CODE_NONE);
        others->noise += (unsigned)event->len;
        return false;
    case ARMWIRE_EVENT_KIND_LATE:
        others->late++;
        return false;
    case ARMWIRE_EVENT_KIND_UNSOLICITED:
        others->unsolicited++;
        return false;
    case ARMWIRE_EVENT_KIND_ECHO:
        others->echo++;
        return false;
    default:
        CHECK(event->kind == ARMWIRE_EVENT_KIND_UNKNOWN);
        others->unknown++;
        return false;
    }
}
