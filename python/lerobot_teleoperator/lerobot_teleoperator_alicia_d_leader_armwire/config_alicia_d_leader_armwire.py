"""The configuration of a leader."""

from dataclasses import dataclass

from lerobot.teleoperators import TeleoperatorConfig

from lerobot_robot_alicia_d_armwire.arm_config import ArmConfig


@TeleoperatorConfig.register_subclass("alicia_d_leader_armwire")
@dataclass(kw_only=True)
class AliciaDLeaderArmwireConfig(TeleoperatorConfig, ArmConfig):
    """A leader arm, moved by hand."""

    action_max_age_s: float = 0.1
    """Maximum age of an action's pose in seconds. The next one is waited for if it is older."""

    def __post_init__(self) -> None:
        """Reject values out of range."""
        self.check_reading("action_max_age_s")
