"""Configurations that are chosen by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar


class Choice:
    """A base class whose subclasses have names."""

    choices: ClassVar[dict[str, type]]

    id: str | None
    calibration_dir: Path | None

    @classmethod
    def register_subclass(cls, name: str) -> Any:
        """A decorator that gives a class its name."""

        def register(subclass: type) -> type:
            cls.choices[name] = subclass
            return subclass

        return register

    @property
    def type(self) -> str:
        """The name."""
        return next(name for name, choice in self.choices.items() if isinstance(self, choice))
