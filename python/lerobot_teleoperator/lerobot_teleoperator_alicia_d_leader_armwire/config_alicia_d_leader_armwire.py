"""The configuration of a leader."""

from dataclasses import dataclass

from lerobot.teleoperators import TeleoperatorConfig


@TeleoperatorConfig.register_subclass("alicia_d_leader_armwire")
@dataclass(kw_only=True)
class AliciaDLeaderArmwireConfig(TeleoperatorConfig):
    """A leader arm, moved by hand."""

    port: str
    """The port, as for `armwire.Ling`."""
    baud: int | None = None
    """The serial port's baud rate; 1000000 by default."""
