"""Drives a virtual follower arm over CAN with python-can, can-isotp and cantools, and checks all received values.

Usage: can_session.py PORT NODE

PORT is an SLCAN port on the adapter's bus, NODE the adapter's node id. The bus is classic CAN at 1 Mbit/s. The arm has
just been switched on: at its zero position, gripper closed, torque on. The session changes the adapter's configuration
and does not restore it.
"""

import random
import struct
import sys
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Self

import can
import isotp

import ling
from checks import SILENCE, STEP_TIMEOUT, expect, require, wait_until
from dbc import Dbc
from ling import CENTRE

# Identifiers of node 0: see docs/can.md.
ARM_REQUEST, ARM_ANSWER = 0x600, 0x610
CONTROL_REQUEST, CONTROL_ANSWER = 0x640, 0x650
CYCLIC = range(0x200, 0x250)

# The version of the control port's messages.
VERSION = 7

# Kinds and initiators of EVENT.
QUEUE_FULL, NO_FRAME, INCOMPLETE, STALE, OUT_OF_RANGE, HOST_SILENT = 1, 2, 3, 4, 5, 16
BY_CAN, BY_COMMAND = 2, 4

# Motion status of a Ling arm.
IDLE, LOCKED = 0, 1
# The speed of the gripper in moves of the vendor's software.
GRIPPER_SPEED = 5500

# The adapter's configuration in this session. The timeouts are long enough for Python and a busy bus.
POLL_HZ, TELEMETRY_HZ, COMMAND_TIMEOUT_MS, HOST_TIMEOUT_MS = 100, 50, 1000, 1000

MOVES = 50
# Refused requests and commands of this session: six that are not a frame, one that is too long, three commands.
REFUSED = 10
# ISO-TP with padding, and with timeouts of 10 s instead of the standard's 1 s.
ISOTP = {"tx_padding": 0x55, "rx_flowcontrol_timeout": 10_000, "rx_consecutive_frame_timeout": 10_000}


class Adapter:
    """An adapter on the bus: ISO-TP to the arm and to the control port, and the adapter's cyclic frames."""

    def __init__(self, port: str, node: int) -> None:
        self.node = node
        self.dbc = Dbc()
        self._bus = can.Bus(interface="slcan", channel=port, bitrate=1_000_000, sleep_after_open=0.2)
        self.cyclic = Cyclic(self.dbc, node)
        self.transport = Transport(node)
        self._notifier = can.Notifier(self._bus, [self.cyclic, self.transport])
        self.arm = self.connect(ARM_REQUEST, ARM_ANSWER)
        self.control = self.connect(CONTROL_REQUEST, CONTROL_ANSWER)
        self._sequence = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.arm.stop()
        self.control.stop()
        self._notifier.stop()
        self._bus.shutdown()

    def connect(self, request: int, answer: int, **params: Any) -> "Connection":
        return Connection(self._bus, self._notifier, request | self.node, answer | self.node, params)

    def read(self, request: bytes) -> bytes:
        """The data of the arm's answer to a request."""
        self.arm.send(request)
        answer = self.arm.receive()
        require(f"{answer.hex(' ')} is one whole frame", ling.is_frame(answer))
        require(f"{answer.hex(' ')} answers {request.hex(' ')}", answer[:3] == request[:3])
        return answer[4:-2]

    def joints(self) -> tuple[tuple[int, ...], int, int]:
        """Positions in ticks, gripper in thousandths of its stroke, and motion status."""
        *joints, gripper, status = struct.unpack("<7HB", self.read(ling.frame(0x06, 0x00)))
        return tuple(joints), gripper, status

    def velocities(self) -> tuple[int, ...]:
        """Speeds of the ten servos, in ticks/s."""
        return struct.unpack("<10H", self.read(ling.frame(0x06, 0x02)))

    def move(self, joints: tuple[int, ...], gripper: int, speed: int) -> None:
        """Starts a move. The arm does not answer."""
        axes = [value for ticks in joints for value in (ticks, speed)]
        self.arm.send(ling.frame(0x06, 0x03, struct.pack("<14H", *axes, gripper, GRIPPER_SPEED)))

    def set_torque(self, on: bool) -> None:
        self.arm.send(ling.frame(0x05, 0x00, bytes([on])))

    def call(self, request: bytes) -> bytes:
        """The adapter's reply to a request on the control port, both in postcard format."""
        self._sequence += 1
        self.control.send(bytes([self._sequence]) + request)
        reply = self.control.receive()
        require(f"{reply.hex(' ')} is reply {self._sequence}", reply[:2] == bytes([0, self._sequence]))
        return reply[2:]

    def command(self, sequence: int, joints: tuple[int, ...], gripper: float, speed: float) -> None:
        """Sends a command: joints in ticks, gripper as a fraction of its stroke, speed in rad/s."""
        for half in self.command_halves(sequence, joints, gripper, speed):
            self.send(half)

    def command_halves(self, sequence: int, joints: tuple[int, ...], gripper: float, speed: float) -> list[can.Message]:
        """The two frames of a command."""
        angles = {f"Joint{number}": radians(ticks) for number, ticks in enumerate(joints, start=1)}
        values = angles | {"Sequence": sequence, "Speed": speed, "Gripper": gripper}
        frames = [self.dbc.encode(name, self.node, values) for name in ("CommandA", "CommandB")]
        return [can.Message(arbitration_id=id, data=data, is_extended_id=False) for id, data in frames]

    def send(self, message: can.Message) -> None:
        self._bus.send(message)


class Connection:
    """ISO-TP with the adapter, by can-isotp."""

    def __init__(self, bus: can.BusABC, notifier: can.Notifier, tx: int, rx: int, params: dict[str, Any]) -> None:
        self.errors: list[Exception] = []
        address = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=tx, rxid=rx)
        self._stack = isotp.NotifierBasedCanStack(
            bus, notifier, address=address, error_handler=self.errors.append, params=ISOTP | params
        )
        self._stack.start()

    def send(self, pdu: bytes) -> None:
        """Sends a PDU, and waits for the end of its transfer."""
        self._stack.send(pdu)
        wait_until("the PDU is transferred", lambda: not self._stack.transmitting(), quiet=True)
        require(f"ISO-TP has no errors: {self.errors}", not self.errors)

    def receive(self) -> bytes:
        pdu = self._stack.recv(block=True, timeout=STEP_TIMEOUT)
        fact = f"a PDU arrives within {STEP_TIMEOUT:.0f} s without errors: {self.errors}"
        require(fact, pdu is not None and not self.errors)
        return bytes(pdu)

    def send_refused(self, pdu: bytes) -> list[Exception]:
        """Sends a PDU that the adapter refuses. Returns the errors."""
        self._stack.send(pdu)
        wait_until("can-isotp reports an error", lambda: bool(self.errors), quiet=True)
        errors, self.errors[:] = list(self.errors), []
        return errors

    def is_silent(self) -> bool:
        return self._stack.recv(block=True, timeout=SILENCE) is None and not self.errors

    def stop(self) -> None:
        self._stack.stop()


class Cyclic(can.Listener):
    """The adapter's cyclic frames, decoded by cantools."""

    def __init__(self, dbc: Dbc, node: int) -> None:
        self._dbc = dbc
        self._node = node
        self._lock = threading.Lock()
        self._parts: dict[str, dict[str, float]] = {}
        self._samples: list[dict[str, float]] = []
        self._events: list[tuple[int, int]] = []
        self._errors: dict[str, float] | None = None
        self.decode_errors: list[str] = []

    def on_message_received(self, message: can.Message) -> None:
        identifier = message.arbitration_id
        if identifier not in CYCLIC or identifier & 0xF != self._node:
            return
        try:
            name, values = self._dbc.decode(identifier, bytes(message.data))
        except ValueError as error:
            self.decode_errors.append(str(error))
            return
        with self._lock:
            if name == "Event":
                self._events.append((int(values["Kind"]), int(values["Initiator"])))
            elif name == "Errors":
                self._errors = values
            else:
                self._parts[name] = values
                self._join_parts()

    def _join_parts(self) -> None:
        """Joins three frames with the same stamp into a sample."""
        a, b, state = (self._parts.get(name) for name in ("JointsA", "JointsB", "State"))
        if a is None or b is None or state is None:
            return
        if a["Stamp"] == b["Stamp"] == int(state["Stamp"]) & 0xFFFF:
            self._parts.clear()
            self._samples.append(a | b | state)

    def clear(self) -> None:
        with self._lock:
            self._samples.clear()
            self._events.clear()
            self._errors = None

    def samples(self) -> list[dict[str, float]]:
        with self._lock:
            return list(self._samples)

    def events(self) -> list[tuple[int, int]]:
        with self._lock:
            return list(self._events)

    def errors(self) -> dict[str, float]:
        """The next ERRORS frame."""
        with self._lock:
            self._errors = None
        wait_until("ERRORS arrives", lambda: self._errors is not None, quiet=True)
        return dict(self._errors or {})


class Transport(can.Listener):
    """The adapter's ISO-TP frames on the bus."""

    def __init__(self, node: int) -> None:
        self._answers = (ARM_ANSWER | node, CONTROL_ANSWER | node)
        self.flow_controls: set[bytes] = set()
        self.lengths: set[int] = set()

    def on_message_received(self, message: can.Message) -> None:
        if message.arbitration_id in self._answers:
            self.lengths.add(len(message.data))
            if message.data[0] >> 4 == 3:
                self.flow_controls.add(bytes(message.data[:3]))


def main(port: str, node: int) -> None:
    with Adapter(port, node) as adapter:
        configure(adapter)
        before = adapter.cyclic.errors()
        check_identity(adapter)
        check_rest(adapter)
        check_torque(adapter)
        check_motion(adapter)
        check_random_moves(adapter)
        check_flow_control(adapter)
        check_refusals(adapter)
        check_commands(adapter)
        check_refused_commands(adapter)
        after = adapter.cyclic.errors()
        counted = {name: after[name] - before[name] for name in after if after[name] != before[name]}
        expect(f"only the expected refusals are counted: {counted}", counted == {"Refused": REFUSED})
        errors = adapter.cyclic.decode_errors
        expect(f"each cyclic frame agrees with the .dbc: {errors}", not errors)
        expect("each ISO-TP frame is padded to 8 bytes", adapter.transport.lengths == {8})
        sent = {flow.hex(" ") for flow in adapter.transport.flow_controls}
        expect(f"flow control frames request no pauses or report an overflow: {sent}", sent == {"30 00 00", "32 00 00"})
    print("python-can, can-isotp and cantools drive the arm")


def configure(adapter: Adapter) -> None:
    """Switches polls, telemetry and commands on."""
    reply = adapter.call(bytes([0]))
    expect(f"the adapter identifies itself with version {VERSION}", reply[:2] == bytes([2, VERSION]))
    # A Config: a Ling arm; Poll::Hertz; CAN; commands; host timeout.
    config = bytes([0])
    config += bytes([1]) + varint(POLL_HZ)
    config += bytes([adapter.node]) + varint(1_000_000) + bytes([0]) + varint(TELEMETRY_HZ)
    config += bytes([1]) + varint(COMMAND_TIMEOUT_MS) + bytes([0])
    config += varint(HOST_TIMEOUT_MS) + bytes([0])
    expect("the adapter accepts a configuration", adapter.call(bytes([3]) + config) == bytes([0]))
    expect("the adapter returns this configuration", adapter.call(bytes([2])) == bytes([4]) + config)
    wait_until("ten samples arrive", lambda: len(adapter.cyclic.samples()) >= 10)


def check_identity(adapter: Adapter) -> None:
    serial, hardware, firmware = struct.unpack("<16sII", adapter.read(ling.frame(0x01, 0x00)))
    expect(f"serial number {serial}", serial == ling.SERIAL_NUMBER.encode())
    expect(f"hardware {hardware}, firmware {firmware}", (hardware, firmware) == (110, 610))
    stroke = adapter.read(ling.frame(0x04, 0x0E))
    expect(f"gripper stroke {stroke.hex()}", stroke == bytes([0]))


def check_rest(adapter: Adapter) -> None:
    joints, gripper, status = adapter.joints()
    expect(f"joints at {joints}, gripper at {gripper}", (joints, gripper) == ((CENTRE,) * 6, 0))
    expect(f"status {status}, locked", status == LOCKED)
    temperatures = adapter.read(ling.frame(0x06, 0x01))
    plausible = all(20 <= celsius <= 40 for celsius in temperatures)
    expect(f"temperatures {list(temperatures)} °C", len(temperatures) == 10 and plausible)
    expect("all ten servos are at rest", adapter.velocities() == (0,) * 10)
    # The request as printed in the document, with a length of 0.
    check = adapter.read(bytes.fromhex("AA FE 00 00 FE 93 FF"))
    expect(f"self-check {check.hex()}", check == bytes([0xFF, 0x03]))
    check_telemetry(adapter)


def check_torque(adapter: Adapter) -> None:
    adapter.set_torque(False)
    wait_until("torque is off", lambda: adapter.joints()[2] == IDLE)
    adapter.move((CENTRE + 100,) * 6, gripper=500, speed=5000)
    time.sleep(0.3)
    expect("the arm does not move without torque", adapter.joints() == ((CENTRE,) * 6, 0, IDLE))
    check_telemetry(adapter)
    adapter.set_torque(True)
    wait_until("torque is on", lambda: adapter.joints()[2] == LOCKED)


def check_motion(adapter: Adapter) -> None:
    target = (2161, 1820, 2389, 2048, 2560, 1024)
    adapter.cyclic.clear()
    adapter.move(target, gripper=500, speed=700)
    fastest = 0
    while adapter.joints()[:2] != (target, 500):
        fastest = max(fastest, *adapter.velocities()[: ling.JOINT_SERVOS])
    expect(f"joints reach {target}, at up to {fastest} ticks/s", fastest == 700)
    expect("all servos are at rest again", adapter.velocities() == (0,) * 10)

    samples = adapter.cyclic.samples()
    stamps = [int(sample["Stamp"]) for sample in samples]
    expect(f"the stamps of {len(samples)} samples increase", stamps == sorted(set(stamps)))
    counts = [int(sample["Count"]) for sample in samples]
    expect("no sample is missing", all((b - a) % 256 == 1 for a, b in pairwise(counts)))
    falling = [ticks(sample["Joint6"]) for sample in samples]
    expect("joint 6 falls in the samples", falling == sorted(falling, reverse=True) and len(set(falling)) > 10)
    check_telemetry(adapter)


def check_random_moves(adapter: Adapter) -> None:
    """Random moves, each checked by ISO-TP and by telemetry."""
    random.seed(4)
    for _ in range(MOVES):
        target = tuple(random.randrange(CENTRE - 300, CENTRE + 300) for _ in range(6))
        gripper = random.randrange(1001)
        adapter.move(target, gripper, speed=5000)
        goal = (target, gripper, LOCKED)
        wait_until(f"joints reach {goal}", lambda: adapter.joints() == goal, quiet=True)
        check_telemetry(adapter, quiet=True)
    print(f"ok: ISO-TP and telemetry agree after {MOVES} random moves", flush=True)


def check_flow_control(adapter: Adapter) -> None:
    """Answers are the same with pauses and small blocks."""
    before = adapter.joints()
    adapter.arm.stop()
    for block_size, st_min in [(1, 0), (2, 0xF5), (0, 20), (3, 5)]:
        adapter.arm = adapter.connect(ARM_REQUEST, ARM_ANSWER, blocksize=block_size, stmin=st_min)
        unchanged = all(adapter.joints() == before for _ in range(10))
        adapter.arm.stop()
        expect(f"answers are the same in blocks of {block_size} with STmin {st_min:#x}", unchanged)
    adapter.arm = adapter.connect(ARM_REQUEST, ARM_ANSWER)


def check_refusals(adapter: Adapter) -> None:
    """PDUs other than one whole frame are refused."""
    before = adapter.joints()
    move = ling.frame(0x06, 0x03, struct.pack("<14H", *[CENTRE + 500, 1000] * 6, 0, 1000))
    invalid = {
        "a wrong checksum": move[:-2] + bytes([move[-2] ^ 1, 0xFF]),
        "a truncated frame": move[:-1],
        "an extra byte": move + b"\xff",
        "a pair of frames": ling.frame(0x06, 0x00) * 2,
        "a PDU without a frame": bytes(range(60)),
        "a single byte": b"\xaa",
    }
    for name, pdu in invalid.items():
        adapter.cyclic.clear()
        counted = adapter.cyclic.errors()["Refused"]
        adapter.arm.send(pdu)
        wait_until(f"{name} is refused", lambda: (NO_FRAME, BY_CAN) in adapter.cyclic.events())
        expect(f"{name} has no answer", adapter.arm.is_silent())
        expect(f"{name} is counted", (adapter.cyclic.errors()["Refused"] - counted) % 256 == 1)
    errors = adapter.arm.send_refused(bytes(4000))
    expect(f"4000 bytes overflow: {errors}", [type(error) for error in errors] == [isotp.OverflowError])
    wait_until("4000 bytes are refused", lambda: (QUEUE_FULL, BY_CAN) in adapter.cyclic.events())
    expect("the arm has not moved", adapter.joints() == before)
    check_telemetry(adapter)


def check_commands(adapter: Adapter) -> None:
    """A stream of commands moves the arm, and its end is reported."""
    adapter.cyclic.clear()
    start, gripper, _ = adapter.joints()
    target = tuple(2 * CENTRE - ticks for ticks in start)
    sequence = 0
    start_time = time.monotonic()
    while adapter.joints()[:2] != (target, 500):
        # Half of the stroke, and 1000 ticks/s.
        adapter.command(sequence % 256, target, gripper=0.5, speed=1000 * ling.TICK)
        if sequence == 0:
            time.sleep(0.2)
            expect("the start of the stream causes no motion", adapter.joints()[:2] == (start, gripper))
        sequence += 1
        time.sleep(0.01)
        require(f"the arm arrives within {STEP_TIMEOUT:.0f} s", time.monotonic() - start_time < STEP_TIMEOUT)
    expect(f"{sequence} commands move the arm to {target}", not adapter.cyclic.events())
    check_telemetry(adapter)
    wait_until("the end of the stream is reported", lambda: (HOST_SILENT, BY_COMMAND) in adapter.cyclic.events())


def check_refused_commands(adapter: Adapter) -> None:
    before = adapter.joints()
    target = (CENTRE,) * 6
    pause = 2 * COMMAND_TIMEOUT_MS / 1000

    def expect_refusal(name: str, reason: int, send: Callable[[], None]) -> None:
        adapter.cyclic.clear()
        send()
        wait_until(f"{name} is refused", lambda: (reason, BY_COMMAND) in adapter.cyclic.events())

    def command(sequence: int) -> None:
        adapter.command(sequence, target, gripper=0.0, speed=1.0)

    time.sleep(pause)
    expect_refusal("a command without a start", STALE, lambda: command(7))
    command(0)
    a, b = adapter.command_halves(1, target, gripper=0.0, speed=1.0)
    expect_refusal("half a command", INCOMPLETE, lambda: adapter.send(a))
    command(0)
    adapter.send(a)
    b.data[7] = 251
    expect_refusal("a gripper out of range", OUT_OF_RANGE, lambda: adapter.send(b))
    time.sleep(pause)
    adapter.cyclic.clear()
    for _ in range(20):
        command(0)
        time.sleep(pause / 20)
    expect("a repeated start causes no event", not adapter.cyclic.events())
    expect("the arm has not moved", adapter.joints() == before)


def check_telemetry(adapter: Adapter, quiet: bool = False) -> None:
    """Telemetry and ISO-TP agree on an arm at rest."""
    joints, gripper, status = adapter.joints()
    adapter.cyclic.clear()
    wait_until("three samples arrive", lambda: len(adapter.cyclic.samples()) >= 3, quiet=True)
    sample = adapter.cyclic.samples()[-1]
    positions = tuple(ticks(sample[f"Joint{number}"]) for number in range(1, 7))
    received = (positions, round(sample["Gripper"] * 1000), sample["MotionStatus"])
    (require if quiet else expect)(f"telemetry has {received}", received == (joints, gripper, status))


def varint(number: int) -> bytes:
    """A number in postcard format."""
    if number < 0x80:
        return bytes([number])
    return bytes([number & 0x7F | 0x80]) + varint(number >> 7)


def radians(ticks: float) -> float:
    return (ticks - CENTRE) * ling.TICK


def ticks(angle: float) -> int:
    """The ticks of an angle in rad, which must be a whole number of them."""
    exact = angle / ling.TICK + CENTRE
    require(f"{angle} rad is a whole number of ticks", abs(exact - round(exact)) < 1e-6)
    return round(exact)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], int(sys.argv[2]))
