"""The configuration of a leader."""

from dataclasses import dataclass

from lerobot.teleoperators import TeleoperatorConfig

from lerobot_robot_alicia_d_armwire.pose import check_reading


@TeleoperatorConfig.register_subclass("alicia_d_leader_armwire")
@dataclass(kw_only=True)
class AliciaDLeaderArmwireConfig(TeleoperatorConfig):
    """A leader arm, moved by hand."""

    port: str
    """The port, as for `armwire.Ling`."""
    baud: int | None = None
    """The serial port's baud rate; 1000000 by default."""
    reading_rate_hz: int = 200
    """Readings of the pose per second, 1 to 1000."""
    action_max_age_s: float = 0.1
    """Maximum age of an action's pose in seconds. An older one is an error."""

    def __post_init__(self) -> None:
        """Reject values out of range."""
        check_reading(self.reading_rate_hz, "action_max_age_s", self.action_max_age_s)
