"""The controller of rustypot for this servo. Loops over servos end at the first error."""

from typing import Any

from rustypot import Sts3215PyController

from programs import IDS


class Program:
    def __init__(self, port: str) -> None:
        self._controller = Sts3215PyController(port, 1_000_000, 0.05)

    def positions(self) -> dict[int, int]:
        return dict(zip(IDS, self._controller.sync_read_raw_present_position(IDS), strict=True))

    def read(self, servo: int, register: str) -> Any:
        reads = {
            "position": self._controller.read_raw_present_position,
            "voltage": self._controller.read_present_voltage,
            "torque": self._controller.read_torque_enable,
        }
        (value,) = reads[register](servo)
        return value

    def set_goals(self, position: int) -> None:
        self._controller.sync_write_raw_goal_position(IDS, [position] * len(IDS))

    def set_speeds(self, speed: int) -> None:
        self._controller.sync_write_raw_goal_speed(IDS, [speed] * len(IDS))

    def switch_torque_on(self) -> None:
        self._switch_torque(True)

    def close(self) -> None:
        self._switch_torque(False)
        del self._controller

    def _switch_torque(self, is_on: bool) -> None:
        for servo in IDS:
            self._controller.write_torque_enable(servo, is_on)
