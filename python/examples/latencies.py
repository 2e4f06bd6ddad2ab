"""Measures the latency of reads and plots it. Usage: latencies.py PORT FIGURE.png. It needs matplotlib."""

import sys
import time

import armwire
from armwire import plot

READS = 500

with armwire.Ling(sys.argv[1]) as arm:
    durations_us = []
    for _ in range(READS):
        begun = time.perf_counter()
        arm.read_joints()
        durations_us.append((time.perf_counter() - begun) * 1e6)
plot.latencies(durations_us, title=f"{READS} reads of the joints").savefig(sys.argv[2], dpi=150)
