"""Alicia-D (Ling) follower and leader arms for LeRobot."""

from .alicia_d_armwire import AliciaDArmwire
from .alicia_d_leader_armwire import AliciaDLeaderArmwire
from .config_alicia_d_armwire import AliciaDArmwireConfig
from .config_alicia_d_leader_armwire import AliciaDLeaderArmwireConfig

__all__ = ["AliciaDArmwire", "AliciaDArmwireConfig", "AliciaDLeaderArmwire", "AliciaDLeaderArmwireConfig"]
