"""The force-feedback leader: its control mode, its force feedback, and arms that are none."""

import asyncio

import pytest

import armwire
from armwire import ControlMode, Inhibit, MotionStatus, aio, sim
from armwire.errors import RefusedError

NOT_SUPPORTED = "not supported: the arm answers, but not for its control mode, so it is no force-feedback leader"


def test_accepted_mode_is_waited_for() -> None:
    with sim.ling(force_feedback="apply=300ms,blocked=2+3") as virtual, armwire.Ling(virtual.port) as arm:
        assert arm.read_mode().mode is ControlMode.POSITION
        state = arm.set_mode(ControlMode.CURRENT)
        zeros = (0.0,) * 6
        expected = armwire.ModeState(ControlMode.CURRENT, (2, 3), (1, 2, 3, 4, 5, 6), zeros, zeros, zeros, zeros)
        assert state == expected


def test_torque_stays_off_after_a_return_to_position_mode() -> None:
    with sim.ling(force_feedback="") as virtual, armwire.Ling(virtual.port) as arm:
        arm.set_torque(True)
        arm.set_mode(ControlMode.CURRENT)
        assert arm.set_mode(ControlMode.POSITION).mode is ControlMode.POSITION
        assert arm.read_joints().status is MotionStatus.IDLE
        with pytest.raises(RefusedError, match="the torque is off"):
            arm.move_deg([0] * 6, speed_deg_s=10, gripper_permille=0)


def test_mode_that_is_not_applied_is_refused() -> None:
    for words, text in [
        ("never", "was accepted, but the mode is position after 2 s"),
        ("refuse", "the arm answered: unsupported or not queued"),
    ]:
        with (
            sim.ling(force_feedback=words) as virtual,
            armwire.Ling(virtual.port) as arm,
            pytest.raises(RefusedError, match=text),
        ):
            arm.set_mode(ControlMode.CURRENT)


def test_unknown_mode_is_not_sent() -> None:
    with sim.ling(force_feedback="") as virtual, armwire.Ling(virtual.port) as arm:
        asked = virtual.requests()
        with pytest.raises(ValueError, match="7 is not a valid ControlMode"):
            arm.set_mode(7)  # type: ignore[arg-type]
        assert virtual.requests() == asked


def test_requested_force_feedback_may_be_inhibited() -> None:
    with sim.ling(force_feedback="stale") as virtual, armwire.Ling(virtual.port) as arm:
        state = arm.set_force_feedback(True)
        assert (state.is_requested, state.is_effective) == (True, False)
        assert state.inhibit == Inhibit.NO_TELEOPERATION | Inhibit.STALE
        assert arm.read_force_feedback() == state
        assert not arm.set_force_feedback(False).is_requested
    with sim.ling(force_feedback="teleoperation") as virtual, armwire.Ling(virtual.port) as arm:
        assert arm.set_force_feedback(True).is_effective


def test_arm_without_answer_is_asked_once() -> None:
    with sim.ling(leader=True) as virtual, armwire.Ling(virtual.port) as arm:
        with pytest.raises(RefusedError, match=NOT_SUPPORTED):
            arm.read_mode()
        asked = virtual.requests()
        for call in (
            arm.read_mode,
            arm.read_force_feedback,
            lambda: arm.set_mode(ControlMode.CURRENT),
            lambda: arm.set_force_feedback(True),
        ):
            with pytest.raises(RefusedError, match=NOT_SUPPORTED):
                call()
        assert virtual.requests() == asked


def test_slow_speeds_need_an_answer_for_the_mode() -> None:
    with sim.ling(force_feedback="") as virtual, armwire.Ling(virtual.port) as arm:
        arm.set_torque(True)
        with pytest.raises(ValueError, match=r"must be 4\.39453"):
            arm.move_deg([0.3] * 6, speed_deg_s=0.2, gripper_permille=0)
        arm.read_mode()
        arm.move_deg([0.3] * 6, speed_deg_s=0.2, gripper_permille=0)
        with pytest.raises(ValueError, match=r"must be 0\.0878906"):
            arm.move_deg([0.3] * 6, speed_deg_s=0.04, gripper_permille=0)


def test_awaited_mode_is_applied() -> None:
    async def run() -> None:
        with sim.ling(force_feedback="apply=200ms") as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                assert (await arm.set_mode(ControlMode.CURRENT)).mode is ControlMode.CURRENT

    asyncio.run(run())


def test_wrong_word_is_refused() -> None:
    with pytest.raises(ValueError, match="'gremlins': expected apply=TIMEms"):
        sim.ling(force_feedback="gremlins")
