"""A Ling arm (Alicia-D): follower or leader."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _armwire
from ._open import Open
from ._reader import Reader
from ._units import (
    DEG_PER_TICK,
    RAD_PER_TICK,
    Floats,
    baud_rate,
    count,
    floats,
    position_ticks,
    rate,
    seconds,
    speed_ticks,
    tolerance_ticks,
)
from .errors import ArmwireError, UnacceptableError

if TYPE_CHECKING:
    from typing import TypeAlias

    # Ticks, gripper, status, and the number of data bytes of another robot.
    Counts: TypeAlias = tuple[tuple[int, ...], int, int, int]
    # Mode, masks of the blocked and the valid joints, and each joint's torque and currents in thousandths.
    Mode: TypeAlias = tuple[int, int, int, tuple[tuple[int, int, int, int], ...]]

MAX_GRIPPER = 1000
# Polling interval of waits.
PERIOD_S = 0.02


class MotionStatus(IntEnum):
    """An arm's motion status. Undocumented values stay plain numbers."""

    IDLE = 0x00
    LOCKED = 0x01
    SYNCING = 0x10
    SYNC_LOCKED = 0x11
    OVERHEATING = 0xE1
    OVERHEAT_PROTECTION = 0xE2


class ControlMode(IntEnum):
    """The control mode of a force-feedback leader. Its torque may be off in both."""

    POSITION = 0
    CURRENT = 1


class Inhibit(IntFlag):
    """The reasons why the force feedback does not act. Undocumented bits are kept."""

    NO_TELEOPERATION = 1
    """The arm is not in teleoperation."""
    STALE = 4
    """The link or the sample is older than 30 ms."""
    FAULT = 8
    """The hardware has a fault."""
    UNSUPPORTED = 16
    """It is not supported."""


_STATUSES = {int(status): status for status in MotionStatus}


@dataclass(frozen=True)
class LingInfo:
    """An arm's identity."""

    serial: str
    kind: Literal["leader", "follower"] | None
    """Leader or follower, by the serial number; `None` for an unknown serial number."""
    hardware: str
    """The hardware version, for example `v1.10`."""
    firmware: str
    """The firmware version, for example `v6.10`, which the vendor's software writes as 6.1.0."""
    extra: bytes = b""
    """Bytes that the arm sent after the documented ones."""


@dataclass(frozen=True)
class JointState:
    """An arm's position and status, in the counts that it sent.

    Counts out of range are kept. The properties raise `UnacceptableError` for them.
    """

    ticks: tuple[int, ...]
    """Positions of joints 1 to 6 in ticks: 4096 per turn, 2048 at zero. The range is 0 to 4095."""
    gripper: int
    """Gripper opening in thousandths. The range is 0 to 1000."""
    status: MotionStatus | int
    """The motion status."""
    extra: bytes = b""
    """Bytes that the arm sent after the documented ones."""
    foreign_data_bytes: int = 0
    """0 for an Alicia-D. Otherwise the number of data bytes in the answer of another robot, which nothing moves or
    holds: 33 is a Bessica-D. The counts, the gripper and the status are other values there."""

    @property
    def joints_deg(self) -> Floats:
        """Angles of joints 1 to 6 in degrees, exact."""
        return floats(_armwire.ling_angles(self.ticks, DEG_PER_TICK))

    @property
    def joints_rad(self) -> Floats:
        """Angles of joints 1 to 6 in radians."""
        return floats(_armwire.ling_angles(self.ticks, RAD_PER_TICK))

    @property
    def gripper_permille(self) -> int:
        """The gripper: 0 is closed, 1000 is open."""
        if self.gripper > MAX_GRIPPER:
            raise UnacceptableError(f"the gripper is at {self.gripper} thousandths, must be 0 to {MAX_GRIPPER}")
        return self.gripper

    @property
    def is_holding(self) -> bool | None:
        """True if the torque is on, false if it is off; `None` if the status, such as overheating, does not show it."""
        if self.foreign_data_bytes:
            return None
        return _armwire.ling_is_holding(self.status)

    @property
    def is_torque_off(self) -> bool:
        """True if the torque is off; false if it is on, and if the status does not show it."""
        return self.is_holding is False

    @property
    def motion_refusal(self) -> str | None:
        """The reason why the arm is not moved; `None` if it may be moved.

        It is not moved without torque, with a status that no document explains, and if it is another robot than an
        Alicia-D.
        """
        return _armwire.ling_motion_refusal(self.status, self.foreign_data_bytes)


@dataclass(frozen=True)
class ModeState:
    """The applied control mode of a force-feedback leader, and the torques and currents of joints 1 to 6."""

    mode: ControlMode
    """The applied mode."""
    blocked: tuple[int, ...]
    """The blocked joints, from 1. Only joints 2 and 3 are documented."""
    valid: tuple[int, ...]
    """The joints, from 1, whose values are valid."""
    residual_torques_nm: tuple[float, ...]
    """The remote residual torques in Nm."""
    requested_currents_a: tuple[float, ...]
    """The requested currents in A."""
    output_currents_a: tuple[float, ...]
    """The output currents in A."""
    measured_currents_a: tuple[float, ...]
    """The measured currents in A."""
    extra: bytes = b""
    """Bytes that the arm sent after the documented ones."""


@dataclass(frozen=True)
class ForceFeedback:
    """The state of the force feedback. Requested is not effective."""

    is_requested: bool
    """It is requested."""
    is_effective: bool
    """It acts on the joints."""
    inhibit: Inhibit
    """The reasons why it does not act."""
    is_sync_active: bool
    """The synchronization with another arm is active."""
    is_torque_enabled: bool
    """The torque is on."""
    is_torque_requested: bool
    """The torque is requested."""
    transition: int
    """Diagnostic: the state of the transition."""
    grip_raw: int
    """Diagnostic: the raw value of the grip."""
    requested_mode: int
    """Diagnostic: the requested mode."""
    extra: bytes = b""
    """Bytes that the arm sent after the documented ones."""


@dataclass(frozen=True)
class LineErrors:
    """Line errors since the port was opened."""

    noise_bytes: int
    """Bytes that were not part of a frame."""
    checksum_errors: int
    """Frames with a wrong checksum."""


def joint_state(counts: Counts, extra: bytes = b"") -> JointState:
    """The state in these counts."""
    ticks, gripper, status, foreign_data_bytes = counts
    named = status if foreign_data_bytes else _STATUSES.get(status, status)
    return JointState(tuple(ticks), gripper, named, extra, foreign_data_bytes)


def mode_state(counts: Mode, extra: bytes) -> ModeState:
    """The mode in these counts."""
    mode, blocked, valid, joints = counts
    torques, requested, output, measured = (
        tuple(value / 1000 for value in values) for values in zip(*joints, strict=True)
    )
    return ModeState(
        ControlMode(mode), _joints_of(blocked), _joints_of(valid), torques, requested, output, measured, extra
    )


def _joints_of(mask: int) -> tuple[int, ...]:
    return tuple(joint for joint in range(1, 9) if mask >> (joint - 1) & 1)


class Ling(Open):
    """A Ling arm (Alicia-D) on a port.

        with armwire.Ling("/dev/ttyACM0") as arm:
            print(arm.read_joints_deg())

    Read    `read_joints`: joints, gripper and status of one instant
            `read_joints_deg`, `read_joints_rad`, `read_gripper_permille`
            `read_velocities_deg_s`, `read_velocities_rad_s`, `read_info`
            `read_temperatures_celsius`, `read_stroke_mm`
            `self_check`, `self_check_mask`, `line_errors`
    Newest  `reader`: a thread reads, and the newest pose is there at once
    Move    `move_deg`, `move_rad`: at once. `wait_until_at_deg`, `wait_until_at_rad`
    Stop    `stop`: not an emergency stop
            `park`: slowly to where the arm lies, then torque off
            `save_park_pose`, `read_park_pose_deg`
    Set     `set_torque`, `set_zero`: the arm falls without torque
            `set_stroke_mm`, `set_temperature_limit_celsius`
    Force   `read_mode`, `set_mode`, `read_force_feedback`, `set_force_feedback`: of a force-feedback leader
    End     `close`, or the end of `with`

    Calls wait for the answer. Reads are retried twice and time out after 0.4 s. Other threads run during a call and may
    use the same object: calls are serialised, and a wait takes turns with them. Ctrl-C ends a call.

    Calls raise the exceptions of `armwire.errors`. A `UserWarning` reports an adapter on USB that has factory settings
    after crashed starts, unless another program has its control port.

    Args:
        port: A serial port such as `/dev/ttyACM0` or `COM3`, or `usb:SERIAL` by its USB serial number;
            `tcp:HOST:PORT`; `can:IFACE/NODE`; `slcan:PORT@BITRATE/NODE`. The `armwire` command accepts the same.
        baud: The serial port's baud rate; 1000000 by default.

    Raises:
        PortError: The port cannot be opened.
        OlderArmError: The arm is of the older generation.
    """

    def __init__(self, port: str, *, baud: int | None = None) -> None:
        self._port = _armwire.LingPort(port, baud_rate(baud))
        self._slowest = _armwire.SLOWEST_TICKS_S
        super().__init__(port, self._port)

    def reader(self, rate_hz: int) -> Reader[JointState]:
        """Read the joints in a thread at this rate, 1 to 1000 per second. See `Reader`.

        Raises:
            ValueError: The rate is out of range.
            PortError: Another reader of this object is open.
        """
        return Reader(self.port, self._port.reader(rate(rate_hz)), joint_state)

    def read_info(self) -> LingInfo:
        """Read serial number and versions."""
        serial, kind, hardware, firmware, extra = self._port.read_info()
        return LingInfo(serial, kind, _version(hardware), _version(firmware), extra)

    def read_joints(self) -> JointState:
        """Read joints, gripper and motion status at once, as raw counts with conversions."""
        return joint_state(*self._port.read_joints())

    def read_joints_deg(self) -> Floats:
        """Read the angles of joints 1 to 6 in degrees."""
        return floats(self._port.read_angles(DEG_PER_TICK))

    def read_joints_rad(self) -> Floats:
        """Read the angles of joints 1 to 6 in radians."""
        return floats(self._port.read_angles(RAD_PER_TICK))

    def read_gripper_permille(self) -> int:
        """Read the gripper: 0 is closed, 1000 is open."""
        return self.read_joints().gripper_permille

    def read_temperatures_celsius(self) -> NDArray[np.int64]:
        """Read the temperature of every servo in °C: 10 values from a follower, 6 from a leader."""
        return np.array(self._port.read_temperatures(), dtype=np.int64)

    def read_velocities_deg_s(self) -> Floats:
        """Read the absolute speed of every servo in degrees per second.

        A follower has 10 servos: joints 1 to 3 have two each.
        """
        return np.array(self._port.read_velocities(), dtype=np.float64) * DEG_PER_TICK

    def read_velocities_rad_s(self) -> Floats:
        """Read the absolute speed of every servo in radians per second."""
        return np.array(self._port.read_velocities(), dtype=np.float64) * RAD_PER_TICK

    def read_stroke_mm(self) -> int:
        """Read the configured stroke of the gripper: 50, 75 or 100 mm."""
        return self._port.read_stroke()

    def self_check(self) -> tuple[int, ...]:
        """Run a self-check of every servo.

        Returns:
            The ids of faulty servos, from 1. A leader has no servos 7 to 10.
        """
        servos = len(self._port.read_temperatures())
        normal = self.self_check_mask()
        return tuple(servo for servo in range(1, servos + 1) if not normal >> (servo - 1) & 1)

    def self_check_mask(self) -> int:
        """Run a self-check of every servo. Bit 0 is servo 1; a 1 is normal. A leader has servos 1 to 6 only."""
        return self._port.self_check()

    def move_deg(
        self,
        joints: ArrayLike,
        *,
        speed_deg_s: ArrayLike,
        gripper_permille: int | None = None,
        gripper_ticks_s: int = 1000,
    ) -> None:
        """Start a move to these angles. The arm moves at once: keep clear of it.

        The arm sends no confirmation. Its torque is read before this object's first move, and before a move after a
        reading that showed it off. A stream of moves costs no readings.

        Args:
            joints: Angles of joints 1 to 6 in degrees, -180 to 179.912.
            speed_deg_s: Degrees per second, 4.395 to 439.453: one number for all joints, or six. An arm may take a
                lower speed for 0. The vendor's software rounds to steps of 4.395; this sends the nearest tick. A
                force-feedback leader that has answered `read_mode` takes 0.088, too.
            gripper_permille: The gripper, 0 closed to 1000 open. It moves in the same request. If omitted, it is the
                last goal that this object has sent since the torque was off. Without one it is the reading, with a
                warning: a grip may loosen.
            gripper_ticks_s: The gripper's speed in ticks per second; the vendor's software sends 5500.

        Raises:
            ValueError: A value is out of range; nothing is sent.
            RefusedError: The torque is off, no document explains the status, it is another robot than an Alicia-D, or
                the adapter refuses motion after a stop; the move is not sent. The adapter is asked unless a program has
                its control port, in a stream of moves once a second.
        """
        ticks = position_ticks(joints, DEG_PER_TICK, "degrees")
        speeds = speed_ticks(speed_deg_s, DEG_PER_TICK, "degrees/s", self._slowest)
        self._move(ticks, speeds, gripper_permille, gripper_ticks_s)

    def move_rad(
        self,
        joints: ArrayLike,
        *,
        speed_rad_s: ArrayLike,
        gripper_permille: int | None = None,
        gripper_ticks_s: int = 1000,
    ) -> None:
        """Start a move to these angles in radians, -3.14159 to 3.14006, at 0.0767 to 7.66990 rad/s. See `move_deg`."""
        ticks = position_ticks(joints, RAD_PER_TICK, "rad")
        speeds = speed_ticks(speed_rad_s, RAD_PER_TICK, "rad/s", self._slowest)
        self._move(ticks, speeds, gripper_permille, gripper_ticks_s)

    def stop(self, *, gripper_permille: int | None = None, hold_reading: bool = False) -> JointState:
        """Stop the arm where it is and keep its torque on. It takes 0.3 s at rest, and 2.5 s at most.

        The arm has no request for this: it gets its own pose as the target of a move, which ends the motion in
        progress. That target is repeated, and never changed. An arm that stands within 3.5° of the last target of this
        object keeps that target, and does not move. At rest, torque-on follows: an adapter then ends the stream of this
        host. An arm without torque is sent nothing. **This is not an emergency stop**: keep a switch in the arm's
        supply. A later move, of another thread or program, moves the arm again.

        Args:
            hold_reading: Hold an arm that stands at its reading, too: one that presses against something gives way. A
                loaded joint sinks then by the angle at which it rests below its target.
            gripper_permille: The gripper's goal, 0 closed to 1000 open. If omitted, it is the last goal that this
                object has sent since the torque was off: a grip stays firm. Without one it is the reading, with a
                warning: a grip may loosen.

        Returns:
            The last reading, of an arm at rest. If its `is_torque_off` is true, the arm is not held.

        Raises:
            ValueError: The gripper's goal is out of range; nothing is sent.
            NotStoppedError: The arm does not come to rest within 2 s, another program or a force moves it, or it does
                not answer: it may still move.
            PortLostError: The port was lost: the arm may still move.
        """
        counts, extra, is_reading = self._port.stop(_gripper(gripper_permille), hold_reading)
        if is_reading:
            _warn_of_grip(self.port, stacklevel=3)
        return joint_state(counts, extra)

    def wait_until_at_deg(self, joints: ArrayLike, *, within_deg: float = 5.7, timeout_s: float = 30.0) -> JointState:
        """Read until the arm is at rest with every joint at these angles.

        A joint does not stop exactly at its target: a servo holds a load by its error. A move of this object that is
        lost is sent once more. Ctrl-C stops the arm if this object has moved it, says so on standard error, and raises
        `KeyboardInterrupt`. A second Ctrl-C ends the stop.

        Args:
            joints: Angles of joints 1 to 6 in degrees, -180 to 179.912.
            within_deg: The tolerance of a joint in degrees, 0.09 to 360.
            timeout_s: The time-out in seconds. An arm is at rest after 0.2 s without motion.

        Returns:
            The state at that time.

        Raises:
            ValueError: An angle, the tolerance or the time-out is out of range; nothing is read.
            RefusedError: After a move of this object the torque went off, or the adapter stopped the arm.
            NotReachedError: The arm did not arrive in time, or is at rest elsewhere after a move of this object there;
                the message names the joints. It is a `TimeoutError`, too. The arm may still move after the time-out.
            AbsentError: The arm that this object has moved did not answer for 2 s. It was stopped then.
            NotStoppedError: It did not answer the stop either: it may still move.
        """
        return self._wait(lambda: self._begin_wait_deg(joints, within_deg, timeout_s))

    def wait_until_at_rad(self, joints: ArrayLike, *, within_rad: float = 0.1, timeout_s: float = 30.0) -> JointState:
        """Read until the arm is at rest with every joint at these angles in radians. See `wait_until_at_deg`."""
        return self._wait(lambda: self._begin_wait_rad(joints, within_rad, timeout_s))

    def park(
        self, *, joints_deg: ArrayLike | None = None, within_deg: float = 5.7, timeout_s: float = 60.0
    ) -> JointState:
        """Move the arm slowly to the pose in which it lies, and switch the torque off once it is at rest there.

        The joints go at 20°/s at most, and arrive together; keep clear of them. The gripper keeps its goal until the
        torque is off. Where the arm does not arrive it is stopped, and its torque stays on. Ctrl-C stops the arm, too,
        says so on standard error, and raises `KeyboardInterrupt`.

        Args:
            joints_deg: Angles of joints 1 to 6 in degrees, -180 to 179.912. If omitted, they are those that
                `save_park_pose` or `armwire park --save` has saved for this arm.
            within_deg: The tolerance of a joint in degrees, 0.09 to 360: it falls by no more without torque.
            timeout_s: The maximum time of the motion in seconds.

        Returns:
            The reading that shows the torque off.

        Raises:
            ValueError: An angle, the tolerance or the time-out is out of range; nothing is sent.
            RefusedError: The torque is off, or no pose is saved: nothing is sent. Another call stopped or moved the
                arm, or the adapter stopped it: the torque stays on.
            NotReachedError: The arm did not arrive. It holds its pose, with its torque on.
            NotStoppedError: It did not arrive, and may still move.
        """
        with self._stopped_by_ctrl_c():
            parking = self._begin_parking(joints_deg, within_deg, timeout_s)
            while (read := self._port.read_parking(parking)) is None:
                time.sleep(PERIOD_S)
        return switched(*read)

    def save_park_pose(self) -> Floats:
        """Save the pose of this arm, which lies without torque, under its serial number, for `park`.

        The file is that of `armwire park --save`. Save it anew after `set_zero`.

        Returns:
            The angles of joints 1 to 6 in degrees.

        Raises:
            RefusedError: The torque is not off, or the arm is not at rest within 5 s.
            PortError: The file cannot be written.
        """
        return floats(_armwire.ling_angles(self._port.save_park_pose(), DEG_PER_TICK))

    def read_park_pose_deg(self) -> Floats:
        """Return the pose that is saved for this arm: the angles of joints 1 to 6 in degrees.

        Raises:
            RefusedError: None is saved.
            PortError: The file cannot be read.
        """
        return floats(_armwire.ling_angles(self._port.read_park_pose(), DEG_PER_TICK))

    def set_torque(self, on: bool) -> JointState:
        """Switch the torque and read it back, half a second at most. With torque off the arm falls: hold it.

        A `UserWarning` reports a status that does not show the torque, such as overheating.

        Returns:
            The reading that shows it. Its `is_holding` is `None` after the warning.

        Raises:
            RefusedError: The status shows that the torque was not switched. Another robot than an Alicia-D is not sent
                torque-on.
        """
        return self._read_back(_armwire.LingSwitching.torque(on))

    def set_zero(self) -> JointState:
        """Make the current pose zero, and read it back. The arm switches its torque off and falls: hold it.

        Returns:
            The reading that shows it.

        Raises:
            RefusedError: The joints are not at zero within half a second. Another robot than an Alicia-D is sent
                nothing.
        """
        return self._read_back(_armwire.LingSwitching.zero())

    def set_stroke_mm(self, stroke: int) -> None:
        """Set the gripper's stroke: 50, 75 or 100 mm."""
        self._port.set_stroke(count("stroke in mm", stroke, 255))

    def set_temperature_limit_celsius(self, limit: int) -> None:
        """Set the overheat protection limit, 0 to 255 °C except 254; the factory default is 85."""
        self._port.set_temperature_limit(count("temperature limit in °C", limit, 255))

    def read_mode(self) -> ModeState:
        """Read the control mode and the currents of a force-feedback leader.

        Raises:
            RefusedError: The arm is none: it answers, but not this request. Later calls send nothing.
        """
        return self._mode(self._port.read_mode())

    def set_mode(self, mode: ControlMode) -> ModeState:
        """Set the control mode of a force-feedback leader, and wait until it is applied, 2 s at most.

        The torque may be off then: after a return to position mode it is. The next move reads it first.

        Returns:
            The reading that shows the mode.

        Raises:
            RefusedError: The arm refuses the mode, or does not apply it; or it is no force-feedback leader, and does
                not get the request.
        """
        switching = mode_switching(mode)
        while (read := self._port.read_mode_change(switching)) is None:
            time.sleep(PERIOD_S)
        return self._mode(read)

    def read_force_feedback(self) -> ForceFeedback:
        """Read the state of the force feedback of a force-feedback leader.

        Raises:
            RefusedError: The arm is none: see `read_mode`.
        """
        return _force_feedback(*self._port.read_force_feedback())

    def set_force_feedback(self, on: bool) -> ForceFeedback:
        """Request the force feedback of a force-feedback leader, or its end. With it the motors push the joints.

        Returns:
            The state, which says whether it is effective.

        Raises:
            RefusedError: The arm is none: see `read_mode`. The adapter refuses motion after a stop.
        """
        return _force_feedback(*self._port.set_force_feedback(on))

    def line_errors(self) -> LineErrors:
        """Return the line errors so far."""
        return LineErrors(*self._port.line_errors())

    def _mode(self, read: tuple[Mode, bytes]) -> ModeState:
        self._slowest = _armwire.SLOWEST_OF_FORCE_FEEDBACK_TICKS_S
        return mode_state(*read)

    def _begin_wait_deg(self, joints: ArrayLike, within: float, timeout_s: float) -> _armwire.LingWait:
        ticks = position_ticks(joints, DEG_PER_TICK, "degrees")
        return self._port.wait(ticks, tolerance_ticks(within, DEG_PER_TICK, "degrees"), seconds(timeout_s))

    def _begin_wait_rad(self, joints: ArrayLike, within: float, timeout_s: float) -> _armwire.LingWait:
        ticks = position_ticks(joints, RAD_PER_TICK, "rad")
        return self._port.wait(ticks, tolerance_ticks(within, RAD_PER_TICK, "rad"), seconds(timeout_s))

    def _begin_parking(self, joints: ArrayLike | None, within: float, timeout_s: float) -> _armwire.LingParking:
        ticks = None if joints is None else position_ticks(joints, DEG_PER_TICK, "degrees")
        return self._port.start_parking(ticks, tolerance_ticks(within, DEG_PER_TICK, "degrees"), seconds(timeout_s))

    def _wait(self, begin: Callable[[], _armwire.LingWait]) -> JointState:
        with self._stopped_by_ctrl_c():
            wait = begin()
            while (state := self._read_wait(wait)) is None:
                time.sleep(PERIOD_S)
        return state

    def _read_back(self, switching: _armwire.LingSwitching) -> JointState:
        while (read := self._port.read_back(switching)) is None:
            time.sleep(PERIOD_S)
        return switched(*read)

    @contextmanager
    def _stopped_by_ctrl_c(self) -> Iterator[None]:
        """Make Ctrl-C stop the motion that this object has begun."""
        try:
            yield
        except KeyboardInterrupt:
            if (text := self._stop_in_words()) is not None:
                print(text, file=sys.stderr)
            raise

    def _stop_in_words(self) -> str | None:
        try:
            if not self._port.has_moved():
                return None
            state = self.stop()
        except ArmwireError as error:
            return str(error)
        return f"{self.port}: {'the arm is without torque' if state.is_torque_off else 'Ctrl-C stopped the arm'}"

    def _read_wait(self, wait: _armwire.LingWait) -> JointState | None:
        """Read the joints once; `None` before the arm is at the target."""
        read = self._port.read_wait(wait)
        return None if read is None else joint_state(*read)

    def _move(self, ticks: list[int], speeds: list[int], gripper: int | None, gripper_speed: int) -> None:
        gripper = _gripper(gripper)
        gripper_speed = count("gripper speed in ticks/s", gripper_speed, 0xFFFF)
        if self._port.move_to(ticks, speeds, gripper, gripper_speed):
            _warn_of_grip(self.port, stacklevel=4)


def mode_switching(mode: ControlMode) -> _armwire.LingModeSwitching:
    """A change to this mode.

    Raises:
        ValueError: There is no such mode.
    """
    return _armwire.LingModeSwitching(ControlMode(mode) == ControlMode.CURRENT)


def _force_feedback(counts: tuple[bool, bool, int, bool, bool, bool, int, int, int], extra: bytes) -> ForceFeedback:
    requested, effective, inhibit, sync, torque, torque_requested, transition, grip, mode = counts
    return ForceFeedback(
        requested, effective, Inhibit(inhibit), sync, torque, torque_requested, transition, grip, mode, extra
    )


def switched(counts: Counts, extra: bytes, text: str | None) -> JointState:
    """Return the reading that decided. A text warns at the line that called the method of the caller."""
    if text is not None:
        warnings.warn(text, stacklevel=4)
    return joint_state(counts, extra)


def _warn_of_grip(port: str, *, stacklevel: int) -> None:
    """Warn at the line that called the object's method."""
    text = "the gripper's goal is its reading, because its last goal is unknown: a grip may loosen"
    warnings.warn(f"{port}: {text} (gripper_permille states a goal)", stacklevel=stacklevel)


def _gripper(permille: int | None) -> int | None:
    return None if permille is None else count("gripper in thousandths", permille, MAX_GRIPPER)


def _version(number: int) -> str:
    return f"v{number // 100}.{number % 100:02}"
