"""The same classes for asyncio.

    async with await armwire.aio.Ling.open("/dev/ttyACM0") as arm:
        print(await arm.read_joints_deg())

Each object has its own thread, which makes its calls in order. A cancelled call that has begun is completed there: the
arm never receives half a request, and the next call waits for its end.
"""

from __future__ import annotations

import asyncio
import functools
import time
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, TypeVar

from . import _adapter, _alpha1, _armwire, _ling, _xarm
from ._open import Open
from .errors import ClosedError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Coroutine
    from types import TracebackType

    from numpy.typing import ArrayLike
    from typing_extensions import Self

__all__ = ["Adapter", "Alpha1", "Ling", "XArm"]

P = ParamSpec("P")
T = TypeVar("T")
Blocking = TypeVar("Blocking", bound=Open)


class _Async(Generic[Blocking]):
    """An object with its own thread for blocking calls."""

    def __init__(self, blocking: Blocking, thread: ThreadPoolExecutor) -> None:
        self._blocking = blocking
        self._thread = thread
        self._is_closed = False

    @property
    def port(self) -> str:
        """The port, as passed to `open`."""
        return self._blocking.port

    async def _run(self, call: Callable[[], T]) -> T:
        if self._is_closed:
            raise ClosedError("the port is closed")
        return await asyncio.get_running_loop().run_in_executor(self._thread, call)

    async def close(self) -> None:
        """Close the port, after the current call ends. Closing it again has no effect."""
        if not self._is_closed:
            self._is_closed = True
            closing = self._thread.submit(self._blocking.close)
            self._thread.shutdown(wait=False)
            await asyncio.wrap_future(closing)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self.close()

    def __repr__(self) -> str:
        return f"aio.{self._blocking!r}"


async def _open(make: Callable[[], Blocking]) -> tuple[Blocking, ThreadPoolExecutor]:
    thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="armwire")
    try:
        return await asyncio.get_running_loop().run_in_executor(thread, make), thread
    except BaseException:
        thread.shutdown(wait=False)
        raise


def _call(
    method: Callable[Concatenate[Blocking, P], T],
) -> Callable[Concatenate[_Async[Blocking], P], Coroutine[Any, Any, T]]:
    """Wrap a blocking method to run in the object's thread."""

    @functools.wraps(method)
    async def call(self: _Async[Blocking], /, *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._run(lambda: method(self._blocking, *args, **kwargs))

    return call


class Ling(_Async[_ling.Ling]):
    """`armwire.Ling` for asyncio."""

    @classmethod
    async def open(cls, port: str, *, baud: int | None = None) -> Self:
        """Open the port; see `armwire.Ling`."""
        return cls(*await _open(lambda: _ling.Ling(port, baud=baud)))

    reader = _call(_ling.Ling.reader)
    read_info = _call(_ling.Ling.read_info)
    read_joints = _call(_ling.Ling.read_joints)
    read_joints_deg = _call(_ling.Ling.read_joints_deg)
    read_joints_rad = _call(_ling.Ling.read_joints_rad)
    read_gripper_permille = _call(_ling.Ling.read_gripper_permille)
    read_temperatures_celsius = _call(_ling.Ling.read_temperatures_celsius)
    read_velocities_deg_s = _call(_ling.Ling.read_velocities_deg_s)
    read_velocities_rad_s = _call(_ling.Ling.read_velocities_rad_s)
    read_stroke_mm = _call(_ling.Ling.read_stroke_mm)
    self_check = _call(_ling.Ling.self_check)
    self_check_mask = _call(_ling.Ling.self_check_mask)
    move_deg = _call(_ling.Ling.move_deg)
    move_rad = _call(_ling.Ling.move_rad)
    stop = _call(_ling.Ling.stop)
    save_park_pose = _call(_ling.Ling.save_park_pose)
    read_park_pose_deg = _call(_ling.Ling.read_park_pose_deg)
    set_stroke_mm = _call(_ling.Ling.set_stroke_mm)
    set_temperature_limit_celsius = _call(_ling.Ling.set_temperature_limit_celsius)
    read_mode = _call(_ling.Ling.read_mode)
    read_force_feedback = _call(_ling.Ling.read_force_feedback)
    set_force_feedback = _call(_ling.Ling.set_force_feedback)
    line_errors = _call(_ling.Ling.line_errors)

    async def set_mode(self, mode: _ling.ControlMode) -> _ling.ModeState:
        """Set the control mode as `armwire.Ling.set_mode`, and take turns with other calls.

        A cancelled call that has begun sets the mode, and does not read it back.
        """
        step = functools.partial(self._blocking._port.read_mode_change, _ling.mode_switching(mode))
        while (read := await self._run(step)) is None:
            await asyncio.sleep(_ling.PERIOD_S)
        return self._blocking._mode(read)

    async def wait_until_at_deg(
        self, joints: ArrayLike, *, within_deg: float = 5.7, timeout_s: float = 30.0
    ) -> _ling.JointState:
        """Wait as `armwire.Ling.wait_until_at_deg`, and take turns with other calls.

        A cancelled wait ends at once, and the arm moves on: `stop` ends its motion.
        """
        return await self._wait(lambda: self._blocking._begin_wait_deg(joints, within_deg, timeout_s))

    async def wait_until_at_rad(
        self, joints: ArrayLike, *, within_rad: float = 0.1, timeout_s: float = 30.0
    ) -> _ling.JointState:
        """Wait for angles in radians. See `wait_until_at_deg`."""
        return await self._wait(lambda: self._blocking._begin_wait_rad(joints, within_rad, timeout_s))

    async def park(
        self, *, joints_deg: ArrayLike | None = None, within_deg: float = 5.7, timeout_s: float = 60.0
    ) -> _ling.JointState:
        """Park as `armwire.Ling.park`, and take turns with other calls.

        A cancelled parking ends at once, with the torque on, and the arm moves on: `stop` ends its motion.
        """
        parking = await self._run(lambda: self._blocking._begin_parking(joints_deg, within_deg, timeout_s))
        step = functools.partial(self._blocking._port.read_parking, parking)
        while (read := await self._run(step)) is None:
            await asyncio.sleep(_ling.PERIOD_S)
        return _ling.switched(*read)

    async def set_torque(self, on: bool) -> _ling.JointState:
        """Switch the torque as `armwire.Ling.set_torque`, and take turns with other calls.

        A cancelled call that has begun switches the torque, and does not read it back.
        """
        return await self._read_back(_armwire.LingSwitching.torque(on))

    async def set_zero(self) -> _ling.JointState:
        """Make the current pose the zero position as `armwire.Ling.set_zero`. See `set_torque`."""
        return await self._read_back(_armwire.LingSwitching.zero())

    async def _wait(self, begin: Callable[[], _armwire.LingWait]) -> _ling.JointState:
        read = functools.partial(self._blocking._read_wait, await self._run(begin))
        while (state := await self._run(read)) is None:
            await asyncio.sleep(_ling.PERIOD_S)
        return state

    async def _read_back(self, switching: _armwire.LingSwitching) -> _ling.JointState:
        step = functools.partial(self._blocking._port.read_back, switching)
        while (read := await self._run(step)) is None:
            await asyncio.sleep(_ling.PERIOD_S)
        return _ling.switched(*read)


class XArm(_Async[_xarm.XArm]):
    """`armwire.XArm` for asyncio."""

    @classmethod
    async def open(cls, host: str, *, supervised: bool = False) -> Self:
        """Connect to the host; see `armwire.XArm`."""
        return cls(*await _open(lambda: _xarm.XArm(host, supervised=supervised)))

    reader = _call(_xarm.XArm.reader)
    read_version = _call(_xarm.XArm.read_version)
    read_serials = _call(_xarm.XArm.read_serials)
    read_torque_source = _call(_xarm.XArm.read_torque_source)
    read_rotation_radius_mm = _call(_xarm.XArm.read_rotation_radius_mm)
    read_joints_rad = _call(_xarm.XArm.read_joints_rad)
    read_joints_deg = _call(_xarm.XArm.read_joints_deg)
    reload_dynamics = _call(_xarm.XArm.reload_dynamics)
    shut_down = _call(_xarm.XArm.shut_down)
    reboot = _call(_xarm.XArm.reboot)
    heartbeat = _call(_xarm.XArm.heartbeat)
    raw = _call(_xarm.XArm.raw)


class Alpha1(_Async[_alpha1.Alpha1]):
    """`armwire.Alpha1` for asyncio."""

    @classmethod
    async def open(cls, port: str, *, baud: int | None = None) -> Self:
        """Open the port; see `armwire.Alpha1`."""
        return cls(*await _open(lambda: _alpha1.Alpha1(port, baud=baud)))

    read_hardware_version = _call(_alpha1.Alpha1.read_hardware_version)
    read_firmware_version = _call(_alpha1.Alpha1.read_firmware_version)
    read_running_servos = _call(_alpha1.Alpha1.read_running_servos)
    act = _call(_alpha1.Alpha1.act)
    play = _call(_alpha1.Alpha1.play)
    stop = _call(_alpha1.Alpha1.stop)
    set_offset_tool = _call(_alpha1.Alpha1.set_offset_tool)
    set_usb_type = _call(_alpha1.Alpha1.set_usb_type)
    move_servo = _call(_alpha1.Alpha1.move_servo)
    release_servo = _call(_alpha1.Alpha1.release_servo)
    set_servo_led = _call(_alpha1.Alpha1.set_servo_led)
    read_servo_angles_deg = _call(_alpha1.Alpha1.read_servo_angles_deg)
    change_servo_id = _call(_alpha1.Alpha1.change_servo_id)
    set_servo_offset_thirds_deg = _call(_alpha1.Alpha1.set_servo_offset_thirds_deg)
    read_servo_offset_thirds_deg = _call(_alpha1.Alpha1.read_servo_offset_thirds_deg)
    read_servo_version = _call(_alpha1.Alpha1.read_servo_version)


class Adapter(_Async[_adapter.Adapter]):
    """`armwire.Adapter` for asyncio."""

    @classmethod
    async def open(cls, port: str) -> Self:
        """Open the control port; see `armwire.Adapter`."""
        return cls(*await _open(lambda: _adapter.Adapter(port)))

    identify = _call(_adapter.Adapter.identify)
    is_in_recovery = _call(_adapter.Adapter.is_in_recovery)
    read_config = _call(_adapter.Adapter.read_config)
    set_config = _call(_adapter.Adapter.set_config)
    save_config = _call(_adapter.Adapter.save_config)
    reset_config = _call(_adapter.Adapter.reset_config)
    read_counters = _call(_adapter.Adapter.read_counters)
    read_latencies = _call(_adapter.Adapter.read_latencies)
    stop = _call(_adapter.Adapter.stop)
    end_stream = _call(_adapter.Adapter.end_stream)
    restart = _call(_adapter.Adapter.restart)
    record_joints = _call(_adapter.Adapter.record_joints)

    async def telemetry(
        self, *, duration_s: float | None = None, events: bool = False
    ) -> AsyncIterator[_adapter.Telemetry]:
        """Iterate over the arm's frames; see `armwire.Adapter.telemetry`."""
        until = None if duration_s is None else time.monotonic() + duration_s
        await self._run(lambda: self._blocking._subscribe(events))
        try:
            # Calls in the object's thread are short, so that a cancelled iteration ends soon even on a silent line.
            while (left := _adapter.READ_TIMEOUT_S if until is None else until - time.monotonic()) > 0:
                wait = min(left, _adapter.READ_TIMEOUT_S)
                if (received := await self._run(functools.partial(self._blocking._receive, wait))) is not None:
                    yield received
        finally:
            if not self._is_closed:
                await self._run(self._blocking._unsubscribe)
