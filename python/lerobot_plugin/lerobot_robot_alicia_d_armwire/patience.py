"""The patience of an observation: a hiccup of the computer is no loss of the arm."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, TypeVar

import armwire

if TYPE_CHECKING:
    from collections.abc import Callable

logger = logging.getLogger(__name__)

T = TypeVar("T")

# Maximum duration of a part of a wait, in seconds. What a part takes longer is a hiccup of this program, which does not
# count: the program has not waited in that time.
PART_S = 0.05


class Patience:
    """The waits for poses and images that are too old, each as long as the time-out at most.

    A busy computer keeps the arm, the camera or this program from its work for tenths of a second, and what is newest
    is old then. The next one comes soon.

    Args:
        timeout_s: Maximum duration of a wait in seconds.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self.waits = 0
        """The number of waits."""

    def get(self, newest: Callable[[], T], wait: Callable[[float], object]) -> T:
        """Return the newest, after waits for the next ones while it is too old.

        Args:
            newest: Returns the newest, or raises a `NoPoseError` or a `TimeoutError` if it is too old.
            wait: Waits for the next one, for this time in seconds at most.

        Raises:
            TimeoutError: It is still too old after the time-out.
        """
        left_s = self._timeout_s
        try:
            return newest()
        except (armwire.errors.NoPoseError, TimeoutError) as error:
            self._count(error)
        while True:
            part_s, begun = min(left_s, PART_S), time.monotonic()
            wait(part_s)
            left_s -= min(time.monotonic() - begun, part_s)
            try:
                return newest()
            except (armwire.errors.NoPoseError, TimeoutError) as error:
                if left_s <= 0:
                    raise TimeoutError(f"{error}, after a wait of {self._timeout_s:g} s") from error

    def _count(self, error: Exception) -> None:
        self.waits += 1
        if self.waits == 1:
            logger.warning("%s: the program waits for the next one. Later waits are only counted.", error)
