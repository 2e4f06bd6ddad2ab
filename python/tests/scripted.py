"""A Ling arm whose joints a test moves. A virtual arm's follow its requests."""

from __future__ import annotations

import os
import pty
import threading
import tty
from collections.abc import Callable
from types import TracebackType
from zlib import crc32

READ_INFO, READ_JOINTS, MOVE, TORQUE_ON = "read-info", "read-joints", "move", "torque-on"
# Command and function of a request.
NAMES = {b"\x01\x00": READ_INFO, b"\x06\x00": READ_JOINTS, b"\x06\x03": MOVE, b"\x05\x00": TORQUE_ON}
LOCKED = 0x01


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
                    self._take(received[1:3])
                    received = received[length:]
        except OSError:
            pass

    def _take(self, head: bytes) -> None:
        name = NAMES[head]
        reading = self.requests.count(READ_JOINTS)
        self.requests.append(name)
        if name == READ_INFO:
            self._answer(head, b"ADFS251205123456" + (110).to_bytes(4, "little") + (610).to_bytes(4, "little"))
        elif name == READ_JOINTS:
            counts = [self._joint1(reading), *[2048] * 5, 500]
            self._answer(head, b"".join(count.to_bytes(2, "little") for count in counts) + bytes([LOCKED]))
        elif name == MOVE:
            self._on_move()

    def _answer(self, head: bytes, data: bytes) -> None:
        body = head + bytes([len(data)]) + data
        os.write(self._ours, b"\xaa" + body + bytes([crc32(body) & 0xFF, 0xFF]))
