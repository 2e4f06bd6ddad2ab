"""An armwire adapter: its configuration, its counters, and the arm's frames with time stamps."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from . import _armwire
from ._ling import JointState, joint_state
from ._open import Open
from ._units import DEG_PER_TICK, MAX_TICKS, RAD_PER_TICK, ZERO

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Mapping

    from numpy.typing import NDArray

    from ._units import Floats

# Maximum duration of one blocking read, in seconds. Deadlines are checked in between.
READ_TIMEOUT_S = 0.2


@dataclass(frozen=True)
class AdapterIdentity:
    """An adapter's identity."""

    board: str
    """The board, for example `stm32f405`."""
    serial: str
    firmware: str
    commit: str
    """The commit of its firmware, followed by `+` if files were changed; empty if unknown."""
    can_fd: bool
    """True if its CAN controller supports CAN FD."""
    can: bool
    """True if it has CAN. True from older firmware, which does not tell."""


@dataclass(frozen=True)
class Telemetry:
    """A frame of the arm, or an event of the adapter."""

    stamp_us: int
    """Reception time of the frame's last byte by the adapter's clock, in microseconds since its start."""
    initiator: str | None
    """Initiator of the request: `usb`, `can`, `poll`, `command`, `adapter`. `None` without a request."""
    frame: bytes
    """The frame as on the wire; empty for an event."""
    event: Mapping[str, object] | None
    """An event of the adapter, for example `{"event": "host_silent", …}`; `None` for a frame."""

    @property
    def joints(self) -> JointState | None:
        """The joint reading in a Ling arm's frame; `None` for other frames and for events."""
        answer = _armwire.ling_joints(self.frame)
        return None if answer is None else joint_state(*answer)


@dataclass(frozen=True)
class JointRecording:
    """Joints over time, as arrays with one entry per reading."""

    stamp_us: NDArray[np.uint64]
    """Time stamps by the adapter's clock, in microseconds since its start."""
    ticks: NDArray[np.uint16]
    """Positions of six joints in ticks, as sent by the arm: 4096 per turn, 2048 at zero. The range is 0 to 4095."""
    gripper_permille: NDArray[np.uint16]
    """Gripper openings in thousandths, as sent by the arm: 0 is closed, 1000 is open."""
    status: NDArray[np.uint8]
    """Motion states, as in `MotionStatus`."""

    @classmethod
    def of(cls, telemetry: Iterable[Telemetry]) -> JointRecording:
        """Collect the joint readings in telemetry."""
        readings = [(each.stamp_us, state) for each in telemetry if (state := each.joints) is not None]
        return cls(
            np.array([stamp for stamp, _ in readings], dtype=np.uint64),
            np.array([state.ticks for _, state in readings], dtype=np.uint16).reshape(-1, 6),
            np.array([state.gripper for _, state in readings], dtype=np.uint16),
            np.array([int(state.status) for _, state in readings], dtype=np.uint8),
        )

    @property
    def time_s(self) -> Floats:
        """Seconds since the first reading."""
        seconds = self.stamp_us.astype(np.float64) / 1e6
        return seconds - (float(seconds[0]) if seconds.size else 0.0)

    @property
    def joints_deg(self) -> Floats:
        """Angles in degrees, six per reading; NaN for positions out of range."""
        return self._angles(DEG_PER_TICK)

    @property
    def joints_rad(self) -> Floats:
        """Angles in radians, six per reading; NaN for positions out of range."""
        return self._angles(RAD_PER_TICK)

    def _angles(self, unit_per_tick: float) -> Floats:
        angles = (self.ticks.astype(np.float64) - ZERO) * unit_per_tick
        angles[self.ticks > MAX_TICKS] = np.nan
        return angles


class Adapter(Open):
    """The control port of an adapter. The arm's own port stays available for `Ling`.

    Calls time out after 3 s and raise the exceptions of `armwire.errors`.

    Args:
        port: The adapter's serial port, such as `/dev/ttyACM0`, which identifies its control port; `usb:SERIAL` by
            its USB serial number; `can:IFACE/NODE`; `slcan:PORT@BITRATE/NODE`; `control:PORT` of a virtual board.

    Raises:
        PortError: No adapter was found, or its control port cannot be opened.
    """

    def __init__(self, port: str) -> None:
        self._port = _armwire.AdapterPort(port)
        self._is_subscribed = False
        super().__init__(port, self._port)

    def identify(self) -> AdapterIdentity:
        """Read the adapter's identity."""
        return AdapterIdentity(*self._port.identify())

    def is_in_recovery(self) -> bool:
        """Return True if the adapter has factory settings after crashed starts.

        They are without CAN, and the saved settings are unused and unchanged until a save.
        """
        return self._port.is_in_recovery()

    def read_config(self) -> dict[str, object]:
        """Read the configuration in force, by the keys of `armwire config`. Without CAN there is no key `can.…`."""
        return cast("dict[str, object]", json.loads(self._port.read_config()))

    def set_config(self, settings: Mapping[str, object], *, save: bool = False) -> None:
        """Change settings until the adapter's next start.

        Args:
            settings: For example `{"poll": 200, "can.telemetry-hz": 100}`; `armwire config help set` lists all.
            save: Save the whole configuration for later starts.

        Raises:
            ValueError: A setting or its value is invalid.
            RefusedError: The adapter rejected the configuration, or has no such setting: it has no CAN.
        """
        words = {True: "on", False: "off"}
        self._port.change_config(
            [f"{key}={words[value] if isinstance(value, bool) else value}" for key, value in settings.items()]
        )
        if save:
            self.save_config()

    def save_config(self) -> None:
        """Save the configuration in force for later starts."""
        self._port.save_config()

    def reset_config(self) -> None:
        """Erase the saved configuration and restore the factory defaults."""
        self._port.reset_config()

    def read_counters(self) -> dict[str, int]:
        """Read the adapter's counters since its start, by name."""
        return cast("dict[str, int]", json.loads(self._port.read_counters()))

    def read_latencies(self) -> dict[str, NDArray[np.int64]]:
        """Read the adapter's latency histograms.

        Returns:
            `answer`, from a request's last byte to its answer's last byte; `turn`, from a request's arrival to its
            first byte on the line; `poll`, from a poll's slot to its first byte on the line. Each has 16 counts, of
            durations shorter than 2, 4, 8, … 32768 µs; the last count includes all longer ones.
        """
        latencies = cast("dict[str, list[int]]", json.loads(self._port.read_latencies()))
        return {name: np.array(counts, dtype=np.int64) for name, counts in latencies.items()}

    def stop(self) -> None:
        """Stop the arm where it is and keep its torque on, whatever program, host or poll uses it.

        Waiting motion of every host is dropped, and further motion is refused for 2 s: the counter `refused_stopped`
        counts it. The gripper keeps the last goal that was sent to it. The call returns when the hold goes to the arm.
        An arm without torque is sent nothing. **This is not an emergency stop**: keep a switch in the arm's supply.

        Raises:
            NotStoppedError: The arm does not answer, or it cannot be stopped by this adapter; the text has the reason.
        """
        self._port.stop()

    def end_stream(self) -> None:
        """End the motion stream of this port's host without switching the torque off."""
        self._port.end_stream()

    def restart(self) -> None:
        """Restart the adapter."""
        self._port.restart()

    def telemetry(self, *, duration_s: float | None = None, events: bool = False) -> Generator[Telemetry, None, None]:
        """Iterate over the arm's frames, for requests of any initiator: the adapter's poll, USB, CAN.

        The adapter polls if configured: `set_config({"poll": 200})`. It drops and counts frames that exceed its queue.

        Args:
            duration_s: Duration in seconds; `None` for an endless iteration.
            events: Also yield events of the adapter.

        Raises:
            RuntimeError: Another iteration over this object's telemetry has not ended.
        """
        until = None if duration_s is None else time.monotonic() + duration_s
        self._subscribe(events)
        try:
            while (left := READ_TIMEOUT_S if until is None else until - time.monotonic()) > 0:
                if (received := self._receive(min(left, READ_TIMEOUT_S))) is not None:
                    yield received
        finally:
            self._unsubscribe()

    def _subscribe(self, events: bool) -> None:
        """Begin the telemetry's only iteration."""
        if self._is_subscribed:
            raise RuntimeError(f"{self.port}: another iteration over the telemetry has not ended")
        self._port.subscribe(True, events)
        self._is_subscribed = True

    def _unsubscribe(self) -> None:
        self._is_subscribed = False
        self._port.subscribe(False, False)

    def _receive(self, timeout_s: float) -> Telemetry | None:
        """Return the next frame or event within a timeout."""
        received = self._port.receive(timeout_s)
        if received is None:
            return None
        stamp, initiator, frame, event = received
        fields = None if event is None else cast("dict[str, object]", json.loads(event))
        return Telemetry(stamp, initiator, frame or b"", fields)

    def record_joints(self, duration_s: float) -> JointRecording:
        """Record a Ling arm's joints for this duration. See `telemetry`."""
        return JointRecording.of(self.telemetry(duration_s=duration_s))
