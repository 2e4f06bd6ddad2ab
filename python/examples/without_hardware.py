"""A test of a program without hardware: `pytest without_hardware.py`."""

import numpy as np
import pytest

import armwire
from armwire import sim


def move(arm: armwire.Ling, joints: list[float]) -> None:
    """Move the arm. The line may lose a request: a move without effect is sent again."""
    for attempts_left in (2, 1, 0):
        arm.move_deg(joints, gripper_permille=0, speed_deg_s=200)
        try:
            arm.wait_until_at_deg(joints, timeout_s=3)
            return
        except TimeoutError:
            if attempts_left == 0:
                raise


def wave(arm: armwire.Ling) -> None:
    """The program under test."""
    for angle in (20, -20, 0):
        move(arm, [0, 0, 0, 0, angle, 0])


# A joint holds its load by its error: the arm returns to within 2°.
def test_wave_returns_to_its_start() -> None:
    with sim.ling() as virtual, armwire.Ling(virtual.port) as arm:
        wave(arm)
        np.testing.assert_allclose(virtual.joints().joints_deg, 0, atol=2)


def test_wave_returns_on_a_noisy_line() -> None:
    with sim.ling() as virtual, armwire.Ling(virtual.port) as arm:
        virtual.set_faults(sim.Faults(noise=1000))
        wave(arm)
        np.testing.assert_allclose(virtual.joints().joints_deg, 0, atol=2)


def test_wave_raises_when_the_arm_is_unplugged() -> None:
    with sim.ling() as virtual, armwire.Ling(virtual.port) as arm:
        virtual.close()
        with pytest.raises(armwire.errors.PortLostError):
            wave(arm)
