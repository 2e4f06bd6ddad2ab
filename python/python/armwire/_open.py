"""What is open until it is closed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self


class _Closable(Protocol):
    def close(self) -> None: ...


class Open:
    """A context manager that closes what it opened."""

    def __init__(self, port: str, opened: _Closable) -> None:
        self.port = port
        """The port, as it was given."""
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
        """Close it, once the call that is under way is done. It may be closed twice."""
        self.__opened.close()
