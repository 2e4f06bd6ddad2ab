"""st3215-bus, with one bus. It tries each request twice."""

from st3215_bus import Buses

from programs import IDS

REGISTERS = {"position": "PresentPosition", "voltage": "PresentVoltage", "torque": "TorqueEnable"}


class Program:
    def __init__(self, port: str) -> None:
        self._buses = Buses({"arm": port}, timeout_ms=30)

    def positions(self) -> dict[int, int]:
        return self._buses.read_positions(IDS)["arm"]

    def read(self, servo: int, register: str) -> int | None:
        return self._buses.read_register(REGISTERS[register], [servo])["arm"].get(servo)

    def set_goals(self, position: int) -> None:
        self._buses.write_goals({"arm": dict.fromkeys(IDS, position)})

    def set_speeds(self, speed: int) -> None:
        self._buses.write_register("GoalSpeed", {"arm": dict.fromkeys(IDS, speed)})

    def switch_torque_on(self) -> None:
        self._buses.set_torque(True, IDS)

    def close(self) -> None:
        self._buses.set_torque(False, IDS)
        self._buses.close()
