"""Drives virtual xArms with the vendor's SDK, and checks all received values.

Usage: xarm_drive.py ARMWIRE

ARMWIRE is the `armwire` program, which serves the arms.
"""

import math
import signal
import sys
import time

from xarm.wrapper import XArmAPI

from checks import expect, require, wait_until
from xarm_sdk import VirtualArm, warnings

# Codes of the SDK.
OK, HAS_ERROR, HAS_WARNING, INVALID, MODBUS_ILLEGAL_FUNCTION = 0, 1, 2, 10, 0x81
# States of the arm.
MOVING, AT_REST, PAUSED, STOPPED, RESET = 1, 2, 3, 4, 5
# The vendor's error code of a joint angle beyond its limit.
JOINT_LIMIT = 23
# Timeout of the program, in seconds.
TOTAL_TIMEOUT = 240.0
# Tolerance of angles in degrees and positions in millimetres: transferred as 32-bit floats, rounded by the SDK.
TOLERANCE = 0.01
TARGET = [10.0, -20.0, -30.0, 0.0, 45.0, -90.0]
HOME = [0.0] * 6
# The flange's position at home, in millimetres.
HOME_POSITION = [207.0, 0.0, 112.0]
# Distance of the flange from the axis of each joint at home, in millimetres.
HOME_RADII = [207.0, 258.6, 465.535, 76.0, 123.227, 0.0]


def main(armwire: str) -> None:
    # Some calls of the SDK may block forever. Others swallow one exception: the alarm repeats.
    signal.signal(signal.SIGALRM, fail_on_timeout)
    signal.setitimer(signal.ITIMER_REAL, TOTAL_TIMEOUT, 1.0)
    with VirtualArm(armwire) as arm:
        check_default_connection(arm)
        check_without_reports(arm)
        check_two_connections(arm)
        check_reboot(arm)
        check_shutdown(arm)
    check_no_report_port(armwire)
    check_warning_at_start(armwire)
    check_error_at_start(armwire)
    for axes in (5, 7):
        check_other_model(armwire, axes)
    print("the vendor's SDK drives the arm")


def check_default_connection(arm: VirtualArm) -> None:
    sdk = arm.connect()
    changes = []
    sdk.register_connect_changed_callback(changes.append)
    expect("the SDK connects, with reports", sdk.connected and sdk._arm.reported)
    wait_until("the SDK changes to protocol id 3", lambda: sdk.core.get_protocol_identifier() == 3)
    wait_until("a report arrives", lambda: sdk._arm._first_report_over)
    expect(f"the report has {sdk.axis} axes and type {sdk.device_type}", (sdk.axis, sdk.device_type) == (6, 6))
    version = sdk._arm.report_data.version
    expect(f"the report has version {version}", version == "6,6,XI1202,AC1302,v1.12.10")
    for _ in range(20):
        check_registers(sdk, radii=HOME_RADII)
    check_refusals(sdk)
    check_registers(sdk, radii=HOME_RADII)
    check_readiness(sdk)
    check_motion(sdk)
    check_modes(sdk)
    check_registers(sdk)
    check_stop(sdk)
    check_error(sdk)
    check_registers(sdk)

    last = sdk.core.last_comm_time
    wait_until("an idle SDK polls the arm", lambda: sdk.core.last_comm_time > last)
    expect("the SDK is still connected", sdk.connected and sdk._arm.reported)
    expect(f"the connection has not changed: {changes}", not changes)
    expect(f"the SDK has no warnings: {warnings}", not warnings)
    sdk.disconnect()


def check_registers(sdk: XArmAPI, code: int = OK, radii: list[float] | None = None) -> None:
    """The registers of the document: 1, 2, 4, 5, 6 and 10, which refuses an unknown value.

    `code` is the SDK's code for the arm's state, in methods that return it. `radii` are the joints' rotation radii, if
    known.
    """
    version = sdk.get_version()
    expect(f"register 1: {version}", version == (OK, "6,6,XI1202,AC1302,v1.12.10"))
    serial = (*sdk.get_robot_sn(), sdk.control_box_sn)
    expect(f"register 2: {serial}", serial == (OK, "XI120204201B02", "AC130202B02L02"))
    reloaded = sdk.core.reload_dynamics()
    expect(f"register 4: {reloaded}", reloaded == [code])
    for source in (1, 0):
        written = sdk.set_report_tau_or_i(source)
        read = sdk.get_report_tau_or_i()
        expect(f"register 5: {read}", written == OK and read == (code, source))
    answers = [sdk.core.get_tcp_rotation_radius(joint) for joint in range(1, 7)]
    codes = [answer[0] for answer in answers]
    expect(f"register 6: codes {codes}", codes == [code] * 6)
    if radii is not None:
        millimetres = [answer[1][0] for answer in answers]
        expect(f"register 6: {millimetres} mm", is_near(millimetres, radii))
    refused = sdk.system_control(3)
    expect(f"register 10: {refused}", refused == INVALID)
    warnings[:] = [text for text in warnings if "system_control(3)" not in text]


def check_refusals(sdk: XArmAPI) -> None:
    # The SDK decodes numbers before it looks at the code, and raises an exception if there are none.
    for joint in (0, 7, 8):
        code = sdk.core.get_tcp_rotation_radius(joint)[0]
        expect(f"joint {joint} is refused: {code}", code == INVALID)
    code = sdk.core.set_gravity_dir([0, 0, -1])[0]
    expect(f"an unsupported register is refused: {code}", code == INVALID)
    code = sdk.get_inverse_kinematics([200, 0, 200, 180, 0, 0])[0]
    expect(f"an unsupported list of numbers is refused: {code}", code == INVALID)
    code = sdk.core.get_dh_params()[0]
    expect(f"the longest list of numbers is refused: {code}", code == INVALID)
    code = sdk.core.ft_sensor_get_config()[0]
    expect(f"the longest answer is refused: {code}", code == INVALID)
    code, _ = sdk.read_holding_registers(0, 2)
    expect(f"standard Modbus is refused: {code:#x}", code == MODBUS_ILLEGAL_FUNCTION)


def check_readiness(sdk: XArmAPI) -> None:
    expect("a new arm is stopped", sdk.get_state() == (OK, STOPPED))
    code = sdk.core.move_joint([0.1] * 7, 1, 1, 0)[0]
    expect("a stopped arm does not move", code == OK and not sdk.core.state_is_ready and sdk.get_cmdnum() == (OK, 0))
    expect("the motors are switched on", sdk.motion_enable(True) == OK)
    motors_on = [1] * 6
    wait_until(
        "the report has the motors on",
        lambda: sdk.motor_enable_states[:6] == sdk.motor_brake_states[:6] == motors_on,
    )
    expect("position mode resets the state", sdk.set_mode(0) == OK and sdk.get_state() == (OK, RESET))
    expect("state 0 makes the arm ready", sdk.set_state(0) == OK and sdk.get_state() == (OK, AT_REST))
    wait_until("the report has state and mode", lambda: (sdk.state, sdk.mode) == (AT_REST, 0))
    expect("the SDK considers the arm ready", sdk.core.state_is_ready)


def check_motion(sdk: XArmAPI) -> None:
    expect("the arm is at home", is_near(angles(sdk), HOME))
    code, position = sdk.get_position()
    expect(f"the flange is at {position}", code == OK and is_near(position, [*HOME_POSITION, 180, 0, 0]))
    # The SDK waits until the arm is at rest.
    code = sdk.set_servo_angle(angle=TARGET, speed=90, wait=True)
    expect(f"a move succeeds: {code}", code == OK)
    expect(f"the joints are at {angles(sdk)}", is_near(angles(sdk), TARGET))
    wait_until("the report has the joints", lambda: is_near(sdk.angles[:6], TARGET) and sdk.state == AT_REST)
    _, position = sdk.get_position()
    has_moved = not is_near(position[:3], HOME_POSITION)
    expect(f"the report has the flange at {sdk.position}", is_near(sdk.position, position) and has_moved)
    _, vector = sdk.get_position_aa()
    expect(f"the report has its rotation {sdk.position_aa[3:]}", is_near(sdk.position_aa[3:], vector[3:]))
    # The SDK's targets of the other joints are those of a report, possibly one from before the end of the last move.
    sdk._arm._sync()
    code = sdk.set_servo_angle(servo_id=1, angle=20, speed=90, wait=True)
    expect(f"one joint moves: {code}", code == OK and is_near(angles(sdk), [20.0, *TARGET[1:]]))


def check_modes(sdk: XArmAPI) -> None:
    start = angles(sdk)
    code = sdk.set_mode(2)
    expect(f"a mode that the arm cannot run is refused: {code}", code == INVALID)
    expect("servo mode is set", sdk.set_mode(1) == OK and sdk.set_state(0) == OK)
    wait_until("the report has the mode", lambda: sdk.mode == 1)
    for step in range(1, 51):
        goal = [angle * (1 - step / 50) for angle in start]
        code = sdk.set_servo_angle_j(goal)
        require(f"a servo target is accepted: {code}", code == OK)
        time.sleep(0.01)
    wait_until("the arm follows servo targets", lambda: is_near(angles(sdk), HOME))
    expect("a queued move is refused in servo mode", sdk.core.move_joint([0.1] * 7, 1, 1, 0)[0] == INVALID)
    expect("position mode is set", sdk.set_mode(0) == OK and sdk.set_state(0) == OK)
    wait_until("the report has the mode", lambda: sdk.mode == 0)
    code = sdk.set_servo_angle_j(TARGET)
    expect(f"a servo target is refused in position mode: {code}", code == INVALID)
    codes = [sdk.set_servo_angle(angle=goal, speed=90, radius=10, wait=False) for goal in (HOME, start, TARGET)]
    expect(f"blended moves are accepted: {codes}", codes == [OK] * 3)
    wait_until("the arm is at the last of them", lambda: is_near(angles(sdk), TARGET))
    code = sdk.move_gohome(speed=90, wait=True)
    expect(f"the arm goes home: {code}", code == OK and is_near(angles(sdk), HOME))
    code = sdk.set_servo_angle(angle=start, speed=90, wait=True)
    expect(f"the arm is back: {code}", code == OK and is_near(angles(sdk), start))
    refused = ("set_mode(2)", "set_servo_angle_j")
    warnings[:] = [text for text in warnings if not any(call in text for call in refused)]


def check_stop(sdk: XArmAPI) -> None:
    start = angles(sdk)
    expect("a move of 10 s is accepted", sdk.set_servo_angle(angle=HOME, speed=9) == OK)
    expect("another move is queued", sdk.set_servo_angle(angle=TARGET, speed=9) == OK)
    wait_until("the report has both", lambda: (sdk.state, sdk.cmd_num) == (MOVING, 2))
    wait_until("the report has the speed", lambda: math.isclose(sdk.realtime_joint_speeds[5], 9, rel_tol=1e-3))
    wait_until("joint 6 has moved", lambda: sdk.angles[5] > start[5] + 1)
    expect("the arm is paused", sdk.set_state(3) == OK and sdk.get_state() == (OK, PAUSED))
    paused = angles(sdk)
    expect("a paused arm is at rest and keeps both moves", sdk.get_cmdnum() == (OK, 2) and angles(sdk) == paused)
    expect("the arm continues", sdk.set_state(0) == OK and sdk.get_state() == (OK, MOVING))
    expect("the arm is stopped", sdk.set_state(4) == OK and sdk.get_state() == (OK, STOPPED))
    expect("a stop drops the moves", sdk.get_cmdnum() == (OK, 0))
    stopped = angles(sdk)
    expect(f"the arm stopped on its way, at {stopped}", start[5] < paused[5] <= stopped[5] < 0)
    expect("the arm is ready again", sdk.set_state(0) == OK and sdk.get_state() == (OK, AT_REST))


def check_error(sdk: XArmAPI) -> None:
    # The SDK's own methods refuse this angle.
    code = sdk.core.move_joint([7.0] * 7, 1, 1, 0)[0]
    expect(f"a joint beyond its limit is an error: {code}", code == HAS_ERROR)
    expect("the error is reported on request", sdk.get_err_warn_code() == (OK, [JOINT_LIMIT, 0]))
    expect("the error stops the arm", sdk.get_state() == (OK, STOPPED))
    wait_until("the report has the error", lambda: (sdk.error_code, sdk.state) == (JOINT_LIMIT, STOPPED))
    check_registers(sdk, code=HAS_ERROR)
    expect("an arm with an error stays stopped", sdk.set_state(0) == OK and sdk.get_state() == (OK, STOPPED))
    expect("the error is cleared", sdk.clean_error() == OK and sdk.get_err_warn_code() == (OK, [0, 0]))
    expect("the arm is ready again", sdk.set_state(0) == OK and sdk.get_state() == (OK, AT_REST))
    wait_until("the report has no error", lambda: (sdk.error_code, sdk.state) == (0, AT_REST))
    code = sdk.set_servo_angle(angle=HOME, speed=90, wait=True)
    expect(f"the arm moves again: {code}", code == OK and is_near(angles(sdk), HOME))


def check_without_reports(arm: VirtualArm) -> None:
    sdk = arm.connect(enable_report=False, enable_heartbeat=True)
    expect("the SDK connects, without reports", sdk.connected and sdk.core.get_protocol_identifier() == 2)
    for _ in range(20):
        check_registers(sdk)
    # Without reports, the SDK's own set_servo_angle waits forever for the first one.
    code = sdk.core.move_joint([math.radians(5)] + [0.0] * 6, 1, 10, 0)[0]
    expect(f"a move is accepted: {code}", code == OK)
    wait_until("the move ends", lambda: sdk.get_state() == (OK, AT_REST))
    expect(f"the joints are at {angles(sdk)}", is_near(angles(sdk), [5.0, *HOME[1:]]))
    # The SDK sends a heartbeat each second: three of them, among other requests.
    end = time.monotonic() + 3
    wait_until("heartbeats do no harm", lambda: sdk.get_state() == (OK, AT_REST) and time.monotonic() > end)
    sdk.disconnect()


def check_two_connections(arm: VirtualArm) -> None:
    first, second = arm.connect(), arm.connect(enable_heartbeat=True)
    for _ in range(50):
        codes = (first.get_state()[0], second.get_cmdnum()[0])
        expect("each connection receives its own answers", codes == (OK, OK))
        same = first.get_version() == second.get_version() and angles(first) == angles(second)
        expect("both connections read the same", same)
    code = first.set_servo_angle(angle=TARGET, speed=90, wait=True)
    expect(f"the first connection moves the arm: {code}", code == OK)
    wait_until(
        "both connections report it", lambda: is_near(first.angles[:6], TARGET) and is_near(second.angles[:6], TARGET)
    )
    first.disconnect()
    expect("the second connection outlives the first", second.get_state() == (OK, AT_REST) and second.connected)
    second.disconnect()


def check_reboot(arm: VirtualArm) -> None:
    sdk = arm.connect()
    expect("a reboot is accepted", sdk.system_control(2) == OK)
    wait_until("the reboot closes the connection", lambda: not sdk.connected)
    sdk.disconnect()
    # The warnings of the closed connection are expected.
    warnings.clear()
    sdk = arm.connect()
    expect("the arm is stopped after the reboot", sdk.connected and sdk.get_state() == (OK, STOPPED))
    expect("the joints are unchanged", is_near(angles(sdk), TARGET))
    check_registers(sdk)
    sdk.disconnect()


def check_shutdown(arm: VirtualArm) -> None:
    sdk = arm.connect()
    expect("a shutdown is accepted", sdk.system_control(1) == OK)
    wait_until("the shutdown closes the connection", lambda: not sdk.connected)
    sdk.disconnect()
    warnings.clear()
    summary = arm.wait()
    expect(f"the virtual arm ends: {summary}", " 0 broken" in summary and " 0 not read" in summary)


def check_no_report_port(armwire: str) -> None:
    with VirtualArm(armwire, "--no-report") as arm:
        sdk = arm.connect()
        wait_until("the SDK changes to protocol id 3", lambda: sdk.core.get_protocol_identifier() == 3)
        for _ in range(20):
            check_registers(sdk)
        expect("the SDK stays connected without a report port", sdk.connected and not sdk._arm.reported)
        sdk.disconnect()
        expect("the virtual arm ends", " 0 broken" in arm.stop())


def check_warning_at_start(armwire: str) -> None:
    with VirtualArm(armwire, "--warning", "13") as arm:
        sdk = arm.connect()
        wait_until("the report has the warning", lambda: sdk.warn_code == 13)
        check_registers(sdk, code=HAS_WARNING)
        expect("the warning is cleared", sdk.clean_warn() == OK and sdk.get_err_warn_code() == (OK, [0, 0]))
        check_registers(sdk)
        sdk.disconnect()
    with VirtualArm(armwire, "--warning", "13") as arm:
        sdk = arm.connect(enable_report=False)
        expect("without reports, the SDK clears a warning when it connects", sdk.get_err_warn_code() == (OK, [0, 0]))
        sdk.disconnect()


def check_error_at_start(armwire: str) -> None:
    with VirtualArm(armwire, "--error", "2") as arm:
        sdk = arm.connect()
        wait_until("the report has the error", lambda: sdk.error_code == 2)
        check_registers(sdk, code=HAS_ERROR)
        expect("an error keeps the motors off", sdk.motion_enable(True) == OK and not any(sdk.motor_enable_states))
        sdk.disconnect()


def check_other_model(armwire: str, axes: int) -> None:
    serials = ["--serial", "XA12345678", "--box-serial", "AB12345678"]
    with VirtualArm(armwire, "--axes", str(axes), *serials) as arm:
        sdk = arm.connect()
        wait_until("a report arrives", lambda: sdk._arm._first_report_over)
        expect(f"the arm has {sdk.axis} axes and type {sdk.device_type}", (sdk.axis, sdk.device_type) == (axes, axes))
        serial = (*sdk.get_robot_sn(), sdk.control_box_sn)
        expect(f"serial numbers {serial}", serial == (OK, "XA12345678", "AB12345678"))
        is_ready = sdk.motion_enable(True) == OK and sdk.set_mode(0) == OK and sdk.set_state(0) == OK
        expect("the arm is ready", is_ready)
        target = [10.0] * axes
        code = sdk.set_servo_angle(angle=target, speed=90, wait=True)
        has_arrived = is_near(sdk.get_servo_angle()[1], target + [0.0] * (7 - axes))
        expect(f"a move succeeds: {code}", code == OK and has_arrived)
        wait_until("the report has the joints", lambda: is_near(sdk.angles[:axes], target))
        sdk.disconnect()


def fail_on_timeout(*_: object) -> None:
    require(f"all checks end within {TOTAL_TIMEOUT:.0f} s", False)


def angles(sdk: XArmAPI) -> list[float]:
    """The angles of six joints, in degrees."""
    code, angles = sdk.get_servo_angle()
    require(f"the joint angles are read: {code}", code == OK)
    return angles[:6]


def is_near(values: list[float], goals: list[float]) -> bool:
    return all(abs(value - goal) <= TOLERANCE for value, goal in zip(values, goals, strict=True))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
