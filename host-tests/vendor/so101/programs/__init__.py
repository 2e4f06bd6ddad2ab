"""Programs for Feetech servos, each behind the same few calls."""

from typing import Any, Protocol

IDS = [1, 2, 3, 4, 5, 6]


class Program(Protocol):
    """A program on a bus of six servos with ids 1 to 6. Errors of the program are its own exceptions."""

    def __init__(self, port: str) -> None:
        """Open the port, and look for the servos if the program does so."""

    def positions(self) -> dict[int, Any]:
        """The positions of all servos, by id, without those that it has no position of."""

    def read(self, servo: int, register: str) -> Any:
        """The `position`, `voltage` or `torque` of one servo. None if the program has no value."""

    def set_goals(self, position: int) -> None:
        """Set the goal of every servo."""

    def set_speeds(self, speed: int) -> None:
        """Set the speed of every servo, in steps per second."""

    def switch_torque_on(self) -> None:
        """Switch the torque of every servo on."""

    def close(self) -> None:
        """Switch the torque of every servo off, and close the port."""
