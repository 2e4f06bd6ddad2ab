"""The base class of open ports."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self


class _Closable(Protocol):
    def close(self) -> None: ...


class Open:
    """A context manager that closes its port on exit."""

    def __init__(self, port: str, opened: _Closable) -> None:
        self.port = port
        """The port, as it was opened."""
        self.__opened = opened

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.port!r})"

    def close(self) -> None:
        """Close the port, after the current call ends. Closing it again has no effect."""
        self.__opened.close()
