"""Robots."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..choice import Choice
from ..device import Device


@dataclass(kw_only=True)
class RobotConfig(Choice):
    """The configuration of a robot."""

    choices: ClassVar[dict[str, type]] = {}

    id: str | None = None
    calibration_dir: Path | None = None

    def __post_init__(self) -> None:
        """Check nothing: there are no cameras."""


class Robot(Device):
    """A robot."""

    @property
    @abstractmethod
    def observation_features(self) -> dict[str, Any]: ...

    @abstractmethod
    def get_observation(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]: ...
