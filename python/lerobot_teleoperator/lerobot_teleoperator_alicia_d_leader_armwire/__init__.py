"""Alicia-D (Ling) leader arms for LeRobot."""

from .alicia_d_leader_armwire import AliciaDLeaderArmwire
from .config_alicia_d_leader_armwire import AliciaDLeaderArmwireConfig

__all__ = ["AliciaDLeaderArmwire", "AliciaDLeaderArmwireConfig"]
