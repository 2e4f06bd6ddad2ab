"""Measures the start of the command `armwire`, beside that of Python itself.

Usage: command_start.py [RUNS]

Prints the medians of `armwire --version` and of `python -c pass`, which take turns, and their ratio. Exits with an
error if the ratio exceeds its limit, as on a busy computer.
"""

import statistics
import subprocess
import sys
import time

MAX_RATIO = 2.5

PYTHON = [sys.executable, "-c", "pass"]
COMMAND = [sys.executable, "-c", "from armwire._command import main; main()", "--version"]


def duration_ms(command: list[str]) -> float:
    """Run a program and return its duration."""
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return (time.perf_counter() - start) * 1000


def main() -> None:
    """Measure, and print the result."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    durations = [(duration_ms(PYTHON), duration_ms(COMMAND)) for _ in range(runs)]
    python, command = (statistics.median(column) for column in zip(*durations, strict=True))
    ratio = command / python
    print(f"python -c pass     {python:6.1f} ms")
    print(f"armwire --version  {command:6.1f} ms, {ratio:.2f} times as long")
    if ratio > MAX_RATIO:
        sys.exit(f"armwire --version takes {ratio:.2f} times as long as Python, the limit is {MAX_RATIO}")


if __name__ == "__main__":
    main()
