#!/usr/bin/env python3
"""Converts an episode of a LeRobot data set of a Ling arm to MCAP, for `armwire replay`.

Usage: lerobot_to_mcap.py DATASET EPISODE STROKE_MM OUT.mcap, where STROKE_MM is that of the gripper: 50, 75 or 100.
Needs `pip install mcap-ros2-support pyarrow`.

The actions must have the names and units of the plugin lerobot_robot_alicia_d_armwire: joint1.pos to joint6.pos in
degrees, and gripper.pos in thousandths of the stroke.
"""

import json
import math
import sys
from pathlib import Path

import pyarrow.dataset
from mcap_ros2.writer import Writer

NAMES = [f"joint{number}" for number in range(1, 7)] + ["gripper"]
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


def convert(folder: Path, episode: int, stroke_mm: int, out: Path) -> int:
    """Write the episode. Returns the number of its poses."""
    names = json.loads((folder / "meta/info.json").read_text())["features"]["action"]["names"]
    expected = [f"{name}.pos" for name in NAMES]
    if names != expected:
        raise SystemExit(f"{folder}: the actions are {names}, and not {expected}: their units are not known")
    data = pyarrow.dataset.dataset(sorted(map(str, (folder / "data").rglob("*.parquet"))))
    rows = data.to_table(["timestamp", "action"], filter=pyarrow.dataset.field("episode_index") == episode).to_pylist()
    if not rows:
        raise SystemExit(f"{folder}: there is no episode {episode}")
    with out.open("xb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for row in rows:
            # A stamp of zero is none.
            nanos = 1_000_000_000 + round(row["timestamp"] * 1e9)
            *joints, gripper = row["action"]
            message = {
                "header": {
                    "stamp": {"sec": nanos // 1_000_000_000, "nanosec": nanos % 1_000_000_000},
                    "frame_id": "",
                },
                "name": NAMES,
                "position": [*map(math.radians, joints), gripper * stroke_mm * 1e-6],
                "velocity": [],
                "effort": [],
            }
            writer.write_message("/joint_states", schema, message, log_time=nanos, publish_time=nanos)
        writer.finish()
    return len(rows)


if __name__ == "__main__":
    if len(sys.argv) != 5:
        raise SystemExit(__doc__)
    print(convert(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])), "poses")
