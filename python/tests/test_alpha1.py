import os
import pty
import threading
import time
import tty
from collections.abc import Iterator

import pytest

import armwire
from armwire import errors, sim

# An angle for each servo.
ANGLES = dict.fromkeys(range(1, 17), 90)


@pytest.fixture
def robot() -> Iterator[armwire.Alpha1]:
    with sim.alpha1() as virtual, armwire.Alpha1(virtual.port) as robot:
        yield robot


@pytest.fixture
def servos() -> Iterator[armwire.Alpha1]:
    with sim.alpha1_servos([1, 2, 16]) as virtual, armwire.Alpha1(virtual.port) as servos:
        yield servos


def test_versions_are_read(robot: armwire.Alpha1) -> None:
    assert robot.read_hardware_version() == b"Alpha1_V2.0"
    assert robot.read_firmware_version() == "2015121519"


def test_action_moves_servos(robot: armwire.Alpha1) -> None:
    robot.act(dict.fromkeys(range(2, 17), 80), release=[1], time_s=0.1, interval_s=0.2)
    assert robot.read_running_servos() == tuple(range(1, 17))


@pytest.mark.parametrize("mask", [0, 1, 0x5555_AAAA, 0xAAAA_5555, 0x8000_0000, 0xFFFF_FFFF])
def test_every_servo_state_is_read(mask: int) -> None:
    states = mask.to_bytes(4, "big")
    ours, theirs = pty.openpty()
    tty.setraw(theirs)

    def answer() -> None:
        assert os.read(ours, 10) == bytes.fromhex("EF FE 00 00 00 00 00 00 00 ED")
        os.write(ours, b"\xef\xfe" + states + bytes([sum(states) & 0xFF, 0xED]))

    robot = threading.Thread(target=answer)
    robot.start()
    with armwire.Alpha1(os.ttyname(theirs)) as opened:
        running = opened.read_running_servos()
    robot.join()
    os.close(theirs)
    os.close(ours)
    assert running == tuple(servo for servo in range(1, 33) if mask >> (servo - 1) & 1)


def test_play_and_stop() -> None:
    with sim.alpha1() as virtual, armwire.Alpha1(virtual.port) as robot:
        robot.play("wave")
        assert virtual.playing() == "wave"
        robot.stop()
        assert virtual.playing() is None


def test_settings_are_accepted(robot: armwire.Alpha1) -> None:
    robot.set_offset_tool(True)
    robot.set_offset_tool(False)
    robot.set_usb_type("serial")


def test_servo_moves_and_reports_its_angle(servos: armwire.Alpha1) -> None:
    servos.move_servo(2, 120, time_s=0.1, lock_s=0.1)
    time.sleep(0.3)
    assert servos.read_servo_angles_deg(2) == (120, 120)
    servos.move_servo(0, 90, time_s=0.1, lock_s=0.1)
    servos.set_servo_led(1, 0)
    servos.release_servo(0)


def test_servo_settings_are_read_back(servos: armwire.Alpha1) -> None:
    servos.set_servo_offset_thirds_deg(1, -9)
    assert servos.read_servo_offset_thirds_deg(1) == -9
    servos.change_servo_id(1, 5)
    assert len(servos.read_servo_version(5)) == 4
    with pytest.raises(errors.AbsentError):
        servos.read_servo_version(1)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda robot: robot.act(ANGLES | {21: 0}, time_s=0, interval_s=0), "servo is 21, must be 1 to 20"),
        (lambda robot: robot.act(ANGLES, release=[21], time_s=0, interval_s=0), "servo is 21, must be 1 to 20"),
        (lambda robot: robot.act(ANGLES | {1: 241}, time_s=0, interval_s=0), "is 241, must be 0 to 240"),
        (lambda robot: robot.act(ANGLES, time_s=6, interval_s=0), r"move time is 6 s, must be 0..=5.1"),
        (lambda robot: robot.act(ANGLES, time_s=0, interval_s=-1), "duration -1 s is out of range"),
        (lambda robot: robot.act({1: 90}, time_s=0, interval_s=0), "servo 2 has neither an angle nor a release"),
        (lambda robot: robot.act(ANGLES, release=[3], time_s=0, interval_s=0), "servo 3 has an angle and a release"),
        (lambda robot: robot.play("x" * 255), "text length is 255 bytes"),
        (lambda robot: robot.set_usb_type("tape"), "USB type is 'tape', must be disk, serial or hid"),
        (lambda robot: robot.move_servo(241, 0, time_s=0, lock_s=0), "servo id is 241"),
        (lambda robot: robot.read_servo_angles_deg(0), "servo id is 0, must be 1"),
        (lambda robot: robot.set_servo_offset_thirds_deg(1, 91), "servo offset is 91"),
    ],
)
def test_invalid_value_is_an_error(robot: armwire.Alpha1, call: object, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        call(robot)  # type: ignore[operator]
