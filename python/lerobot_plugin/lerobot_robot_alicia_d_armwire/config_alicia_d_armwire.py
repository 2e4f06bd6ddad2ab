"""The configuration of a follower."""

import math
from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig

from .arm_config import ArmConfig
from .pose import JOINTS


@RobotConfig.register_subclass("alicia_d_armwire")
@dataclass(kw_only=True)
class AliciaDArmwireConfig(RobotConfig, ArmConfig):
    """A follower arm."""

    speed_deg_s: float = 120.0
    """Speed of each joint in degrees per second, up to 439."""
    gripper_ticks_s: int = 5500
    """Speed of the gripper in ticks per second."""
    max_relative_target: float | dict[str, float] | None = None
    """Maximum distance of an action from the current joints, in degrees. Larger distances are clamped.

    One number for all joints, or by name, `joint1` to `joint6`. It costs a read for each action."""
    observation_max_age_s: float = 0.1
    """Maximum age of an observed pose in seconds. The next one is waited for if it is older."""
    action_timeout_s: float = 0.5
    """Time without an action after which the arm stops, in seconds. 0 disables it."""
    disable_torque_on_disconnect: bool = False
    """Switch the torque off on disconnect. The arm falls: hold it."""
    park_on_disconnect: bool = False
    """Go slowly to the pose that `armwire park --save` has saved for this arm, and switch the torque off there.

    An arm without a saved pose cannot be connected then."""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    """Cameras, as for other LeRobot robots."""

    def __post_init__(self) -> None:
        """Reject values that would move the arm unexpectedly."""
        super().__post_init__()
        if not 4.4 <= self.speed_deg_s <= 439:
            raise ValueError(f"speed_deg_s is {self.speed_deg_s}, must be 4.4 to 439")
        if self.park_on_disconnect and self.disable_torque_on_disconnect:
            raise ValueError("park_on_disconnect and disable_torque_on_disconnect exclude each other")
        if not (self.action_timeout_s >= 0 and math.isfinite(self.action_timeout_s)):
            raise ValueError(f"action_timeout_s is {self.action_timeout_s}, must be 0 or more")
        self.check_reading("observation_max_age_s")
        if self.gripper_ticks_s not in range(1, 0x10000):
            raise ValueError(f"gripper_ticks_s is {self.gripper_ticks_s}, must be 1 to 65535")
        limit = self.max_relative_target
        limits = limit if isinstance(limit, dict) else {} if limit is None else {"joint1": limit}
        for name, value in limits.items():
            if name not in JOINTS:
                raise ValueError(f"max_relative_target has {name!r}, must be among {', '.join(JOINTS)}")
            if not (value > 0 and math.isfinite(value)):
                raise ValueError(f"max_relative_target is {limit}, must be over 0")
