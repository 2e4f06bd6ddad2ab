"""Configurations selected by name."""

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
        """Return a decorator that sets the name of a class."""

        def register(subclass: type) -> type:
            cls.choices[name] = subclass
            return subclass

        return register

    @property
    def type(self) -> str:
        """Return the name."""
        return next(name for name, choice in self.choices.items() if isinstance(self, choice))
