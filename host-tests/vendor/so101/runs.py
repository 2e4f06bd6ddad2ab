"""Runs of scripts with the foreign programs, each in a process of its own."""

import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
# Modules in place of large ones that the programs import and do not use.
STAND_IN = HERE / "stand_in"
# Timeout of a run, in seconds: several times its duration.
TIMEOUT = 60
# Some programs wait 34 ms for an answer, and another process may have the processor as long: one run proves nothing.
TRIES = 6


@dataclass(frozen=True)
class Pythons:
    """The Python of each environment: two packages have a module of the same name."""

    most: str
    ftservo: str

    def of(self, name: str) -> str:
        """The Python for a program or a page, by its name."""
        return self.ftservo if name.startswith("ftservo") else self.most


def run(python: str, script: Path, *args: str) -> str:
    """The output of a script. `fails` if it does, `hangs` if it exceeds the timeout."""
    command = [python, "-B", str(script), *args]
    path = {**os.environ, "PYTHONPATH": str(STAND_IN)}
    try:
        done = subprocess.run(command, env=path, capture_output=True, text=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return "hangs"
    if done.returncode != 0:
        print(f"{' '.join(command)} failed:\n{done.stderr}", file=sys.stderr, flush=True)
        return "fails"
    return done.stdout.strip()


def settled(name: str, run_once: Callable[[], str], expected: str | None) -> str:
    """The expected result, if one of two runs or two of all runs have it. Otherwise the most frequent one.

    Without an expected result, the first that two runs have.
    """
    results: Counter[str] = Counter()
    for before in range(TRIES):
        # What disturbed the last run may go on.
        time.sleep(before)
        result = run_once()
        results[result] += 1
        if result == expected and (before < 2 or results[result] == 2):
            return result
        if expected is None and results[result] == 2:
            return result
        if expected is not None:
            print(f"{name}: {result!r}, expected {expected!r}", flush=True)
    return results.most_common(1)[0][0]
