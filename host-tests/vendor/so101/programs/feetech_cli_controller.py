"""The controller of feetech-cli. Loops over servos end at the first error."""

from feetech_cli.controller import FeetechServoController

from programs import IDS

POSITION = 56
REGISTERS = {"position": "present_position", "voltage": "present_voltage", "torque": "torque_enable"}


class Program:
    def __init__(self, port: str) -> None:
        self._controller = FeetechServoController(
            port=port, baudrate=1_000_000, timeout=0.05, min_id=IDS[0], max_id=IDS[-1]
        )
        self._controller.open()
        self._speed = 0

    def positions(self) -> dict[int, int]:
        read = self._controller.sync_read(IDS, POSITION, 2)
        return {servo: int.from_bytes(data, "little") for servo, (_, data) in read.items()}

    def read(self, servo: int, register: str) -> int:
        return self._controller.read_register(servo, REGISTERS[register])

    def set_goals(self, position: int) -> None:
        self._controller.sync_write_positions(IDS, [position] * len(IDS), velocity=self._speed)

    def set_speeds(self, speed: int) -> None:
        # A goal is written with its speed.
        self._speed = speed

    def switch_torque_on(self) -> None:
        self._switch_torque(True)

    def close(self) -> None:
        self._switch_torque(False)
        self._controller.close()

    def _switch_torque(self, is_on: bool) -> None:
        for servo in IDS:
            self._controller.set_torque(servo, is_on)
