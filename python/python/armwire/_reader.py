"""The newest pose of an arm, read by a thread of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Literal, Protocol, TypeVar

from ._open import Open
from ._units import count

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    At: TypeAlias = tuple[int, int, int, bool, float]

P = TypeVar("P")
Raw = TypeVar("Raw")
RawOut = TypeVar("RawOut", covariant=True)


@dataclass(frozen=True)
class Reading(Generic[P]):
    """A pose at its time."""

    pose: P
    number: int
    """The number of the reading, from 1. Of a pose between two readings, that of the earlier."""
    monotonic_ns: int
    """The time of the pose, in nanoseconds of the clock of `time.monotonic_ns()` on Linux."""
    unix_ns: int
    """The same time in nanoseconds since 1970."""
    stamped_by: Literal["adapter", "receipt"]
    """`adapter`: the arrival of the answer at the adapter. `receipt`: its receipt by this program, which is later."""
    age_s: float
    """The time since then, when this was returned, in seconds."""


@dataclass(frozen=True)
class ReaderCounts:
    """Counts since a reader's start."""

    samples: int
    """Readings."""
    lost: int
    """Readings without an acceptable answer in time, or lost on the way from the adapter."""
    missed: int
    """Readings that were not begun: a call used the arm, an answer came after a period, or the system was busy."""


class _Port(Protocol[RawOut]):
    def latest(self, max_age_s: float | None) -> tuple[RawOut, At]: ...
    def at(self, monotonic_ns: int) -> tuple[RawOut, At]: ...
    def next_after(self, number: int, timeout_s: float) -> tuple[RawOut, At] | None: ...
    def counts(self) -> tuple[int, int, int]: ...
    def close(self) -> None: ...


class Reader(Open, Generic[P]):
    """A thread that reads the pose of an arm at a rate. `Ling.reader` and `XArm.reader` start one.

    An adapter on the arm's port polls the arm, and its stamps are the times of the readings. Without one the thread
    reads by itself. A lost answer costs one reading.

    Calls while the arm's port is lost raise a `PortLostError`. The port is opened again, and readings and commands
    go on when the arm with the same serial number answers. Calls after `close` of the arm or of the reader raise a
    `ClosedError`.
    """

    def __init__(self, name: str, port: _Port[Raw], pose: Callable[[Raw], P]) -> None:
        super().__init__(name, port)

        def reading(found: tuple[Raw, At]) -> Reading[P]:
            raw, (number, monotonic_ns, unix_ns, is_adapters, age_s) = found
            return Reading(pose(raw), number, monotonic_ns, unix_ns, "adapter" if is_adapters else "receipt", age_s)

        def latest(max_age_s: float | None) -> Reading[P]:
            return reading(port.latest(max_age_s))

        def at(monotonic_ns: int) -> Reading[P]:
            return reading(port.at(count("monotonic time in ns", monotonic_ns, 2**63 - 1, minimum=-(2**63))))

        def next_after(number: int, timeout_s: float) -> Reading[P] | None:
            found = port.next_after(count("number of a reading", number, 2**64 - 1), timeout_s)
            return None if found is None else reading(found)

        self._latest, self._at, self._next_after = latest, at, next_after
        self._counts = port.counts

    def latest(self, *, max_age_s: float | None = None) -> Reading[P]:
        """Return the newest pose, without waiting.

        Args:
            max_age_s: Maximum age in seconds; 0.1 or three periods by default, whichever is longer.

        Raises:
            NoPoseError: The newest pose is older, or there is none yet.
        """
        return self._latest(max_age_s)

    def at(self, monotonic_ns: int) -> Reading[P]:
        """Return the pose at this time of `time.monotonic_ns()`, without waiting.

        It is linear between the readings before and after, rounded to the arm's resolution. Readings are kept for 2 s
        at 1000 Hz, and longer at a lower rate.

        Raises:
            NoPoseError: The time is not between two readings, or they are more than 0.1 s and three periods apart.
        """
        return self._at(monotonic_ns)

    def next_after(self, number: int, *, timeout_s: float = 1.0) -> Reading[P] | None:
        """Return the next reading after this number, or `None` after the time-out. 0 is for the first that is kept."""
        return self._next_after(number, timeout_s)

    def counts(self) -> ReaderCounts:
        """Return the counts since the start."""
        return ReaderCounts(*self._counts())

    def close(self) -> None:
        """End the thread. The arm stays open. Closing it again has no effect."""
        super().close()
