"""The newest pose of virtual arms."""

import asyncio
import itertools
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from conftest import served
from scripted import ScriptedArm

import armwire
from armwire import aio, errors, sim


def following(reader: armwire.Reader[armwire.JointState], count: int) -> list[armwire.Reading[armwire.JointState]]:
    """The first readings, this many."""
    readings: list[armwire.Reading[armwire.JointState]] = []
    while len(readings) < count:
        reading = reader.next_after(readings[-1].number if readings else 0, timeout_s=10)
        assert reading is not None
        readings.append(reading)
    return readings


def follow_to_the_end(reader: armwire.Reader[armwire.JointState]) -> None:
    """Wait for readings until there are none."""
    while True:
        reader.next_after(reader.counts().samples)


def test_readings_come_once_in_the_order_of_time(arm: armwire.Ling) -> None:
    with arm.reader(200) as reader:
        readings = following(reader, 10)
    assert [reading.number for reading in readings] == list(range(1, 11))
    assert all(first.monotonic_ns < second.monotonic_ns for first, second in itertools.pairwise(readings))
    assert {reading.pose.ticks for reading in readings} == {(2048,) * 6}
    assert {reading.stamped_by for reading in readings} == {"receipt"}


def test_time_is_that_of_this_computer(arm: armwire.Ling) -> None:
    with arm.reader(100) as reader:
        before = time.monotonic_ns(), time.time_ns()
        reading = reader.next_after(reader.counts().samples)
        after = time.monotonic_ns(), time.time_ns()
    assert reading is not None
    assert before[0] <= reading.monotonic_ns <= after[0]
    assert before[1] <= reading.unix_ns <= after[1]
    assert 0 <= reading.age_s <= (after[0] - before[0]) / 1e9


def test_pose_at_a_time_is_linear() -> None:
    # Each reading is 10 ticks farther.
    with (
        ScriptedArm(lambda reading: 1000 + 10 * reading) as scripted,
        armwire.Ling(scripted.port) as arm,
        arm.reader(100) as reader,
    ):
        first, second = following(reader, 2)
        assert second.pose.ticks[0] == first.pose.ticks[0] + 10
        span = second.monotonic_ns - first.monotonic_ns
        assert reader.at(first.monotonic_ns + span // 2).pose.ticks[0] == first.pose.ticks[0] + 5
        for outside in (first.monotonic_ns - 1, time.monotonic_ns() + 10**12):
            with pytest.raises(errors.NoPoseError):
                reader.at(outside)


def test_commands_go_between_readings(arm: armwire.Ling) -> None:
    with arm.reader(200) as reader:
        assert arm.read_info().kind == "follower"
        arm.move_deg([10] * 6, gripper_permille=0, speed_deg_s=400)
        arm.wait_until_at_deg([10] * 6)
        newest = reader.next_after(reader.counts().samples)
    assert newest is not None
    assert newest.pose.joints_deg[0] == pytest.approx(10, abs=0.3)


def test_stale_pose_is_an_error(virtual: sim.VirtualLing, arm: armwire.Ling) -> None:
    with arm.reader(200) as reader:
        assert reader.next_after(0) is not None
        virtual.set_faults(sim.Faults(drop=1_000_000))
        while reader.next_after(reader.counts().samples, timeout_s=0.2) is not None:
            pass
        with pytest.raises(errors.NoPoseError, match="ms old, and the limit is 100"):
            reader.latest()
        assert reader.latest(max_age_s=1000).pose.ticks == (2048,) * 6
        assert reader.counts().lost > 0


def test_lost_port_is_an_error_at_once(virtual: sim.VirtualLing, arm: armwire.Ling) -> None:
    with arm.reader(200) as reader:
        assert reader.next_after(0) is not None
        virtual.close()
        with pytest.raises(errors.PortLostError, match="was it unplugged"):
            follow_to_the_end(reader)
        with pytest.raises(errors.PortLostError):
            reader.latest()


def test_reader_goes_on_when_the_same_arm_is_back(tmp_path: Path) -> None:
    port = tmp_path / "arm"
    with served(port):
        arm = armwire.Ling(str(port))
        reader = arm.reader(200)
        assert reader.next_after(0) is not None
    with arm, reader:
        with pytest.raises(errors.PortLostError, match="was it unplugged"):
            follow_to_the_end(reader)
        with pytest.raises(errors.PortLostError):
            arm.stop()

        def loss() -> str:
            with pytest.raises(errors.PortLostError) as lost:
                reader.latest()
            return str(lost.value)

        with served(port, "--serial", "ADFS990000000001"):
            while "another arm is on this port: ADFS990000000001" not in loss():
                time.sleep(0.01)
        with served(port):
            while True:
                with suppress(errors.PortLostError, errors.NoPoseError):
                    reader.latest()
                    break
                time.sleep(0.01)
            arm.move_deg([10] * 6, gripper_permille=0, speed_deg_s=100)
            arm.wait_until_at_deg([10] * 6)


def test_closed_reader_and_arm_raise_errors(virtual: sim.VirtualLing) -> None:
    arm = armwire.Ling(virtual.port)
    with arm.reader(200) as reader, pytest.raises(errors.PortError, match="another reader"):
        arm.reader(100)
    reader.close()
    for call in (reader.latest, lambda: reader.at(0), lambda: reader.next_after(0), reader.counts):
        with pytest.raises(errors.ClosedError):
            call()
    reader = arm.reader(100)
    assert reader.next_after(0) is not None
    arm.close()
    with pytest.raises(errors.ClosedError):
        follow_to_the_end(reader)
    with pytest.raises(errors.ClosedError):
        reader.latest()


def test_reader_is_dropped_while_a_thread_waits_for_motion(arm: armwire.Ling) -> None:
    reader = arm.reader(200)
    assert reader.next_after(0) is not None
    arm.move_deg([20] * 6, gripper_permille=0, speed_deg_s=100)
    waiting = threading.Thread(target=arm.wait_until_at_deg, args=([20] * 6,))
    waiting.start()
    del reader
    waiting.join()


@pytest.mark.parametrize("rate", [0, 1001, -1])
def test_rate_out_of_range_is_an_error(arm: armwire.Ling, rate: int) -> None:
    with pytest.raises(ValueError, match=f"rate in Hz is {rate}, must be 1 to 1000"):
        arm.reader(rate)


def test_number_and_time_out_of_range_are_errors(arm: armwire.Ling) -> None:
    with arm.reader(100) as reader:
        for number in (-1, 2**64):
            with pytest.raises(ValueError, match=f"number of a reading is {number}, must be 0 to "):
                reader.next_after(number)
        with pytest.raises(ValueError, match="monotonic time in ns is "):
            reader.at(2**63)


def test_xarm_has_a_reader() -> None:
    with sim.xarm() as virtual, armwire.XArm(virtual.port) as arm, arm.reader(100) as reader:
        reading = reader.next_after(0)
        assert reading is not None
        assert reading.pose.value.tolist() == arm.read_joints_rad().value.tolist()


def test_newest_pose_needs_no_awaiting(virtual: sim.VirtualLing) -> None:
    async def run() -> int:
        async with await aio.Ling.open(virtual.port) as arm:
            with await arm.reader(100) as reader:
                await arm.read_joints()
                return reader.latest(max_age_s=1000).number

    assert asyncio.run(run()) > 0


def test_readings_have_the_stamps_of_an_adapter(board: Path) -> None:
    bus = f"slcan:{board / 'bus'}"
    with armwire.Ling(bus) as arm, arm.reader(100) as reader:
        readings = following(reader, 20)
    assert {reading.stamped_by for reading in readings} == {"adapter"}
    # The periods of the adapter's polls, by its clock.
    periods = [(second.monotonic_ns - first.monotonic_ns) / 1e6 for first, second in itertools.pairwise(readings)]
    assert sorted(periods)[len(periods) // 2] == pytest.approx(10, abs=1)
