#!/usr/bin/env python3
"""Converts an episode of a LeRobot data set of a Ling arm to MCAP, for `armwire replay`.

Needs `pip install mcap-ros2-support pyarrow`; --joints also needs the package armwire.

The units are those of the robot_type in meta/info.json. Names of actions tell no units: the plugins of this project and
of the vendor have the same names. A data set without a robot_type, or with another, needs --unit or --joints.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import NamedTuple

import pyarrow
import pyarrow.dataset
from mcap_ros2.writer import Writer

NAMES = [f"joint{number}" for number in range(1, 7)] + ["gripper"]
# Limits of the ranges may be rounded to 32 bits.
ROUNDING = 1e-6
# The resolution of a joint in rad: the highest position is half a turn less one tick.
TICK = math.tau / 4096
JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


class Unit(NamedTuple):
    """Units of actions: those of a turn, and that of an open gripper."""

    turn: float
    open_gripper: float
    words: str


UNITS = {
    "degrees": Unit(360, 1000, "degrees, and the gripper from 0 to 1000"),
    "radians": Unit(math.tau, 100, "radians, and the gripper from 0 to 100"),
}
# The plugins of this project, and the vendor's.
ROBOT_TYPES = {
    "alicia_d_armwire": "degrees",
    "alicia_d_leader_armwire": "degrees",
    "alicia_d": "radians",
}


class Joint(NamedTuple):
    """A joint of the actions: value = factor * arm + offset, in rad, or in m of the gripper's opening."""

    name: str
    factor: float
    offset: float


class DataSet(NamedTuple):
    """What meta/info.json says of the actions."""

    names: list[str]
    robot_type: str | None


def read_info(folder: Path) -> DataSet:
    """Read the description of a data set."""
    path = folder / "meta/info.json"
    try:
        info = json.loads(path.read_text())
        names = info["features"]["action"]["names"]
        robot_type = info.get("robot_type")
    except OSError as error:
        raise SystemExit(f"{path}: {error.strerror}: is this the folder of a data set?") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SystemExit(f"{path}: no names of actions: {error!r}") from error
    return DataSet(names, robot_type)


def chosen_unit(folder: Path, robot_type: str | None, stated: str | None) -> tuple[str, str]:
    """The unit of the actions, and why."""
    choices = "; ".join(f"--unit {name}: {unit.words}" for name, unit in UNITS.items())
    known = ROBOT_TYPES.get(robot_type) if isinstance(robot_type, str) else None
    place = folder / "meta/info.json"
    if known and stated and stated != known:
        raise SystemExit(
            f"{place}: the robot_type {robot_type!r} has {known}, and not --unit {stated}; a file for --joints may "
            "state other units"
        )
    if known:
        return known, f"robot_type {robot_type!r}"
    if stated:
        return stated, "--unit"
    found = "no robot_type" if robot_type is None else f"the unknown robot_type {robot_type!r}"
    raise SystemExit(
        f"{place}: {found}, and the names of actions tell no units: state them: {choices}; or --joints FILE"
    )


def joints_of(folder: Path, data_set: DataSet, options: argparse.Namespace) -> tuple[list[Joint], str]:
    """The joints of the actions, and the source of their units."""
    if options.joints:
        try:
            from armwire import joints_file
        except ImportError as error:
            raise SystemExit(f"--joints needs the package armwire: {error}") from error
        try:
            named = joints_file.read(options.joints, arm=options.joints_of)
        except ValueError as error:
            raise SystemExit(str(error)) from error
        return [Joint(*joint) for joint in named], str(options.joints)
    name, source = chosen_unit(folder, data_set.robot_type, options.unit)
    unit = UNITS[name]
    factors = [unit.turn / math.tau] * 6 + [unit.open_gripper / (options.stroke_mm / 1000)]
    joints = [Joint(name, factor, 0.0) for name, factor in zip(NAMES, factors)]
    return joints, f"{name}, by {source}"


def pose(joints: list[Joint], action: list[float], stroke_mm: int) -> list[float]:
    """The pose of an action, in rad and m.

    Raises:
        ValueError: A value that the arm cannot have.
    """
    positions = []
    for nth, (joint, value) in enumerate(zip(joints, action)):
        position = (value - joint.offset) / joint.factor
        low, high = (-math.pi, math.pi - TICK) if nth < 6 else (0.0, stroke_mm / 1000)
        if not low - ROUNDING <= position <= high + ROUNDING:
            unit = "rad" if nth < 6 else "m"
            raise ValueError(
                f"{joint.name}.pos is {value:g}, which is {position:.4g} {unit}, not within {low:.4g} to {high:.4g}"
            )
        positions.append(position)
    return positions


def convert(options: argparse.Namespace) -> str:
    """Write the episode. Returns a summary."""
    folder, episode = options.dataset, options.episode
    data_set = read_info(folder)
    joints, source = joints_of(folder, data_set, options)
    expected = [f"{joint.name}.pos" for joint in joints]
    if data_set.names != expected:
        raise SystemExit(
            f"{folder}/meta/info.json: the actions are {data_set.names}, and not {expected}; a file for --joints may "
            "state other names"
        )
    files = sorted(map(str, (folder / "data").rglob("*.parquet")))
    try:
        data = pyarrow.dataset.dataset(files)
        of_episode = pyarrow.dataset.field("episode_index") == episode
        rows = data.to_table(["timestamp", "action"], filter=of_episode).to_pylist()
    except (OSError, pyarrow.ArrowException) as error:
        raise SystemExit(f"{folder}/data: {error}") from error
    if not rows:
        raise SystemExit(f"{folder}: there is no episode {episode}")
    poses = []
    for nth, row in enumerate(rows):
        try:
            poses.append(pose(joints, row["action"], options.stroke_mm))
        except ValueError as error:
            place = f"{folder}: action {nth} of episode {episode}"
            raise SystemExit(f"{place}: {error}: are the units {source}?") from error
    with options.out.open("xb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for row, positions in zip(rows, poses):
            # A stamp of zero is none.
            nanos = 1_000_000_000 + round(row["timestamp"] * 1e9)
            message = {
                "header": {
                    "stamp": {"sec": nanos // 1_000_000_000, "nanosec": nanos % 1_000_000_000},
                    "frame_id": "",
                },
                "name": NAMES,
                "position": positions,
                "velocity": [],
                "effort": [],
            }
            writer.write_message("/joint_states", schema, message, log_time=nanos, publish_time=nanos)
        writer.finish()
    return f"{len(rows)} poses ({source})"


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, metavar="DATASET", help="the folder of the data set")
    parser.add_argument("episode", type=int, metavar="EPISODE", help="the number of the episode, from 0")
    parser.add_argument("stroke_mm", type=int, metavar="STROKE_MM", choices=(50, 75, 100), help="that of the gripper")
    parser.add_argument("out", type=Path, metavar="OUT.mcap", help="the new file")
    units = parser.add_mutually_exclusive_group()
    units.add_argument("--unit", choices=sorted(UNITS), help="of the actions, if the robot_type does not tell it")
    units.add_argument("--joints", type=Path, metavar="FILE", help="names and units of the actions: docs/joints.md")
    parser.add_argument("--joints-of", metavar="NAME", help="the arm in that file, if it has several")
    return parser


if __name__ == "__main__":
    options = arguments().parse_args()
    if options.joints_of and not options.joints:
        arguments().error("--joints-of needs --joints")
    try:
        print(convert(options))
    except FileExistsError as error:
        sys.exit(f"{error.filename}: {error.strerror}")
