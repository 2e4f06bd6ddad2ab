"""The configuration of a leader."""

from dataclasses import dataclass

from lerobot.teleoperators import TeleoperatorConfig


@TeleoperatorConfig.register_subclass("alicia_d_leader_armwire")
@dataclass(kw_only=True)
class AliciaDLeaderArmwireConfig(TeleoperatorConfig):
    """A leader arm, moved by hand."""

    port: str
    """As `armwire.Ling` takes it."""
    baud: int | None = None
    """Of the serial port; 1000000 unless given."""
