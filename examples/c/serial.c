/* Reads a Ling arm on a POSIX serial port and moves it slowly to zero. Ctrl-C stops it. Usage: serial /dev/ttyUSB0 */
#define _DEFAULT_SOURCE
#include <armwire.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

/* 20 degrees per second. */
#define SPEED 228

static int port;
static ArmwireLingClient arm;
static volatile sig_atomic_t interrupted;

static void interrupt(int signal)
{
    (void)signal;
    interrupted = 1;
}

static uint64_t now_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

/* Waits for bytes until this time, and passes them to the client: none if the port is empty. */
static void wait(uint64_t until_us)
{
    uint64_t now = now_us();
    struct pollfd events = {port, POLLIN, 0};
    uint8_t *space;
    size_t len;
    if (poll(&events, 1, until_us > now ? (int)((until_us - now) / 1000u + 1u) : 0) <= 0) {
        armwire_ling_client_received(&arm, now_us(), 0);
        return;
    }
    armwire_ling_client_space(&arm, &space, &len);
    ssize_t got = read(port, space, len);
    if (got <= 0) {
        perror("read");
        exit(1);
    }
    armwire_ling_client_received(&arm, now_us(), (size_t)got);
}

/* Completes an accepted request. Returns false, after the reason, if it fails. The response is of kind NONE for a request
 * without an answer. */
static bool try_call(ArmwireStatus status, ArmwireLingResponse *response)
{
    ArmwireEvent event;
    ArmwireFault fault;
    char text[128];
    while (status == ARMWIRE_STATUS_OK) {
        armwire_ling_client_poll(&arm, now_us(), &event, response);
        switch (event.kind) {
        case ARMWIRE_EVENT_KIND_TRANSMIT: {
            ssize_t sent = write(port, event.bytes, event.len);
            status = armwire_ling_client_transmitted(&arm, now_us(), sent > 0 ? (size_t)sent : 0);
            break;
        }
        case ARMWIRE_EVENT_KIND_RECEIVE: wait(0); break;
        case ARMWIRE_EVENT_KIND_WAIT: wait(event.until_us); break;
        case ARMWIRE_EVENT_KIND_ANSWER:
        case ARMWIRE_EVENT_KIND_SENT: return true;
        case ARMWIRE_EVENT_KIND_TIMED_OUT: fprintf(stderr, "no answer\n"); return false;
        case ARMWIRE_EVENT_KIND_ERROR_FRAME: fprintf(stderr, "the arm answered with an error frame\n"); return false;
        case ARMWIRE_EVENT_KIND_NOISE:
        case ARMWIRE_EVENT_KIND_UNKNOWN:
        case ARMWIRE_EVENT_KIND_UNACCEPTABLE:
            armwire_fault_text(&event.fault, text, sizeof text);
            fprintf(stderr, "on the line: %s\n", text);
            if (event.kind == ARMWIRE_EVENT_KIND_UNACCEPTABLE) {
                return false;
            }
            break;
        default: break; /* A late answer, or an echo. */
        }
    }
    armwire_ling_client_fault(&arm, &fault);
    armwire_fault_text(&fault, text, sizeof text);
    fprintf(stderr, "%s: %s\n", armwire_status_text(status), text);
    return false;
}

/* Completes an accepted request and returns its answer. Ends the program if it fails. */
static ArmwireLingResponse call(ArmwireStatus status)
{
    ArmwireLingResponse response;
    if (!try_call(status, &response)) {
        exit(1);
    }
    return response;
}

/* Waits, at most until a signal. */
static void pause_us(long us)
{
    const struct timespec time = {us / 1000000, us % 1000000 * 1000};
    nanosleep(&time, NULL);
}

/* Stops the arm, whose gripper keeps this goal. Returns the exit status. */
static int stop(const uint16_t *opening_per_mille)
{
    ArmwireLingStop stop;
    ArmwireLingStopStep step;
    ArmwireLingResponse joints;
    armwire_ling_stop_init(&stop, ARMWIRE_VERSION, opening_per_mille);
    for (;;) {
        armwire_ling_stop_poll(&stop, now_us(), &step);
        switch (step.kind) {
        case ARMWIRE_LING_STOP_STEP_KIND_WAIT: pause_us((long)(step.until_us - now_us())); break;
        case ARMWIRE_LING_STOP_STEP_KIND_MOVE: try_call(armwire_ling_client_move(&arm, &step.target), &joints); break;
        case ARMWIRE_LING_STOP_STEP_KIND_TORQUE_ON: try_call(armwire_ling_client_set_torque(&arm, 1), &joints); break;
        case ARMWIRE_LING_STOP_STEP_KIND_READ_JOINTS:
            /* A failed read is repeated. */
            if (try_call(armwire_ling_client_read_joints(&arm), &joints)) {
                armwire_ling_stop_on_joints(&stop, now_us(), &joints);
            }
            break;
        case ARMWIRE_LING_STOP_STEP_KIND_AT_REST: fprintf(stderr, "stopped\n"); return 130;
        case ARMWIRE_LING_STOP_STEP_KIND_WITHOUT_TORQUE: fprintf(stderr, "the torque is off\n"); return 1;
        default: fprintf(stderr, "the arm may still move: switch its supply off\n"); return 1;
        }
    }
}

int main(int argc, char **argv)
{
    struct termios settings;
    if (argc != 2) {
        fprintf(stderr, "usage: serial PORT\n");
        return 2;
    }
    port = open(argv[1], O_RDWR | O_NOCTTY);
    if (port < 0 || tcgetattr(port, &settings) != 0) {
        perror(argv[1]);
        return 1;
    }
    cfmakeraw(&settings);
    cfsetspeed(&settings, B1000000);
    tcsetattr(port, TCSANOW, &settings);
    if (armwire_ling_client_init(&arm, ARMWIRE_VERSION, NULL) != ARMWIRE_STATUS_OK) {
        return 1;
    }

    char serial[65];
    ArmwireLingResponse info = call(armwire_ling_client_read_info(&arm));
    armwire_printable(info.serial_number, sizeof info.serial_number, serial, sizeof serial);
    printf("arm %s, firmware %u.%02u\n", serial, (unsigned)info.firmware_version / 100, (unsigned)info.firmware_version % 100);

    ArmwireLingResponse joints = call(armwire_ling_client_read_joints(&arm));
    switch (armwire_ling_check_motion(&joints)) {
    case ARMWIRE_LING_MOTION_ALLOWED:
        break;
    case ARMWIRE_LING_MOTION_TORQUE_OFF:
        fprintf(stderr, "the torque is off: nothing was sent\n");
        return 1;
    case ARMWIRE_LING_MOTION_FOREIGN:
        fprintf(stderr, "not an Alicia-D (%u data bytes): nothing was sent\n", joints.foreign_data_bytes);
        return 1;
    default:
        fprintf(stderr, "no document explains the arm's status 0x%02x: nothing was sent\n", joints.motion_status);
        return 1;
    }
    /* The gripper keeps its opening. */
    const ArmwireLingMove home = {{2048, 2048, 2048, 2048, 2048, 2048},
                                  {SPEED, SPEED, SPEED, SPEED, SPEED, SPEED},
                                  joints.opening_per_mille,
                                  1000};
    printf("In 3 s every joint moves to zero, at 20 degrees per second. Keep clear. Ctrl-C stops the arm.\n");
    signal(SIGINT, interrupt);
    signal(SIGTERM, interrupt);
    signal(SIGHUP, interrupt);
    pause_us(3000000);
    if (interrupted) {
        return 1;
    }
    call(armwire_ling_client_move(&arm, &home));
    ArmwireLingArrival arrival;
    ArmwireLingArrived arrived = {.kind = ARMWIRE_LING_ARRIVED_KIND_NOT_YET};
    armwire_ling_arrival_init(&arrival, ARMWIRE_VERSION, &home, ARMWIRE_LING_TOLERANCE);
    while (!interrupted && arrived.kind <= ARMWIRE_LING_ARRIVED_KIND_RESEND) {
        pause_us(20000);
        if (!try_call(armwire_ling_client_read_joints(&arm), &joints)) {
            return stop(&home.opening_per_mille);
        }
        armwire_ling_arrival_on_joints(&arrival, now_us(), &joints, &arrived);
        if (arrived.kind == ARMWIRE_LING_ARRIVED_KIND_RESEND) {
            call(armwire_ling_client_move(&arm, &home));
        }
    }
    if (interrupted) {
        return stop(&home.opening_per_mille);
    }
    printf(arrived.kind == ARMWIRE_LING_ARRIVED_KIND_ELSEWHERE ? "at rest elsewhere" : "reached");
    for (int joint = 0; joint < ARMWIRE_LING_JOINTS; joint++) {
        printf(" %u", joints.position_ticks[joint]);
    }
    printf(" ticks, gripper %u per mille\n", joints.opening_per_mille);
    return 0;
}
