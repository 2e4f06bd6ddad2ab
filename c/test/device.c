/* Arms in C: every request of a client arrives unchanged at the device, and every response at the client, with and without
 * faults on the line. Runs in virtual time. Usage: device ROUNDS */
#include "harness.h"

static Random rng = {1};
/* Faults in bytes per thousand. */
static uint32_t faults;
static uint64_t clock_us;

/* Applies the faults of a line to bytes. Returns their number in `to`, which has twice the size. */
static size_t line(const uint8_t *from, size_t len, uint8_t *to)
{
    size_t n = 0;
    for (size_t i = 0; i < len; i++) {
        uint32_t fault = random_below(&rng, 1000) < faults ? random_below(&rng, 3) : 3;
        if (fault == 0) {
            continue;
        }
        if (fault == 1) {
            to[n++] = (uint8_t)random_below(&rng, 256);
        }
        uint32_t flipped = fault == 2 ? 1u << random_below(&rng, 8) : 0;
        to[n++] = (uint8_t)(from[i] ^ flipped);
    }
    return n;
}

/* Defines NAME_exchange: carries the request in flight to the device and its response back, in chunks. The device answers by
 * NAME_answer, which returns the length of the response in `out`, 0 for none. */
#define DEFINE_EXCHANGE(name, Name)                                                                                   \
    /* The request in flight has ended. A void of its last repeat makes the device discard that. */                   \
    static ArmwireEvent name##_end(ArmwireEvent end)                                                                  \
    {                                                                                                                 \
        ArmwireEvent event = end, received;                                                                           \
        Armwire##Name##Response response;                                                                             \
        Armwire##Name##Request request;                                                                               \
        while (faults > 0 && event.kind != ARMWIRE_EVENT_KIND_WAIT) {                                                 \
            CHECK_OK(armwire_##name##_client_poll(&name##_client, clock_us, &event, &response));                      \
            size_t len = event.kind == ARMWIRE_EVENT_KIND_TRANSMIT ? event.len : 0, taken;                            \
            for (size_t at = 0; at < len; at += taken) {                                                              \
                CHECK(event.bytes[at] == 0);                                                                          \
                CHECK_OK(armwire_##name##_device_receive(&name##_device, event.bytes + at, len - at, &taken));        \
                do {                                                                                                  \
                    CHECK_OK(armwire_##name##_device_poll(&name##_device, &received, &request));                      \
                    CHECK(received.kind != ARMWIRE_EVENT_KIND_REQUEST);                                               \
                } while (received.kind != ARMWIRE_EVENT_KIND_WAIT);                                                   \
            }                                                                                                         \
            CHECK_OK(armwire_##name##_client_transmitted(&name##_client, clock_us, len));                             \
        }                                                                                                             \
        return end;                                                                                                   \
    }                                                                                                                 \
                                                                                                                      \
    static ArmwireEvent name##_exchange(Armwire##Name##Response *response)                                            \
    {                                                                                                                 \
        static Others others;                                                                                         \
        for (;;) {                                                                                                    \
            ArmwireEvent event;                                                                                       \
            uint8_t to_device[700], to_client[2000];                                                                  \
            CHECK_OK(armwire_##name##_client_poll(&name##_client, clock_us, &event, response));                       \
            if (event.kind == ARMWIRE_EVENT_KIND_WAIT) {                                                              \
                CHECK(event.until_us != UINT64_MAX && event.until_us > clock_us);                                     \
                clock_us = event.until_us;                                                                            \
                /* An arm discards an incomplete request after this silence. */                                       \
                CHECK_OK(armwire_##name##_device_idle(&name##_device));                                               \
                continue;                                                                                             \
            }                                                                                                         \
            if (event.kind == ARMWIRE_EVENT_KIND_RECEIVE) {                                                           \
                CHECK_OK(armwire_##name##_client_received(&name##_client, clock_us, 0));                              \
                continue;                                                                                             \
            }                                                                                                         \
            if (event.kind != ARMWIRE_EVENT_KIND_TRANSMIT) {                                                          \
                if (ends_request(&event, &others)) {                                                                  \
                    return name##_end(event);                                                                                     \
                }                                                                                                     \
                continue;                                                                                             \
            }                                                                                                         \
            size_t part = 1 + random_below(&rng, (uint32_t)event.len);                                                \
            size_t there = line(event.bytes, part, to_device), back = 0;                                              \
            clock_us += 10 * part;                                                                                    \
            CHECK_OK(armwire_##name##_client_transmitted(&name##_client, clock_us, part));                            \
            for (size_t at = 0; at < there || event.kind != ARMWIRE_EVENT_KIND_WAIT;) {                               \
                size_t taken;                                                                                         \
                Armwire##Name##Request request;                                                                       \
                CHECK_OK(armwire_##name##_device_receive(&name##_device, to_device + at, there - at, &taken));        \
                at += taken;                                                                                          \
                CHECK_OK(armwire_##name##_device_poll(&name##_device, &event, &request));                             \
                if (event.kind == ARMWIRE_EVENT_KIND_REQUEST) {                                                       \
                    uint8_t out[260];                                                                                 \
                    size_t len = name##_answer(&request, out, sizeof out);                                            \
                    back += line(out, len, to_client + back);                                                         \
                    CHECK(back < sizeof to_client - 520);                                                             \
                }                                                                                                     \
            }                                                                                                         \
            for (size_t at = 0; at < back;) {                                                                         \
                size_t taken, chunk = 1 + random_below(&rng, (uint32_t)(back - at));                                  \
                clock_us += 10 * chunk;                                                                               \
                CHECK_OK(armwire_##name##_client_receive(&name##_client, clock_us, to_client + at, chunk, &taken));   \
                at += taken;                                                                                          \
                if (at < back) {                                                                                      \
                    CHECK_OK(armwire_##name##_client_poll(&name##_client, clock_us, &event, response));               \
                    bool is_event = event.kind != ARMWIRE_EVENT_KIND_WAIT &&                                          \
                                    event.kind != ARMWIRE_EVENT_KIND_RECEIVE &&                                       \
                                    event.kind != ARMWIRE_EVENT_KIND_TRANSMIT;                                        \
                    if (is_event && ends_request(&event, &others)) {                                                  \
                        CHECK(faults > 0);                                                                            \
                        return name##_end(event);                                                                                 \
                    }                                                                                                 \
                }                                                                                                     \
            }                                                                                                         \
        }                                                                                                             \
    }

/* Returns true for an answer on a line without faults. Without faults every request has one. */
static bool answered(const ArmwireEvent *event)
{
    if (faults == 0) {
        CHECK(event->kind == ARMWIRE_EVENT_KIND_ANSWER);
    }
    return event->kind == ARMWIRE_EVENT_KIND_ANSWER && faults == 0;
}

static uint8_t any8(void)
{
    return (uint8_t)random_below(&rng, 256);
}

static uint16_t any16(void)
{
    return (uint16_t)random_below(&rng, 65536);
}

/* Ling */

static ArmwireLingClient ling_client;
static ArmwireLingDevice ling_device;
static ArmwireLingRequest ling_request;
static ArmwireLingResponse ling_sent;

static size_t ling_answer(const ArmwireLingRequest *request, uint8_t *out, size_t size)
{
    ArmwireLingResponse *response = &ling_sent;
    size_t len;
    ling_request = *request;
    memset(response, 0, sizeof *response);
    response->servos = random_below(&rng, 2) == 0 ? 6 : 10;
    switch (request->kind) {
    case ARMWIRE_LING_REQUEST_KIND_READ_INFO:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_INFO;
        for (size_t i = 0; i < sizeof response->serial_number; i++) {
            response->serial_number[i] = any8();
        }
        response->hardware_version = any16();
        response->firmware_version = any16();
        break;
    case ARMWIRE_LING_REQUEST_KIND_READ_STROKE:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_STROKE;
        response->stroke_mm = (uint8_t)(50 + 25 * random_below(&rng, 3));
        break;
    case ARMWIRE_LING_REQUEST_KIND_READ_JOINTS:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_JOINTS;
        for (size_t i = 0; i < ARMWIRE_LING_JOINTS; i++) {
            response->position_ticks[i] = any16();
        }
        response->opening_per_mille = any16();
        response->motion_status = any8();
        break;
    case ARMWIRE_LING_REQUEST_KIND_READ_TEMPERATURES:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_TEMPERATURES;
        for (size_t i = 0; i < response->servos; i++) {
            response->temperature_celsius[i] = any8();
        }
        break;
    case ARMWIRE_LING_REQUEST_KIND_READ_VELOCITIES:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_VELOCITIES;
        for (size_t i = 0; i < response->servos; i++) {
            response->velocity_ticks_per_s[i] = any16();
        }
        break;
    case ARMWIRE_LING_REQUEST_KIND_SELF_CHECK:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_SELF_CHECK;
        response->normal_servos = any16();
        break;
    case ARMWIRE_LING_REQUEST_KIND_SET_MODE:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_MODE_REPLY;
        response->requested_mode = request->control_mode;
        response->mode_result = (uint8_t)random_below(&rng, 3);
        break;
    case ARMWIRE_LING_REQUEST_KIND_READ_MODE:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_MODE;
        response->control_mode = any8() & 1;
        response->blocked_joints = any8();
        response->valid_joints = any8();
        for (size_t i = 0; i < ARMWIRE_LING_JOINTS; i++) {
            response->joint_force[i].residual_torque_mnm = (int16_t)(any16() - 32768);
            response->joint_force[i].requested_current_ma = (int16_t)(any16() - 32768);
            response->joint_force[i].output_current_ma = (int16_t)(any16() - 32768);
            response->joint_force[i].measured_current_ma = (int16_t)(any16() - 32768);
        }
        break;
    case ARMWIRE_LING_REQUEST_KIND_SET_FORCE_FEEDBACK:
    case ARMWIRE_LING_REQUEST_KIND_READ_FORCE_FEEDBACK:
        response->kind = ARMWIRE_LING_RESPONSE_KIND_FORCE_FEEDBACK;
        response->force_feedback.requested = any8() & 1;
        response->force_feedback.effective = any8() & 1;
        response->force_feedback.inhibit_mask = any8();
        response->force_feedback.sync_active = any8() & 1;
        response->force_feedback.torque_enabled = any8() & 1;
        response->force_feedback.torque_requested = any8() & 1;
        response->force_feedback.transition = any8();
        response->force_feedback.grip_raw = any8();
        response->requested_mode = any8();
        break;
    default:
        return 0;
    }
    CHECK_OK(armwire_ling_device_respond(&ling_device, response, out, size, &len));
    return len;
}

DEFINE_EXCHANGE(ling, Ling)

static void ling_same(const ArmwireLingResponse *got)
{
    const ArmwireLingResponse *sent = &ling_sent;
    bool many = sent->kind == ARMWIRE_LING_RESPONSE_KIND_TEMPERATURES || sent->kind == ARMWIRE_LING_RESPONSE_KIND_VELOCITIES;
    CHECK(got->kind == sent->kind);
    CHECK(memcmp(got->serial_number, sent->serial_number, sizeof got->serial_number) == 0);
    CHECK(got->hardware_version == sent->hardware_version && got->firmware_version == sent->firmware_version);
    CHECK(memcmp(got->position_ticks, sent->position_ticks, sizeof got->position_ticks) == 0);
    CHECK(got->opening_per_mille == sent->opening_per_mille && got->motion_status == sent->motion_status);
    CHECK(got->stroke_mm == sent->stroke_mm && got->servos == (many ? sent->servos : 0));
    CHECK(memcmp(got->temperature_celsius, sent->temperature_celsius, sizeof got->temperature_celsius) == 0);
    CHECK(memcmp(got->velocity_ticks_per_s, sent->velocity_ticks_per_s, sizeof got->velocity_ticks_per_s) == 0);
    CHECK(got->normal_servos == sent->normal_servos);
    CHECK(got->requested_mode == sent->requested_mode && got->mode_result == sent->mode_result);
    CHECK(got->control_mode == sent->control_mode);
    CHECK(got->blocked_joints == sent->blocked_joints && got->valid_joints == sent->valid_joints);
    CHECK(memcmp(got->joint_force, sent->joint_force, sizeof got->joint_force) == 0);
    CHECK(memcmp(&got->force_feedback, &sent->force_feedback, sizeof got->force_feedback) == 0);
}

static void ling_round(void)
{
    typedef ArmwireStatus Plain(ArmwireLingClient *);
    static Plain *const plain[] = {
        armwire_ling_client_read_info,         armwire_ling_client_set_zero,        armwire_ling_client_read_stroke,
        armwire_ling_client_read_joints,       armwire_ling_client_read_temperatures,
        armwire_ling_client_read_velocities,   armwire_ling_client_self_check};
    static const uint32_t kinds[] = {
        ARMWIRE_LING_REQUEST_KIND_READ_INFO,       ARMWIRE_LING_REQUEST_KIND_SET_ZERO,
        ARMWIRE_LING_REQUEST_KIND_READ_STROKE,     ARMWIRE_LING_REQUEST_KIND_READ_JOINTS,
        ARMWIRE_LING_REQUEST_KIND_READ_TEMPERATURES, ARMWIRE_LING_REQUEST_KIND_READ_VELOCITIES,
        ARMWIRE_LING_REQUEST_KIND_SELF_CHECK,      ARMWIRE_LING_REQUEST_KIND_SET_STROKE,
        ARMWIRE_LING_REQUEST_KIND_SET_TORQUE,      ARMWIRE_LING_REQUEST_KIND_SET_TEMPERATURE_LIMIT,
        ARMWIRE_LING_REQUEST_KIND_MOVE,            ARMWIRE_LING_REQUEST_KIND_SET_MODE,
        ARMWIRE_LING_REQUEST_KIND_READ_MODE,       ARMWIRE_LING_REQUEST_KIND_SET_FORCE_FEEDBACK,
        ARMWIRE_LING_REQUEST_KIND_READ_FORCE_FEEDBACK};
    uint32_t which = random_below(&rng, 15);
    uint8_t stroke_mm = (uint8_t)(50 + 25 * random_below(&rng, 3)), on = any8() & 1, celsius = (uint8_t)random_below(&rng, 254);
    ArmwireLingMove target;
    for (size_t i = 0; i < ARMWIRE_LING_JOINTS; i++) {
        target.position_ticks[i] = (uint16_t)random_below(&rng, 4096);
        target.speed_ticks_per_s[i] = (uint16_t)(50 + random_below(&rng, 4951));
    }
    target.opening_per_mille = (uint16_t)random_below(&rng, 1001);
    target.gripper_speed_ticks_per_s = any16();
    memset(&ling_request, 0, sizeof ling_request);
    switch (which) {
    case 7: CHECK_OK(armwire_ling_client_set_stroke(&ling_client, stroke_mm)); break;
    case 8: CHECK_OK(armwire_ling_client_set_torque(&ling_client, on)); break;
    case 9: CHECK_OK(armwire_ling_client_set_temperature_limit(&ling_client, celsius)); break;
    case 10: CHECK_OK(armwire_ling_client_move(&ling_client, &target)); break;
    case 11: CHECK_OK(armwire_ling_client_set_mode(&ling_client, on)); break;
    case 12: CHECK_OK(armwire_ling_client_read_mode(&ling_client)); break;
    case 13: CHECK_OK(armwire_ling_client_set_force_feedback(&ling_client, on)); break;
    case 14: CHECK_OK(armwire_ling_client_read_force_feedback(&ling_client)); break;
    default: CHECK_OK(plain[which](&ling_client)); break;
    }
    ArmwireLingResponse response;
    ArmwireEvent event = ling_exchange(&response);
    if (which == 1 || (which >= 7 && which <= 10)) {
        CHECK(event.kind == ARMWIRE_EVENT_KIND_SENT);
    } else if (answered(&event)) {
        ling_same(&response);
    }
    if (faults == 0) {
        const ArmwireLingRequest *got = &ling_request;
        CHECK(got->kind == kinds[which]);
        CHECK(got->stroke_mm == (which == 7 ? stroke_mm : 0) && got->torque_on == (which == 8 ? on : 0));
        CHECK(got->temperature_limit_celsius == (which == 9 ? celsius : 0));
        CHECK(got->control_mode == (which == 11 ? on : 0) && got->force_feedback_on == (which == 13 ? on : 0));
        CHECK(which != 10 || memcmp(&got->target, &target, sizeof target) == 0);
    }
}

/* Alpha1 */

static ArmwireAlpha1Client alpha1_client;
static ArmwireAlpha1Device alpha1_device;
static ArmwireAlpha1Request alpha1_request;
static ArmwireAlpha1Response alpha1_sent;
static uint8_t alpha1_name[254], alpha1_text[254];
static size_t alpha1_name_len;

static size_t alpha1_answer(const ArmwireAlpha1Request *request, uint8_t *out, size_t size)
{
    ArmwireAlpha1Response *response = &alpha1_sent;
    size_t len;
    alpha1_request = *request;
    if (faults == 0) {
        CHECK(request->name_len == 0 || memcmp(request->name, alpha1_name, request->name_len) == 0);
    }
    memset(response, 0, sizeof *response);
    response->success = any8() & 1;
    response->servo_id = request->servo_id;
    switch (request->kind) {
    case ARMWIRE_ALPHA1_REQUEST_KIND_READ_HARDWARE_VERSION:
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_HARDWARE_VERSION;
        response->success = 0;
        response->text = alpha1_text;
        response->text_len = random_below(&rng, 255);
        for (size_t i = 0; i < response->text_len; i++) {
            alpha1_text[i] = any8();
        }
        break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_READ_SERVO_STATES:
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_STATES;
        response->success = 0;
        response->running_servos = (uint32_t)any16() << 16 | any16();
        break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_STOP: response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_STOPPED; break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_READ_FIRMWARE_VERSION:
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_FIRMWARE_VERSION;
        for (size_t i = 0; i < sizeof response->firmware_version; i++) {
            response->firmware_version[i] = any8();
        }
        break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_ACT: response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_ACTED; break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_SET_OFFSET_TOOL: response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_OFFSET_TOOL; break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_SET_USB_TYPE: response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_USB_TYPE; break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_PLAY: response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_PLAYING; break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_MOVE:
    case ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_RELEASE:
    case ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_SET_LED:
        if (request->servo_id == 0) {
            return 0;
        }
        response->success = 0;
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED;
        break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_READ_ANGLES:
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ANGLES;
        response->target_degrees = any16();
        response->actual_degrees = any16();
        break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_CHANGE_ID:
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ID_CHANGED;
        response->servo_id = response->success ? request->new_servo_id : request->servo_id;
        response->previous_servo_id = request->servo_id;
        break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_SET_OFFSET:
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_OFFSET_SET;
        break;
    case ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_READ_OFFSET:
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_OFFSET;
        response->offset_thirds_of_degree = (int16_t)(any16() - 32768);
        break;
    default:
        CHECK(request->kind == ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_READ_VERSION);
        response->kind = ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_VERSION;
        for (size_t i = 0; i < sizeof response->servo_version; i++) {
            response->servo_version[i] = any8();
        }
        break;
    }
    CHECK_OK(armwire_alpha1_device_respond(&alpha1_device, response, out, size, &len));
    return len;
}

DEFINE_EXCHANGE(alpha1, Alpha1)

static void alpha1_same(const ArmwireAlpha1Response *got)
{
    const ArmwireAlpha1Response *sent = &alpha1_sent;
    bool servo = sent->kind >= ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED;
    CHECK(got->kind == sent->kind && got->success == sent->success);
    CHECK(got->servo_id == (servo ? sent->servo_id : 0) && got->previous_servo_id == sent->previous_servo_id);
    CHECK(memcmp(got->firmware_version, sent->firmware_version, sizeof got->firmware_version) == 0);
    CHECK(memcmp(got->servo_version, sent->servo_version, sizeof got->servo_version) == 0);
    CHECK(got->target_degrees == sent->target_degrees && got->actual_degrees == sent->actual_degrees);
    CHECK(got->offset_thirds_of_degree == sent->offset_thirds_of_degree && got->running_servos == sent->running_servos);
    CHECK(got->text_len == sent->text_len);
    CHECK(got->text_len == 0 || memcmp(got->text, sent->text, got->text_len) == 0);
}

static void alpha1_round(void)
{
    ArmwireAlpha1Client *client = &alpha1_client;
    uint32_t kind = 1 + random_below(&rng, 16);
    uint8_t servo = (uint8_t)(1 + random_below(&rng, 240)), other = (uint8_t)(1 + random_below(&rng, 240));
    uint8_t to = random_below(&rng, 4) == 0 ? 0 : servo, flag = any8() & 1, byte = any8();
    uint8_t usb = (uint8_t)(1 + random_below(&rng, 3)), angle = (uint8_t)random_below(&rng, 241);
    uint32_t time_ms = 20 * random_below(&rng, 256), lock_ms = 20 * random_below(&rng, 65536);
    int16_t offset = (int16_t)((int)random_below(&rng, 181) - 90);
    ArmwireAlpha1Action action;
    memset(&action, 0, sizeof action);
    for (size_t i = 0; i < ARMWIRE_ALPHA1_SERVOS; i++) {
        uint8_t degrees = (uint8_t)random_below(&rng, 242);
        action.angle_degrees[i] = degrees > 240 ? ARMWIRE_ALPHA1_NO_ANGLE : degrees;
    }
    action.time_ms = time_ms;
    action.interval_ms = lock_ms;
    alpha1_name_len = random_below(&rng, 255);
    for (size_t i = 0; i < alpha1_name_len; i++) {
        alpha1_name[i] = any8();
    }
    memset(&alpha1_request, 0, sizeof alpha1_request);
    switch (kind) {
    case 1: CHECK_OK(armwire_alpha1_client_read_hardware_version(client)); break;
    case 2: CHECK_OK(armwire_alpha1_client_read_servo_states(client)); break;
    case 3: CHECK_OK(armwire_alpha1_client_stop(client)); break;
    case 4: CHECK_OK(armwire_alpha1_client_read_firmware_version(client)); break;
    case 5: CHECK_OK(armwire_alpha1_client_act(client, &action)); break;
    case 6: CHECK_OK(armwire_alpha1_client_set_offset_tool(client, flag)); break;
    case 7: CHECK_OK(armwire_alpha1_client_set_usb_type(client, usb)); break;
    case 8: CHECK_OK(armwire_alpha1_client_play(client, alpha1_name, alpha1_name_len)); break;
    case 9: CHECK_OK(armwire_alpha1_client_servo_move(client, to, angle, time_ms, lock_ms)); break;
    case 10: CHECK_OK(armwire_alpha1_client_servo_release(client, to)); break;
    case 11: CHECK_OK(armwire_alpha1_client_servo_set_led(client, to, byte)); break;
    case 12: CHECK_OK(armwire_alpha1_client_servo_read_angles(client, servo)); break;
    case 13: CHECK_OK(armwire_alpha1_client_servo_change_id(client, servo, other)); break;
    case 14: CHECK_OK(armwire_alpha1_client_servo_set_offset(client, servo, offset)); break;
    case 15: CHECK_OK(armwire_alpha1_client_servo_read_offset(client, servo)); break;
    default: CHECK_OK(armwire_alpha1_client_servo_read_version(client, servo)); break;
    }
    ArmwireAlpha1Response response;
    ArmwireEvent event = alpha1_exchange(&response);
    bool to_all = kind >= 9 && kind <= 11 && to == 0;
    if (to_all) {
        CHECK(event.kind == ARMWIRE_EVENT_KIND_SENT);
    } else if (answered(&event)) {
        alpha1_same(&response);
    }
    if (faults == 0) {
        const ArmwireAlpha1Request *got = &alpha1_request;
        CHECK(got->kind == kind);
        CHECK(got->servo_id == (kind < 9 ? 0 : kind <= 11 ? to : servo) && got->new_servo_id == (kind == 13 ? other : 0));
        CHECK(got->connected == (kind == 6 ? flag : 0) && got->usb_type == (kind == 7 ? usb : 0));
        CHECK(got->led == (kind == 11 ? byte : 0) && got->angle_degrees == (kind == 9 ? angle : 0));
        CHECK(got->time_ms == (kind == 9 ? time_ms : 0) && got->lock_ms == (kind == 9 ? lock_ms : 0));
        CHECK(got->offset_thirds_of_degree == (kind == 14 ? offset : 0));
        CHECK(got->name_len == (kind == 8 ? alpha1_name_len : 0));
        CHECK(kind != 5 || memcmp(&got->action, &action, sizeof action) == 0);
    }
}

/* xArm */

static ArmwireXarmClient xarm_client;
static ArmwireXarmDevice xarm_device;
static ArmwireXarmRequest xarm_request;
static ArmwireXarmResponse xarm_sent;
static uint8_t xarm_params[252], xarm_data[252];

static size_t xarm_answer(const ArmwireXarmRequest *request, uint8_t *out, size_t size)
{
    ArmwireXarmResponse *response = &xarm_sent;
    size_t len;
    CHECK(request->params_len == 0 || memcmp(request->params, xarm_params, request->params_len) == 0);
    xarm_request = *request;
    memset(response, 0, sizeof *response);
    response->state = any8();
    response->reg = request->reg;
    for (size_t i = 0; i < sizeof xarm_data; i++) {
        xarm_data[i] = any8();
    }
    response->data = xarm_data;
    response->data_len = 0;
    switch (request->kind) {
    case ARMWIRE_XARM_REQUEST_KIND_HEARTBEAT: return 0;
    case ARMWIRE_XARM_REQUEST_KIND_READ_VERSION:
        response->kind = ARMWIRE_XARM_RESPONSE_KIND_VERSION;
        response->data_len = 1 + random_below(&rng, 252);
        break;
    case ARMWIRE_XARM_REQUEST_KIND_READ_SERIALS:
        response->kind = ARMWIRE_XARM_RESPONSE_KIND_SERIALS;
        response->data_len = 1 + random_below(&rng, 252);
        break;
    case ARMWIRE_XARM_REQUEST_KIND_READ_TORQUE_SOURCE:
        response->kind = ARMWIRE_XARM_RESPONSE_KIND_TORQUE_SOURCE;
        response->torque_source = any8() & 1;
        break;
    case ARMWIRE_XARM_REQUEST_KIND_READ_ROTATION_RADIUS:
        response->kind = ARMWIRE_XARM_RESPONSE_KIND_ROTATION_RADIUS;
        response->rotation_radius_mm = (float)any16() / 8;
        break;
    case ARMWIRE_XARM_REQUEST_KIND_REBOOT:
        response->kind = ARMWIRE_XARM_RESPONSE_KIND_SYSTEM_CONTROL;
        response->system_control = any16();
        break;
    case ARMWIRE_XARM_REQUEST_KIND_RAW:
        response->kind = ARMWIRE_XARM_RESPONSE_KIND_RAW;
        response->data_len = random_below(&rng, 253);
        break;
    default:
        CHECK(request->kind == ARMWIRE_XARM_REQUEST_KIND_RELOAD_DYNAMICS ||
              request->kind == ARMWIRE_XARM_REQUEST_KIND_SHUTDOWN);
        response->kind = ARMWIRE_XARM_RESPONSE_KIND_EMPTY;
        break;
    }
    CHECK_OK(armwire_xarm_device_respond(&xarm_device, request, response, out, size, &len));
    return len;
}

DEFINE_EXCHANGE(xarm, Xarm)

static void xarm_same(const ArmwireXarmResponse *got)
{
    const ArmwireXarmResponse *sent = &xarm_sent;
    CHECK(got->kind == sent->kind && got->state == sent->state && got->reg == sent->reg);
    CHECK(got->torque_source == sent->torque_source && got->system_control == sent->system_control);
    CHECK(memcmp(&got->rotation_radius_mm, &sent->rotation_radius_mm, sizeof(float)) == 0);
    CHECK(got->data_len == sent->data_len);
    CHECK(got->data_len == 0 || memcmp(got->data, sent->data, got->data_len) == 0);
}

static void xarm_round(void)
{
    ArmwireXarmClient *client = &xarm_client;
    uint32_t kind = 1 + random_below(&rng, 9);
    uint8_t joint = (uint8_t)(1 + random_below(&rng, 7)), reg = (uint8_t)(11 + random_below(&rng, 245));
    size_t len = random_below(&rng, 253);
    uint16_t protocol = (uint16_t)(2 + random_below(&rng, 2));
    for (size_t i = 0; i < len; i++) {
        xarm_params[i] = any8();
    }
    memset(&xarm_request, 0, sizeof xarm_request);
    CHECK_OK(armwire_xarm_client_set_protocol(client, protocol));
    switch (kind) {
    case 1: CHECK_OK(armwire_xarm_client_heartbeat(client)); break;
    case 2: CHECK_OK(armwire_xarm_client_read_version(client)); break;
    case 3: CHECK_OK(armwire_xarm_client_read_serials(client)); break;
    case 4: CHECK_OK(armwire_xarm_client_reload_dynamics(client)); break;
    case 5: CHECK_OK(armwire_xarm_client_read_torque_source(client)); break;
    case 6: CHECK_OK(armwire_xarm_client_read_rotation_radius(client, joint)); break;
    case 7: CHECK_OK(armwire_xarm_client_shutdown(client)); break;
    case 8: CHECK_OK(armwire_xarm_client_reboot(client)); break;
    default: CHECK_OK(armwire_xarm_client_raw(client, reg, xarm_params, len)); break;
    }
    ArmwireXarmResponse response;
    ArmwireEvent event = xarm_exchange(&response);
    if (kind == 1) {
        CHECK(event.kind == ARMWIRE_EVENT_KIND_SENT);
    } else if (answered(&event)) {
        xarm_same(&response);
    }
    CHECK(xarm_request.kind == kind && xarm_request.protocol_id == (kind == 1 ? 1 : protocol));
    CHECK(xarm_request.joint == (kind == 6 ? joint : 0) && xarm_request.params_len == (kind == 9 ? len : 0));
    CHECK(kind != 9 || xarm_request.reg == reg);
}

/* Checks a device's response to frames that are not requests, and the client's handling of it. */
static void invalid_requests_are_refused_by_the_device(void)
{
    static const uint8_t bad_joint[] = {0, 7, 0, 3, 0, 2, 6, 8}, modbus[] = {0, 7, 0, 0, 0, 6, 1, 3, 0, 0, 0, 1};
    static const uint8_t stray[] = {0, 7, 0, 9, 0, 2, 6, 8};
    ArmwireXarmRequest request;
    ArmwireXarmResponse response, got;
    ArmwireEvent event;
    uint8_t out[260];
    size_t taken, len;
    char text[128];

    CHECK_OK(armwire_xarm_device_receive(&xarm_device, bad_joint, sizeof bad_joint, &taken));
    CHECK_OK(armwire_xarm_device_poll(&xarm_device, &event, &request));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_UNKNOWN && event.len == sizeof bad_joint && request.transaction_id == 7);
    CHECK(armwire_fault_text(&event.fault, text, sizeof text) < sizeof text);
    CHECK(strcmp(text, "register 6: joint is 8, must be 1..=7 (data byte 0)") == 0);
    CHECK_OK(armwire_xarm_refusal(&event.fault, &response));
    CHECK_OK(armwire_xarm_device_respond(&xarm_device, &request, &response, out, sizeof out, &len));
    CHECK(len == 8 && memcmp(out, "\0\7\0\3\0\2\6\10", 8) == 0);

    CHECK_OK(armwire_xarm_device_receive(&xarm_device, modbus, sizeof modbus, &taken));
    CHECK_OK(armwire_xarm_device_poll(&xarm_device, &event, &request));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_UNKNOWN && event.fault.message == ARMWIRE_MESSAGE_KIND_MODBUS);
    CHECK_OK(armwire_xarm_refusal(&event.fault, &response));
    CHECK_OK(armwire_xarm_device_respond(&xarm_device, &request, &response, out, sizeof out, &len));
    CHECK_OK(armwire_xarm_client_receive(&xarm_client, clock_us, out, len, &taken));
    CHECK_OK(armwire_xarm_client_poll(&xarm_client, clock_us, &event, &got));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_UNSOLICITED && got.kind == ARMWIRE_XARM_RESPONSE_KIND_MODBUS_REFUSED);
    CHECK(got.modbus_unit == 1 && got.modbus_function == 3);

    memset(&response, 0, sizeof response);
    response.kind = ARMWIRE_XARM_RESPONSE_KIND_HEARTBEAT;
    CHECK_OK(armwire_xarm_device_respond(&xarm_device, NULL, &response, out, sizeof out, &len));
    CHECK_OK(armwire_xarm_client_receive(&xarm_client, clock_us, out, len, &taken));
    CHECK_OK(armwire_xarm_client_poll(&xarm_client, clock_us, &event, &got));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_UNSOLICITED && got.kind == ARMWIRE_XARM_RESPONSE_KIND_HEARTBEAT);

    CHECK_OK(armwire_xarm_client_receive(&xarm_client, clock_us, stray, sizeof stray, &taken));
    CHECK_OK(armwire_xarm_client_poll(&xarm_client, clock_us, &event, &got));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_BROKEN && event.fault.code != ARMWIRE_FAULT_CODE_NONE);
    CHECK_OK(armwire_xarm_device_receive(&xarm_device, stray, sizeof stray, &taken));
    CHECK_OK(armwire_xarm_device_poll(&xarm_device, &event, &request));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_BROKEN);
}

static void a_header_of_another_version_is_refused(void)
{
    ArmwireLingClient client, before;
    ArmwireXarmDevice device;
    memset(&client, 0x5A, sizeof client);
    before = client;
    CHECK(armwire_version() == ARMWIRE_VERSION);
    CHECK(armwire_ling_client_init(&client, ARMWIRE_VERSION + 1, NULL) == ARMWIRE_STATUS_VERSION);
    CHECK(memcmp(&client, &before, sizeof client) == 0);
    CHECK(armwire_ling_client_read_joints(&client) == ARMWIRE_STATUS_NOT_INITIALIZED);
    CHECK(armwire_xarm_device_init(&device, ARMWIRE_VERSION - 1) == ARMWIRE_STATUS_VERSION);
}

/* The event that ends a read of the gripper's stroke, by this answer. */
static ArmwireEvent ling_answered_by(const uint8_t *answer, size_t len, ArmwireLingResponse *response)
{
    ArmwireEvent event;
    size_t taken;
    CHECK_OK(armwire_ling_client_read_stroke(&ling_client));
    CHECK_OK(armwire_ling_client_poll(&ling_client, clock_us, &event, response));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_RECEIVE);
    CHECK_OK(armwire_ling_client_received(&ling_client, clock_us, 0));
    CHECK_OK(armwire_ling_client_poll(&ling_client, clock_us, &event, response));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_TRANSMIT);
    CHECK_OK(armwire_ling_client_transmitted(&ling_client, clock_us, event.len));
    CHECK_OK(armwire_ling_client_receive(&ling_client, clock_us, answer, len, &taken));
    CHECK(taken == len);
    CHECK_OK(armwire_ling_client_poll(&ling_client, clock_us, &event, response));
    return event;
}

static void bytes_after_documented_fields_are_in_the_event(void)
{
    static const uint8_t longer[] = {0xAA, 0x04, 0x0E, 0x03, 0x02, 0x07, 0x08, 0xA1, 0xFF};
    static const uint8_t documented[] = {0xAA, 0x04, 0x0E, 0x01, 0x01, 0x96, 0xFF};
    ArmwireLingResponse response;
    ArmwireEvent event = ling_answered_by(longer, sizeof longer, &response);
    CHECK(event.kind == ARMWIRE_EVENT_KIND_ANSWER && response.stroke_mm == 100);
    CHECK(event.len == 2 && event.bytes[0] == 7 && event.bytes[1] == 8);
    event = ling_answered_by(documented, sizeof documented, &response);
    CHECK(event.kind == ARMWIRE_EVENT_KIND_ANSWER && response.stroke_mm == 75);
    CHECK(event.len == 0 && event.bytes == NULL);
}

/* Joints and gripper with this status, and how an arm that answers them may be moved. */
static ArmwireLingMotion motion_of(uint8_t status, uint8_t foreign_data_bytes)
{
    ArmwireLingResponse joints = {.kind = ARMWIRE_LING_RESPONSE_KIND_JOINTS,
                                  .motion_status = status,
                                  .foreign_data_bytes = foreign_data_bytes};
    return armwire_ling_check_motion(&joints);
}

static void another_robot_is_named_and_not_held(void)
{
    uint8_t frame[] = {0xAA, 0x06, 0x00, 0x21, 0x65, 0x00, 0xcb, 0x00, 0x33, 0x01, 0x91, 0x01, 0xfd,
                       0x01, 0x59, 0x02, 0xbd, 0x02, 0x29, 0x03, 0x8b, 0x03, 0xf1, 0x03, 0x4f, 0x04,
                       0xb1, 0x04, 0x15, 0x05, 0x81, 0x05, 0x59, 0x01, 0xa6, 0x02, 0x11, 0x3d, 0xff};
    ArmwireLingStop stop;
    ArmwireLingStopStep step;
    ArmwireEvent event;
    ArmwireLingResponse response;
    size_t taken;
    uint64_t now = 1000000;
    CHECK_OK(armwire_ling_stop_init(&stop, ARMWIRE_VERSION, NULL));
    for (;;) {
        CHECK_OK(armwire_ling_stop_poll(&stop, now, &step));
        if (step.kind == ARMWIRE_LING_STOP_STEP_KIND_WAIT) {
            now = step.until_us;
            continue;
        }
        if (step.kind != ARMWIRE_LING_STOP_STEP_KIND_READ_JOINTS) {
            break;
        }
        CHECK_OK(armwire_ling_client_receive(&ling_client, clock_us, frame, sizeof frame, &taken));
        CHECK_OK(armwire_ling_client_poll(&ling_client, clock_us, &event, &response));
        CHECK(event.kind == ARMWIRE_EVENT_KIND_UNSOLICITED && event.len == 0);
        CHECK(response.position_ticks[0] == 0x65 && response.foreign_data_bytes == 33);
        CHECK(armwire_ling_check_motion(&response) == ARMWIRE_LING_MOTION_FOREIGN);
        CHECK_OK(armwire_ling_stop_on_joints(&stop, now, &response));
    }
    CHECK(step.kind == ARMWIRE_LING_STOP_STEP_KIND_UNHOLDABLE);

    CHECK(motion_of(0x01, 0) == ARMWIRE_LING_MOTION_ALLOWED && motion_of(0xE1, 0) == ARMWIRE_LING_MOTION_ALLOWED);
    CHECK(motion_of(0x00, 0) == ARMWIRE_LING_MOTION_TORQUE_OFF && motion_of(0xE2, 0) == ARMWIRE_LING_MOTION_TORQUE_OFF);
    CHECK(motion_of(0x42, 0) == ARMWIRE_LING_MOTION_UNKNOWN_STATUS);
    CHECK(motion_of(0x01, 33) == ARMWIRE_LING_MOTION_FOREIGN);
    CHECK(armwire_ling_check_motion(NULL) == ARMWIRE_LING_MOTION_NO_READING);
}

static void error_frame_ends_the_request_with_its_bytes(void)
{
    static const uint8_t error[] = {0xAA, 0xEE, 0x00, 0x02, 0x01, 0x03, 0x36, 0xFF};
    ArmwireLingResponse response;
    ArmwireEvent event = ling_answered_by(error, sizeof error, &response);
    CHECK(event.kind == ARMWIRE_EVENT_KIND_ERROR_FRAME && response.kind == ARMWIRE_LING_RESPONSE_KIND_NONE);
    CHECK(event.len == sizeof error && memcmp(event.bytes, error, sizeof error) == 0);
    CHECK_OK(armwire_ling_client_poll(&ling_client, clock_us, &event, &response));
    CHECK(event.kind == ARMWIRE_EVENT_KIND_WAIT && event.until_us == UINT64_MAX);
}

int main(int argc, char **argv)
{
    CHECK(argc == 2);
    unsigned long rounds = strtoul(argv[1], NULL, 10);
    a_header_of_another_version_is_refused();
    CHECK_OK(armwire_ling_device_init(&ling_device, ARMWIRE_VERSION));
    CHECK_OK(armwire_alpha1_device_init(&alpha1_device, ARMWIRE_VERSION));
    CHECK_OK(armwire_xarm_device_init(&xarm_device, ARMWIRE_VERSION));
    CHECK_OK(armwire_ling_client_init(&ling_client, ARMWIRE_VERSION, NULL));
    CHECK_OK(armwire_alpha1_client_init(&alpha1_client, ARMWIRE_VERSION, NULL));
    CHECK_OK(armwire_xarm_client_init(&xarm_client, ARMWIRE_VERSION, NULL));
    bytes_after_documented_fields_are_in_the_event();
    error_frame_ends_the_request_with_its_bytes();
    another_robot_is_named_and_not_held();
    for (unsigned long round = 0; round < rounds; round++) {
        ling_round();
        alpha1_round();
        xarm_round();
    }
    faults = 20;
    for (unsigned long round = 0; round < rounds; round++) {
        ling_round();
        alpha1_round();
    }
    invalid_requests_are_refused_by_the_device();
    return 0;
}
