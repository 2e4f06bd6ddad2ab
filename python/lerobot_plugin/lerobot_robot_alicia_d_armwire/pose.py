"""A pose for LeRobot: by name, joints in degrees, the gripper from 0 (closed) to 1000 (open)."""

import armwire

JOINTS = tuple(f"joint{number}" for number in range(1, 7))
GRIPPER = "gripper"
FEATURES: dict[str, type] = {f"{name}.pos": float for name in (*JOINTS, GRIPPER)}

CALIBRATION = (
    "The servos of an Alicia-D store the factory's zero position: no calibration is needed. `armwire set-zero PORT` "
    "makes the current pose the zero position permanently. Leader and follower need the same zero pose."
)


def pose(state: armwire.JointState) -> dict[str, float]:
    """The pose in an arm's joint state."""
    values = [*state.joints_deg.tolist(), float(state.gripper_permille)]
    return dict(zip(FEATURES, values, strict=True))
