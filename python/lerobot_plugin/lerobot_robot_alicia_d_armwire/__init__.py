"""Alicia-D (Ling) follower arms for LeRobot."""

from .alicia_d_armwire import AliciaDArmwire
from .config_alicia_d_armwire import AliciaDArmwireConfig

__all__ = ["AliciaDArmwire", "AliciaDArmwireConfig"]
