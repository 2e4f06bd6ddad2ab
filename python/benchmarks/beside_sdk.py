"""Compares joint reads of one virtual arm, and programs that read it once, with this package and with the vendor's SDK.

Usage: beside_sdk.py ARMWIRE FOLDER

ARMWIRE is the `armwire` command, which serves the arm in its own process. FOLDER is `host-tests/vendor`, with the code
that starts the serial layer of the SDK. Exits with an error if a limit is missed.
"""

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import armwire

# Rounds of each, alternating.
ROUNDS = 5
READS = 1000
# Limits: ratio of the reads per second, and ratio of the CPU time per read. Machines differ by a tenth.
MIN_SPEED = 2.5
MAX_CPU = 1 / 4
# A program that reads an arm once with the SDK.
ONCE = """
import sys
sys.path.insert(0, sys.argv[1])
from sdk import servo_driver
driver, _ = servo_driver(sys.argv[2])
if not driver.connect() or not driver.acquire_info("joint_gripper", wait=True):
    sys.exit("the SDK got no answer")
print(driver.data_parser.get_info("joint"))
driver.disconnect()
"""


@dataclass
class Measured:
    """Result of a round."""

    reads_per_s: float
    cpu_us: float


def measure(read: Callable[[], object]) -> Measured:
    """Measure a round of reads."""
    cpu, begun = cpu_s(), time.perf_counter()
    for _ in range(READS):
        read()
    return Measured(READS / (time.perf_counter() - begun), (cpu_s() - cpu) / READS * 1e6)


def cpu_s() -> float:
    """Return the CPU time of all threads of this process, in seconds."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def ours(port: str) -> Measured:
    """Measure a round with this package's public API."""
    with armwire.Ling(port) as arm:
        return measure(arm.read_joints_rad)


def vendors(driver: Any) -> Measured:
    """Measure a round with the SDK's own joint read."""
    if not driver.connect():
        sys.exit("the SDK did not connect")

    def read() -> object:
        if not driver.acquire_info("joint_gripper", wait=True):
            sys.exit("the SDK got no answer")
        return driver.data_parser.get_info("joint")

    try:
        return measure(read)
    finally:
        driver.disconnect()


def duration_s(program: list[str]) -> float:
    """Run a program, and return its duration in seconds."""
    begun = time.perf_counter()
    subprocess.run(program, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begun


def main(command: str, folder: str) -> None:
    """Measure both in alternating rounds, and compare them."""
    sys.path.insert(0, folder)
    from sdk import servo_driver  # type: ignore[import-not-found]

    # All processes share one core: a wake-up on another core takes longer than a read.
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    server = subprocess.Popen([command, "sim", "ling"], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        port = server.stdout.readline().split(" is at ")[1].split(";")[0]
        driver, _ = servo_driver(port)
        rounds = [(vendors(driver), ours(port)) for _ in range(ROUNDS)]
        programs = [sys.executable, "-c", ONCE, folder, port], [command, "info", port]
        firsts = [[duration_s(program) for program in programs] for _ in range(ROUNDS)]
    finally:
        server.terminate()
        server.wait()
    # Other load only slows a round down: the best round is the least affected.
    speed = [max(each.reads_per_s for each in side) for side in zip(*rounds, strict=True)]
    cpu = [min(each.cpu_us for each in side) for side in zip(*rounds, strict=True)]
    print(f"best of {ROUNDS} rounds of {READS} reads each, alternating, on one virtual arm and one core:")
    print(f"  alicia_d_sdk 6.1.0  {speed[0]:6.0f} reads/s  {cpu[0]:5.0f} µs of CPU per read")
    print(f"  armwire             {speed[1]:6.0f} reads/s  {cpu[1]:5.0f} µs of CPU per read")
    faster, part = speed[1] / speed[0], cpu[1] / cpu[0]
    print(f"  {faster:.1f} times the reads, at least {MIN_SPEED:g}")
    print(f"  1/{1 / part:.1f} of the CPU, at most 1/{1 / MAX_CPU:g}")
    first = [min(side) for side in zip(*firsts, strict=True)]
    print(f"one pose from the shell, best of {ROUNDS} rounds:")
    print(f"  alicia_d_sdk 6.1.0  {first[0]:.2f} s, a program that connects and reads the joints")
    print(f"  armwire info        {first[1]:.2f} s, {first[1] / first[0]:.1f} times that: it listens for 0.1 s first")
    if faster < MIN_SPEED or part > MAX_CPU:
        sys.exit("FAILED: a limit is missed")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
