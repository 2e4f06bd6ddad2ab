"""Virtual arms for all tests. `ARMWIRE_BOARD` is the folder with the ports of a running virtual board."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import armwire
from armwire import sim


@pytest.fixture
def virtual() -> Iterator[sim.VirtualLing]:
    """A virtual follower, whose joints are exactly where they are sent."""
    with sim.ling(plant="ideal") as virtual:
        yield virtual


@pytest.fixture
def arm(virtual: sim.VirtualLing) -> Iterator[armwire.Ling]:
    """The follower, opened."""
    with armwire.Ling(virtual.port) as arm:
        yield arm


@pytest.fixture
def ctrl_c() -> Iterator[Callable[[], None]]:
    """Ctrl-C, from another thread."""
    # A shell's background job inherits SIGINT as ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield lambda: os.kill(os.getpid(), signal.SIGINT)
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def board() -> Path:
    """The folder with the ports `arm`, `control` and `bus` of a virtual board with a Ling arm."""
    folder = os.environ.get("ARMWIRE_BOARD")
    if folder is None:
        pytest.skip("ARMWIRE_BOARD is not set: `cargo xtask python` serves a virtual board")
    return Path(folder)


@contextmanager
def served(port: Path, *options: str) -> Iterator[None]:
    """A virtual arm at this path, in a process of its own."""
    program = [sys.executable, "-c", "from armwire._command import main; main()"]
    with subprocess.Popen([*program, "sim", "ling", "--pty", port, *options], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        try:
            yield
        finally:
            process.terminate()
