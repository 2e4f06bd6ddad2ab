import asyncio
import inspect
import time

import pytest

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

        with sim.ling() as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                task = asyncio.create_task(turn())
                await arm.move_deg([10] * 6, gripper_permille=0, speed_deg_s=100)
                state = await arm.wait_until_at_deg([10] * 6, timeout_s=5)
                task.cancel()
                assert state.ticks[0] - 2162 in range(-3, 4)
        return turns

    assert asyncio.run(run()) > 20


def test_calls_of_many_tasks_take_turns() -> None:
    async def run() -> None:
        with sim.ling() as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                states = await asyncio.gather(*(arm.read_joints() for _ in range(50)))
                assert {state.ticks for state in states} == {(2048,) * 6}

    asyncio.run(run())


def test_cancelled_call_leaves_the_arm_usable() -> None:
    async def run() -> None:
        with sim.ling(turnaround_us=50_000) as virtual:
            async with await aio.Ling.open(virtual.port) as arm:
                for _ in range(3):
                    with pytest.raises(asyncio.TimeoutError):
                        await asyncio.wait_for(arm.read_stroke_mm(), 0.01)
                    assert (await arm.read_info()).kind == "follower"

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


@pytest.mark.parametrize("name", aio.__all__)
def test_every_method_has_its_variant(name: str) -> None:
    blocking, variant = getattr(armwire, name), getattr(aio, name)
    for method, _ in inspect.getmembers(blocking, inspect.isfunction):
        if not method.startswith("_"):
            assert hasattr(variant, method), method


def test_late_arm_does_not_block_the_loop() -> None:
    async def run() -> float:
        with sim.ling(turnaround_us=400_000) as virtual:
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


def test_closed_port_says_so(virtual: sim.VirtualLing) -> None:
    async def run() -> None:
        async with await aio.Ling.open(virtual.port) as arm:
            await arm.close()
            with pytest.raises(armwire.errors.ClosedError):
                await arm.read_joints()

    asyncio.run(run())
