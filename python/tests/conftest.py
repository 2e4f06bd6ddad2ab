"""Virtual arms for all tests. `ARMWIRE_BOARD` is the folder with the ports of a running virtual board."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import armwire
from armwire import sim


@pytest.fixture
def virtual() -> Iterator[sim.VirtualLing]:
    """A virtual follower."""
    with sim.ling() as virtual:
        yield virtual


@pytest.fixture
def arm(virtual: sim.VirtualLing) -> Iterator[armwire.Ling]:
    """The follower, opened."""
    with armwire.Ling(virtual.port) as arm:
        yield arm


@pytest.fixture
def board() -> Path:
    """The folder with the ports `arm`, `control` and `bus` of a virtual board with a Ling arm."""
    folder = os.environ.get("ARMWIRE_BOARD")
    if folder is None:
        pytest.skip("ARMWIRE_BOARD is not set: `cargo xtask python` serves a virtual board")
    return Path(folder)
