"""What the two packages with the module `scservo_sdk` share. Loops over servos end at the first error."""

from typing import Any

from scservo_sdk import GroupSyncRead, GroupSyncWrite, PortHandler

from programs import IDS

TORQUE, GOAL, SPEED, POSITION, VOLTAGE = 40, 42, 46, 56, 62


def opened(path: str) -> PortHandler:
    """Open a port."""
    port = PortHandler(path)
    if not port.openPort():
        raise OSError(f"cannot open {path}")
    return port


class ScservoProgram:
    """A program that uses this SDK.

    Args:
        port: The open port.
        packets: The SDK's packet handler.
        is_own_port: The packet handler has the port. Otherwise it takes it with each call.
    """

    def __init__(self, port: PortHandler, packets: Any, *, is_own_port: bool) -> None:
        self._port, self._packets = port, packets
        self._before = () if is_own_port else (port,)

    def positions(self) -> dict[int, int]:
        group = GroupSyncRead(*self._before, self._packets, POSITION, 2)
        for servo in IDS:
            group.addParam(servo)
        self._check(group.txRxPacket())
        # The later SDK returns the error byte, too.
        return {
            servo: group.getData(servo, POSITION, 2)
            for servo in IDS
            if group.isAvailable(servo, POSITION, 2) not in (False, (False, 0))
        }

    def read(self, servo: int, register: str) -> int:
        if register == "position":
            read = self._packets.read2ByteTxRx(*self._before, servo, POSITION)
        else:
            address = {"voltage": VOLTAGE, "torque": TORQUE}[register]
            read = self._packets.read1ByteTxRx(*self._before, servo, address)
        value, result, error = read
        self._check(result, error)
        return value

    def set_goals(self, position: int) -> None:
        self._write_all(GOAL, position)

    def set_speeds(self, speed: int) -> None:
        self._write_all(SPEED, speed)

    def switch_torque_on(self) -> None:
        self._switch_torque(1)

    def close(self) -> None:
        self._switch_torque(0)
        self._port.closePort()

    def _switch_torque(self, value: int) -> None:
        for servo in IDS:
            self._check(*self._packets.write1ByteTxRx(*self._before, servo, TORQUE, value))

    def _write_all(self, address: int, value: int) -> None:
        group = GroupSyncWrite(*self._before, self._packets, address, 2)
        for servo in IDS:
            group.addParam(servo, list(value.to_bytes(2, "little")))
        self._check(group.txPacket())

    def _check(self, result: int, error: int = 0) -> None:
        if result != 0:
            raise ConnectionError(self._packets.getTxRxResult(result))
        if error != 0:
            raise RuntimeError(self._packets.getRxPacketError(error))
