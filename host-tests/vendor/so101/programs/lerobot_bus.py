"""The bus of LeRobot, as its SO-101 follower uses it."""

from lerobot.motors import Motor, MotorNormMode
from lerobot.motors.feetech import FeetechMotorsBus

NAMES = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
REGISTERS = {"position": "Present_Position", "voltage": "Present_Voltage", "torque": "Torque_Enable"}
# `num_read_retries` of SOFollowerConfig.
RETRIES = 2


def bus(port: str) -> FeetechMotorsBus:
    """A bus of this port, not connected yet."""
    motors = {name: Motor(servo, "sts3215", MotorNormMode.DEGREES) for servo, name in enumerate(NAMES, 1)}
    return FeetechMotorsBus(port, motors)


class Program:
    def __init__(self, port: str) -> None:
        self._bus = bus(port)
        self._bus.connect()

    def positions(self) -> dict[int, int]:
        read = self._bus.sync_read("Present_Position", normalize=False, num_retry=RETRIES)
        return dict(enumerate(read.values(), 1))

    def read(self, servo: int, register: str) -> int:
        return self._bus.read(REGISTERS[register], NAMES[servo - 1], normalize=False, num_retry=RETRIES)

    def set_goals(self, position: int) -> None:
        self._bus.sync_write("Goal_Position", dict.fromkeys(NAMES, position), normalize=False)

    def set_speeds(self, speed: int) -> None:
        self._bus.sync_write("Goal_Velocity", dict.fromkeys(NAMES, speed))

    def switch_torque_on(self) -> None:
        self._bus.enable_torque()

    def close(self) -> None:
        self._bus.disconnect()
