"""The configuration of a follower."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("alicia_d_armwire")
@dataclass(kw_only=True)
class AliciaDArmwireConfig(RobotConfig):
    """A follower arm."""

    port: str
    """As `armwire.Ling` takes it: a serial port, `tcp:HOST:PORT`, `can:IFACE/NODE`, `slcan:PORT@BITRATE/NODE`."""
    baud: int | None = None
    """Of the serial port; 1000000 unless given."""
    speed_deg_s: float = 120.0
    """How fast each joint moves to an action, up to 439."""
    gripper_ticks_s: int = 5500
    """How fast the gripper moves."""
    max_relative_target: float | dict[str, float] | None = None
    """By how many degrees at most an action may be away from where the joints are; farther ones are cut to it.

    One number for all joints, or by name, `joint1` to `joint6`. It costs a read for each action."""
    action_timeout_s: float = 0.5
    """After how long without a further action the arm is stopped where it is. 0 for never."""
    disable_torque_on_disconnect: bool = False
    """The arm falls then: hold it."""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    """As of any robot of LeRobot."""

    def __post_init__(self) -> None:
        """Check what would move the arm in a way that nobody wants."""
        super().__post_init__()
        if not 0 < self.speed_deg_s <= 439:
            raise ValueError(f"speed_deg_s is {self.speed_deg_s}, must be over 0 and up to 439")
        if not self.action_timeout_s >= 0:
            raise ValueError(f"action_timeout_s is {self.action_timeout_s}, must be 0 or more")
