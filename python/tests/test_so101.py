import os
import re
import tty
from collections.abc import Iterator
from typing import Any

import pytest

from armwire import sim

PING, READ, WRITE = 1, 2, 3
TORQUE, GOAL, POSITION = 40, 42, 56


class Bus:
    """A program of its own: packets over the port."""

    def __init__(self, port: str) -> None:
        self._port = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._port)

    def close(self) -> None:
        os.close(self._port)

    def send(self, servo: int, code: int, data: bytes = b"") -> None:
        body = bytes([servo, len(data) + 2, code]) + data
        os.write(self._port, b"\xff\xff" + body + bytes([~sum(body) & 0xFF]))

    def call(self, servo: int, code: int, data: bytes, answer: int) -> tuple[int, bytes]:
        """Send a request, and return the error byte and the data of its answer of this many data bytes."""
        self.send(servo, code, data)
        got = b""
        while len(got) < answer + 6:
            got += os.read(self._port, answer + 6 - len(got))
        assert (sum(got[2:]) & 0xFF, got[:3]) == (0xFF, bytes([0xFF, 0xFF, servo])), got.hex(" ")
        return got[4], got[5:-1]

    def write(self, servo: int, address: int, value: int, size: int) -> int:
        return self.call(servo, WRITE, bytes([address]) + value.to_bytes(size, "little"), 0)[0]

    def read(self, servo: int, address: int, size: int) -> int:
        return int.from_bytes(self.call(servo, READ, bytes([address, size]), size)[1], "little")


@pytest.fixture
def virtual() -> Iterator[sim.VirtualSo101]:
    with sim.so101() as virtual:
        yield virtual


@pytest.fixture
def bus(virtual: sim.VirtualSo101) -> Iterator[Bus]:
    bus = Bus(virtual.port)
    yield bus
    bus.close()


def test_servo_moves_to_its_goal(virtual: sim.VirtualSo101, bus: Bus) -> None:
    assert bus.write(2, GOAL, 2500, 2) == 0
    while not 2498 <= bus.read(2, POSITION, 2) <= 2502:
        pass
    assert [servo.torque for servo in virtual.state()] == [False, True, False, False, False, False]


def test_orders_fail_answers(virtual: sim.VirtualSo101, bus: Bus) -> None:
    virtual.order("error 1 33")
    assert bus.call(1, PING, b"", 0) == (33, b"")
    virtual.order("clear")
    assert bus.call(1, PING, b"", 0) == (0, b"")
    virtual.order("twice")
    bus.call(1, PING, b"", 0)
    # The next bytes are those of servo 1 again.
    with pytest.raises(AssertionError, match="ff ff 01"):
        bus.call(2, PING, b"", 0)


def test_brownout_switches_torque_off(virtual: sim.VirtualSo101, bus: Bus) -> None:
    bus.write(1, TORQUE, 1, 1)
    virtual.order("brownout 1:0")
    bus.send(1, PING)
    # The supply is back at once, and that answer is lost.
    assert bus.read(2, TORQUE, 1) == 0
    assert not any(servo.torque for servo in virtual.state())


def test_hand_moves_a_servo_without_torque(virtual: sim.VirtualSo101, bus: Bus) -> None:
    virtual.order("hand 3 1000")
    assert bus.read(3, POSITION, 2) == 1000
    assert virtual.state()[2] == sim.ServoState(id=3, position=1000, encoder=1000.0, torque=False)
    bus.write(3, TORQUE, 1, 1)
    with pytest.raises(ValueError, match="servo 3 holds its position"):
        virtual.order("hand 3 1500")


def test_servos_are_those_stated() -> None:
    with sim.so101(ids=[7, 9], models=[777, 2825], volts=12) as virtual:
        bus = Bus(virtual.port)
        # 12 V is above the limit of an STS3215 for 7.4 V.
        assert bus.call(9, READ, bytes([3, 2]), 2) == (1, (2825).to_bytes(2, "little"))
        bus.close()


ORDERS = "late, damaged, twice, brownout, silent, unplugged, error, echo, sag, hand, clear, state"


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("late x", "'late x': expected late N[:MS]"),
        ("gremlins", f"unknown order 'gremlins': expected one of {ORDERS}"),
        ("", f"unknown order '': expected one of {ORDERS}"),
        ("silent 7", "no servo has id 7"),
        ("error 1 256", "'error 1 256': expected error ID BITS"),
        ("hand 2 4096", "servo 2: position is 4096 steps, must be 0..=4095"),
    ],
)
def test_wrong_orders_are_refused(virtual: sim.VirtualSo101, line: str, reason: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(reason)}$"):
        virtual.order(line)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"ids": [1, 2, 1]}, "two servos have id 1"),
        ({"ids": [254]}, "servo id is 254, must be 0..=253"),
        ({"ids": []}, "an arm has at least one servo"),
        ({"models": [777, 778]}, "there are 2 models for 6 servos: expected one, or one for each"),
        ({"volts": 26.0}, "supply is 26 V, must be 0..=25.4"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(reason)}$"):
        sim.so101(**arguments)
