import asyncio
import select
import signal
import socket
import threading
import time
import tty
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scripted import TORQUE_ON, ZERO, Row, RowArm, rows, verdict_of

import armwire
from armwire import MotionStatus, aio, sim
from armwire.errors import NotReachedError

TARGET = [10.0, -20.0, 30.0, 0.0, 45.0, -90.0]
# Half a tick in degrees: the largest rounding error of a position.
HALF_TICK = 45 / 1024


def wait_until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def go(arm: armwire.Ling, joints: object, gripper: int = 500) -> armwire.JointState:
    arm.move_deg(joints, gripper_permille=gripper, speed_deg_s=400, gripper_ticks_s=5500)  # type: ignore[arg-type]
    return arm.wait_until_at_deg(joints, timeout_s=5)  # type: ignore[arg-type]


def test_info_has_serial_kind_and_versions(arm: armwire.Ling) -> None:
    assert arm.read_info() == armwire.LingInfo("ADFS251205123456", "follower", "v1.10", "v6.10")


def test_fresh_arm_is_at_zero_and_locked(arm: armwire.Ling) -> None:
    state = arm.read_joints()
    assert state == armwire.JointState((2048,) * 6, 0, MotionStatus.LOCKED)
    assert state.is_holding is True
    assert arm.read_gripper_permille() == 0


def test_move_reaches_angles_in_degrees_and_radians(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    go(arm, TARGET)
    time.sleep(0.2)
    assert virtual.joints().ticks == (2162, 1820, 2389, 2048, 2560, 1024)
    np.testing.assert_allclose(arm.read_joints_deg(), TARGET, atol=HALF_TICK)
    np.testing.assert_allclose(arm.read_joints_rad(), np.radians(TARGET), atol=np.radians(HALF_TICK))
    arm.move_rad(np.radians([0, 90, -90, 0, 0, 0]), gripper_permille=1000, speed_rad_s=[7] * 6)
    arm.wait_until_at_rad(np.radians([0, 90, -90, 0, 0, 0]), timeout_s=5)


def test_every_position_survives_conversion_to_angles() -> None:
    from armwire._units import DEG_PER_TICK, RAD_PER_TICK, position_ticks

    for ticks in range(0, 4096, 6):
        six = [min(ticks + joint, 4095) for joint in range(6)]
        state = armwire.JointState(tuple(six), 0, MotionStatus.IDLE)
        assert state.joints_deg.tolist() == [(tick - 2048) * 45 / 512 for tick in six]
        assert position_ticks(state.joints_deg, DEG_PER_TICK, "") == six
        assert position_ticks(state.joints_rad, RAD_PER_TICK, "") == six


@pytest.mark.parametrize(
    ("joints", "kwargs", "text"),
    [
        ([200, 0, 0, 0, 0, 0], {}, "angle of joint 1 is 200 degrees, must be -180 to 179.912"),
        ([0, 0, float("nan"), 0, 0, 0], {}, "angle of joint 3 is nan degrees"),
        ([0] * 5, {}, r"joint angles have the shape \(5,\), must be 6 numbers"),
        ([0] * 6, {"speed_deg_s": 0}, "speed of joint 1 is 0 degrees/s, must be 4.39453 to 439.453"),
        ([0] * 6, {"speed_deg_s": [5, 5, 5, 5, 4, 5]}, "speed of joint 5 is 4 degrees/s.*an arm may take less for 0"),
        ([0] * 6, {"speed_deg_s": [5, 5, 5, 5, 5, 440]}, "speed of joint 6 is 440"),
        ([0] * 6, {"gripper_permille": 1001}, "gripper in thousandths is 1001, must be 0 to 1000"),
        ([0] * 6, {"gripper_permille": -1}, "gripper in thousandths is -1"),
        ([0] * 6, {"gripper_ticks_s": 70000}, "gripper speed in ticks/s is 70000"),
    ],
)
def test_invalid_value_is_refused_and_not_sent(
    arm: armwire.Ling, virtual: sim.VirtualLing, joints: list[float], kwargs: dict[str, object], text: str
) -> None:
    arguments: dict[str, object] = {"gripper_permille": 0, "speed_deg_s": 100} | kwargs
    with pytest.raises(ValueError, match=text):
        arm.move_deg(joints, **arguments)  # type: ignore[arg-type]
    assert virtual.requests() == 0


def test_follower_has_ten_servos_and_leader_six(arm: armwire.Ling) -> None:
    assert arm.read_temperatures_celsius().tolist() == [25] * 10
    assert arm.read_velocities_deg_s().tolist() == [0] * 10
    with sim.ling(plant="ideal", leader=True) as virtual, armwire.Ling(virtual.port) as leader:
        assert leader.read_temperatures_celsius().tolist() == [25] * 6
        assert leader.read_info().kind == "leader"
        assert leader.self_check() == ()


def test_velocities_show_motion_in_both_units(arm: armwire.Ling) -> None:
    arm.move_deg([90, 0, 0, 0, 0, 0], gripper_permille=0, speed_deg_s=90)
    time.sleep(0.5)
    degrees, radians = arm.read_velocities_deg_s(), arm.read_velocities_rad_s()
    assert degrees.max() == pytest.approx(90, abs=0.1)
    assert radians.max() == pytest.approx(np.radians(90), abs=0.01)


def test_self_check_names_faulty_servos(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    virtual.set_faulty(3)
    virtual.set_faulty(10)
    assert arm.self_check() == (3, 10)


def test_torque_off_releases_the_arm(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    assert not virtual.push_joints_deg(TARGET)
    arm.set_torque(False)
    assert virtual.push_joints_deg(TARGET)
    np.testing.assert_allclose(arm.read_joints_deg(), TARGET, atol=HALF_TICK)
    arm.set_torque(True)
    assert arm.read_joints().status is MotionStatus.LOCKED


def test_motion_without_torque_is_refused_at_once(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    arm.set_torque(False)
    before = virtual.requests()
    with pytest.raises(armwire.errors.RefusedError, match=r"torque is off \(status idle\), so nothing was sent"):
        arm.move_deg(TARGET, gripper_permille=500, speed_deg_s=90)
    with pytest.raises(armwire.errors.RefusedError, match="nothing was sent"):
        arm.move_rad([0] * 6, gripper_permille=500, speed_rad_s=1)
    # A reading each.
    assert virtual.requests() == before + 2
    arm.set_torque(True)
    go(arm, TARGET)


def test_stream_of_moves_costs_no_readings(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    for angle in range(10):
        arm.move_deg([angle] * 6, gripper_permille=0, speed_deg_s=90)
    arm.read_joints()
    # The reading before the first move, the moves, and the last reading.
    assert virtual.requests() == 12


def test_wait_ends_when_the_torque_goes_off(arm: armwire.Ling) -> None:
    arm.move_deg([90] * 6, gripper_permille=0, speed_deg_s=5)
    # The limit is below the temperature: the arm switches its torque off.
    arm.set_temperature_limit_celsius(10)
    with pytest.raises(armwire.errors.RefusedError, match="status overheat protection"):
        arm.wait_until_at_deg([90] * 6)
    with pytest.raises(armwire.errors.RefusedError, match="nothing was sent"):
        arm.move_deg([0] * 6, gripper_permille=0, speed_deg_s=90)


def test_wait_for_an_arm_moved_by_hand_returns() -> None:
    with sim.ling(plant="ideal", leader=True) as virtual, armwire.Ling(virtual.port) as leader:
        timer = threading.Timer(0.1, virtual.push_joints_deg, (TARGET,))
        timer.start()
        assert leader.wait_until_at_deg(TARGET).is_holding is False
        timer.join()


def test_omitted_gripper_gets_its_last_goal(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    arm.move_deg([0] * 6, gripper_permille=1000, speed_deg_s=90, gripper_ticks_s=200)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm.move_deg([1] * 6, speed_deg_s=90, gripper_ticks_s=5500)
    wait_until(lambda: virtual.joints().gripper == 1000)


def test_omitted_gripper_without_a_goal_warns(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    arm.set_torque(False)
    virtual.push_gripper_permille(300)
    arm.set_torque(True)
    with pytest.warns(UserWarning, match="a grip may loosen") as warned:
        arm.move_deg(TARGET, speed_deg_s=400)
    assert warned[0].filename == __file__
    arm.wait_until_at_deg(TARGET)
    assert virtual.joints().gripper == 300


def test_gripper_without_torque_forgets_its_goal(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    go(arm, [0] * 6, gripper=1000)
    arm.set_torque(False)
    virtual.push_gripper_permille(300)
    arm.set_torque(True)
    with pytest.warns(UserWarning, match="a grip may loosen"):
        arm.move_deg(TARGET, speed_deg_s=400)
    arm.wait_until_at_deg(TARGET)
    assert virtual.joints().gripper == 300


def test_leader_is_moved_by_hand() -> None:
    with sim.ling(plant="ideal", leader=True) as virtual, armwire.Ling(virtual.port) as leader:
        assert virtual.push_joints_deg(TARGET)
        assert virtual.push_gripper_permille(321)
        assert leader.read_gripper_permille() == 321
        np.testing.assert_allclose(leader.read_joints_deg(), TARGET, atol=HALF_TICK)


def test_zero_makes_the_pose_zero(arm: armwire.Ling) -> None:
    go(arm, TARGET)
    arm.set_zero()
    state = arm.read_joints()
    np.testing.assert_allclose(state.joints_deg, 0, atol=3 * 45 / 512)
    assert state.status is MotionStatus.IDLE


@pytest.mark.parametrize("stroke", [50, 75, 100])
def test_stroke_is_set_and_read(arm: armwire.Ling, stroke: int) -> None:
    arm.set_stroke_mm(stroke)
    assert arm.read_stroke_mm() == stroke


def test_invalid_stroke_and_limit_are_errors(arm: armwire.Ling) -> None:
    with pytest.raises(ValueError, match="gripper stroke is 60 mm, must be 50, 75 or 100"):
        arm.set_stroke_mm(60)
    with pytest.raises(ValueError, match="254"):
        arm.set_temperature_limit_celsius(254)
    with pytest.raises(ValueError, match="must be 0 to 255"):
        arm.set_temperature_limit_celsius(256)


def test_low_temperature_limit_shows_as_overheating(arm: armwire.Ling) -> None:
    arm.set_temperature_limit_celsius(20)
    assert arm.read_joints().status in (MotionStatus.OVERHEATING, MotionStatus.OVERHEAT_PROTECTION)


def test_target_not_reached_names_the_joint(arm: armwire.Ling) -> None:
    with pytest.raises(TimeoutError, match=r"target not reached after 0.1 s: joint 2 is 20.04° off"):
        arm.wait_until_at_deg([0, -20, 0, 0, 0, 0], timeout_s=0.1)


@pytest.mark.parametrize("timeout_s", [float("nan"), float("inf"), -0.1])
def test_wait_refuses_an_unusable_timeout(arm: armwire.Ling, virtual: sim.VirtualLing, timeout_s: float) -> None:
    with pytest.raises(ValueError, match="must be 0 or more, and finite"):
        arm.wait_until_at_deg([0] * 6, timeout_s=timeout_s)
    assert virtual.requests() == 0


def test_arm_at_rest_is_at_a_target_within_the_tolerance(arm: armwire.Ling, virtual: sim.VirtualLing) -> None:
    arm.set_torque(False)
    for ticks in (2048 - 65, 2048 + 65):
        virtual.push_joints_deg([(ticks - 2048) * 45 / 512] * 6)
        assert arm.wait_until_at_deg([0] * 6).ticks == (ticks,) * 6
    virtual.push_joints_deg([0, 0, 0, 0, 0, 66 * 45 / 512])
    with pytest.raises(NotReachedError, match=r"joint 6 is 5.80° off"):
        arm.wait_until_at_deg([0] * 6, timeout_s=0.5)
    assert arm.wait_until_at_deg([0] * 6, within_deg=6).ticks[5] == 2048 + 66
    with pytest.raises(ValueError, match=r"the tolerance is 0 degrees, must be 0.0878906 to 360"):
        arm.wait_until_at_deg([0] * 6, within_deg=0)


@pytest.mark.parametrize("row", rows(), ids=str)
def test_rows_of_readings_have_their_verdicts(row: Row) -> None:
    with RowArm(row) as scripted, armwire.Ling(scripted.port) as arm, verdict_of(row):
        state = arm.set_zero() if row.effect == ZERO else arm.set_torque(row.effect == TORQUE_ON)
        assert (state.status, state.ticks) == (row.later_status, (row.later_ticks,) * 6)


@pytest.mark.parametrize("row", rows(), ids=str)
def test_awaited_rows_have_their_verdicts(row: Row) -> None:
    async def run(port: str) -> armwire.JointState:
        async with await aio.Ling.open(port) as arm:
            return await (arm.set_zero() if row.effect == ZERO else arm.set_torque(row.effect == TORQUE_ON))

    with RowArm(row) as scripted, verdict_of(row):
        assert asyncio.run(run(scripted.port)).status == row.later_status


@pytest.mark.parametrize(
    ("status", "is_holding"),
    [(0x00, False), (0x01, True), (0x10, None), (0x11, True), (0xE1, None), (0xE2, False), (0x42, None)],
)
def test_status_shows_the_torque(status: int, is_holding: bool | None) -> None:
    state = armwire.JointState((2048,) * 6, 0, status)
    assert (state.is_holding, state.is_torque_off) == (is_holding, is_holding is False)


def test_counts_out_of_range_are_kept() -> None:
    # The example in the vendor's document has this gripper.
    state = armwire.JointState((2050, 2043, 2043, 2050, 2042, 4096), 2051, MotionStatus.IDLE)
    with pytest.raises(armwire.errors.UnacceptableError, match="joint 6: joint position is 4096 ticks, must be 0"):
        _ = state.joints_deg
    with pytest.raises(armwire.errors.UnacceptableError, match="2051 thousandths"):
        _ = state.gripper_permille


def test_threads_share_an_arm(arm: armwire.Ling) -> None:
    failures: list[BaseException] = []

    def read() -> None:
        try:
            for _ in range(50):
                assert arm.read_joints().ticks == (2048,) * 6
        except BaseException as failure:
            failures.append(failure)

    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []


def test_other_threads_run_during_a_call() -> None:
    with sim.ling(plant="ideal", turnaround_us=200_000) as virtual, armwire.Ling(virtual.port) as arm:
        thread = threading.Thread(target=arm.read_joints)
        thread.start()
        turns = 0
        while thread.is_alive():
            time.sleep(0.001)
            turns += 1
    assert turns > 5


def test_arm_answers_over_tcp(virtual: sim.VirtualLing) -> None:
    # A server of the arm's serial port, for one client.
    with socket.create_server(("127.0.0.1", 0)) as server, open(virtual.port, "r+b", buffering=0) as serial:
        tty.setraw(serial.fileno())

        def serve() -> None:
            client, _ = server.accept()
            with client:
                while True:
                    ready, _, _ = select.select([client.fileno(), serial.fileno()], [], [])
                    if client.fileno() in ready:
                        if not (request := client.recv(100)):
                            return
                        serial.write(request)
                    if serial.fileno() in ready:
                        client.sendall(serial.read(100))

        thread = threading.Thread(target=serve)
        thread.start()
        with armwire.Ling(f"tcp:127.0.0.1:{server.getsockname()[1]}") as arm:
            assert arm.read_info().kind == "follower"
            assert arm.read_joints().ticks == (2048,) * 6
        thread.join()


def test_closed_arm_raises_and_closes_twice(virtual: sim.VirtualLing) -> None:
    arm = armwire.Ling(virtual.port)
    arm.close()
    arm.close()
    with pytest.raises(armwire.errors.ClosedError):
        arm.read_joints()
    # The port is free again.
    with armwire.Ling(virtual.port) as again:
        again.read_info()


def test_signal_handler_cannot_block_the_call_it_interrupts() -> None:
    with sim.ling(plant="ideal", turnaround_us=40_000) as virtual, armwire.Ling(virtual.port) as arm:
        before = signal.signal(signal.SIGALRM, lambda *_: arm.set_torque(True))
        signal.setitimer(signal.ITIMER_REAL, 0.01)
        try:
            with pytest.raises(RuntimeError, match="a signal handler cannot call"):
                arm.read_info()
        finally:
            signal.signal(signal.SIGALRM, before)
        assert arm.read_info().kind == "follower"


@pytest.fixture
def user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The user's folder of configurations, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


def test_parked_arm_lies_in_its_pose_without_torque(user: None) -> None:
    with sim.ling() as virtual, armwire.Ling(virtual.port) as arm:
        with pytest.raises(armwire.errors.RefusedError, match=r"no pose is saved .* save_park_pose\(\) saves it"):
            arm.park()
        assert virtual.joints().is_holding
        with pytest.raises(armwire.errors.RefusedError, match="not saved: the torque is not off"):
            arm.save_park_pose()
        arm.set_torque(False)
        saved = arm.save_park_pose()
        np.testing.assert_array_equal(arm.read_park_pose_deg(), saved)
        arm.set_torque(True)
        go(arm, [10, -50, -50, 0, -20, -10])
        assert arm.park().is_torque_off
        np.testing.assert_allclose(virtual.joints().joints_deg, saved, atol=5.8)
        with pytest.raises(armwire.errors.RefusedError, match="the torque is off"):
            arm.park(joints_deg=[0] * 6)


def test_parking_that_does_not_arrive_keeps_the_torque() -> None:
    with sim.ling(plant="typical,obstacle=3:5deg") as virtual, armwire.Ling(virtual.port) as arm:
        with pytest.raises(NotReachedError, match=r"joint 3 is .*; not parked, the arm holds its pose"):
            arm.park(joints_deg=[0, 0, 20, 0, 0, 0])
        assert virtual.joints().is_holding
        assert virtual.joints().joints_deg[2] < 6


def test_stop_of_another_call_ends_a_parking() -> None:
    async def run() -> None:
        with sim.ling() as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                parking = asyncio.create_task(arm.park(joints_deg=[90, 0, 0, 0, 0, 0]))
                while (await arm.read_joints_deg())[0] < 2:
                    await asyncio.sleep(0)
                await arm.stop()
                with pytest.raises(armwire.errors.RefusedError, match="another call stopped, moved or released"):
                    await parking
            assert virtual.joints().is_holding
            assert virtual.joints().joints_deg[0] < 60

    asyncio.run(run())


def test_plant_of_a_virtual_arm_lets_its_joints_sag() -> None:
    with sim.ling(plant="sag=26") as virtual, armwire.Ling(virtual.port) as arm:
        wait_until(lambda: virtual.joints().ticks[1] == 2022)
        assert arm.read_joints() == virtual.joints()
    with sim.ling(plant="obstacle=2:30deg") as virtual, armwire.Ling(virtual.port) as arm:
        arm.move_deg([0, 60, 0, 0, 0, 0], gripper_permille=500, speed_deg_s=400, gripper_ticks_s=5500)
        wait_until(lambda: virtual.joints().ticks[1] == 2389)
        virtual.remove_obstacle()
        wait_until(lambda: virtual.joints().ticks[1] == 2731)


@pytest.mark.parametrize("plant", ["", "gremlins=1", "sag=201", "sag=1,sag=2", "overshoot=5%"])
def test_wrong_plant_is_a_value_error(plant: str) -> None:
    with pytest.raises(ValueError, match=r"expected|twice|needs"):
        sim.ling(plant=plant)
