"""Checks of an expected fact. A check that fails ends the program."""

import sys
import time
from collections.abc import Callable

# Timeout of each step, in seconds. The xArm's SDK polls an idle arm after 30 s, and the virtual board may be slow.
STEP_TIMEOUT = 60.0
# Pause between two polls of a condition, in seconds.
POLL_PERIOD = 0.001
# Time without bytes that proves silence, in seconds.
SILENCE = 0.3


def require(fact: str, holds: bool) -> None:
    """Ends the program if the fact does not hold."""
    if not holds:
        sys.exit(f"FAILED: {fact}")


def expect(fact: str, holds: bool) -> None:
    """Prints the fact. Ends the program if it does not hold."""
    require(fact, holds)
    print(f"ok: {fact}", flush=True)


def wait_until(fact: str, condition: Callable[[], bool], quiet: bool = False) -> None:
    """Polls until the condition holds. Ends the program on timeout."""
    start = time.monotonic()
    while not condition():
        require(f"{fact} within {STEP_TIMEOUT:.0f} s", time.monotonic() - start < STEP_TIMEOUT)
        time.sleep(POLL_PERIOD)
    if not quiet:
        print(f"ok: {fact}, after {time.monotonic() - start:.1f} s", flush=True)
