/* A Ling client in a random program: requests are cancelled at any point, the port accepts them in pieces, and answers come
 * late, unread or not at all. An answer is that of the request in flight, and no request is executed after its end. Runs in
 * virtual time. Usage: endings STEPS */
#include "harness.h"

/* The length of every request of this program, and the zeros after a part of one. */
#define REQUEST 7
#define VOID 261
/* Maximum delay of an answer: 50 ms for the arm, and latency and stale window of `armwire_config_serial`. */
#define LONGEST_US 160000
#define ANSWERS 256

typedef struct Answer {
    uint64_t due_us;
    size_t len;
    uint8_t bytes[64];
} Answer;

static Random rng = {1};
static uint64_t clock_us;
static ArmwireLingClient client;
static ArmwireLingDevice device;

/* The request in flight, and the number of its submission, which its answer has. The port was read for it: it goes out
 * next. */
static bool in_flight, is_next;
static uint32_t kind;
static uint16_t number;
/* Accepted bytes of a request that is not complete, and zeros that are due before any other byte. */
static size_t part, zeros;
/* Accepted bytes of a fence that is not complete: a read that the client sends before a request. */
static size_t fence;
/* Answers that have not arrived, in their order, and bytes that have arrived and were not read. */
static Answer answers[ANSWERS];
static size_t answers_len, unread_len;
static uint8_t unread[ANSWERS * sizeof answers[0].bytes];
static unsigned long answered, voided;

/* The request in flight has ended. */
static void end(void)
{
    CHECK(in_flight);
    in_flight = false;
    if (part > 0) {
        voided++;
        part = 0;
        zeros = VOID;
    }
}

static void submit(void)
{
    ArmwireStatus expected = in_flight ? ARMWIRE_STATUS_BUSY : ARMWIRE_STATUS_OK;
    uint32_t next = random_below(&rng, 3);
    if (next == 0) {
        CHECK(armwire_ling_client_set_torque(&client, 0) == expected);
        next = ARMWIRE_LING_REQUEST_KIND_SET_TORQUE;
    } else if (next == 1) {
        CHECK(armwire_ling_client_read_velocities(&client) == expected);
        next = ARMWIRE_LING_REQUEST_KIND_READ_VELOCITIES;
    } else {
        CHECK(armwire_ling_client_read_joints(&client) == expected);
        next = ARMWIRE_LING_REQUEST_KIND_READ_JOINTS;
    }
    if (!in_flight) {
        in_flight = true;
        is_next = false;
        kind = next;
        number++;
    }
}

/* The arm answers a fence, or the request in flight, if it has an answer. */
static void answer(const ArmwireLingRequest *request, bool is_fence)
{
    ArmwireLingResponse response;
    Answer *next = &answers[answers_len];
    CHECK(is_fence || (in_flight && request->kind == kind));
    memset(&response, 0, sizeof response);
    response.servos = 6;
    response.stroke_mm = 50;
    response.position_ticks[0] = response.velocity_ticks_per_s[0] = is_fence ? 0 : number;
    if (request->kind == ARMWIRE_LING_REQUEST_KIND_SET_TORQUE || random_below(&rng, 8) == 0) {
        return;
    }
    switch (request->kind) {
    case ARMWIRE_LING_REQUEST_KIND_READ_JOINTS: response.kind = ARMWIRE_LING_RESPONSE_KIND_JOINTS; break;
    case ARMWIRE_LING_REQUEST_KIND_READ_STROKE: response.kind = ARMWIRE_LING_RESPONSE_KIND_STROKE; break;
    case ARMWIRE_LING_REQUEST_KIND_READ_TEMPERATURES: response.kind = ARMWIRE_LING_RESPONSE_KIND_TEMPERATURES; break;
    default: response.kind = ARMWIRE_LING_RESPONSE_KIND_VELOCITIES;
    }
    CHECK(answers_len < ANSWERS);
    CHECK_OK(armwire_ling_device_respond(&device, &response, next->bytes, sizeof next->bytes, &next->len));
    next->due_us = clock_us + random_below(&rng, random_below(&rng, 2) == 0 ? 2000 : LONGEST_US);
    /* An arm answers one request after the other. */
    if (answers_len > 0 && next->due_us < next[-1].due_us) {
        next->due_us = next[-1].due_us;
    }
    answers_len++;
}

/* Time passes, and answers arrive. */
static void pass_until(uint64_t until_us)
{
    size_t arrived = 0;
    clock_us = until_us > clock_us ? until_us : clock_us;
    while (arrived < answers_len && answers[arrived].due_us <= clock_us) {
        CHECK(unread_len + answers[arrived].len <= sizeof unread);
        memcpy(unread + unread_len, answers[arrived].bytes, answers[arrived].len);
        unread_len += answers[arrived++].len;
    }
    answers_len -= arrived;
    memmove(answers, answers + arrived, answers_len * sizeof answers[0]);
}

/* Reads some bytes, or reports that there are none. */
static void receive(void)
{
    uint8_t *space;
    size_t len;
    CHECK_OK(armwire_ling_client_space(&client, &space, &len));
    CHECK(len > 0);
    len = 1 + random_below(&rng, (uint32_t)len);
    len = len < unread_len ? len : unread_len;
    memcpy(space, unread, len);
    unread_len -= len;
    memmove(unread, unread + len, unread_len);
    CHECK_OK(armwire_ling_client_received(&client, clock_us, len));
}

/* The port accepts a part of these bytes. */
static void transmit(const uint8_t *bytes, size_t len)
{
    ArmwireEvent event;
    ArmwireLingRequest request;
    size_t taken, accepted = 1 + random_below(&rng, (uint32_t)len);
    bool is_fence = zeros == 0 && !(in_flight && is_next);
    CHECK(zeros > 0 ? len <= zeros : (is_fence ? fence : part) + len == REQUEST);
    for (size_t at = 0; at < accepted; at += taken) {
        CHECK(zeros == 0 || bytes[at] == 0);
        CHECK_OK(armwire_ling_device_receive(&device, bytes + at, accepted - at, &taken));
        do {
            CHECK_OK(armwire_ling_device_poll(&device, &event, &request));
            if (event.kind == ARMWIRE_EVENT_KIND_REQUEST) {
                answer(&request, is_fence);
            }
        } while (event.kind != ARMWIRE_EVENT_KIND_WAIT);
    }
    if (zeros > 0) {
        zeros -= accepted;
    } else if (is_fence) {
        fence = (fence + accepted) % REQUEST;
    } else {
        part = (part + accepted) % REQUEST;
    }
    CHECK_OK(armwire_ling_client_transmitted(&client, clock_us, accepted));
}

static void poll(void)
{
    ArmwireEvent event;
    ArmwireLingResponse response;
    CHECK_OK(armwire_ling_client_poll(&client, clock_us, &event, &response));
    switch (event.kind) {
    case ARMWIRE_EVENT_KIND_RECEIVE:
        is_next = true;
        receive();
        break;
    case ARMWIRE_EVENT_KIND_TRANSMIT: transmit(event.bytes, event.len); break;
    case ARMWIRE_EVENT_KIND_WAIT:
        /* A program that waits reads what arrives. This one may be slow. */
        if (unread_len > 0) {
            receive();
        } else if (in_flight) {
            CHECK(event.until_us != UINT64_MAX);
            pass_until(answers_len > 0 && answers[0].due_us < event.until_us ? answers[0].due_us : event.until_us);
        }
        break;
    case ARMWIRE_EVENT_KIND_ANSWER:
        CHECK((response.kind == ARMWIRE_LING_RESPONSE_KIND_JOINTS ? response.position_ticks[0]
                                                                  : response.velocity_ticks_per_s[0]) == number);
        answered++;
        end();
        break;
    case ARMWIRE_EVENT_KIND_SENT:
    case ARMWIRE_EVENT_KIND_TIMED_OUT: end(); break;
    /* A part of an answer, whose rest is unread at the timeout. */
    case ARMWIRE_EVENT_KIND_NOISE: break;
    default: CHECK(event.kind == ARMWIRE_EVENT_KIND_LATE || event.kind == ARMWIRE_EVENT_KIND_UNSOLICITED);
    }
}

int main(int argc, char **argv)
{
    CHECK(argc == 2);
    CHECK_OK(armwire_ling_client_init(&client, ARMWIRE_VERSION, NULL));
    CHECK_OK(armwire_ling_device_init(&device, ARMWIRE_VERSION));
    for (unsigned long steps = strtoul(argv[1], NULL, 10); steps > 0; steps--) {
        uint32_t choice = random_below(&rng, 40);
        if (choice < 8) {
            submit();
        } else if (choice == 8) {
            CHECK_OK(armwire_ling_client_cancel(&client));
            if (in_flight) {
                end();
            }
        } else if (choice == 9) {
            pass_until(clock_us + random_below(&rng, 300000));
        } else {
            poll();
        }
    }
    for (unsigned polls = 0; in_flight; polls++) {
        CHECK(polls < 1000);
        poll();
    }
    printf("%lu answers, %lu voids\n", answered, voided);
    CHECK(answered > 0 && voided > 0);
    return 0;
}
