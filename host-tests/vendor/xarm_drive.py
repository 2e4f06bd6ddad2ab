"""Drives virtual xArms with the vendor's SDK and checks all that it reads.

Usage: xarm_drive.py ARMWIRE

ARMWIRE is the program that serves the arms.
"""

import math
import signal
import sys
import time
from collections.abc import Callable

from xarm.wrapper import XArmAPI
from xarm_sdk import VirtualArm, complaints

# Codes of the SDK.
OK, HAS_ERROR, HAS_WARNING, NOT_READY, INVALID, MODBUS_ILLEGAL_FUNCTION = 0, 1, 2, 9, 10, 0x81
# States of the arm.
MOVING, AT_REST, PAUSED, STOPPED, RESET = 1, 2, 3, 4, 5
# An error of the vendor's list: a joint angle beyond its limit.
JOINT_LIMIT = 23
# How long anything here may take, in seconds. The longest is 30 s, after which the SDK asks how the arm is.
STEP_TIMEOUT = 60.0
# How long all of it may take.
LIMIT = 240.0
# Angles and positions pass through 32 bits and are rounded by the SDK: degrees, millimetres.
CLOSE = 0.01
TARGET = [10.0, -20.0, -30.0, 0.0, 45.0, -90.0]
HOME = [0.0] * 6
# How far the flange is from the axis of each joint at home, in millimetres: joint 1 from its x, joint 6 not at all.
HOME_RADII = [207.0, 258.6, 465.535, 76.0, 123.227, 0.0]


def main(armwire: str) -> None:
    # Some calls of the SDK may wait for ever, and some of it swallows every exception but not the next one.
    signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, LIMIT, 1.0)
    with VirtualArm(armwire) as arm:
        default_connection(arm)
        without_reports(arm)
        two_at_once(arm)
        reboot(arm)
        shutdown(arm)
    no_report_port(armwire)
    with_a_warning(armwire)
    with_an_error(armwire)
    for axes in (5, 7):
        other_model(armwire, axes)
    print("the vendor's SDK drives the arm")


def default_connection(arm: VirtualArm) -> None:
    sdk = arm.connect()
    losses = []
    sdk.register_connect_changed_callback(losses.append)
    expect("the SDK connects, with reports", sdk.connected and sdk._arm.reported)
    wait_until("it changes to protocol id 3", lambda: sdk.core.get_protocol_identifier() == 3)
    wait_until("it has a report", lambda: sdk._arm._first_report_over)
    expect(f"axes {sdk.axis} and type {sdk.device_type}, from the report", (sdk.axis, sdk.device_type) == (6, 6))
    text = sdk._arm.report_data.version
    expect(f"version {text}, from the report", text == "6,6,XI1202,AC1302,v1.12.10")
    for _ in range(20):
        registers(sdk, radii=HOME_RADII)
    refusals(sdk)
    registers(sdk, radii=HOME_RADII)
    readiness(sdk)
    motion(sdk)
    registers(sdk)
    stopping(sdk)
    error(sdk)
    registers(sdk)

    last = sdk.core.last_comm_time
    wait_until("an idle SDK asks by itself how the arm is", lambda: sdk.core.last_comm_time > last)
    expect("it is connected still", sdk.connected and sdk._arm.reported)
    expect(f"it never was not: {losses}", not losses)
    expect(f"it has nothing to complain of: {complaints}", not complaints)
    sdk.disconnect()


def registers(sdk: XArmAPI, code: int = OK, radii: list[float] | None = None) -> None:
    """The registers of the document: 1, 2, 4, 5, 6 and 10 (which is refused what it does not have).

    `code` is the one that the SDK makes of the arm's state, where it does not hide it; `radii` are those of the joints,
    if they are known.
    """
    version = sdk.get_version()
    expect(f"register 1: {version}", version == (OK, "6,6,XI1202,AC1302,v1.12.10"))
    serial = (*sdk.get_robot_sn(), sdk.control_box_sn)
    expect(f"register 2: {serial}", serial == (OK, "XI120204201B02", "AC130202B02L02"))
    reloaded = sdk.core.reload_dynamics()
    expect(f"register 4: {reloaded}", reloaded == [code])
    for source in (1, 0):
        chosen = sdk.set_report_tau_or_i(source)
        told = sdk.get_report_tau_or_i()
        expect(f"register 5: {told}", chosen == OK and told == (code, source))
    got = [sdk.core.get_tcp_rotation_radius(joint) for joint in range(1, 7)]
    expect(f"register 6: codes {[g[0] for g in got]}", all(g[0] == code for g in got))
    if radii is not None:
        millimetres = [g[1][0] for g in got]
        expect(f"register 6: {millimetres} mm", near(millimetres, radii))
    told = sdk.system_control(3)
    expect(f"register 10: {told}", told == INVALID)
    complaints[:] = [text for text in complaints if "system_control(3)" not in text]


def refusals(sdk: XArmAPI) -> None:
    # The SDK looks for four bytes in the answer, which is as short as a refusal is.
    for joint in (0, 7, 8):
        try:
            sdk.core.get_tcp_rotation_radius(joint)
        except ValueError:
            expect(f"there is no joint {joint}", True)
        else:
            expect(f"there is no joint {joint}", False)
    told = sdk.core.set_gravity_dir([0, 0, -1])
    expect(f"a register that it does not have: {told}", told == [INVALID])
    code, _ = sdk.read_holding_registers(0, 2)
    expect(f"standard Modbus: {code:#x}", code == MODBUS_ILLEGAL_FUNCTION)


def readiness(sdk: XArmAPI) -> None:
    expect("switched on, it is stopped", sdk.get_state() == (OK, STOPPED))
    code = sdk.core.move_joint([0.1] * 7, 1, 1, 0)[0]
    expect("and does not move", code == OK and not sdk.core.state_is_ready and sdk.get_cmdnum() == (OK, 0))
    expect("motors on", sdk.motion_enable(True) == OK)
    wait_until("the report has them", lambda: sdk.motor_enable_states[:6] == sdk.motor_brake_states[:6] == [1] * 6)
    expect("position mode", sdk.set_mode(0) == OK and sdk.get_state() == (OK, RESET))
    expect("ready", sdk.set_state(0) == OK and sdk.get_state() == (OK, AT_REST))
    wait_until("the report has it", lambda: (sdk.state, sdk.mode) == (AT_REST, 0))
    expect("it can move", sdk.core.state_is_ready)


def motion(sdk: XArmAPI) -> None:
    expect("it is at home", near(angles(sdk), HOME))
    code, position = sdk.get_position()
    expect(f"its flange at {position}", code == OK and near(position, [207, 0, 112, 180, 0, 0]))
    # The SDK waits until the arm is at rest.
    code = sdk.set_servo_angle(angle=TARGET, speed=90, wait=True)
    expect(f"it moves: {code}", code == OK)
    expect(f"to {angles(sdk)}", near(angles(sdk), TARGET))
    wait_until("the report has it", lambda: near(sdk.angles[:6], TARGET) and sdk.state == AT_REST)
    _, position = sdk.get_position()
    expect(f"and the flange at {sdk.position}", near(sdk.position, position) and not near(position[:3], [207, 0, 112]))
    _, vector = sdk.get_position_aa()
    expect(f"and its turn {sdk.position_aa[3:]}", near(sdk.position_aa[3:], vector[3:]))
    # The SDK sends the others to where it saw them at the end of the last move, by a report that may be older than that.
    sdk._arm._sync()
    code = sdk.set_servo_angle(servo_id=1, angle=20, speed=90, wait=True)
    expect(f"one joint moves: {code}", code == OK and near(angles(sdk), [20.0, *TARGET[1:]]))


def stopping(sdk: XArmAPI) -> None:
    start = angles(sdk)
    expect("a move of 10 s", sdk.set_servo_angle(angle=HOME, speed=9) == OK)
    expect("and another after it", sdk.set_servo_angle(angle=TARGET, speed=9) == OK)
    wait_until("the report has both", lambda: (sdk.state, sdk.cmd_num) == (MOVING, 2))
    wait_until("and how fast joints turn", lambda: math.isclose(sdk.realtime_joint_speeds[5], 9, rel_tol=1e-3))
    wait_until("it has moved", lambda: sdk.angles[5] > start[5] + 1)
    expect("paused", sdk.set_state(3) == OK and sdk.get_state() == (OK, PAUSED))
    paused = angles(sdk)
    expect("it stands, and has both still to do", sdk.get_cmdnum() == (OK, 2) and angles(sdk) == paused)
    expect("it goes on", sdk.set_state(0) == OK and sdk.get_state() == (OK, MOVING))
    expect("stopped", sdk.set_state(4) == OK and sdk.get_state() == (OK, STOPPED) and sdk.get_cmdnum() == (OK, 0))
    stopped = angles(sdk)
    expect(f"half-way, at {stopped}", start[5] < paused[5] <= stopped[5] < 0)
    expect("ready again", sdk.set_state(0) == OK and sdk.get_state() == (OK, AT_REST))


def error(sdk: XArmAPI) -> None:
    # The SDK itself would refuse this.
    code = sdk.core.move_joint([7.0] * 7, 1, 1, 0)[0]
    expect(f"a joint beyond its limit: {code}", code == HAS_ERROR)
    expect("is an error", sdk.get_err_warn_code() == (OK, [JOINT_LIMIT, 0]))
    expect("and it stops", sdk.get_state() == (OK, STOPPED))
    wait_until("the report has it", lambda: (sdk.error_code, sdk.state) == (JOINT_LIMIT, STOPPED))
    registers(sdk, code=HAS_ERROR)
    expect("it does not get ready", sdk.set_state(0) == OK and sdk.get_state() == (OK, STOPPED))
    expect("the error is cleared", sdk.clean_error() == OK and sdk.get_err_warn_code() == (OK, [0, 0]))
    expect("it gets ready", sdk.set_state(0) == OK and sdk.get_state() == (OK, AT_REST))
    wait_until("the report has it", lambda: (sdk.error_code, sdk.state) == (0, AT_REST))
    code = sdk.set_servo_angle(angle=HOME, speed=90, wait=True)
    expect(f"and moves: {code}", code == OK and near(angles(sdk), HOME))


def without_reports(arm: VirtualArm) -> None:
    sdk = arm.connect(enable_report=False, enable_heartbeat=True)
    expect("the SDK connects, without reports", sdk.connected and sdk.core.get_protocol_identifier() == 2)
    for _ in range(20):
        registers(sdk)
    # Without reports, the SDK's own set_servo_angle waits for the first one for ever.
    code = sdk.core.move_joint([math.radians(5)] + [0.0] * 6, 1, 10, 0)[0]
    expect(f"it moves: {code}", code == OK)
    wait_until("and arrives", lambda: sdk.get_state() == (OK, AT_REST))
    expect(f"at {angles(sdk)}", near(angles(sdk), [5.0, *HOME[1:]]))
    # A heartbeat every second: three of them, and the calls between, hurt nothing.
    end = time.monotonic() + 3
    wait_until("heartbeats hurt nothing", lambda: sdk.get_state() == (OK, AT_REST) and time.monotonic() > end)
    sdk.disconnect()


def two_at_once(arm: VirtualArm) -> None:
    one, other = arm.connect(), arm.connect(enable_heartbeat=True)
    for _ in range(50):
        expect("each gets its own answers", (one.get_state()[0], other.get_cmdnum()[0]) == (OK, OK))
        expect("and so", one.get_version() == other.get_version() and angles(one) == angles(other))
    code = one.set_servo_angle(angle=TARGET, speed=90, wait=True)
    expect(f"one moves the arm: {code}", code == OK)
    wait_until("both see it", lambda: near(one.angles[:6], TARGET) and near(other.angles[:6], TARGET))
    one.disconnect()
    expect("one leaves, the other stays", other.get_state() == (OK, AT_REST) and other.connected)
    other.disconnect()


def reboot(arm: VirtualArm) -> None:
    sdk = arm.connect()
    expect("reboot", sdk.system_control(2) == OK)
    wait_until("it closes the connection", lambda: not sdk.connected)
    sdk.disconnect()
    # That it closes is not news to be complained of.
    complaints.clear()
    sdk = arm.connect()
    expect("it comes back, stopped", sdk.connected and sdk.get_state() == (OK, STOPPED))
    expect("where it was", near(angles(sdk), TARGET))
    registers(sdk)
    sdk.disconnect()


def shutdown(arm: VirtualArm) -> None:
    sdk = arm.connect()
    expect("shutdown", sdk.system_control(1) == OK)
    wait_until("it closes the connection", lambda: not sdk.connected)
    sdk.disconnect()
    complaints.clear()
    said = arm.wait()
    expect(f"the virtual arm ends: {said}", " 0 broken" in said and " 0 not read" in said)


def no_report_port(armwire: str) -> None:
    with VirtualArm(armwire, "--no-report") as arm:
        sdk = arm.connect()
        wait_until("it changes to protocol id 3", lambda: sdk.core.get_protocol_identifier() == 3)
        for _ in range(20):
            registers(sdk)
        expect("the SDK does without a report port", sdk.connected and not sdk._arm.reported)
        sdk.disconnect()
        expect("the virtual arm ends", " 0 broken" in arm.stop())


def with_a_warning(armwire: str) -> None:
    with VirtualArm(armwire, "--warning", "13") as arm:
        sdk = arm.connect()
        wait_until("the report has the warning", lambda: sdk.warn_code == 13)
        registers(sdk, code=HAS_WARNING)
        expect("the warning is cleared", sdk.clean_warn() == OK and sdk.get_err_warn_code() == (OK, [0, 0]))
        registers(sdk)
        sdk.disconnect()
    with VirtualArm(armwire, "--warning", "13") as arm:
        sdk = arm.connect(enable_report=False)
        expect("without reports, the SDK clears a warning as it connects", sdk.get_err_warn_code() == (OK, [0, 0]))
        sdk.disconnect()


def with_an_error(armwire: str) -> None:
    with VirtualArm(armwire, "--error", "2") as arm:
        sdk = arm.connect()
        wait_until("the report has the error", lambda: sdk.error_code == 2)
        registers(sdk, code=HAS_ERROR)
        expect("no motors while there is an error", sdk.motion_enable(True) == OK and not any(sdk.motor_enable_states))
        sdk.disconnect()


def other_model(armwire: str, axes: int) -> None:
    serials = ["--serial", "XA12345678", "--box-serial", "AB12345678"]
    with VirtualArm(armwire, "--axes", str(axes), *serials) as arm:
        sdk = arm.connect()
        wait_until("it has a report", lambda: sdk._arm._first_report_over)
        expect(f"{sdk.axis} axes, type {sdk.device_type}", (sdk.axis, sdk.device_type) == (axes, axes))
        serial = (*sdk.get_robot_sn(), sdk.control_box_sn)
        expect(f"serial numbers {serial}", serial == (OK, "XA12345678", "AB12345678"))
        expect("motors on", sdk.motion_enable(True) == OK and sdk.set_mode(0) == OK and sdk.set_state(0) == OK)
        target = [10.0] * axes
        code = sdk.set_servo_angle(angle=target, speed=90, wait=True)
        expect(f"it moves: {code}", code == OK and near(sdk.get_servo_angle()[1], target + [0.0] * (7 - axes)))
        wait_until("the report has it", lambda: near(sdk.angles[:axes], target))
        sdk.disconnect()


def give_up(*_: object) -> None:
    sys.exit(f"FAILED: not done within {LIMIT:.0f} s")


def angles(sdk: XArmAPI) -> list[float]:
    """The angles of six joints, in degrees."""
    code, all_seven = sdk.get_servo_angle()
    if code != OK:
        sys.exit(f"FAILED: the joint angles: {code}")
    return all_seven[:6]


def expect(what: str, holds: bool) -> None:
    """Prints what holds; ends the program if it does not."""
    if not holds:
        sys.exit(f"FAILED: {what}")
    print(f"ok: {what}", flush=True)


def wait_until(what: str, holds: Callable[[], bool]) -> None:
    """Asks again and again until it holds; ends the program when patience does."""
    start = time.monotonic()
    while not holds():
        if time.monotonic() - start > STEP_TIMEOUT:
            sys.exit(f"FAILED: not within {STEP_TIMEOUT:.0f} s: {what}")
        time.sleep(0.01)
    print(f"ok: {what}, after {time.monotonic() - start:.1f} s", flush=True)


def near(values: list[float], wanted: list[float]) -> bool:
    return all(abs(value - want) <= CLOSE for value, want in zip(values, wanted, strict=True))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
