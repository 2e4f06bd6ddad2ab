"""Stopping a Ling arm: `stop`, and Ctrl-C in a wait."""

import asyncio
import threading
import time
import warnings
from collections.abc import Callable, Iterator

import pytest
from scripted import MOVE, READ_JOINTS, TORQUE_ON, ScriptedArm

import armwire
from armwire import MotionStatus, aio, errors, sim
from armwire.compat.alicia_d import create_robot

FAR = [170.0] * 6
SLOW = 30.0


# The readings of an arm at rest, in ticks.
REST = 3


@pytest.fixture
def virtual() -> Iterator[sim.VirtualLing]:
    """A virtual follower, with weight."""
    with sim.ling() as virtual:
        yield virtual


def wait_until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def start(arm: armwire.Ling, virtual: sim.VirtualLing, **gripper: int) -> None:
    """Start a motion of some seconds, and return when it has begun."""
    arm.move_deg(FAR, speed_deg_s=SLOW, **{"gripper_permille": 0, **gripper})
    wait_until(lambda: virtual.joints().ticks[0] > 2060)


def assert_rests(arm: armwire.Ling, virtual: sim.VirtualLing, state: armwire.JointState) -> None:
    """The arm is where it was read at rest: between start and target, with its torque on."""
    assert virtual.joints().ticks == pytest.approx(state.ticks, abs=REST)
    assert arm.read_velocities_deg_s()[:9].max() < 2
    assert all(2040 < ticks < 3900 for ticks in state.ticks)
    assert state.is_holding is True


def test_stopped_arm_rests_between_start_and_target(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    start(arm, virtual)
    assert_rests(arm, virtual, arm.stop())
    # It moves again.
    arm.move_deg([0] * 6, speed_deg_s=400)
    arm.wait_until_at_deg([0] * 6)


def test_stop_keeps_the_grippers_last_goal(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    start(arm, virtual, gripper_permille=1000, gripper_ticks_s=50)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        state = arm.stop()
    assert state.gripper < 1000
    wait_until(lambda: virtual.joints().gripper == 1000)


def test_stop_without_a_goal_warns_of_the_grip(virtual: sim.VirtualLing) -> None:
    with armwire.Ling(virtual.port) as other:
        start(other, virtual, gripper_permille=1000, gripper_ticks_s=50)
    with armwire.Ling(virtual.port) as arm:
        with pytest.warns(UserWarning, match="a grip may loosen") as warned:
            state = arm.stop()
        assert warned[0].filename == __file__
        assert_rests(arm, virtual, state)
        assert arm.read_velocities_deg_s()[9] == 0
        assert 0 < virtual.joints().gripper < 1000


def test_stated_gripper_is_the_goal(virtual: sim.VirtualLing, arm: armwire.Ling) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm.stop(gripper_permille=700)
        wait_until(lambda: virtual.joints().gripper == 700)
        arm.stop()
    assert arm.read_gripper_permille() == 700
    with pytest.raises(ValueError, match="must be 0 to 1000"):
        arm.stop(gripper_permille=1001)


def test_arm_without_torque_is_sent_nothing(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    arm.set_torque(False)
    before = virtual.requests()
    state = arm.stop()
    assert state.is_holding is False
    # One reading.
    assert virtual.requests() == before + 1
    assert virtual.joints().status is MotionStatus.IDLE


def test_arm_that_moves_on_is_not_stopped() -> None:
    with (
        ScriptedArm(lambda reading: 2048 + 10 * reading) as scripted,
        armwire.Ling(scripted.port) as arm,
        pytest.raises(errors.NotStoppedError, match="joint 1 still moves"),
    ):
        arm.stop(gripper_permille=500)


def test_silent_arm_is_not_stopped(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    virtual.set_faults(sim.Faults(drop=1_000_000))
    with pytest.raises(errors.NotStoppedError, match="no answer"):
        arm.stop(gripper_permille=500)


def test_stop_ends_the_stream_of_an_adapter_at_rest() -> None:
    with ScriptedArm(lambda _: 2048) as scripted, armwire.Ling(scripted.port) as arm:
        arm.stop(gripper_permille=500)
        arm.read_joints()
    assert MOVE in scripted.requests
    assert scripted.requests.index(TORQUE_ON) == len(scripted.requests) - 2
    assert scripted.requests[-1] == READ_JOINTS


def test_stop_by_asyncio_is_the_same(virtual: sim.VirtualLing) -> None:
    async def run() -> None:
        async with await aio.Ling.open(virtual.port) as arm:
            await arm.move_deg(FAR, gripper_permille=0, speed_deg_s=SLOW)
            wait = asyncio.create_task(arm.wait_until_at_deg(FAR))
            while virtual.joints().ticks[0] < 2060:
                await asyncio.sleep(0.005)
            state = await arm.stop()
            assert virtual.joints().ticks == pytest.approx(state.ticks, abs=REST)
            assert not wait.done()
            wait.cancel()

    asyncio.run(run())


def test_ctrl_c_in_a_wait_stops_the_arm(
    arm: armwire.Ling, virtual: sim.VirtualLing, ctrl_c: Callable[[], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def press() -> None:
        # The third request and those after it are the wait's.
        wait_until(lambda: virtual.requests() > 2 and virtual.joints().ticks[0] > 2060)
        ctrl_c()

    arm.move_deg(FAR, gripper_permille=0, speed_deg_s=SLOW)
    thread = threading.Thread(target=press)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        arm.wait_until_at_deg(FAR)
    thread.join()
    assert capsys.readouterr().err == f"{virtual.port}: Ctrl-C stopped the arm\n"
    assert_rests(arm, virtual, virtual.joints())


def test_ctrl_c_in_a_script_for_the_sdk_stops_the_arm(
    virtual: sim.VirtualLing, ctrl_c: Callable[[], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def press() -> None:
        wait_until(lambda: virtual.joints().ticks[0] > 2060)
        ctrl_c()

    robot = create_robot(virtual.port)
    thread = threading.Thread(target=press)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        robot.set_robot_state(FAR, 0, joint_format="deg", speed_deg_s=SLOW)
    thread.join()
    assert capsys.readouterr().err == f"{virtual.port}: Ctrl-C stopped the arm\n"
    assert_rests(robot.arm, virtual, virtual.joints())


def test_second_ctrl_c_ends_the_stop(ctrl_c: Callable[[], None], capsys: pytest.CaptureFixture[str]) -> None:
    moves: list[None] = []

    def joint1(reading: int) -> int:
        # During the wait.
        if reading == 3:
            ctrl_c()
        return 2048 + 10 * reading

    def on_move() -> None:
        moves.append(None)
        # The first move is the program's, the second that of the stop.
        if len(moves) == 2:
            ctrl_c()

    with ScriptedArm(joint1, on_move) as scripted, armwire.Ling(scripted.port) as arm:
        arm.move_deg(FAR, gripper_permille=0, speed_deg_s=SLOW)
        with pytest.raises(KeyboardInterrupt):
            arm.wait_until_at_deg(FAR)
    assert len(moves) >= 2
    # The stop has no result: it would take 2 s, and fail.
    assert capsys.readouterr().err == ""


def test_ctrl_c_stops_no_arm_that_was_not_moved(
    arm: armwire.Ling, virtual: sim.VirtualLing, ctrl_c: Callable[[], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def press() -> None:
        wait_until(lambda: virtual.requests() > 0)
        ctrl_c()

    thread = threading.Thread(target=press)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        arm.wait_until_at_deg(FAR)
    thread.join()
    assert capsys.readouterr().err == ""


def test_ctrl_c_is_kept_when_the_port_is_closed(ctrl_c: Callable[[], None]) -> None:
    def joint1(reading: int) -> int:
        # During the wait. The port is closed after this reading.
        if reading == 3:
            closing.start()
            ctrl_c()
        return 2048

    with ScriptedArm(joint1) as scripted, armwire.Ling(scripted.port) as arm:
        closing = threading.Thread(target=arm.close)
        arm.move_deg(FAR, gripper_permille=0, speed_deg_s=SLOW)
        with pytest.raises(KeyboardInterrupt):
            arm.wait_until_at_deg(FAR)
        closing.join()


def test_failed_stop_after_ctrl_c_is_reported(ctrl_c: Callable[[], None], capsys: pytest.CaptureFixture[str]) -> None:
    def joint1(reading: int) -> int:
        # During the wait.
        if reading == 3:
            ctrl_c()
        return 2048 + 10 * reading

    with ScriptedArm(joint1) as scripted, armwire.Ling(scripted.port) as arm:
        arm.move_deg(FAR, gripper_permille=0, speed_deg_s=SLOW)
        with pytest.raises(KeyboardInterrupt):
            arm.wait_until_at_deg(FAR)
    assert "joint 1 still moves after 2 s; switch the arm's supply off" in capsys.readouterr().err
