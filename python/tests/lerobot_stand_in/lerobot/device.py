"""The common part of robots and teleoperators."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any


class Device(ABC):
    """A device with a configuration, and the methods that a subclass must implement."""

    config_class: type
    name: str

    def __init__(self, config: Any) -> None:
        self.id = config.id

    def __str__(self) -> str:
        return f"{self.id} {type(self).__name__}"

    @property
    @abstractmethod
    def is_connected(self) -> bool: ...

    @abstractmethod
    def connect(self, calibrate: bool = True) -> None: ...

    @property
    @abstractmethod
    def is_calibrated(self) -> bool: ...

    @abstractmethod
    def calibrate(self) -> None: ...

    @abstractmethod
    def configure(self) -> None: ...

    @property
    @abstractmethod
    def action_features(self) -> dict[str, Any]: ...

    @abstractmethod
    def disconnect(self) -> None: ...
