/* Every request of an Alpha1 client against a virtual robot and virtual servos. Usage: alpha1 ARMWIRE, the path of the command */
#include "harness.h"

DEFINE_CALL(alpha1, Alpha1)

static ArmwireAlpha1Client client;
static Port port;
static Others others;

/* Returns the response to an accepted request. */
static ArmwireAlpha1Response answer(ArmwireStatus status, uint32_t kind)
{
    ArmwireAlpha1Response response;
    CHECK(status == ARMWIRE_STATUS_OK);
    CHECK(alpha1_call(&client, &port, &response, &others).kind == ARMWIRE_EVENT_KIND_ANSWER);
    CHECK(response.kind == kind);
    return response;
}

static void done(ArmwireStatus status, uint32_t kind)
{
    CHECK(answer(status, kind).success == 1);
}

static void sent(ArmwireStatus status)
{
    ArmwireAlpha1Response response;
    CHECK(status == ARMWIRE_STATUS_OK);
    CHECK(alpha1_call(&client, &port, &response, &others).kind == ARMWIRE_EVENT_KIND_SENT);
}

static void every_request_to_the_robot_is_answered(void)
{
    ArmwireAlpha1Response response =
        answer(armwire_alpha1_client_read_hardware_version(&client), ARMWIRE_ALPHA1_RESPONSE_KIND_HARDWARE_VERSION);
    char text[300];
    CHECK(armwire_printable(response.text, response.text_len, text, sizeof text) > 0);
    response =
        answer(armwire_alpha1_client_read_firmware_version(&client), ARMWIRE_ALPHA1_RESPONSE_KIND_FIRMWARE_VERSION);
    CHECK(response.success == 1 && memcmp(response.firmware_version, "2015121519", 10) >= 0);

    ArmwireAlpha1Action action;
    memset(&action, 0, sizeof action);
    memset(action.angle_degrees, ARMWIRE_ALPHA1_NO_ANGLE, sizeof action.angle_degrees);
    memset(action.angle_degrees, 90, 16);
    action.time_ms = 100;
    action.interval_ms = 200;
    done(armwire_alpha1_client_act(&client, &action), ARMWIRE_ALPHA1_RESPONSE_KIND_ACTED);
    response = answer(armwire_alpha1_client_read_servo_states(&client), ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_STATES);
    CHECK(response.running_servos == 0xFFFF);
    answer(armwire_alpha1_client_play(&client, (const uint8_t *)"dance", 5), ARMWIRE_ALPHA1_RESPONSE_KIND_PLAYING);
    answer(armwire_alpha1_client_stop(&client), ARMWIRE_ALPHA1_RESPONSE_KIND_STOPPED);
    done(armwire_alpha1_client_set_offset_tool(&client, 1), ARMWIRE_ALPHA1_RESPONSE_KIND_OFFSET_TOOL);
    done(armwire_alpha1_client_set_offset_tool(&client, 0), ARMWIRE_ALPHA1_RESPONSE_KIND_OFFSET_TOOL);
    done(armwire_alpha1_client_set_usb_type(&client, ARMWIRE_ALPHA1_USB_TYPE_HID),
         ARMWIRE_ALPHA1_RESPONSE_KIND_USB_TYPE);
    CHECK(others.noise + others.late + others.unsolicited + others.echo + others.unknown == 0);
}

static void every_request_to_a_servo_is_answered(void)
{
    ArmwireAlpha1Response response = answer(armwire_alpha1_client_servo_move(&client, 3, 120, 0, 0),
                                            ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED);
    CHECK(response.servo_id == 3);
    response = answer(armwire_alpha1_client_servo_read_angles(&client, 3), ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ANGLES);
    CHECK(response.servo_id == 3 && response.success == 1 && response.target_degrees == 120);
    response =
        answer(armwire_alpha1_client_servo_release(&client, 3), ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED);
    CHECK(response.servo_id == 3);
    response =
        answer(armwire_alpha1_client_servo_set_led(&client, 4, 1), ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED);
    CHECK(response.servo_id == 4);
    sent(armwire_alpha1_client_servo_move(&client, 0, 90, 1000, 1000));
    sent(armwire_alpha1_client_servo_set_led(&client, 0, 0));
    sent(armwire_alpha1_client_servo_release(&client, 0));

    response = answer(armwire_alpha1_client_servo_set_offset(&client, 5, -9),
                      ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_OFFSET_SET);
    CHECK(response.servo_id == 5 && response.success == 1);
    response = answer(armwire_alpha1_client_servo_read_offset(&client, 5), ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_OFFSET);
    CHECK(response.servo_id == 5 && response.success == 1 && response.offset_thirds_of_degree == -9);
    response =
        answer(armwire_alpha1_client_servo_change_id(&client, 16, 17), ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ID_CHANGED);
    CHECK(response.servo_id == 17 && response.success == 1 && response.previous_servo_id == 16);
    response = answer(armwire_alpha1_client_servo_read_version(&client, 17), ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_VERSION);
    CHECK(response.servo_id == 17 && response.success == 1);
    done(armwire_alpha1_client_servo_change_id(&client, 17, 16), ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ID_CHANGED);
    CHECK(others.noise + others.late + others.unsolicited + others.echo + others.unknown == 0);
}

/* Sends one of eight requests to the robot or of eight to a servo, and sets the kind of its response. */
static ArmwireStatus make_request(unsigned which, uint32_t *kind)
{
    static const uint32_t kinds[] = {
        ARMWIRE_ALPHA1_RESPONSE_KIND_HARDWARE_VERSION,   ARMWIRE_ALPHA1_RESPONSE_KIND_FIRMWARE_VERSION,
        ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_STATES,       ARMWIRE_ALPHA1_RESPONSE_KIND_STOPPED,
        ARMWIRE_ALPHA1_RESPONSE_KIND_ACTED,              ARMWIRE_ALPHA1_RESPONSE_KIND_PLAYING,
        ARMWIRE_ALPHA1_RESPONSE_KIND_OFFSET_TOOL,        ARMWIRE_ALPHA1_RESPONSE_KIND_USB_TYPE,
        ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED, ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED,
        ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED, ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ANGLES,
        ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_OFFSET_SET,   ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_OFFSET,
        ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ID_CHANGED,   ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_VERSION};
    ArmwireAlpha1Action action;
    memset(&action, 0, sizeof action);
    memset(action.angle_degrees, 90, 16);
    *kind = kinds[which];
    switch (which) {
    case 0: return armwire_alpha1_client_read_hardware_version(&client);
    case 1: return armwire_alpha1_client_read_firmware_version(&client);
    case 2: return armwire_alpha1_client_read_servo_states(&client);
    case 3: return armwire_alpha1_client_stop(&client);
    case 4: return armwire_alpha1_client_act(&client, &action);
    case 5: return armwire_alpha1_client_play(&client, (const uint8_t *)"dance", 5);
    case 6: return armwire_alpha1_client_set_offset_tool(&client, 0);
    case 7: return armwire_alpha1_client_set_usb_type(&client, ARMWIRE_ALPHA1_USB_TYPE_SERIAL_PORT);
    case 8: return armwire_alpha1_client_servo_move(&client, 2, 90, 0, 0);
    case 9: return armwire_alpha1_client_servo_release(&client, 2);
    case 10: return armwire_alpha1_client_servo_set_led(&client, 2, 0);
    case 11: return armwire_alpha1_client_servo_read_angles(&client, 2);
    case 12: return armwire_alpha1_client_servo_set_offset(&client, 2, 6);
    case 13: return armwire_alpha1_client_servo_read_offset(&client, 2);
    case 14: return armwire_alpha1_client_servo_change_id(&client, 3, 3);
    default: return armwire_alpha1_client_servo_read_version(&client, 2);
    }
}

/* Every request ends once, and no answer is matched to another request. */
static void requests_end_whatever_the_line_does(unsigned rounds, bool servos)
{
    unsigned answers = 0, timeouts = 0, unacceptable = 0;
    for (unsigned round = 0; round < rounds; round++) {
        for (unsigned request = 0; request < 8; request++) {
            uint32_t kind;
            CHECK(make_request(servos ? request + 8 : request, &kind) == ARMWIRE_STATUS_OK);
            ArmwireAlpha1Response response;
            ArmwireEvent event = alpha1_call(&client, &port, &response, &others);
            if (event.kind == ARMWIRE_EVENT_KIND_ANSWER) {
                CHECK(response.kind == kind);
                answers++;
            } else if (event.kind == ARMWIRE_EVENT_KIND_TIMED_OUT) {
                CHECK(event.sends == 1 || event.sends == 3);
                timeouts++;
            } else {
                CHECK(event.kind == ARMWIRE_EVENT_KIND_UNACCEPTABLE);
                unacceptable++;
            }
        }
    }
    printf("%u answers, %u time-outs, %u unacceptable; %u bytes of noise, %u late, %u unsolicited, %u echoes, %u unknown\n",
           answers, timeouts, unacceptable, others.noise, others.late, others.unsolicited, others.echo, others.unknown);
    CHECK(answers + timeouts + unacceptable == 8 * rounds);
    CHECK(answers > 4 * rounds && others.noise > 0);
}

int main(int argc, char **argv)
{
    static const char *const sims[] = {"alpha1", "alpha1-servo"};
    ArmwireConfig config;
    CHECK(argc == 2);
    CHECK_OK(armwire_config_serial(&config));
    config.baud = 115200;
    for (unsigned servos = 0; servos < 2; servos++) {
        const char *const good[] = {sims[servos], NULL}, *const bad[] = {sims[servos], "--faults", "2000", NULL};
        config.latency_us = 2000000;
        CHECK_OK(armwire_alpha1_client_init(&client, ARMWIRE_VERSION, &config));
        port = port_open(argv[1], good);
        if (servos == 0) {
            every_request_to_the_robot_is_answered();
        } else {
            every_request_to_a_servo_is_answered();
        }
        port_close(&port);

        config.latency_us = 30000;
        CHECK_OK(armwire_alpha1_client_init(&client, ARMWIRE_VERSION, &config));
        port = port_open(argv[1], bad);
        requests_end_whatever_the_line_does(10, servos == 1);
        port_close(&port);
        memset(&others, 0, sizeof others);
    }
    return 0;
}
