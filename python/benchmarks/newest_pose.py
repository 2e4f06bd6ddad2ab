"""Measures how long a program waits for the pose of an arm: a read that waits, and the newest pose of a reader.

Usage: newest_pose.py [SECONDS]

It prints a Markdown table. Two virtual arms lose 1 % of their answers. In each period of 10 ms one is read with
`Ling.read_joints`, and the other observed with `get_observation` of the plugin for LeRobot, without cameras. LeRobot
is not needed. Exits with an error if a limit is missed, as on a busy computer.
"""

import importlib
import importlib.util
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import armwire
from armwire import sim

PERIOD_S = 0.01
# An answer has 21 bytes: 1 % of the answers lose one.
FAULTS = sim.Faults(drop=480)
# Limits of the 99th percentile, in milliseconds.
MAX_OBSERVATION_MS = 0.5
MAX_LATEST_MS = 0.2

PYTHON = Path(__file__).parent.parent


class Calls:
    """Durations of calls, and the number of those without a pose."""

    def __init__(self, call: Callable[[], object]) -> None:
        self._call = call
        self._durations_ms: list[float] = []
        self._failed = 0

    def make(self) -> None:
        """Make a call."""
        begun = time.perf_counter_ns()
        try:
            self._call()
        except Exception as error:
            if "answer" not in str(error) and "pose" not in str(error):
                raise
            self._failed += 1
        self._durations_ms.append((time.perf_counter_ns() - begun) / 1e6)

    def percentile(self, percent: float) -> float:
        """Return a percentile, in milliseconds."""
        durations = sorted(self._durations_ms)
        return durations[min(int(len(durations) * percent / 100), len(durations) - 1)]

    def __str__(self) -> str:
        percentiles = " | ".join(f"{self.percentile(percent):.3f}" for percent in (50, 99, 99.9, 100))
        return f"{percentiles} | {self._failed}"


def follower(port: str, folder: str) -> Any:
    """Return the plugin's follower."""
    if importlib.util.find_spec("lerobot") is None:
        sys.path.insert(0, str(PYTHON / "tests/lerobot_stand_in"))
    sys.path.insert(0, str(PYTHON / "lerobot_plugin"))
    plugin: Any = importlib.import_module("lerobot_robot_alicia_d_armwire")
    config = plugin.AliciaDArmwireConfig(id="bench", calibration_dir=Path(folder), port=port, action_timeout_s=0)
    return plugin.AliciaDArmwire(config)


def main(seconds: float) -> None:
    """Measure for this time."""
    with (
        sim.ling() as read,
        sim.ling() as observed,
        armwire.Ling(read.port) as arm,
        tempfile.TemporaryDirectory() as folder,
    ):
        robot = follower(observed.port, folder)
        robot.connect()
        read.set_faults(FAULTS)
        observed.set_faults(FAULTS)
        reads, observations = Calls(arm.read_joints), Calls(robot.get_observation)
        latest = Calls(robot._reader.latest)
        begun = time.monotonic()
        due = begun
        while due < begun + seconds:
            time.sleep(max(0.0, due - time.monotonic()))
            observations.make()
            latest.make()
            reads.make()
            # Periods that a read has taken are left out.
            due += PERIOD_S * max(1, int((time.monotonic() - due) / PERIOD_S))
        counts, dropped = robot._reader.counts(), observed.injected().drop
        robot.disconnect()
    print("| ms | p50 | p99 | p99.9 | max | without a pose |")
    print("|---|---:|---:|---:|---:|---:|")
    print(f"| `read_joints` | {reads} |")
    print(f"| `get_observation` without cameras | {observations} |")
    print(f"| `Reader.latest` | {latest} |")
    # A byte costs one reading. Without another loss on the line, the answers to the others came late.
    late = max(0, counts.lost - dropped)
    print(
        f"\nThe reader had {counts.samples} readings. It gave up {counts.lost}: {counts.lost - late} after a dropped "
        f"byte, {late} because the answer came late. It did not begin {counts.missed} in time."
    )
    for name, calls, limit in (
        ("get_observation", observations, MAX_OBSERVATION_MS),
        ("latest", latest, MAX_LATEST_MS),
    ):
        if calls.percentile(99) > limit:
            sys.exit(f"FAILED: p99 of {name} is {calls.percentile(99):.3f} ms, must be at most {limit} ms")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 30.0)
