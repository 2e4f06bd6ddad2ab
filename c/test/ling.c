/* Every request of a Ling client against a virtual arm. Usage: ling ARMWIRE, the path of the command */
#include "harness.h"

DEFINE_CALL(ling, Ling)

typedef ArmwireStatus Read(ArmwireLingClient *client);

static ArmwireLingClient arm;
static Port port;
static Others others;

static ArmwireLingResponse answer(Read *read, uint32_t kind)
{
    ArmwireLingResponse response;
    CHECK_OK(read(&arm));
    CHECK(ling_call(&arm, &port, &response, &others).kind == ARMWIRE_EVENT_KIND_ANSWER);
    CHECK(response.kind == kind);
    return response;
}

static void sent(ArmwireStatus status)
{
    ArmwireLingResponse response;
    CHECK(status == ARMWIRE_STATUS_OK);
    CHECK(ling_call(&arm, &port, &response, &others).kind == ARMWIRE_EVENT_KIND_SENT);
    CHECK(response.kind == ARMWIRE_LING_RESPONSE_KIND_NONE);
}

/* Sets what the arm does not confirm, and returns the kind of the last step of its read-back. */
static uint32_t set(ArmwireLingEffect effect)
{
    ArmwireLingReadBack read_back;
    ArmwireLingReadBackStep step;
    CHECK_OK(armwire_ling_read_back_init(&read_back, ARMWIRE_VERSION, effect));
    for (;;) {
        CHECK_OK(armwire_ling_read_back_poll(&read_back, now_us(), &step));
        switch (step.kind) {
        case ARMWIRE_LING_READ_BACK_STEP_KIND_WAIT: break;
        case ARMWIRE_LING_READ_BACK_STEP_KIND_READ_JOINTS: {
            ArmwireLingResponse joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
            CHECK_OK(armwire_ling_read_back_on_joints(&read_back, now_us(), &joints));
            break;
        }
        case ARMWIRE_LING_READ_BACK_STEP_KIND_SET_TORQUE:
            sent(armwire_ling_client_set_torque(&arm, step.torque_on));
            break;
        case ARMWIRE_LING_READ_BACK_STEP_KIND_SET_ZERO: sent(armwire_ling_client_set_zero(&arm)); break;
        default: return step.kind;
        }
    }
}

static void effects_are_read_back(void)
{
    static const ArmwireLingEffect effects[] = {ARMWIRE_LING_EFFECT_TORQUE_ON, ARMWIRE_LING_EFFECT_TORQUE_OFF,
                                                ARMWIRE_LING_EFFECT_ZERO};
    for (size_t effect = 0; effect < sizeof effects / sizeof *effects; effect++) {
        CHECK(set(effects[effect]) == ARMWIRE_LING_READ_BACK_STEP_KIND_CONFIRMED);
    }
    /* Below the temperature: the protection switches the torque off. */
    sent(armwire_ling_client_set_temperature_limit(&arm, 0));
    CHECK(set(ARMWIRE_LING_EFFECT_TORQUE_ON) == ARMWIRE_LING_READ_BACK_STEP_KIND_CONTRADICTED);
    sent(armwire_ling_client_set_temperature_limit(&arm, 80));
    CHECK(set(ARMWIRE_LING_EFFECT_TORQUE_ON) == ARMWIRE_LING_READ_BACK_STEP_KIND_CONFIRMED);
}

static void every_request_is_answered_or_sent(void)
{
    ArmwireLingResponse info = answer(armwire_ling_client_read_info, ARMWIRE_LING_RESPONSE_KIND_INFO);
    char serial[65];
    CHECK(armwire_printable(info.serial_number, sizeof info.serial_number, serial, sizeof serial) == 16);
    CHECK(strcmp(serial, "ADFS251205123456") == 0);
    CHECK(info.firmware_version >= 610 && info.hardware_version > 0);

    sent(armwire_ling_client_set_stroke(&arm, 75));
    CHECK(answer(armwire_ling_client_read_stroke, ARMWIRE_LING_RESPONSE_KIND_STROKE).stroke_mm == 75);
    sent(armwire_ling_client_set_temperature_limit(&arm, 80));
    sent(armwire_ling_client_set_torque(&arm, 1));

    const ArmwireLingMove target = {{2148, 1948, 2248, 2048, 2000, 2100}, {5000, 5000, 5000, 5000, 5000, 5000}, 250, 5500};
    sent(armwire_ling_client_move(&arm, &target));
    uint64_t deadline_us = now_us() + 10000000u;
    ArmwireLingResponse joints;
    do {
        joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
        CHECK(now_us() < deadline_us);
    } while (memcmp(joints.position_ticks, target.position_ticks, sizeof joints.position_ticks) != 0 ||
             joints.opening_per_mille != target.opening_per_mille);

    ArmwireLingResponse warm = answer(armwire_ling_client_read_temperatures, ARMWIRE_LING_RESPONSE_KIND_TEMPERATURES);
    CHECK(warm.servos == 10 && warm.temperature_celsius[9] > 0);
    CHECK(answer(armwire_ling_client_read_velocities, ARMWIRE_LING_RESPONSE_KIND_VELOCITIES).servos == 10);
    CHECK(answer(armwire_ling_client_self_check, ARMWIRE_LING_RESPONSE_KIND_SELF_CHECK).normal_servos == 0x3FF);
    sent(armwire_ling_client_set_torque(&arm, 0));
    sent(armwire_ling_client_set_zero(&arm));
    joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
    for (size_t joint = 0; joint < ARMWIRE_LING_JOINTS; joint++) {
        CHECK(joints.position_ticks[joint] == 2048);
    }
    CHECK(others.noise + others.late + others.unsolicited + others.echo + others.unknown == 0);
}

/* Runs a stop, and returns its last step. */
static ArmwireLingStopStep run_stop(ArmwireLingStop *stop, unsigned *moves, unsigned *torques)
{
    ArmwireLingStopStep step;
    for (*moves = *torques = 0;;) {
        CHECK_OK(armwire_ling_stop_poll(stop, now_us(), &step));
        switch (step.kind) {
        case ARMWIRE_LING_STOP_STEP_KIND_WAIT: break;
        case ARMWIRE_LING_STOP_STEP_KIND_READ_JOINTS: {
            ArmwireLingResponse joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
            CHECK_OK(armwire_ling_stop_on_joints(stop, now_us(), &joints));
            break;
        }
        case ARMWIRE_LING_STOP_STEP_KIND_MOVE:
            sent(armwire_ling_client_move(&arm, &step.target));
            ++*moves;
            break;
        case ARMWIRE_LING_STOP_STEP_KIND_TORQUE_ON:
            sent(armwire_ling_client_set_torque(&arm, 1));
            ++*torques;
            break;
        default: return step;
        }
    }
}

/* Stops the arm at its reading, and returns the last step. */
static ArmwireLingStopStep stop_arm(const uint16_t *opening_per_mille, unsigned *moves, unsigned *torques)
{
    ArmwireLingStop stop;
    CHECK_OK(armwire_ling_stop_init(&stop, ARMWIRE_VERSION, opening_per_mille));
    return run_stop(&stop, moves, torques);
}

static void moved_arm_arrives_and_a_stopped_one_is_elsewhere(void)
{
    ArmwireLingMove target = {{2248, 2048, 2048, 2048, 2048, 2048}, {400, 400, 400, 400, 400, 400}, 600, 1000};
    ArmwireLingArrival arrival;
    ArmwireLingArrived arrived = {0};
    sent(armwire_ling_client_set_torque(&arm, 1));
    sent(armwire_ling_client_move(&arm, &target));
    CHECK_OK(armwire_ling_arrival_init(&arrival, ARMWIRE_VERSION, &target, ARMWIRE_LING_TOLERANCE));
    while (arrived.kind <= ARMWIRE_LING_ARRIVED_KIND_RESEND) {
        ArmwireLingResponse joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
        CHECK_OK(armwire_ling_arrival_on_joints(&arrival, now_us(), &joints, &arrived));
    }
    CHECK(arrived.kind == ARMWIRE_LING_ARRIVED_KIND_AT_TARGET && arrived.away == 0);

    /* Nothing moves it there. */
    target.position_ticks[0] = 2448;
    arrived.kind = ARMWIRE_LING_ARRIVED_KIND_NOT_YET;
    CHECK_OK(armwire_ling_arrival_init(&arrival, ARMWIRE_VERSION, &target, ARMWIRE_LING_TOLERANCE));
    while (arrived.kind <= ARMWIRE_LING_ARRIVED_KIND_RESEND) {
        ArmwireLingResponse joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
        CHECK_OK(armwire_ling_arrival_on_joints(&arrival, now_us(), &joints, &arrived));
    }
    CHECK(arrived.kind == ARMWIRE_LING_ARRIVED_KIND_ELSEWHERE && arrived.away == 1);
    CHECK(arrived.deviation_ticks[0] == -200);
}

static void moving_arm_stops_and_keeps_its_torque(void)
{
    const ArmwireLingMove target = {{4000, 2048, 2048, 2048, 2048, 2048}, {200, 200, 200, 200, 200, 200}, 600, 1000};
    unsigned moves, torques;
    sent(armwire_ling_client_set_torque(&arm, 1));
    sent(armwire_ling_client_move(&arm, &target));
    CHECK(stop_arm(&target.opening_per_mille, &moves, &torques).kind == ARMWIRE_LING_STOP_STEP_KIND_AT_REST);
    CHECK(moves >= 1 && torques == 1);
    ArmwireLingResponse joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
    CHECK(joints.position_ticks[0] < 3900);
    CHECK(armwire_ling_holding(joints.motion_status) == ARMWIRE_LING_HOLDING_YES);
    uint16_t held[ARMWIRE_LING_JOINTS];
    memcpy(held, joints.position_ticks, sizeof held);

    CHECK(stop_arm(NULL, &moves, &torques).grip_may_loosen == 1 && moves >= 1 && torques == 1);
    joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
    CHECK(memcmp(joints.position_ticks, held, sizeof held) == 0);

    /* It stands near this goal, and is held there. */
    ArmwireLingStop stop;
    ArmwireLingMove goal = target;
    memcpy(goal.position_ticks, joints.position_ticks, sizeof goal.position_ticks);
    goal.position_ticks[1] += 20;
    CHECK_OK(armwire_ling_stop_init_after(&stop, ARMWIRE_VERSION, &goal));
    ArmwireLingStopStep end = run_stop(&stop, &moves, &torques);
    CHECK(end.kind == ARMWIRE_LING_STOP_STEP_KIND_AT_REST && end.grip_may_loosen == 0);
    CHECK(end.deviation_ticks[1] == 0 && torques == 1);
    joints = answer(armwire_ling_client_read_joints, ARMWIRE_LING_RESPONSE_KIND_JOINTS);
    CHECK(memcmp(joints.position_ticks, goal.position_ticks, sizeof goal.position_ticks) == 0);
    sent(armwire_ling_client_set_torque(&arm, 0));
    CHECK(stop_arm(NULL, &moves, &torques).kind == ARMWIRE_LING_STOP_STEP_KIND_WITHOUT_TORQUE);
    CHECK(moves == 0 && torques == 0);
}

static Read *const reads[] = {armwire_ling_client_read_info,       armwire_ling_client_read_stroke,
                              armwire_ling_client_read_joints,     armwire_ling_client_read_temperatures,
                              armwire_ling_client_read_velocities, armwire_ling_client_self_check};
static const uint32_t kinds[] = {ARMWIRE_LING_RESPONSE_KIND_INFO,       ARMWIRE_LING_RESPONSE_KIND_STROKE,
                                 ARMWIRE_LING_RESPONSE_KIND_JOINTS,     ARMWIRE_LING_RESPONSE_KIND_TEMPERATURES,
                                 ARMWIRE_LING_RESPONSE_KIND_VELOCITIES, ARMWIRE_LING_RESPONSE_KIND_SELF_CHECK};
#define READS (sizeof reads / sizeof *reads)

/* Reads only: the arm discards a request with a gap, and requests without an answer are not repeated. */
static void frames_may_be_written_in_parts(void)
{
    port.max_write = 3;
    for (size_t read = 0; read < READS; read++) {
        answer(reads[read], kinds[read]);
    }
    port.max_write = SIZE_MAX;
}

/* Every request ends once, and no answer is matched to another request. */
static void requests_end_whatever_the_line_does(unsigned rounds)
{
    const ArmwireLingMove home = {{2048, 2048, 2048, 2048, 2048, 2048}, {500, 500, 500, 500, 500, 500}, 500, 1000};
    unsigned answers = 0, timeouts = 0, unacceptable = 0;
    for (unsigned round = 0; round < rounds; round++) {
        sent(armwire_ling_client_set_torque(&arm, 1));
        sent(armwire_ling_client_move(&arm, &home));
        sent(armwire_ling_client_set_stroke(&arm, 100));
        sent(armwire_ling_client_set_temperature_limit(&arm, 70));
        sent(armwire_ling_client_set_torque(&arm, 0));
        sent(armwire_ling_client_set_zero(&arm));
        for (size_t read = 0; read < READS; read++) {
            ArmwireLingResponse response;
            CHECK_OK(reads[read](&arm));
            CHECK(reads[read](&arm) == ARMWIRE_STATUS_BUSY);
            ArmwireEvent event = ling_call(&arm, &port, &response, &others);
            if (event.kind == ARMWIRE_EVENT_KIND_ANSWER) {
                CHECK(response.kind == kinds[read]);
                answers++;
            } else if (event.kind == ARMWIRE_EVENT_KIND_TIMED_OUT) {
                CHECK(event.sends == 3);
                timeouts++;
            } else {
                CHECK(event.kind == ARMWIRE_EVENT_KIND_UNACCEPTABLE && event.fault.code != ARMWIRE_FAULT_CODE_NONE);
                unacceptable++;
            }
        }
    }
    printf("%u answers, %u time-outs, %u unacceptable; %u bytes of noise, %u late, %u unsolicited, %u echoes, %u unknown\n",
           answers, timeouts, unacceptable, others.noise, others.late, others.unsolicited, others.echo, others.unknown);
    CHECK(answers + timeouts + unacceptable == 6 * rounds);
    CHECK(answers > 5 * rounds && others.noise > 0);
}

/* A mode that is accepted is applied later. The answer for the mode permits slow moves. */
static void leader_applies_a_mode_later(void)
{
    sent(armwire_ling_client_set_torque(&arm, 1));
    ArmwireLingMove target = {{2049, 2048, 2048, 2048, 2048, 2048}, {1, 1, 1, 1, 1, 1}, 0, 1000};
    ArmwireLingResponse mode = {0};
    CHECK(armwire_ling_client_move_slowly(&arm, &target, &mode) == ARMWIRE_STATUS_OUT_OF_RANGE);
    mode = answer(armwire_ling_client_read_mode, ARMWIRE_LING_RESPONSE_KIND_MODE);
    CHECK(mode.control_mode == 0 && mode.blocked_joints == 2 && mode.valid_joints == 0x3F);
    CHECK(armwire_ling_client_move(&arm, &target) == ARMWIRE_STATUS_OUT_OF_RANGE);
    sent(armwire_ling_client_move_slowly(&arm, &target, &mode));

    ArmwireLingResponse reply;
    CHECK_OK(armwire_ling_client_set_mode(&arm, 1));
    CHECK(ling_call(&arm, &port, &reply, &others).kind == ARMWIRE_EVENT_KIND_ANSWER);
    CHECK(reply.kind == ARMWIRE_LING_RESPONSE_KIND_MODE_REPLY && reply.requested_mode == 1 && reply.mode_result == 0);
    uint64_t deadline_us = now_us() + 10000000u;
    do {
        mode = answer(armwire_ling_client_read_mode, ARMWIRE_LING_RESPONSE_KIND_MODE);
        CHECK(now_us() < deadline_us);
    } while (mode.control_mode != 1);

    CHECK_OK(armwire_ling_client_set_force_feedback(&arm, 1));
    CHECK(ling_call(&arm, &port, &reply, &others).kind == ARMWIRE_EVENT_KIND_ANSWER);
    CHECK(reply.force_feedback.requested == 1 && reply.force_feedback.effective == 0);
    reply = answer(armwire_ling_client_read_force_feedback, ARMWIRE_LING_RESPONSE_KIND_FORCE_FEEDBACK);
    CHECK(reply.force_feedback.inhibit_mask == 1 && reply.requested_mode == 1);
}

int main(int argc, char **argv)
{
    /* Its poses are exact. */
    static const char *const good[] = {"ling", "--plant", "ideal", NULL};
    static const char *const leader[] = {"ling", "--force-feedback=apply=300ms,blocked=2", NULL};
    static const char *const bad[] = {"ling", "--plant", "ideal", "--faults", "2000", NULL};
    ArmwireConfig config;
    CHECK(argc == 2);
    CHECK_OK(armwire_config_serial(&config));
    config.latency_us = 2000000;
    CHECK_OK(armwire_ling_client_init(&arm, ARMWIRE_VERSION, &config));
    port = port_open(argv[1], good);
    every_request_is_answered_or_sent();
    effects_are_read_back();
    moved_arm_arrives_and_a_stopped_one_is_elsewhere();
    moving_arm_stops_and_keeps_its_torque();
    frames_may_be_written_in_parts();
    port_close(&port);

    CHECK_OK(armwire_ling_client_init(&arm, ARMWIRE_VERSION, &config));
    port = port_open(argv[1], leader);
    leader_applies_a_mode_later();
    port_close(&port);

    config.latency_us = 30000;
    CHECK_OK(armwire_ling_client_init(&arm, ARMWIRE_VERSION, &config));
    port = port_open(argv[1], bad);
    requests_end_whatever_the_line_does(20);
    port_close(&port);
    return 0;
}
