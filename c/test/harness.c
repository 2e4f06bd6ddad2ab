#define _POSIX_C_SOURCE 200809L
#define _DEFAULT_SOURCE

#include "harness.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

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

void arm_name(const Port *port, char *name, size_t size)
{
    /* NAME is at PORT; ... or NAME is at PORT, ... */
    const char *at = strstr(port->line, " is at ");
    CHECK(at != NULL);
    at += strlen(" is at ");
    size_t len = strcspn(at, ";,");
    CHECK(len < size);
    memcpy(name, at, len);
    name[len] = '\0';
}

static int connect_to(const Port *port)
{
    char name[300];
    arm_name(port, name, sizeof name);
    const char *colon = strchr(name, ':');
    return colon != NULL ? open_tcp(name, colon) : open_serial(name);
}

Port arm_start(const char *armwire, const char *const *words)
{
    const char *argv[16] = {armwire, "sim"};
    for (size_t i = 0; words[i] != NULL; i++) {
        CHECK(i + 3 < sizeof argv / sizeof *argv);
        argv[i + 2] = words[i];
    }
    int ends[2];
    CHECK(pipe(ends) == 0);
    int process = fork();
    CHECK(process >= 0);
    if (process == 0) {
        dup2(ends[1], STDOUT_FILENO);
        close(ends[0]);
        close(ends[1]);
        execv(armwire, (char *const *)(uintptr_t)argv);
        _exit(127);
    }
    close(ends[1]);
    Port port = {-1, SIZE_MAX, 0, 0, process, fdopen(ends[0], "r"), ""};
    CHECK(port.output != NULL && fgets(port.line, sizeof port.line, port.output) != NULL);
    return port;
}

void arm_end(Port *port)
{
    unsigned long long in, out, lost;
    int status;
    CHECK(kill(port->process, SIGINT) == 0);
    CHECK(fgets(port->line, sizeof port->line, port->output) != NULL);
    CHECK(waitpid(port->process, &status, 0) == port->process && status == 0);
    fclose(port->output);
    printf("%s", port->line);
    if (sscanf(port->line, "%llu bytes in, %llu out, %llu not read", &in, &out, &lost) == 3) {
        CHECK(in == port->out && out == port->in && lost == 0);
    }
}

Port port_open(const char *armwire, const char *const *words)
{
    Port port = arm_start(armwire, words);
    port.fd = connect_to(&port);
    return port;
}

void port_reopen(Port *port)
{
    CHECK(close(port->fd) == 0);
    port->fd = connect_to(port);
}

void port_close(Port *port)
{
    uint8_t rest[256];
    while (port_read(port, rest, sizeof rest, now_us() + 300000u) > 0) {
    }
    CHECK(close(port->fd) == 0);
    arm_end(port);
}

size_t port_write(Port *port, const uint8_t *bytes, size_t len)
{
    ssize_t sent = write(port->fd, bytes, len < port->max_write ? len : port->max_write);
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
