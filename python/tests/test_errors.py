import os
import pty
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from zlib import crc32

import pytest

import armwire
from armwire import errors, sim


@contextmanager
def peer(answer: bytes) -> Iterator[str]:
    """Open a serial port whose other end answers each request with these bytes."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)

    def serve() -> None:
        try:
            while os.read(ours, 100):
                os.write(ours, answer)
        except OSError:
            pass

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        os.close(theirs)
        thread.join()
        os.close(ours)


def frame(body: str) -> bytes:
    """Build a Ling frame with a valid checksum."""
    data = bytes.fromhex(body)
    return b"\xaa" + data + bytes([crc32(data) & 0xFF, 0xFF])


def read(port: str) -> None:
    with armwire.Ling(port) as arm:
        arm.read_joints()


def test_missing_port_is_a_port_error() -> None:
    with pytest.raises(errors.PortError, match="/dev/no-such-port: no such port"):
        armwire.Ling("/dev/no-such-port")


@pytest.mark.parametrize("baud", [0, -1, 2**32])
def test_baud_rate_out_of_range_is_a_value_error(baud: int) -> None:
    for arm in (armwire.Ling, armwire.Alpha1):
        with pytest.raises(ValueError, match=f"baud rate is {baud}, must be 1 to 4294967295"):
            arm("/dev/no-such-port", baud=baud)


def test_port_in_use_is_a_port_error(virtual: sim.VirtualLing, arm: armwire.Ling) -> None:
    with pytest.raises(errors.PortError, match="in use by this process"):
        armwire.Ling(virtual.port)


def test_wrong_port_text_is_a_value_error() -> None:
    with pytest.raises(ValueError, match="the port's name is missing"):
        armwire.Ling("can:")


def test_silence_is_absent() -> None:
    with peer(b"") as port, pytest.raises(errors.AbsentError, match="is the arm powered"):
        read(port)


def test_wrong_checksum_is_damaged() -> None:
    damaged = bytes.fromhex("AA06000F00080008000800080008000800000170FF")
    with peer(damaged) as port, pytest.raises(errors.DamagedError, match="check cable"):
        read(port)


def test_answer_after_its_timeout_is_late() -> None:
    with (
        sim.ling(turnaround_us=350_000) as virtual,
        armwire.Ling(virtual.port) as arm,
        pytest.raises(errors.LateError, match="too late"),
    ):
        arm.read_info()


def test_late_answer_is_not_taken_for_the_next() -> None:
    with sim.ling(turnaround_us=350_000) as virtual, armwire.Ling(virtual.port) as arm:
        with pytest.raises(errors.LateError):
            arm.read_stroke_mm()
        with pytest.raises(errors.NoAnswerError):
            arm.read_info()


def test_other_bytes_are_the_wrong_arm() -> None:
    with peer(b"hello, world") as port, pytest.raises(errors.WrongArmError, match="no frame of a Ling arm"):
        read(port)


def test_echo_alone_is_the_wrong_arm() -> None:
    with peer(bytes.fromhex("AA060001FE9AFF")) as port, pytest.raises(errors.WrongArmError, match="our own requests"):
        read(port)


def test_unknown_answer_is_refused() -> None:
    with peer(frame("77000100")) as port, pytest.raises(errors.RefusedError, match="command 77"):
        read(port)


def test_bytes_after_documented_fields_are_kept() -> None:
    counts = "000800080008000800080008F40101"
    with peer(frame(f"060011{counts}7778")) as port, armwire.Ling(port) as arm:
        state = arm.read_joints()
    assert (state.gripper, state.extra) == (500, b"\x77\x78")
    info = b"ADFS251205123456".hex() + "6E00000062020000"
    with peer(frame(f"01001A{info}7778")) as port, armwire.Ling(port) as arm:
        assert arm.read_info().extra == b"\x77\x78"


def test_error_frame_is_an_error_with_its_bytes() -> None:
    with peer(frame("EE00020103")) as port, pytest.raises(errors.ErrorFrameError, match="AA EE 00 02 01 03"):
        read(port)


def test_answer_outside_the_protocol_is_unacceptable() -> None:
    with (
        peer(frame("040E0103")) as port,
        armwire.Ling(port) as arm,
        pytest.raises(errors.UnacceptableError, match="gripper stroke type is 3"),
    ):
        arm.read_stroke_mm()


def test_older_arm_raises_its_own_error() -> None:
    with sim.older_ling() as virtual, pytest.raises(errors.OlderArmError, match="older generation"):
        armwire.Ling(virtual.port)


def test_refusals_of_other_arms_are_refused() -> None:
    with sim.xarm() as virtual, armwire.XArm(virtual.port) as arm, pytest.raises(errors.RefusedError):
        arm.raw(99)
    with sim.alpha1() as robot, armwire.Alpha1(robot.port) as arm1, pytest.raises(errors.RefusedError):
        arm1.play("no such action")


def test_host_without_an_arm_is_a_port_error() -> None:
    with pytest.raises(errors.PortError, match="nothing listens there"):
        armwire.XArm("127.0.0.1:1")


def test_every_exception_is_an_armwire_error() -> None:
    for name in errors.__all__:
        assert issubclass(getattr(errors, name), armwire.ArmwireError)
    assert issubclass(errors.AbsentError, TimeoutError)
    assert issubclass(errors.PortLostError, OSError)


def test_missing_hid_device_is_an_error_with_its_reason() -> None:
    with pytest.raises(errors.PortError, match="no such HID device"):
        armwire.Alpha1("hid:/dev/no-such-hidraw")
