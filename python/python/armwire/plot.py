"""Figures of joints over time and of latencies, from telemetry, recordings, and files of `armwire monitor --csv`.

It needs `pip install matplotlib`, and for recordings `pip install mcap-ros2-support`. As a program::

    armwire record /dev/ttyACM0 motion.mcap
    python -m armwire.plot motion.mcap --save motion.png
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from . import joints_file
from ._units import JOINTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray

    from ._adapter import JointRecording
    from ._units import Floats

MAGIC = b"\x89MCAP"
# Colours that stay distinct for colour-blind readers and differ in lightness.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")


def joints(
    time_s: ArrayLike,
    joints_deg: ArrayLike,
    gripper_permille: ArrayLike | None = None,
    *,
    gripper_mm: ArrayLike | None = None,
) -> Figure:
    """Draw the angles of six joints over time, with the gripper below if given.

    Args:
        time_s: Time of each reading.
        joints_deg: Six angles per reading.
        gripper_permille: Gripper opening of each reading.
        gripper_mm: The same in mm, instead.
    """
    from matplotlib.figure import Figure

    times, angles = np.asarray(time_s, dtype=np.float64), np.asarray(joints_deg, dtype=np.float64)
    if angles.shape != (times.size, JOINTS):
        raise ValueError(f"joints have shape {angles.shape}, must have ({times.size}, {JOINTS}) for {times.size} times")
    figure = Figure(figsize=(9, 5), layout="constrained")
    if gripper_permille is not None and gripper_mm is not None:
        raise ValueError("both gripper_permille and gripper_mm are given: draw one of them")
    gripper, unit = (gripper_mm, "mm") if gripper_permille is None else (gripper_permille, "‰")
    if gripper is None:
        upper = figure.subplots()
    else:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        lower.plot(times, np.asarray(gripper), color="black", linewidth=1.5)
        lower.set_ylabel(f"gripper in {unit}")
        lower.grid(alpha=0.3)
        if gripper_permille is not None:
            lower.set_ylim(-50, 1050)
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


class Motion(NamedTuple):
    """Poses of a recording."""

    time_s: Floats
    """Times since the first pose."""
    joints_deg: Floats
    """Joint angles, six per pose."""
    gripper_mm: Floats
    """Gripper openings; NaN where the stroke was not known."""


def read_mcap(
    path: str | Path,
    *,
    topic: str = "/joint_states",
    joints: Sequence[joints_file.Joint] = joints_file.ARM,
) -> Motion:
    """Read the poses of a Ling arm in an MCAP file of `armwire record`, `monitor --mcap` or `teleop --mcap`.

    A file of another program is read by the `joints` of a joints file.

    A file that ends early, of a program that was killed, is read as far as it goes.

    Args:
        path: The file.
        topic: The arm; `/leader/joint_states` or `/follower/joint_states` of `teleop`.
        joints: Names and units of the joints and of the gripper, by `armwire.joints_file.read`.

    Raises:
        ValueError: The file is no MCAP file, is damaged, or has no such poses; the message names it.
    """
    from mcap.reader import NonSeekingReader
    from mcap_ros2.decoder import DecoderFactory

    states, topics = [], set[str]()
    decoders = DecoderFactory()
    with open(path, "rb") as file:
        try:
            for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                topics.add(channel.topic)
                if channel.topic == topic and (decode := decoders.decoder_for(channel.message_encoding, schema)):
                    states.append(decode(message.data))
        # Errors of a damaged file are of many kinds, such as `struct.error` and `KeyError`.
        except Exception as error:
            # At the end of the file, the program that wrote it was killed, or still writes.
            if file.read(1):
                raise ValueError(f"{path}: damaged: {error!r}") from error
    rows: list[list[float]] = []
    *arm, gripper = joints
    names = [joint.name for joint in arm]
    for state in states:
        if len(state.name) != len(state.position) or not set(names) <= set(state.name):
            raise ValueError(f"{path}: the joints are {state.name!r}, must be {', '.join(names)}")
        position = dict(zip(state.name, state.position, strict=True))
        if len(position) != len(state.name):
            raise ValueError(f"{path}: a joint is there twice: {state.name!r}")
        time_s = state.header.stamp.sec + state.header.stamp.nanosec / 1e9
        opening = gripper.arm(position.get(gripper.name, float("nan")))
        rows.append([time_s, *(joint.arm(position[joint.name]) for joint in arm), opening])
    if not rows:
        others = f"; there are: {', '.join(sorted(topics))}" if topics else ""
        raise ValueError(f"{path}: no poses on {topic}{others}")
    values = np.array(rows, dtype=np.float64)
    return Motion(values[:, 0] - values[0, 0], np.degrees(values[:, 1:-1]), values[:, -1] * 1000)


def _label_latencies(axes: Axes, title: str) -> None:
    axes.set_xscale("log")
    axes.set_xlabel("duration in microseconds")
    axes.set_ylabel("count")
    axes.set_title(title)
    axes.grid(alpha=0.3)


def _drawn(path: Path, topic: str, named: Sequence[joints_file.Joint] | None, *, are_latencies: bool) -> Figure:
    """The figure of a file, with joints of a joints file."""
    with open(path, "rb") as file:
        is_recording = file.read(len(MAGIC)) == MAGIC
    if is_recording:
        if are_latencies:
            raise ValueError(f"{path}: a recording has no latencies: draw a file of `armwire monitor --csv`")
        motion = read_mcap(path, topic=topic, joints=named or joints_file.ARM)
        gripper_mm = motion.gripper_mm if np.isfinite(motion.gripper_mm).any() else None
        return joints(motion.time_s, motion.joints_deg, gripper_mm=gripper_mm)
    if named:
        raise ValueError(f"{path}: a file of `armwire monitor --csv` has its own units: --joints is for MCAP files")
    readings = read_csv(path)
    if are_latencies:
        return latencies(readings.latency_us[np.isfinite(readings.latency_us)], title="from request to answer")
    return joints(readings.time_s, readings.joints_deg, readings.gripper_permille)


def main() -> None:
    """Draw a recording, or a file of `armwire monitor --csv`."""
    arguments = argparse.ArgumentParser(prog="python -m armwire.plot", description=main.__doc__)
    arguments.add_argument("file", type=Path, help="an MCAP file of `armwire record`, or a file of `monitor --csv`")
    arguments.add_argument("--save", type=Path, required=True, help="the figure, such as motion.png or motion.svg")
    arguments.add_argument("--topic", default="/joint_states", help="the arm in an MCAP file (default: %(default)s)")
    arguments.add_argument("--joints", type=Path, metavar="FILE", help="a file with the names and units of the joints")
    arguments.add_argument("--joints-of", metavar="NAME", help="the arm in that file, if it has several")
    arguments.add_argument("--latencies", action="store_true", help="draw the latencies instead of the joints")
    parsed = arguments.parse_args()
    if parsed.joints_of and not parsed.joints:
        arguments.error("--joints-of needs --joints")
    try:
        named = joints_file.read(parsed.joints, arm=parsed.joints_of) if parsed.joints else None
        _drawn(parsed.file, parsed.topic, named, are_latencies=parsed.latencies).savefig(parsed.save, dpi=150)
    except (OSError, ValueError) as error:
        sys.exit(str(error))
    except ImportError as error:
        sys.exit(f"{error}: pip install matplotlib mcap-ros2-support")


if __name__ == "__main__":
    main()
