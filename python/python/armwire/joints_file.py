"""Names and units of joints as other programs have them, from a joints file.

The page joints.md of the guide describes the file. The command, the ROS 2 node and `armwire.plot` read the same one.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from ._armwire import read_joints_file


class Joint(NamedTuple):
    """A joint, or the gripper: value = factor * arm + offset.

    The arm's side is an angle in rad, or the opening of the gripper in m, where 0 is closed.
    """

    name: str
    factor: float
    offset: float

    def value(self, arm: float) -> float:
        """The value of the other program at this angle in rad, or opening in m."""
        return self.factor * arm + self.offset

    def arm(self, value: float) -> float:
        """The angle in rad, or the opening in m, at this value of the other program."""
        return (value - self.offset) / self.factor


ARM = [Joint(name, 1.0, 0.0) for name in (*(f"joint{number}" for number in range(1, 7)), "gripper")]
"""The joints and the gripper as the arm has them."""


def read(path: str | Path, *, arm: str | None = None) -> list[Joint]:
    """Read the six joints and the gripper of an arm.

    Args:
        path: The file.
        arm: The arm's name; not needed if the file has one arm.

    Raises:
        ValueError: The file cannot be read, is wrong, or does not have the arm; the message has the place.
    """
    return [Joint(*joint) for joint in read_joints_file(os.fspath(path), arm)]
