"""Figures of joints over time and of latencies, from telemetry or from files of `armwire monitor --csv`.

It needs matplotlib: `pip install matplotlib`. As a program::

    armwire monitor /dev/ttyACM0 --csv --count 500 > motion.csv
    python -m armwire.plot motion.csv --save motion.png
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ._units import JOINTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray

    from ._adapter import JointRecording
    from ._units import Floats

# Colours that stay distinct for colour-blind readers and differ in lightness.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")


def joints(time_s: ArrayLike, joints_deg: ArrayLike, gripper_permille: ArrayLike | None = None) -> Figure:
    """Draw the angles of six joints over time, with the gripper below if given.

    Args:
        time_s: Time of each reading.
        joints_deg: Six angles per reading.
        gripper_permille: Gripper opening of each reading.
    """
    from matplotlib.figure import Figure

    times, angles = np.asarray(time_s, dtype=np.float64), np.asarray(joints_deg, dtype=np.float64)
    if angles.shape != (times.size, JOINTS):
        raise ValueError(f"joints have shape {angles.shape}, must have ({times.size}, {JOINTS}) for {times.size} times")
    figure = Figure(figsize=(9, 5), layout="constrained")
    if gripper_permille is None:
        upper = figure.subplots()
    else:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        lower.plot(times, np.asarray(gripper_permille), color="black", linewidth=1.5)
        lower.set_ylabel("gripper in ‰")
        lower.set_ylim(-50, 1050)
        lower.grid(alpha=0.3)
    for joint, colour in enumerate(COLOURS):
        upper.plot(times, angles[:, joint], color=colour, linewidth=1.5, label=f"joint {joint + 1}")
    upper.set_ylabel("angle in degrees")
    upper.grid(alpha=0.3)
    figure.legend(*upper.get_legend_handles_labels(), loc="outside right upper", frameon=False)
    figure.axes[-1].set_xlabel("time in seconds")
    return figure


def recording(recorded: JointRecording) -> Figure:
    """Draw an adapter's recording, by the adapter's clock."""
    return joints(recorded.time_s, recorded.joints_deg, recorded.gripper_permille)


def latencies(durations_us: ArrayLike, *, title: str = "") -> Figure:
    """Draw a histogram of durations in microseconds, with the median and the 99th percentile marked."""
    from matplotlib.figure import Figure

    durations = np.asarray(durations_us, dtype=np.float64)
    if durations.size == 0:
        raise ValueError("no durations")
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    shortest, longest = max(durations.min(), 1.0), max(durations.max(), 2.0)
    axes.hist(durations, bins=np.geomspace(shortest * 0.99, longest * 1.01, 60).tolist(), color=COLOURS[4])
    for percent, style in ((50, "-"), (99, "--")):
        value = float(np.percentile(durations, percent))
        axes.axvline(value, color="black", linestyle=style, linewidth=1.2, label=f"{percent} %: {value:.0f} µs")
    _label_latencies(axes, title)
    axes.legend(frameon=False)
    return figure


def adapter_latencies(counts: NDArray[np.int64], *, title: str = "") -> Figure:
    """Draw a histogram of `Adapter.read_latencies`: 16 counts of durations up to 2, 4, 8, … µs."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    edges = 2.0 ** np.arange(len(counts) + 1)
    axes.stairs(counts, edges, fill=True, color=COLOURS[4])
    _label_latencies(axes, title)
    return figure


class Readings(NamedTuple):
    """Columns of a file of `armwire monitor --csv`, with one entry per line; NaN for empty fields."""

    time_s: Floats
    joints_deg: Floats
    """Joint angles, six per line."""
    gripper_permille: Floats
    latency_us: Floats
    """Times from request to answer; empty if no request was sent."""


def read_csv(path: str | Path) -> Readings:
    """Read a file of `armwire monitor --csv`.

    Raises:
        ValueError: The file lacks a column or has an invalid line; the message names it.
    """
    wanted = ["time_s", *(f"joint_{joint}_deg" for joint in range(1, JOINTS + 1)), "gripper_percent"]
    rows: list[list[float]] = []
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = [column for column in [*wanted, "latency_us"] if column not in (reader.fieldnames or [])]
        if missing:
            raise ValueError(f"{path}: no column {missing[0]}: is it from `armwire monitor --csv` of a Ling arm?")
        for row in reader:
            try:
                # A line without joints means a missing answer.
                rows.append([float(row[column] or "nan") for column in [*wanted, "latency_us"]])
            except (TypeError, ValueError) as error:
                raise ValueError(f"{path}, line {reader.line_num}: {error}") from error
    values = np.array(rows, dtype=np.float64).reshape(-1, len(wanted) + 1)
    return Readings(values[:, 0], values[:, 1:-2], values[:, -2] * 10, values[:, -1])


def _label_latencies(axes: Axes, title: str) -> None:
    axes.set_xscale("log")
    axes.set_xlabel("duration in microseconds")
    axes.set_ylabel("count")
    axes.set_title(title)
    axes.grid(alpha=0.3)


def main() -> None:
    """Draw a file of `armwire monitor --csv`."""
    arguments = argparse.ArgumentParser(prog="python -m armwire.plot", description=main.__doc__)
    arguments.add_argument("csv", type=Path, help="a file of `armwire monitor --csv`")
    arguments.add_argument("--save", type=Path, required=True, help="the figure, such as motion.png or motion.svg")
    arguments.add_argument("--latencies", action="store_true", help="draw the latencies instead of the joints")
    parsed = arguments.parse_args()
    readings = read_csv(parsed.csv)
    if parsed.latencies:
        figure = latencies(readings.latency_us[np.isfinite(readings.latency_us)], title="from request to answer")
    else:
        figure = joints(readings.time_s, readings.joints_deg, readings.gripper_permille)
    figure.savefig(parsed.save, dpi=150)


if __name__ == "__main__":
    main()
