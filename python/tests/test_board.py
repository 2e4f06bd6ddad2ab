"""Tests through the shipped firmware image on a virtual board, over each of its ports."""

import asyncio
import os
import time
from pathlib import Path

import numpy as np
import pytest

import armwire
from armwire import aio, errors


@pytest.mark.parametrize("port", ["arm", "slcan:bus"])
def test_every_call_passes_the_adapter(board: Path, port: str) -> None:
    kind, _, name = port.rpartition(":")
    with armwire.Ling(f"{kind}:{board / name}" if kind else str(board / name)) as arm:
        assert arm.read_info().serial == "ADFS251205123456"
        arm.set_torque(True)
        target = [10, -20, 30, 0, 45, -90] if port == "arm" else [0, 0, 0, 0, 0, 0]
        arm.move_deg(target, gripper_permille=500, speed_deg_s=200)
        state = arm.wait_until_at_deg(target, timeout_s=10)
        np.testing.assert_allclose(state.joints_deg, target, atol=1.5)
        assert arm.read_temperatures_celsius().shape == (10,)
        assert arm.read_velocities_deg_s().shape == (10,)
        arm.set_stroke_mm(100)
        assert arm.read_stroke_mm() == 100
        assert arm.self_check() == ()
        arm.set_temperature_limit_celsius(85)
        arm.set_zero()
        # Without torque a loaded joint sinks.
        assert np.abs(arm.read_joints_deg()).max() < 1.5
        assert arm.line_errors() == armwire.LineErrors(0, 0)


def test_adapter_is_identified(board: Path) -> None:
    with armwire.Adapter(f"control:{board / 'control'}") as adapter:
        identity = adapter.identify()
        assert identity.board == os.environ.get("ARMWIRE_BOARD_NAME", "stm32f405")
        assert identity.can
        config = adapter.read_config()
        assert config["arm"] == "ling"
        counters = adapter.read_counters()
        assert all(isinstance(count, int) for count in counters.values())
        assert set(adapter.read_latencies()) == {"answer", "turn", "poll"}
        assert not adapter.is_in_recovery()
        adapter.end_stream()


def test_adapter_is_configured_and_refuses(board: Path) -> None:
    with armwire.Adapter(f"control:{board / 'control'}") as adapter:
        adapter.set_config({"poll": 100, "can.telemetry-hz": 10, "can.commands": False})
        assert adapter.read_config()["poll"] == 100
        with pytest.raises(ValueError, match="there is no setting 'pole'"):
            adapter.set_config({"pole": 1})
        with pytest.raises(ValueError, match="'x' is not off, fastest"):
            adapter.set_config({"poll": "x"})
        with pytest.raises(errors.RefusedError, match="rejected"):
            adapter.set_config({"poll": 2000})
        adapter.save_config()
        adapter.reset_config()
        assert adapter.read_config()["poll"] == "off"


def test_adapter_stops_an_arm_that_a_program_moves(board: Path) -> None:
    with armwire.Adapter(f"control:{board / 'control'}") as adapter, armwire.Ling(str(board / "arm")) as arm:
        arm.set_torque(True)
        begun = arm.read_joints()
        arm.move_deg([170] * 6, gripper_permille=0, speed_deg_s=10)
        with pytest.raises(TimeoutError):
            arm.wait_until_at_deg([170] * 6, timeout_s=0.3)
        adapter.stop()
        refused = adapter.read_counters()["refused_stopped"]
        arm.move_deg([-170] * 6, gripper_permille=0, speed_deg_s=10)
        # The arm rests where it was stopped: the move did not reach it.
        stopped = arm.stop()
        assert stopped.is_holding is True
        assert begun.ticks[0] < stopped.ticks[0] < 3900
        assert adapter.read_counters()["refused_stopped"] > refused


REFUSED = r"motion is refused for [0-2]\.\d s more: stopped by a host on USB"


def move_once_permitted(arm: armwire.Ling, joints: list[float]) -> None:
    """Start a slow move, after the end of a refusal."""
    while True:
        try:
            return arm.move_deg(joints, gripper_permille=0, speed_deg_s=5)
        except errors.RefusedError:
            time.sleep(0.1)


def test_refused_motion_names_the_stop(board: Path) -> None:
    with armwire.Adapter(f"control:{board / 'control'}") as adapter, armwire.Ling(f"slcan:{board / 'bus'}") as arm:
        arm.set_torque(True)
        begun = arm.read_joints()
        adapter.stop()
        with pytest.raises(errors.RefusedError, match=REFUSED):
            arm.move_deg([170] * 6, gripper_permille=0, speed_deg_s=200)
        assert arm.read_joints().ticks == pytest.approx(begun.ticks, abs=16)
        move_once_permitted(arm, [170.0] * 6)
        adapter.stop()
        with pytest.raises(errors.RefusedError, match=REFUSED):
            arm.wait_until_at_deg([170] * 6)
        # The hold is refused, too, and the arm rests.
        assert arm.stop().is_holding is True


def test_refused_motion_names_the_stop_by_asyncio(board: Path) -> None:
    async def run() -> None:
        async with (
            await aio.Adapter.open(f"control:{board / 'control'}") as adapter,
            await aio.Ling.open(f"slcan:{board / 'bus'}") as arm,
        ):
            await arm.set_torque(True)
            await adapter.stop()
            with pytest.raises(errors.RefusedError, match=REFUSED):
                await arm.move_deg([170] * 6, gripper_permille=0, speed_deg_s=200)

    asyncio.run(run())


def test_adapter_without_a_stop_for_its_arm_says_so(board: Path) -> None:
    with armwire.Adapter(f"control:{board / 'control'}") as adapter:
        adapter.set_config({"arm": "raw"})
        with pytest.raises(errors.NotStoppedError, match="cannot stop an arm of kind 'raw'"):
            adapter.stop()
        adapter.reset_config()


def test_telemetry_has_the_adapters_stamps(board: Path) -> None:
    with armwire.Adapter(f"control:{board / 'control'}") as adapter:
        adapter.set_config({"poll": 100})
        seen = []
        for telemetry in adapter.telemetry():
            seen.append(telemetry)
            if len(seen) == 50:
                break
        adapter.set_config({"poll": "off"})
    assert all(each.initiator == "poll" and each.joints is not None for each in seen)
    periods = np.diff([each.stamp_us for each in seen])
    # The poll is regular by the adapter's clock, independent of this computer's load.
    np.testing.assert_allclose(periods, 10_000, atol=20)


def test_recording_has_arrays_while_a_program_moves(board: Path) -> None:
    with armwire.Adapter(f"control:{board / 'control'}") as adapter, armwire.Ling(str(board / "arm")) as arm:
        adapter.set_config({"poll": 100})
        arm.set_torque(True)
        arm.move_deg([20] * 6, gripper_permille=0, speed_deg_s=50)
        recording = adapter.record_joints(1.0)
        adapter.set_config({"poll": "off"})
    count = len(recording.stamp_us)
    assert count > 30
    assert recording.joints_deg.shape == recording.joints_rad.shape == (count, 6)
    assert recording.gripper_permille.shape == recording.status.shape == (count,)
    # Up to the noise of a reading.
    assert (np.diff(recording.joints_deg[:, 0]) > -0.2).all()
    assert recording.time_s[-1] > 0.3


def test_telemetry_by_asyncio(board: Path) -> None:
    async def run() -> list[armwire.Telemetry]:
        async with await aio.Adapter.open(f"control:{board / 'control'}") as adapter:
            await adapter.set_config({"poll": 100})
            received = [each async for each in adapter.telemetry(duration_s=0.5)]
            await adapter.set_config({"poll": "off"})
            return received

    begun = time.monotonic()
    received = asyncio.run(run())
    assert len(received) > 10
    assert time.monotonic() - begun < 5


def test_silent_telemetry_can_be_cancelled(board: Path) -> None:
    async def iterate(adapter: aio.Adapter) -> None:
        async for _ in adapter.telemetry():
            pass

    async def run() -> None:
        async with await aio.Adapter.open(f"control:{board / 'control'}") as adapter:
            await adapter.set_config({"poll": "off"})
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(iterate(adapter), 1)
            await adapter.read_counters()

    asyncio.run(run())


def test_telemetry_has_one_iteration_at_a_time(board: Path) -> None:
    with armwire.Adapter(f"control:{board / 'control'}") as adapter:
        adapter.set_config({"poll": 200})
        for _ in adapter.telemetry(duration_s=5):
            with pytest.raises(RuntimeError, match="another iteration"):
                adapter.record_joints(duration_s=0.1)
            break
        adapter.set_config({"poll": "off"})


def test_control_port_is_asked_for_not_guessed(board: Path) -> None:
    reason = "the system does not show which adapter has this port: its control port must be named, such as "
    with pytest.raises(errors.PortError, match=reason):
        armwire.Adapter(str(board / "arm"))
