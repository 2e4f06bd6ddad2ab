/* Every request of an xArm client against a virtual arm. Usage: xarm ARMWIRE, the path of the command */
#include "harness.h"

DEFINE_CALL(xarm, Xarm)

static ArmwireXarmClient arm;
static Port port;
static Others others;

static ArmwireXarmResponse answer(ArmwireStatus status, uint32_t kind)
{
    ArmwireXarmResponse response;
    CHECK(status == ARMWIRE_STATUS_OK);
    CHECK(xarm_call(&arm, &port, &response, &others).kind == ARMWIRE_EVENT_KIND_ANSWER);
    CHECK(response.kind == kind);
    return response;
}

static void every_request_is_answered_or_sent(void)
{
    ArmwireXarmResponse response;
    char text[200];
    CHECK_OK(armwire_xarm_client_heartbeat(&arm));
    CHECK(xarm_call(&arm, &port, &response, &others).kind == ARMWIRE_EVENT_KIND_SENT);

    response = answer(armwire_xarm_client_read_version(&arm), ARMWIRE_XARM_RESPONSE_KIND_VERSION);
    CHECK(response.reg == 1 && response.data_len == 40);
    CHECK(armwire_printable(response.data, 4, text, sizeof text) == 4 && strcmp(text, "6,6,") == 0);
    response = answer(armwire_xarm_client_read_serials(&arm), ARMWIRE_XARM_RESPONSE_KIND_SERIALS);
    CHECK(response.reg == 2 && response.data_len == 40 && response.data[0] == 'X');
    response = answer(armwire_xarm_client_reload_dynamics(&arm), ARMWIRE_XARM_RESPONSE_KIND_EMPTY);
    CHECK(response.reg == 4 && (response.state & 0x08) == 0);
    response = answer(armwire_xarm_client_read_torque_source(&arm), ARMWIRE_XARM_RESPONSE_KIND_TORQUE_SOURCE);
    CHECK(response.reg == 5 && response.torque_source <= 1);
    for (uint8_t joint = 1; joint <= 6; joint++) {
        response =
            answer(armwire_xarm_client_read_rotation_radius(&arm, joint), ARMWIRE_XARM_RESPONSE_KIND_ROTATION_RADIUS);
        CHECK(response.reg == 6 && response.rotation_radius_mm >= 0.0f);
    }
    /* Register 13 is the state: an untyped reply. */
    response = answer(armwire_xarm_client_raw(&arm, 13, NULL, 0), ARMWIRE_XARM_RESPONSE_KIND_RAW);
    CHECK(response.reg == 13);
    CHECK(others.noise + others.late + others.unsolicited + others.echo + others.unknown == 0);
}

int main(int argc, char **argv)
{
    static const char *const words[] = {"xarm", "--listen", "127.0.0.1:0", "--no-report", NULL};
    CHECK(argc == 2);
    port = port_open(argv[1], words);
    for (size_t i = 0; i < 2; i++) {
        CHECK_OK(armwire_xarm_client_init(&arm, ARMWIRE_VERSION, NULL));
        every_request_is_answered_or_sent();
        CHECK_OK(armwire_xarm_client_set_protocol(&arm, 3));
        every_request_is_answered_or_sent();
        /* The arm closes the connection after a reboot or shutdown. */
        ArmwireStatus status = i == 0 ? armwire_xarm_client_reboot(&arm) : armwire_xarm_client_shutdown(&arm);
        ArmwireXarmResponse response = answer(status, ARMWIRE_XARM_RESPONSE_KIND_EMPTY);
        CHECK(response.reg == 10 && (response.state & 0x08) == 0);
        if (i == 0) {
            port_reopen(&port);
            port.max_write = 1;
        }
    }
    port_close(&port);
    CHECK(strncmp(port.line, "2 connections, 0 broken; 50 requests, 0 unknown frames;", 55) == 0);
    return 0;
}
