import asyncio
import inspect
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from scripted import ScriptedArm

import armwire
from armwire import aio, errors, sim


def test_arm_moves_while_another_task_runs() -> None:
    async def run() -> int:
        turns = 0

        async def turn() -> None:
            nonlocal turns
            while True:
                await asyncio.sleep(0.001)
                turns += 1

        with sim.ling(plant="ideal") as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                task = asyncio.create_task(turn())
                await arm.move_deg([10] * 6, gripper_permille=0, speed_deg_s=100)
                state = await arm.wait_until_at_deg([10] * 6, timeout_s=5)
                task.cancel()
                assert state.ticks[0] - 2162 in range(-3, 4)
        return turns

    assert asyncio.run(run()) > 20


def test_calls_of_many_tasks_are_serialised() -> None:
    async def run() -> None:
        with sim.ling(plant="ideal") as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                states = await asyncio.gather(*(arm.read_joints() for _ in range(50)))
                assert {state.ticks for state in states} == {(2048,) * 6}

    asyncio.run(run())


def test_cancelled_call_leaves_the_arm_usable() -> None:
    async def run() -> None:
        with sim.ling(plant="ideal", turnaround_us=50_000) as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                for _ in range(3):
                    with pytest.raises(asyncio.TimeoutError):
                        await asyncio.wait_for(arm.read_stroke_mm(), 0.01)
                    assert (await arm.read_info()).kind == "follower"

    asyncio.run(run())


def test_calls_take_their_turn_during_a_wait() -> None:
    async def run() -> None:
        with sim.ling(plant="ideal") as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                await arm.move_deg([90] * 6, gripper_permille=0, speed_deg_s=5)
                wait = asyncio.create_task(arm.wait_until_at_deg([90] * 6, timeout_s=10))
                await asyncio.sleep(0)
                await arm.read_stroke_mm()
                assert not wait.done()
                wait.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await wait
                # The end of the wait is not the end of the motion.
                assert (await arm.read_velocities_deg_s()).max() > 0

    asyncio.run(run())


def test_calls_take_their_turn_while_the_torque_is_read_back() -> None:
    async def run() -> None:
        # Its torque stays on.
        with ScriptedArm(lambda _: 2048) as scripted:
            async with await aio.Ling.open(scripted.port) as arm:
                switch = asyncio.create_task(arm.set_torque(False))
                await asyncio.sleep(0)
                await arm.read_joints()
                assert not switch.done()
                with pytest.raises(errors.RefusedError):
                    await switch

    asyncio.run(run())


@pytest.mark.parametrize("timeout_s", [float("nan"), float("inf"), -0.1])
def test_wait_refuses_an_unusable_timeout(timeout_s: float) -> None:
    async def run() -> None:
        with sim.ling(plant="ideal") as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                with pytest.raises(ValueError, match="must be 0 or more, and finite"):
                    await arm.wait_until_at_deg([0] * 6, timeout_s=timeout_s)
                assert virtual.requests() == 0

    asyncio.run(run())


def test_port_that_does_not_open_raises() -> None:
    with pytest.raises(errors.PortError):
        asyncio.run(aio.Ling.open("/dev/no-such-port"))


def test_other_arms_answer() -> None:
    async def run() -> None:
        with sim.xarm() as virtual, sim.alpha1() as robot:
            async with await aio.XArm.open(virtual.port) as xarm, await aio.Alpha1.open(robot.port) as alpha1:
                version, firmware = await asyncio.gather(xarm.read_version(), alpha1.read_firmware_version())
                assert (version.value.axes, firmware) == (6, "2015121519")

    asyncio.run(run())


def methods(blocking: type) -> list[str]:
    return [name for name, _ in inspect.getmembers(blocking, inspect.isfunction) if not name.startswith("_")]


def parameters(method: Callable[..., Any]) -> list[tuple[str, Any, Any]]:
    # Annotations are texts in one of the modules.
    return [(each.name, each.kind, each.default) for each in inspect.signature(method).parameters.values()]


@pytest.mark.parametrize("name", aio.__all__)
def test_every_method_has_its_awaited_variant(name: str) -> None:
    blocking, variant = getattr(armwire, name), getattr(aio, name)
    for method in methods(blocking):
        ours, theirs = getattr(blocking, method), getattr(variant, method)
        if inspect.isgeneratorfunction(ours):
            assert inspect.isasyncgenfunction(theirs), method
        else:
            assert inspect.iscoroutinefunction(theirs), method
        # A variant may wrap another method with the same parameters.
        assert theirs.__name__ == method
        assert parameters(ours) == parameters(theirs), method


# The arguments of every method, ordered so that no call changes the result of a later one.
LING: dict[str, tuple[Any, ...]] = {
    "read_info": (),
    "read_joints": (),
    "read_joints_deg": (),
    "read_joints_rad": (),
    "read_gripper_permille": (),
    "read_temperatures_celsius": (),
    "read_velocities_deg_s": (),
    "read_velocities_rad_s": (),
    "read_stroke_mm": (),
    "self_check": (),
    "self_check_mask": (),
    "line_errors": (),
    "wait_until_at_deg": ([0] * 6,),
    "wait_until_at_rad": ([0] * 6,),
    "move_deg": ([0] * 6,),
    "move_rad": ([0] * 6,),
    "set_stroke_mm": (50,),
    "set_temperature_limit_celsius": (60,),
    "set_torque": (True,),
    "stop": (),
    # It ends without torque.
    "park": (),
    "save_park_pose": (),
    "read_park_pose_deg": (),
    "set_zero": (),
}
# A force-feedback leader's, which starts without torque.
LEADER: dict[str, tuple[Any, ...]] = {
    "read_mode": (),
    "set_mode": (armwire.ControlMode.CURRENT,),
    "set_force_feedback": (True,),
    "read_force_feedback": (),
}
KEYWORDS: dict[str, dict[str, Any]] = {
    "park": {"joints_deg": [0] * 6},
    "move_deg": {"gripper_permille": 0, "speed_deg_s": 10},
    "move_rad": {"gripper_permille": 0, "speed_rad_s": 0.2},
    "act": {"time_s": 0.1, "interval_s": 0.1},
    "move_servo": {"time_s": 0.1, "lock_s": 0.1},
}
XARM: dict[str, tuple[Any, ...]] = {
    "read_version": (),
    "read_serials": (),
    "read_torque_source": (),
    "read_rotation_radius_mm": (6,),
    "read_joints_rad": (),
    "read_joints_deg": (),
    "heartbeat": (),
    "raw": (42,),
    "reload_dynamics": (),
    "reboot": (),
}
# Either ends the connection.
XARM_OFF: dict[str, tuple[Any, ...]] = {"shut_down": ()}
ALPHA1: dict[str, tuple[Any, ...]] = {
    "read_hardware_version": (),
    "read_firmware_version": (),
    "read_running_servos": (),
    "act": (dict.fromkeys(range(1, 17), 90),),
    "play": ("wave",),
    "stop": (),
    "set_offset_tool": (True,),
    "set_usb_type": ("serial",),
}
SERVOS: dict[str, tuple[Any, ...]] = {
    "read_servo_angles_deg": (1,),
    "read_servo_offset_thirds_deg": (1,),
    "read_servo_version": (1,),
    "set_servo_offset_thirds_deg": (1, 3),
    "set_servo_led": (1, 0),
    "move_servo": (1, 90),
    "release_servo": (1,),
    "change_servo_id": (1, 2),
}


@pytest.mark.parametrize(
    ("make", "name", "calls"),
    [
        (partial(sim.ling, plant="ideal"), "Ling", LING),
        (partial(sim.ling, force_feedback="apply=0ms"), "Ling", LEADER),
        (sim.xarm, "XArm", XARM),
        (sim.xarm, "XArm", XARM_OFF),
        (sim.alpha1, "Alpha1", ALPHA1),
        (sim.alpha1_servos, "Alpha1", SERVOS),
    ],
)
def test_variant_returns_the_same(
    make: Callable[[], Any],
    name: str,
    calls: dict[str, tuple[Any, ...]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    with make() as virtual, getattr(armwire, name)(virtual.port) as arm:
        expected = [
            (method, repr(getattr(arm, method)(*args, **KEYWORDS.get(method, {})))) for method, args in calls.items()
        ]

    async def run() -> list[tuple[str, str]]:
        with make() as virtual:
            async with await getattr(aio, name).open(virtual.port) as arm:
                return [
                    (method, repr(await getattr(arm, method)(*args, **KEYWORDS.get(method, {}))))
                    for method, args in calls.items()
                ]

    assert asyncio.run(run()) == expected


def test_every_arms_variant_is_called() -> None:
    called = {"Ling": {*LING, *LEADER}, "XArm": {*XARM, *XARM_OFF}, "Alpha1": {*ALPHA1, *SERVOS}}
    for name, calls in called.items():
        # A reader has its own test: its name is that of a port.
        assert calls == {*methods(getattr(armwire, name))} - {"close", "reader"}


def test_late_arm_does_not_block_the_loop() -> None:
    async def run() -> float:
        with sim.ling(plant="ideal", turnaround_us=400_000) as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                call = asyncio.create_task(arm.read_joints())
                worst, last = 0.0, time.monotonic()
                while not call.done():
                    await asyncio.sleep(0.005)
                    worst, last = max(worst, time.monotonic() - last), time.monotonic()
                with pytest.raises(errors.NoAnswerError):
                    call.result()
                return worst

    assert asyncio.run(run()) < 0.2


def test_closed_port_raises_an_error(virtual: sim.VirtualLing) -> None:
    async def run() -> None:
        async with await aio.Ling.open(virtual.port) as arm:
            await arm.close()
            with pytest.raises(armwire.errors.ClosedError):
                await arm.read_joints()

    asyncio.run(run())
