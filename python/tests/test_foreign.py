"""Another robot than an Alicia-D, and an arm whose status no document explains."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from scripted import MOVE, READ_JOINTS, TORQUE_OFF, TORQUE_ON, ZERO, ScriptedArm

import armwire
from armwire import errors
from armwire.compat.alicia_d import create_robot

# The joints of the vendor's two-armed robot.
BESSICA = (Path(__file__).parents[2] / "protocol/tests/bessica.bin").read_bytes()
NAME = r"the arm is not an Alicia-D but a Bessica-D \(33 data bytes\), so nothing was sent"
HOME = [0.0] * 6

MOTIONS: list[Callable[[armwire.Ling], Any]] = [
    lambda arm: arm.move_deg(HOME, speed_deg_s=20),
    lambda arm: arm.move_rad(HOME, speed_rad_s=1, gripper_permille=500),
]
SETTINGS: list[Callable[[armwire.Ling], Any]] = [lambda arm: arm.set_torque(True), lambda arm: arm.set_zero()]


class Bessica(ScriptedArm):
    """The vendor's two-armed robot."""

    def _take(self, head: bytes, data: bytes) -> None:
        if head != b"\x06\x00":
            super()._take(head, data)
            return
        self.requests.append(READ_JOINTS)
        os.write(self._ours, BESSICA)


class UnknownStatus(ScriptedArm):
    """An arm with a status of a later version."""

    def _state(self, reading: int) -> tuple[list[int], int]:
        return [2048] * 6, 0x42


@pytest.fixture
def bessica() -> Iterator[Bessica]:
    bessica = Bessica(lambda _: 2048)
    with bessica:
        yield bessica
        assert {MOVE, TORQUE_ON, ZERO}.isdisjoint(bessica.requests)


@pytest.mark.parametrize("motion", MOTIONS + SETTINGS)
def test_another_robot_is_sent_no_motion(bessica: Bessica, motion: Callable[[armwire.Ling], Any]) -> None:
    with armwire.Ling(bessica.port) as arm:
        for _ in range(2):
            with pytest.raises(errors.RefusedError, match=NAME):
                motion(arm)


def test_another_robot_is_not_held(bessica: Bessica) -> None:
    with (
        armwire.Ling(bessica.port) as arm,
        pytest.raises(errors.NotStoppedError, match="a Bessica-D: its answer is 33"),
    ):
        arm.stop(gripper_permille=500)


def test_another_robot_is_read_and_released(bessica: Bessica) -> None:
    with armwire.Ling(bessica.port) as arm:
        state = arm.read_joints()
        assert (state.ticks[0], state.foreign_data_bytes, len(state.extra)) == (0x65, 33, 18)
        assert state.is_holding is None
        assert not state.is_torque_off
        assert state.motion_refusal == "the arm is not an Alicia-D but a Bessica-D (33 data bytes)"
        with arm.reader(100) as reader:
            reading = reader.next_after(0)
            assert reading is not None
            assert reading.pose.foreign_data_bytes == 33
        with pytest.warns(UserWarning, match="status not an Alicia-D but a Bessica-D .* does not show its effect"):
            arm.set_torque(False)
    assert TORQUE_OFF in bessica.requests


def test_compat_moves_no_other_robot(bessica: Bessica) -> None:
    robot = create_robot(bessica.port)
    with pytest.raises(errors.RefusedError, match=NAME):
        robot.set_robot_state(target_joints=HOME, wait_for_completion=False)
    robot.disconnect()


def test_arm_of_unknown_status_is_only_stopped() -> None:
    with UnknownStatus(lambda _: 2048) as virtual, armwire.Ling(virtual.port) as arm:
        for motion in MOTIONS:
            with pytest.raises(errors.RefusedError, match="no document explains the arm's status 0x42, so nothing"):
                motion(arm)
        assert MOVE not in virtual.requests
        arm.stop(gripper_permille=500)
        assert MOVE in virtual.requests
        moves = virtual.requests.count(MOVE)
        for motion in MOTIONS:
            with pytest.raises(errors.RefusedError, match="0x42"):
                motion(arm)
        assert virtual.requests.count(MOVE) == moves
