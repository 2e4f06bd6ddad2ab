"""A Ling arm whose joints a test moves. A virtual arm's follow its requests."""

from __future__ import annotations

import os
import pty
import threading
import time
import tty
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from zlib import crc32

import pytest

import armwire

READ_INFO, READ_JOINTS, MOVE, TORQUE_ON, TORQUE_OFF = "read-info", "read-joints", "move", "torque-on", "torque-off"
ZERO = "zero"
# Command and function of a request, and the data of a torque.
NAMES = {
    b"\x01\x00": READ_INFO,
    b"\x03\x00": ZERO,
    b"\x05\x00\x00": TORQUE_OFF,
    b"\x05\x00\x01": TORQUE_ON,
    b"\x06\x00": READ_JOINTS,
    b"\x06\x03": MOVE,
}
# The stroke, the temperatures and the velocities, which a client may read before another request.
FENCES = {b"\x04\x0e": bytes([1]), b"\x06\x01": bytes(6), b"\x06\x02": bytes(12)}
LOCKED = 0x01
ROWS = Path(__file__).parents[2] / "protocol/tests/effects.txt"


@dataclass(frozen=True)
class Row:
    """Readings after a request that the arm does not answer, and their verdict."""

    effect: str
    status: int
    ticks: int
    change_s: float
    later_status: int
    later_ticks: int
    verdict: str


def rows() -> list[Row]:
    """The rows that every program follows."""
    lines = [line.split() for line in ROWS.read_text().splitlines() if not line.startswith("#")]
    return [
        Row(effect, int(status, 16), int(ticks), int(change) / 1000, int(later, 16), int(later_ticks), verdict)
        for effect, status, ticks, change, later, later_ticks, verdict in lines
    ]


class ScriptedArm:
    """An arm on a pseudo-terminal. Its torque is on.

    Args:
        joint1: Returns the ticks of joint 1 in a reading, by the reading's number from 0. The others stay at zero.
        on_move: Called at each move.
    """

    def __init__(self, joint1: Callable[[int], int], on_move: Callable[[], None] = lambda: None) -> None:
        self.requests: list[str] = []
        self._joint1, self._on_move = joint1, on_move
        self._ours, self._theirs = pty.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> ScriptedArm:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        os.close(self._theirs)
        self._thread.join()
        os.close(self._ours)

    def _serve(self) -> None:
        received = b""
        try:
            while True:
                received += os.read(self._ours, 100)
                while len(received) > 3 and len(received) >= (length := 6 + received[3]):
                    self._take(received[1:3], received[4:5])
                    received = received[length:]
        except OSError:
            pass

    def _take(self, head: bytes, data: bytes) -> None:
        if head in FENCES:
            self._answer(head, FENCES[head])
            return
        name = NAMES.get(head) or NAMES[head + data]
        reading = self.requests.count(READ_JOINTS)
        self.requests.append(name)
        if name == READ_INFO:
            self._answer(head, b"ADFS251205123456" + (110).to_bytes(4, "little") + (610).to_bytes(4, "little"))
        elif name == READ_JOINTS:
            ticks, status = self._state(reading)
            counts = [*ticks, 500]
            self._answer(head, b"".join(count.to_bytes(2, "little") for count in counts) + bytes([status]))
        elif name == MOVE:
            self._on_move()

    def _state(self, reading: int) -> tuple[list[int], int]:
        """The ticks and the status in a reading."""
        return [self._joint1(reading), *[2048] * 5], LOCKED

    def _answer(self, head: bytes, data: bytes) -> None:
        body = head + bytes([len(data)]) + data
        os.write(self._ours, b"\xaa" + body + bytes([crc32(body) & 0xFF, 0xFF]))


class RowArm(ScriptedArm):
    """An arm with the readings of a row."""

    def __init__(self, row: Row) -> None:
        super().__init__(lambda _: row.ticks)
        self._row = row
        self._requested: float | None = None

    def _take(self, head: bytes, data: bytes) -> None:
        super()._take(head, data)
        if self.requests[-1] == self._row.effect and self._requested is None:
            self._requested = time.monotonic()

    def _state(self, reading: int) -> tuple[list[int], int]:
        row = self._row
        has_changed = self._requested is not None and time.monotonic() - self._requested >= row.change_s
        return ([row.later_ticks] * 6, row.later_status) if has_changed else ([row.ticks] * 6, row.status)


@contextmanager
def verdict_of(row: Row) -> Iterator[None]:
    """Expect the verdict of this row."""
    if row.verdict == "contradicted":
        with pytest.raises(armwire.errors.RefusedError, match=" was sent, but "):
            yield
    elif row.verdict == "not-shown":
        with pytest.warns(UserWarning, match=": sent; status .* does not show its effect"):
            yield
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
