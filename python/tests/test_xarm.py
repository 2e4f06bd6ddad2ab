import struct
import time
from collections.abc import Iterator

import numpy as np
import pytest

import armwire
from armwire import XArmState, errors, sim


@pytest.fixture
def xarm() -> Iterator[armwire.XArm]:
    with sim.xarm() as virtual, armwire.XArm(virtual.port) as xarm:
        yield xarm


def test_version_and_serials_are_read(xarm: armwire.XArm) -> None:
    version = xarm.read_version()
    text = "6,6,XI1202,AC1302,v1.12.10"
    assert version.value == armwire.XArmVersion(text, 6, 6, "XI1202", "AC1302", "v1.12.10")
    assert version.state == XArmState.NOT_READY
    assert xarm.read_serials().value == armwire.XArmSerials("XI120204201B02", "AC130202B02L02")


@pytest.mark.parametrize("axes", [5, 6, 7])
def test_number_of_axes_is_read(axes: int) -> None:
    with sim.xarm(axes=axes) as virtual, armwire.XArm(virtual.port, supervised=True) as xarm:
        assert xarm.read_version().value.axes == axes


def test_torque_source_and_radius_are_read(xarm: armwire.XArm) -> None:
    assert xarm.read_torque_source().value == "torque"
    assert 0 <= xarm.read_rotation_radius_mm(2).value < 2000
    with pytest.raises(ValueError, match=r"joint is 8, must be 1..=7"):
        xarm.read_rotation_radius_mm(8)


def test_dynamics_reload_and_heartbeat(xarm: armwire.XArm) -> None:
    assert xarm.reload_dynamics().value is None
    xarm.heartbeat()
    assert xarm.read_torque_source().value == "torque"


def test_raw_registers_move_the_joints(xarm: armwire.XArm) -> None:
    target = np.radians([10, -20, -30, 0, 45, -90, 0])
    xarm.raw(11, bytes([8, 1]))  # motors on
    xarm.raw(19, bytes([0]))  # position mode
    xarm.raw(12, bytes([0]))  # ready
    xarm.raw(23, struct.pack("<7f3f", *target, 3.0, 20.0, 0.0))
    deadline = time.monotonic() + 10
    while np.abs(xarm.read_joints_rad().value - target).max() > 1e-3:
        assert time.monotonic() < deadline
    np.testing.assert_allclose(xarm.read_joints_deg().value, np.degrees(target), atol=0.06)


def test_typed_register_cannot_be_raw(xarm: armwire.XArm) -> None:
    with pytest.raises(ValueError, match="register 1 has types of its own"):
        xarm.raw(1)


def test_reboot_closes_the_connection(xarm: armwire.XArm) -> None:
    assert xarm.reboot().value is None
    with pytest.raises(errors.PortLostError):
        xarm.read_version()
    with armwire.XArm(xarm.port) as again:
        again.read_version()


def test_shutdown_ends_the_arm(xarm: armwire.XArm) -> None:
    assert xarm.shut_down().value is None
    with pytest.raises(errors.PortLostError):
        xarm.read_version()
