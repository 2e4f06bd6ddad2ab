/* Moves a Ling arm on UART1 of a Cortex-M3, with a log on UART0, without an operating system and without interrupts.
 * For Arm's MPS2 board with image AN385, in QEMU: -machine mps2-an385. */
#include <armwire.h>

typedef struct Uart {
    volatile uint32_t data, state, control, interrupts, divider;
} Uart;
#define LOG ((Uart *)0x40004000)
#define ARM ((Uart *)0x40005000)
#define TX_FULL 1u
#define RX_FULL 2u
#define SYSTICK ((volatile uint32_t *)0xE000E010) /* control, reload, value */
#define CLOCK_MHZ 25u

static ArmwireLingClient arm;
static uint32_t bytes_out, bytes_in;

static uint64_t now_us(void)
{
    static uint64_t ticks;
    static uint32_t last;
    uint32_t value = SYSTICK[2];
    ticks += (last - value) & 0xFFFFFF; /* It counts down. */
    last = value;
    return ticks / CLOCK_MHZ;
}

static void log_text(const char *text)
{
    while (*text != '\0') {
        while (LOG->state & TX_FULL) {
        }
        LOG->data = (uint8_t)*text++;
    }
}

static void log_number(uint32_t number)
{
    char digits[11] = {0}, *first = digits + 10;
    do {
        *--first = (char)('0' + number % 10);
    } while (number /= 10);
    log_text(first);
    log_text(" ");
}

static size_t uart_read(uint8_t *space, size_t len)
{
    size_t n = 0;
    while (n < len && (ARM->state & RX_FULL)) {
        space[n++] = (uint8_t)ARM->data;
    }
    bytes_in += n;
    return n;
}

static size_t uart_write(const uint8_t *bytes, size_t len)
{
    size_t n = 0;
    while (n < len && !(ARM->state & TX_FULL)) {
        ARM->data = bytes[n++];
    }
    bytes_out += n;
    return n;
}

/* Executes one step of the client without waiting. The read of the next step answers the event RECEIVE. */
static ArmwireEvent step(ArmwireLingResponse *response)
{
    ArmwireEvent event;
    uint8_t *space;
    size_t len;
    armwire_ling_client_space(&arm, &space, &len);
    armwire_ling_client_received(&arm, now_us(), uart_read(space, len));
    armwire_ling_client_poll(&arm, now_us(), &event, response);
    if (event.kind == ARMWIRE_EVENT_KIND_TRANSMIT) {
        armwire_ling_client_transmitted(&arm, now_us(), uart_write(event.bytes, event.len));
    }
    return event;
}

/* Completes the request in flight. Other work is possible between two steps. */
static ArmwireEvent call(ArmwireLingResponse *response)
{
    for (;;) {
        ArmwireEvent event = step(response);
        switch (event.kind) {
        case ARMWIRE_EVENT_KIND_ANSWER:
        case ARMWIRE_EVENT_KIND_SENT:
        case ARMWIRE_EVENT_KIND_TIMED_OUT:
        case ARMWIRE_EVENT_KIND_UNACCEPTABLE:
        case ARMWIRE_EVENT_KIND_ERROR_FRAME: return event;
        default: break; /* RECEIVE, no answer yet, or noise. */
        }
    }
}

int main(void)
{
    static const ArmwireLingMove target = {{2048, 1900, 2200, 2048, 2048, 1500}, {3000, 3000, 3000, 3000, 3000, 3000}, 250, 3000};
    ArmwireLingResponse joints;
    LOG->divider = ARM->divider = 25; /* 1 Mbaud */
    LOG->control = 1;
    ARM->control = 3;
    SYSTICK[1] = 0xFFFFFF;
    SYSTICK[2] = 0;
    SYSTICK[0] = 5;
    if (armwire_ling_client_init(&arm, ARMWIRE_VERSION, NULL) != ARMWIRE_STATUS_OK) {
        log_text("the header and the library have different versions\n");
        return 1;
    }
    do {
        armwire_ling_client_read_info(&arm);
    } while (call(&joints).kind != ARMWIRE_EVENT_KIND_ANSWER); /* The arm may still be starting. */
    armwire_ling_client_set_torque(&arm, 1);
    call(&joints);
    do {
        /* Repeated, because a move has no answer and may be lost. */
        armwire_ling_client_move(&arm, &target);
        call(&joints);
        armwire_ling_client_read_joints(&arm);
        if (call(&joints).kind != ARMWIRE_EVENT_KIND_ANSWER) {
            log_text("no answer\n");
        }
    } while (joints.position_ticks[5] != target.position_ticks[5]);
    for (unsigned joint = 0; joint < ARMWIRE_LING_JOINTS; joint++) {
        log_number(joints.position_ticks[joint]);
    }
    log_text("ticks\n");
    for (uint64_t end_us = now_us() + 300000; now_us() < end_us;) {
        step(&joints); /* A late answer may still arrive. */
    }
    log_number(bytes_out);
    log_text("bytes out, ");
    log_number(bytes_in);
    log_text("in\n");
    return 0;
}
