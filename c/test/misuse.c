/* Every function with invalid arguments, except dangling pointers: NULL, uninitialized memory or memory of another kind, values
 * out of range, short buffers, calls in any order. Usage: misuse CALLS [SEED] */
#include "harness.h"

enum Kind {
    LING_CLIENT,
    LING_DEVICE,
    LING_STOP,
    LING_READ_BACK,
    LING_ARRIVAL,
    ALPHA1_CLIENT,
    ALPHA1_DEVICE,
    XARM_CLIENT,
    XARM_DEVICE,
    KINDS
};

static const size_t sizes[KINDS] = {sizeof(ArmwireLingClient),   sizeof(ArmwireLingDevice),   sizeof(ArmwireLingStop),
                                    sizeof(ArmwireLingReadBack), sizeof(ArmwireLingArrival),  sizeof(ArmwireAlpha1Client),
                                    sizeof(ArmwireAlpha1Device), sizeof(ArmwireXarmClient),   sizeof(ArmwireXarmDevice)};

/* Memory on the heap, so that the address sanitizer detects an access beyond it. Each fits every kind, to test wrong types. */
#define MEMORIES 12
static void *memories[MEMORIES];
/* The kind in each memory, KINDS for none. */
static enum Kind contents[MEMORIES];
static size_t largest;

static Random rng;
static uint64_t clock_us;
static unsigned long statuses[ARMWIRE_STATUS_UNKNOWN_KIND + 1];

static bool one_in(uint32_t n)
{
    return random_below(&rng, n) == 0;
}

static uint8_t any8(void)
{
    return (uint8_t)random_below(&rng, 256);
}

static uint16_t any16(void)
{
    return (uint16_t)random_below(&rng, 65536);
}

static uint32_t any32(void)
{
    return one_in(2) ? random_below(&rng, 300) : (uint32_t)any16() << 16 | any16();
}

static size_t any_size(void)
{
    return one_in(20) ? SIZE_MAX - random_below(&rng, 3) : random_below(&rng, 300);
}

static void *or_null(void *pointer)
{
    return one_in(25) ? NULL : pointer;
}

static void any_bytes(void *to, size_t len)
{
    for (size_t i = 0; i < len; i++) {
        ((uint8_t *)to)[i] = any8();
    }
}

/* Bytes for a line: noise, and frames of every protocol, whole or damaged. */
static size_t any_line(uint8_t *to, size_t room)
{
    static const uint8_t frames[][24] = {
        {7, 0xAA, 6, 0, 1, 0xFE, 0x9A, 0xFF},
        {21, 0xAA, 6, 0, 15, 0, 8, 0, 8, 0, 8, 0, 8, 0, 8, 0, 8, 0xF4, 1, 0, 0xB4, 0xFF},
        {7, 0xAA, 5, 0, 1, 1, 0xF9, 0xFF},
        {10, 0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED},
        {4, 0xF2, 0x2F, 0xAA, 0xED},
        {10, 0xFA, 0xAF, 1, 2, 0, 0, 0, 0, 3, 0xED},
        {10, 0xFA, 0xAF, 1, 0xAA, 0, 0x5A, 0, 0x5A, 0x5F, 0xED},
        {7, 0, 1, 0, 2, 0, 1, 1},
        {8, 0, 1, 0, 2, 0, 2, 5, 0},
        {9, 0, 1, 0, 2, 0, 3, 5, 0, 1},
    };
    size_t len = 0;
    while (len + 24 <= room && !one_in(4)) {
        const uint8_t *frame = frames[random_below(&rng, sizeof frames / sizeof *frames)];
        memcpy(to + len, frame + 1, frame[0]);
        if (one_in(8)) {
            to[len + random_below(&rng, frame[0])] = any8();
        }
        len += frame[0];
    }
    if (one_in(6) && len + 24 <= room) {
        any_bytes(to + len, 24);
        len += 24;
    }
    return len;
}

/* Copies bytes to the heap, with exactly this length. */
static uint8_t *exact(const uint8_t *bytes, size_t len)
{
    uint8_t *copy = malloc(len > 0 ? len : 1);
    CHECK(copy != NULL);
    memcpy(copy, bytes, len);
    return copy;
}

/* The common functions of all clients and devices. */
#define DEFINE_MECHANICS(name, Name)                                                                                  \
    static ArmwireStatus name##_client_mechanics(Armwire##Name##Client *client, uint32_t which)                       \
    {                                                                                                                 \
        ArmwireConfig config = {any32(), any32(), any32(), any32(), any8()};                                          \
        ArmwireEvent event;                                                                                           \
        Armwire##Name##Response response;                                                                             \
        ArmwireFault fault;                                                                                           \
        uint8_t line[200], *space;                                                                                    \
        size_t len, taken;                                                                                            \
        ArmwireStatus status;                                                                                         \
        switch (which) {                                                                                              \
        case 0:                                                                                                       \
            return armwire_##name##_client_init(client, one_in(20) ? any32() : ARMWIRE_VERSION, or_null(&config));    \
        case 1: return armwire_##name##_client_idle(client);                                                          \
        case 2: return armwire_##name##_client_cancel(client);                                                        \
        case 3: return armwire_##name##_client_received(client, clock_us, any_size());                                \
        case 4: return armwire_##name##_client_transmitted(client, clock_us, any_size());                             \
        case 5:                                                                                                       \
            status = armwire_##name##_client_fault(client, or_null(&fault));                                          \
            if (status == ARMWIRE_STATUS_OK) {                                                                        \
                armwire_fault_text(&fault, NULL, 0);                                                                  \
            }                                                                                                         \
            return status;                                                                                            \
        case 6:                                                                                                       \
            status = armwire_##name##_client_space(client, or_null(&space), or_null(&len));                           \
            if (status == ARMWIRE_STATUS_OK && len >= 1) {                                                            \
                any_bytes(space, len);                                                                                \
                status = armwire_##name##_client_received(client, clock_us, random_below(&rng, (uint32_t)len));       \
                CHECK(status == ARMWIRE_STATUS_OK);                                                                   \
            }                                                                                                         \
            return status;                                                                                            \
        case 7: {                                                                                                     \
            len = any_line(line, sizeof line);                                                                        \
            uint8_t *bytes = exact(line, len);                                                                        \
            status = armwire_##name##_client_receive(client, clock_us, or_null(bytes), len, or_null(&taken));         \
            free(bytes);                                                                                              \
            return status;                                                                                            \
        }                                                                                                             \
        default:                                                                                                      \
            status = armwire_##name##_client_poll(client, clock_us, or_null(&event), or_null(&response));             \
            if (status == ARMWIRE_STATUS_OK) {                                                                        \
                CHECK(event.kind <= ARMWIRE_EVENT_KIND_RECEIVE && event.kind != ARMWIRE_EVENT_KIND_REQUEST);          \
                look_at(&event);                                                                                      \
                if (event.kind == ARMWIRE_EVENT_KIND_TRANSMIT && one_in(2)) {                                         \
                    CHECK_OK(armwire_##name##_client_transmitted(client, clock_us, event.len));                       \
                }                                                                                                     \
            }                                                                                                         \
            return status;                                                                                            \
        }                                                                                                             \
    }                                                                                                                 \
    static ArmwireStatus name##_device_mechanics(Armwire##Name##Device *device, uint32_t which)                       \
    {                                                                                                                 \
        ArmwireEvent event;                                                                                           \
        Armwire##Name##Request request;                                                                               \
        ArmwireFault fault;                                                                                           \
        uint8_t line[200], *space;                                                                                    \
        size_t len, taken;                                                                                            \
        ArmwireStatus status;                                                                                         \
        switch (which) {                                                                                              \
        case 0: return armwire_##name##_device_init(device, one_in(20) ? any32() : ARMWIRE_VERSION);                  \
        case 1: return armwire_##name##_device_idle(device);                                                          \
        case 2: return armwire_##name##_device_received(device, any_size());                                          \
        case 3: return armwire_##name##_device_fault(device, or_null(&fault));                                        \
        case 4:                                                                                                       \
            status = armwire_##name##_device_space(device, or_null(&space), or_null(&len));                           \
            if (status == ARMWIRE_STATUS_OK) {                                                                        \
                any_bytes(space, len);                                                                                \
            }                                                                                                         \
            return status;                                                                                            \
        case 5: {                                                                                                     \
            len = any_line(line, sizeof line);                                                                        \
            uint8_t *bytes = exact(line, len);                                                                        \
            status = armwire_##name##_device_receive(device, or_null(bytes), len, or_null(&taken));                   \
            free(bytes);                                                                                              \
            return status;                                                                                            \
        }                                                                                                             \
        default:                                                                                                      \
            status = armwire_##name##_device_poll(device, or_null(&event), or_null(&request));                        \
            if (status == ARMWIRE_STATUS_OK) {                                                                        \
                look_at(&event);                                                                                      \
            }                                                                                                         \
            return status;                                                                                            \
        }                                                                                                             \
    }

/* Checks that the bytes of an event are readable and the text of its fault is terminated. */
static void look_at(const ArmwireEvent *event)
{
    char text[128], cut[8];
    unsigned sum = 0;
    for (size_t i = 0; i < event->len; i++) {
        sum += event->bytes[i];
    }
    CHECK(event->len == 0 || sum <= 255 * event->len);
    size_t len = armwire_fault_text(&event->fault, text, sizeof text);
    CHECK(len > 0 && len < sizeof text && strlen(text) == len);
    size_t room = random_below(&rng, sizeof cut + 1);
    CHECK(armwire_fault_text(&event->fault, cut, room) == len);
    CHECK(room == 0 || strlen(cut) == room - 1);
    CHECK(armwire_printable(event->bytes, event->len, text, sizeof text) >= event->len);
    CHECK(strlen(text) < sizeof text);
}

DEFINE_MECHANICS(ling, Ling)
DEFINE_MECHANICS(alpha1, Alpha1)
DEFINE_MECHANICS(xarm, Xarm)

static ArmwireStatus ling_client_call(ArmwireLingClient *client)
{
    ArmwireLingMove target;
    any_bytes(&target, sizeof target);
    if (one_in(2)) {
        memset(&target, 0, sizeof target);
    }
    switch (random_below(&rng, 25)) {
    case 0: return armwire_ling_client_read_info(client);
    case 1: return armwire_ling_client_set_zero(client);
    case 2: return armwire_ling_client_set_stroke(client, one_in(2) ? 75 : any8());
    case 3: return armwire_ling_client_read_stroke(client);
    case 4: return armwire_ling_client_set_torque(client, (uint8_t)random_below(&rng, 3));
    case 5: return armwire_ling_client_read_joints(client);
    case 6: return armwire_ling_client_read_temperatures(client);
    case 7: return armwire_ling_client_set_temperature_limit(client, (uint8_t)(250 + random_below(&rng, 6)));
    case 8: return armwire_ling_client_read_velocities(client);
    case 9: return armwire_ling_client_move(client, or_null(&target));
    case 10: return armwire_ling_client_self_check(client);
    case 11: return armwire_ling_client_set_mode(client, (uint8_t)random_below(&rng, 3));
    case 12: return armwire_ling_client_read_mode(client);
    case 13: return armwire_ling_client_set_force_feedback(client, (uint8_t)random_below(&rng, 3));
    case 14: return armwire_ling_client_read_force_feedback(client);
    case 15: {
        ArmwireLingResponse mode;
        any_bytes(&mode, sizeof mode);
        mode.kind = random_below(&rng, 11);
        return armwire_ling_client_move_slowly(client, or_null(&target), or_null(&mode));
    }
    default: return ling_client_mechanics(client, one_in(6) ? 0 : 1 + random_below(&rng, 10));
    }
}

static ArmwireStatus ling_device_call(ArmwireLingDevice *device)
{
    ArmwireLingResponse response;
    size_t len, room = random_below(&rng, 71);
    if (one_in(2)) {
        return ling_device_mechanics(device, one_in(6) ? 0 : 1 + random_below(&rng, 8));
    }
    any_bytes(&response, sizeof response);
    response.kind = one_in(10) ? any32() : random_below(&rng, 11);
    response.servos = one_in(4) ? any8() : (uint8_t)(6 + 4 * random_below(&rng, 2));
    response.stroke_mm = one_in(4) ? any8() : 50;
    uint8_t *out = malloc(room + 1);
    ArmwireStatus status =
        armwire_ling_device_respond(device, or_null(&response), one_in(25) ? NULL : out + 1, room, or_null(&len));
    free(out);
    return status;
}

static ArmwireStatus ling_stop_call(ArmwireLingStop *stop)
{
    ArmwireLingStopStep next;
    ArmwireLingResponse joints;
    ArmwireLingMove last;
    uint16_t opening = any16() % 1100;
    ArmwireStatus status;
    switch (random_below(&rng, 9)) {
    case 0: return armwire_ling_stop_init(stop, one_in(20) ? any32() : ARMWIRE_VERSION, or_null(&opening));
    case 1:
        any_bytes(&last, sizeof last);
        if (one_in(2)) {
            memset(&last, 0, sizeof last);
        }
        return armwire_ling_stop_init_after(stop, one_in(20) ? any32() : ARMWIRE_VERSION, or_null(&last));
    case 2:
    case 3:
        any_bytes(&joints, sizeof joints);
        joints.kind = one_in(10) ? any32() : ARMWIRE_LING_RESPONSE_KIND_JOINTS;
        joints.motion_status = one_in(2) ? 1 : any8();
        return armwire_ling_stop_on_joints(stop, clock_us, or_null(&joints));
    default:
        status = armwire_ling_stop_poll(stop, clock_us, or_null(&next));
        if (status == ARMWIRE_STATUS_OK) {
            CHECK(next.kind <= ARMWIRE_LING_STOP_STEP_KIND_MOVED_BY_ANOTHER);
        }
        return status;
    }
}

static ArmwireStatus ling_read_back_call(ArmwireLingReadBack *read_back)
{
    ArmwireLingReadBackStep next;
    ArmwireLingResponse joints;
    ArmwireStatus status;
    switch (random_below(&rng, 8)) {
    case 0: return armwire_ling_read_back_init(read_back, one_in(20) ? any32() : ARMWIRE_VERSION, random_below(&rng, 5));
    case 1:
    case 2:
        any_bytes(&joints, sizeof joints);
        joints.kind = one_in(10) ? any32() : ARMWIRE_LING_RESPONSE_KIND_JOINTS;
        joints.motion_status = one_in(2) ? 1 : any8();
        return armwire_ling_read_back_on_joints(read_back, clock_us, or_null(&joints));
    default:
        status = armwire_ling_read_back_poll(read_back, clock_us, or_null(&next));
        if (status == ARMWIRE_STATUS_OK) {
            CHECK(next.kind <= ARMWIRE_LING_READ_BACK_STEP_KIND_NO_READING);
        }
        return status;
    }
}

static ArmwireStatus ling_arrival_call(ArmwireLingArrival *arrival)
{
    ArmwireLingArrived arrived;
    ArmwireLingResponse joints;
    ArmwireLingMove target;
    if (one_in(8)) {
        any_bytes(&target, sizeof target);
        for (int joint = 0; joint < ARMWIRE_LING_JOINTS; joint++) {
            target.position_ticks[joint] %= 4200;
            target.speed_ticks_per_s[joint] = (uint16_t)(50 + random_below(&rng, 5000));
        }
        target.opening_per_mille %= 1100;
        return armwire_ling_arrival_init(arrival, one_in(20) ? any32() : ARMWIRE_VERSION, or_null(&target),
                                         any16());
    }
    any_bytes(&joints, sizeof joints);
    joints.kind = one_in(10) ? any32() : ARMWIRE_LING_RESPONSE_KIND_JOINTS;
    joints.motion_status = one_in(2) ? 1 : any8();
    ArmwireStatus status = armwire_ling_arrival_on_joints(arrival, clock_us, or_null(&joints), or_null(&arrived));
    if (status == ARMWIRE_STATUS_OK) {
        CHECK(arrived.kind <= ARMWIRE_LING_ARRIVED_KIND_ELSEWHERE && arrived.away < 0x80);
    }
    return status;
}

static ArmwireStatus alpha1_client_call(ArmwireAlpha1Client *client)
{
    ArmwireAlpha1Action action;
    uint8_t name[255];
    size_t len = random_below(&rng, 256);
    ArmwireStatus status;
    any_bytes(&action, sizeof action);
    any_bytes(name, sizeof name);
    if (one_in(2)) {
        memset(&action, 0, sizeof action);
    }
    switch (random_below(&rng, 30)) {
    case 0: return armwire_alpha1_client_read_hardware_version(client);
    case 1: return armwire_alpha1_client_read_servo_states(client);
    case 2: return armwire_alpha1_client_stop(client);
    case 3: return armwire_alpha1_client_read_firmware_version(client);
    case 4: return armwire_alpha1_client_act(client, or_null(&action));
    case 5: return armwire_alpha1_client_set_offset_tool(client, (uint8_t)random_below(&rng, 3));
    case 6: return armwire_alpha1_client_set_usb_type(client, (uint8_t)random_below(&rng, 5));
    case 7: {
        uint8_t *bytes = exact(name, len);
        status = armwire_alpha1_client_play(client, or_null(bytes), len);
        free(bytes);
        return status;
    }
    case 8: return armwire_alpha1_client_servo_move(client, any8(), any8(), any32(), any32());
    case 9: return armwire_alpha1_client_servo_release(client, any8());
    case 10: return armwire_alpha1_client_servo_set_led(client, any8(), any8());
    case 11: return armwire_alpha1_client_servo_read_angles(client, any8());
    case 12: return armwire_alpha1_client_servo_change_id(client, any8(), any8());
    case 13: return armwire_alpha1_client_servo_set_offset(client, any8(), (int16_t)(any16() - 32768));
    case 14: return armwire_alpha1_client_servo_read_offset(client, any8());
    case 15: return armwire_alpha1_client_servo_read_version(client, any8());
    default: return alpha1_client_mechanics(client, one_in(6) ? 0 : 1 + random_below(&rng, 10));
    }
}

static ArmwireStatus alpha1_device_call(ArmwireAlpha1Device *device)
{
    ArmwireAlpha1Response response;
    uint8_t bytes[255];
    size_t len, room = random_below(&rng, 261);
    if (one_in(2)) {
        return alpha1_device_mechanics(device, one_in(6) ? 0 : 1 + random_below(&rng, 8));
    }
    any_bytes(&response, sizeof response);
    any_bytes(bytes, sizeof bytes);
    response.kind = one_in(10) ? any32() : random_below(&rng, 16);
    response.success = (uint8_t)random_below(&rng, 3);
    response.text_len = random_below(&rng, 256);
    uint8_t *text = exact(bytes, response.text_len), *out = malloc(room + 1);
    response.text = one_in(25) ? NULL : text;
    ArmwireStatus status =
        armwire_alpha1_device_respond(device, or_null(&response), one_in(25) ? NULL : out + 1, room, or_null(&len));
    free(text);
    free(out);
    return status;
}

static ArmwireStatus xarm_client_call(ArmwireXarmClient *client)
{
    uint8_t params[255];
    size_t len = random_below(&rng, 256);
    ArmwireStatus status;
    any_bytes(params, sizeof params);
    switch (random_below(&rng, 20)) {
    case 0: return armwire_xarm_client_heartbeat(client);
    case 1: return armwire_xarm_client_read_version(client);
    case 2: return armwire_xarm_client_read_serials(client);
    case 3: return armwire_xarm_client_reload_dynamics(client);
    case 4: return armwire_xarm_client_read_torque_source(client);
    case 5: return armwire_xarm_client_read_rotation_radius(client, (uint8_t)random_below(&rng, 9));
    case 6: return armwire_xarm_client_shutdown(client);
    case 7: return armwire_xarm_client_reboot(client);
    case 8: {
        uint8_t *bytes = exact(params, len);
        status = armwire_xarm_client_raw(client, any8(), or_null(bytes), len);
        free(bytes);
        return status;
    }
    case 9: return armwire_xarm_client_set_protocol(client, (uint16_t)random_below(&rng, 5));
    default: return xarm_client_mechanics(client, one_in(6) ? 0 : 1 + random_below(&rng, 10));
    }
}

static ArmwireStatus xarm_device_call(ArmwireXarmDevice *device)
{
    ArmwireXarmResponse response;
    ArmwireXarmRequest request;
    ArmwireFault fault;
    uint8_t bytes[255];
    size_t len, room = random_below(&rng, 261);
    if (one_in(2)) {
        return xarm_device_mechanics(device, one_in(6) ? 0 : 1 + random_below(&rng, 8));
    }
    any_bytes(&fault, sizeof fault);
    any_bytes(&request, sizeof request);
    any_bytes(&response, sizeof response);
    (void)armwire_xarm_refusal(or_null(&fault), or_null(&response));
    any_bytes(bytes, sizeof bytes);
    response.kind = one_in(10) ? any32() : random_below(&rng, 11);
    response.data_len = random_below(&rng, 256);
    uint8_t *data = exact(bytes, response.data_len), *out = malloc(room + 1);
    response.data = one_in(25) ? NULL : data;
    ArmwireStatus status = armwire_xarm_device_respond(device, or_null(&request), or_null(&response),
                                                       one_in(25) ? NULL : out + 1, room, or_null(&len));
    free(data);
    free(out);
    return status;
}

static ArmwireStatus call(enum Kind kind, void *memory)
{
    switch (kind) {
    case LING_CLIENT: return ling_client_call(memory);
    case LING_DEVICE: return ling_device_call(memory);
    case LING_STOP: return ling_stop_call(memory);
    case LING_READ_BACK: return ling_read_back_call(memory);
    case LING_ARRIVAL: return ling_arrival_call(memory);
    case ALPHA1_CLIENT: return alpha1_client_call(memory);
    case ALPHA1_DEVICE: return alpha1_device_call(memory);
    case XARM_CLIENT: return xarm_client_call(memory);
    default: return xarm_device_call(memory);
    }
}

/* Returns the kind in memory, by calls without side effects. */
static enum Kind look_into(void *memory)
{
    static const ArmwireLingResponse none;
    ArmwireFault fault;
    if (armwire_ling_stop_on_joints(memory, 0, &none) == ARMWIRE_STATUS_UNKNOWN_KIND) return LING_STOP;
    if (armwire_ling_read_back_on_joints(memory, 0, &none) == ARMWIRE_STATUS_UNKNOWN_KIND) return LING_READ_BACK;
    if (armwire_ling_arrival_on_joints(memory, 0, &none, NULL) == ARMWIRE_STATUS_UNKNOWN_KIND) return LING_ARRIVAL;
    if (armwire_ling_client_fault(memory, &fault) == ARMWIRE_STATUS_OK) return LING_CLIENT;
    if (armwire_ling_device_fault(memory, &fault) == ARMWIRE_STATUS_OK) return LING_DEVICE;
    if (armwire_alpha1_client_fault(memory, &fault) == ARMWIRE_STATUS_OK) return ALPHA1_CLIENT;
    if (armwire_alpha1_device_fault(memory, &fault) == ARMWIRE_STATUS_OK) return ALPHA1_DEVICE;
    if (armwire_xarm_client_fault(memory, &fault) == ARMWIRE_STATUS_OK) return XARM_CLIENT;
    if (armwire_xarm_device_fault(memory, &fault) == ARMWIRE_STATUS_OK) return XARM_DEVICE;
    return KINDS;
}

static void step(void)
{
    size_t at = random_below(&rng, MEMORIES);
    void *memory = memories[at];
    enum Kind kind = contents[at] == KINDS || one_in(8) ? (enum Kind)random_below(&rng, KINDS) : contents[at];
    clock_us += random_below(&rng, 4) * random_below(&rng, 60000);
    if (one_in(500)) {
        /* Uninitialized memory. */
        any_bytes(memory, largest);
        contents[at] = look_into(memory);
        CHECK(contents[at] == KINDS);
    } else if (one_in(500)) {
        /* Moved memory: the content does not depend on its address. */
        void *moved = malloc(largest);
        CHECK(moved != NULL);
        memcpy(moved, memory, largest);
        free(memory);
        memories[at] = moved;
    } else if (one_in(40)) {
        ArmwireStatus status = call(kind, NULL);
        CHECK(status == ARMWIRE_STATUS_NULL || status == ARMWIRE_STATUS_VERSION || status == ARMWIRE_STATUS_OUT_OF_RANGE);
        statuses[status]++;
    } else {
        uint8_t before[sizeof(ArmwireXarmClient)];
        memcpy(before, memory, largest);
        ArmwireStatus status = call(kind, memory);
        CHECK(status <= ARMWIRE_STATUS_UNKNOWN_KIND);
        statuses[status]++;
        enum Kind now = look_into(memory);
        /* Only `init` changes the kind, and nothing is written beyond the memory of a kind. */
        CHECK(now == contents[at] || (now == kind && status == ARMWIRE_STATUS_OK));
        CHECK(memcmp(before + sizes[kind], (uint8_t *)memory + sizes[kind], largest - sizes[kind]) == 0);
        if (now == contents[at] && kind != contents[at]) {
            CHECK(status != ARMWIRE_STATUS_OK && memcmp(before, memory, largest) == 0);
        }
        contents[at] = now;
    }
}

int main(int argc, char **argv)
{
    CHECK(argc == 2 || argc == 3);
    rng.state = argc == 3 ? strtoull(argv[2], NULL, 10) : 1;
    largest = sizeof(ArmwireXarmClient);
    for (size_t i = 0; i < MEMORIES; i++) {
        contents[i] = KINDS;
        memories[i] = calloc(1, largest);
        CHECK(memories[i] != NULL);
    }
    for (unsigned long calls = strtoul(argv[1], NULL, 10); calls > 0; calls--) {
        step();
    }
    for (uint32_t status = 0; status <= ARMWIRE_STATUS_UNKNOWN_KIND; status++) {
        printf("%9lu %s\n", statuses[status], armwire_status_text(status));
        CHECK(statuses[status] > 0);
    }
    CHECK(strcmp(armwire_status_text(99), "unknown status") == 0);
    for (size_t i = 0; i < MEMORIES; i++) {
        free(memories[i]);
    }
    return 0;
}
