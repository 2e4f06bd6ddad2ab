"""Teleoperators."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..choice import Choice
from ..device import Device


@dataclass(kw_only=True)
class TeleoperatorConfig(Choice):
    """The configuration of a teleoperator."""

    choices: ClassVar[dict[str, type]] = {}

    id: str | None = None
    calibration_dir: Path | None = None


class Teleoperator(Device):
    """A teleoperator."""

    @property
    @abstractmethod
    def feedback_features(self) -> dict[str, Any]: ...

    @abstractmethod
    def get_action(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_feedback(self, feedback: dict[str, Any]) -> None: ...
