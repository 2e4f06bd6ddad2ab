"""Drives a virtual follower arm over CAN, with python-can, can-isotp and cantools, and checks all that it reads.

Usage: can_session.py PORT NODE

PORT is an SLCAN port on the adapter's bus, NODE the adapter's node id. The bus is classic, at 1 Mbit/s. The arm is as
it is when switched on: at its zero position, its gripper closed, its torque on. The session configures the adapter as
it needs it, and leaves it so.
"""

import random
import struct
import sys
import threading
import time
import zlib
from collections.abc import Callable
from types import TracebackType
from typing import Any

import can
import isotp
from dbc import Dbc

# Identifiers of node 0: see docs/can.md.
ARM_REQUEST, ARM_ANSWER = 0x600, 0x610
CONTROL_REQUEST, CONTROL_ANSWER = 0x640, 0x650
CYCLIC = range(0x200, 0x250)

# The version of the control port's messages.
VERSION = 4

# What EVENT says.
QUEUE_FULL, NOT_A_FRAME, INCOMPLETE, STALE, OUT_OF_RANGE, HOST_SILENT = 1, 2, 3, 4, 5, 16
BY_CAN, BY_COMMAND = 2, 4

# What a Ling arm says it does.
IDLE, LOCKED = 0, 1
CENTRE, TICKS = 2048, 4096
# Servos 1 to 9 of a follower move its joints, the tenth its gripper.
JOINT_SERVOS = 9
# The speed of the gripper that the vendor's software sends.
GRIPPER_SPEED = 5500

# The configuration of this session. The bus is busy, and Python has all the time it may need.
POLL_HZ, TELEMETRY_HZ, COMMAND_TIMEOUT_MS, SILENCE_MS = 100, 50, 1000, 1000

# How long an answer may take, and how long none must come, in seconds. The virtual board is slow on a busy machine.
ANSWER, NO_ANSWER = 30.0, 0.3
# How long any motion here may take.
STEP_TIMEOUT = 30.0
MOVES = 50
# How many requests and commands here are refused: six that are no frame, one too long, three commands.
REFUSED = 10
# ISO-TP with padding, and with 10 s where the standard has 1 s.
ISOTP = {"tx_padding": 0x55, "rx_flowcontrol_timeout": 10_000, "rx_consecutive_frame_timeout": 10_000}


class Adapter:
    """An adapter on the bus: ISO-TP to the arm and to the control port, and the cyclic frames it sends."""

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

    def __enter__(self) -> "Adapter":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.arm.stop()
        self.control.stop()
        self._notifier.stop()
        self._bus.shutdown()

    def connect(self, request: int, answer: int, **params: Any) -> "Connection":
        return Connection(self._bus, self._notifier, request | self.node, answer | self.node, params)

    def ask(self, request: bytes) -> bytes:
        """The data of the arm's answer to a request."""
        self.arm.send(request)
        answer = self.arm.receive(ANSWER)
        expect_quietly(f"the answer to {request.hex(' ')} is of its kind", answer[:3] == request[:3])
        expect_quietly(f"the answer {answer.hex(' ')} is a whole frame", answer == frame(*answer[1:3], answer[4:-2]))
        return answer[4:-2]

    def joints(self) -> tuple[tuple[int, ...], int, int]:
        """Positions in ticks, gripper in thousandths, and what the arm does."""
        *joints, gripper, status = struct.unpack("<7HB", self.ask(frame(0x06, 0x00)))
        return tuple(joints), gripper, status

    def velocities(self) -> tuple[int, ...]:
        return struct.unpack("<10H", self.ask(frame(0x06, 0x02)))

    def move(self, joints: tuple[int, ...], gripper: int, speed: int) -> None:
        """Starts to move. The arm does not answer."""
        axes = [value for ticks in joints for value in (ticks, speed)]
        self.arm.send(frame(0x06, 0x03, struct.pack("<14H", *axes, gripper, GRIPPER_SPEED)))

    def torque(self, on: bool) -> None:
        self.arm.send(frame(0x05, 0x00, bytes([on])))

    def call(self, request: bytes) -> bytes:
        """The adapter's reply to a request on the control port, both in postcard format."""
        self._sequence += 1
        self.control.send(bytes([self._sequence]) + request)
        reply = self.control.receive(ANSWER)
        expect_quietly(f"{reply.hex(' ')} is the reply", reply[:2] == bytes([0, self._sequence]))
        return reply[2:]

    def command(self, sequence: int, joints: tuple[int, ...], gripper: float, speed: float) -> None:
        """Sends a command: where to go in ticks, the gripper as a fraction, and how fast in rad/s."""
        for half in self.halves(sequence, joints, gripper, speed):
            self.send(half)

    def halves(self, sequence: int, joints: tuple[int, ...], gripper: float, speed: float) -> list[can.Message]:
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
        """Sends a PDU, and waits until the adapter has it."""
        self._stack.send(pdu)
        wait_until("the PDU has gone", lambda: not self._stack.transmitting(), quietly=True)
        expect_quietly(f"nothing went wrong in ISO-TP: {self.errors}", not self.errors)

    def receive(self, patience: float) -> bytes:
        pdu = self._stack.recv(block=True, timeout=patience)
        expect_quietly(f"a PDU comes within {patience} s, and no {self.errors}", pdu is not None and not self.errors)
        return bytes(pdu)

    def send_in_vain(self, pdu: bytes) -> list[Exception]:
        """Sends a PDU that will not get through: why it does not."""
        self._stack.send(pdu)
        wait_until("can-isotp gives up", lambda: bool(self.errors), quietly=True)
        errors, self.errors[:] = list(self.errors), []
        return errors

    def is_silent(self) -> bool:
        return self._stack.recv(block=True, timeout=NO_ANSWER) is None and not self.errors

    def stop(self) -> None:
        self._stack.stop()


class Cyclic(can.Listener):
    """The cyclic frames as they come, decoded by cantools."""

    def __init__(self, dbc: Dbc, node: int) -> None:
        self._dbc = dbc
        self._node = node
        self._lock = threading.Lock()
        self._parts: dict[str, dict[str, float]] = {}
        self._samples: list[dict[str, float]] = []
        self._events: list[tuple[int, int]] = []
        self._errors: dict[str, float] | None = None
        self.wrong: list[str] = []

    def on_message_received(self, message: can.Message) -> None:
        identifier = message.arbitration_id
        if identifier not in CYCLIC or identifier & 0xF != self._node:
            return
        try:
            name, values = self._dbc.decode(identifier, bytes(message.data))
        except ValueError as error:
            self.wrong.append(str(error))
            return
        with self._lock:
            if name == "Event":
                self._events.append((int(values["Kind"]), int(values["Initiator"])))
            elif name == "Errors":
                self._errors = values
            else:
                self._parts[name] = values
                self._join()

    def _join(self) -> None:
        """Makes a sample of three frames with the same stamp."""
        a, b, state = (self._parts.get(name) for name in ("JointsA", "JointsB", "State"))
        if a is None or b is None or state is None:
            return
        if a["Stamp"] == b["Stamp"] == int(state["Stamp"]) & 0xFFFF:
            self._parts.clear()
            self._samples.append(a | b | state)

    def forget(self) -> None:
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
        wait_until("ERRORS comes", lambda: self._errors is not None, quietly=True)
        return dict(self._errors or {})


class Transport(can.Listener):
    """The adapter's frames of ISO-TP as they are on the bus."""

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
        identify(adapter)
        rest(adapter)
        torque(adapter)
        motion(adapter)
        moves(adapter)
        flow_control(adapter)
        refusals(adapter)
        commands(adapter)
        wrong_commands(adapter)
        after = adapter.cyclic.errors()
        counted = {name: after[name] - before[name] for name in after if after[name] != before[name]}
        expect(f"nothing went wrong but what was to be refused: {counted}", counted == {"Refused": REFUSED})
        expect(f"every cyclic frame is as the .dbc says {adapter.cyclic.wrong}", not adapter.cyclic.wrong)
        expect("every ISO-TP frame is padded to 8 bytes", adapter.transport.lengths == {8})
        asked = {flow.hex(" ") for flow in adapter.transport.flow_controls}
        expect(f"flow control asks for no pauses or is an overflow: {asked}", asked == {"30 00 00", "32 00 00"})
    print("python-can, can-isotp and cantools drive the arm")


def configure(adapter: Adapter) -> None:
    """Polls the arm, and switches telemetry and commands on."""
    reply = adapter.call(bytes([0]))
    expect("the adapter says what it is", reply[:2] == bytes([2, VERSION]))
    # A Config: a Ling arm; Poll::Hertz; CAN; silence.
    config = b"".join([
        bytes([0]),
        bytes([1]) + varint(POLL_HZ),
        bytes([adapter.node]) + varint(1_000_000) + bytes([0]) + varint(TELEMETRY_HZ),
        bytes([1]) + varint(COMMAND_TIMEOUT_MS) + bytes([0]),
        varint(SILENCE_MS) + bytes([0]),
    ])
    expect("it takes a configuration", adapter.call(bytes([3]) + config) == bytes([0]))
    expect("it has that configuration", adapter.call(bytes([2])) == bytes([4]) + config)
    wait_until("telemetry comes", lambda: len(adapter.cyclic.samples()) >= 10)


def identify(adapter: Adapter) -> None:
    info = adapter.ask(frame(0x01, 0x00))
    serial, hardware, firmware = struct.unpack("<16sII", info)
    expect(f"serial number {serial}", serial == b"ADFS251205123456")
    expect(f"hardware {hardware}, firmware {firmware}", (hardware, firmware) == (110, 610))
    stroke = adapter.ask(frame(0x04, 0x0E))
    expect(f"gripper stroke {stroke.hex()}", stroke == bytes([0]))


def rest(adapter: Adapter) -> None:
    joints, gripper, status = adapter.joints()
    expect(f"joints at {joints}, gripper at {gripper}", (joints, gripper) == ((CENTRE,) * 6, 0))
    expect(f"status {status}, locked", status == LOCKED)
    temperatures = adapter.ask(frame(0x06, 0x01))
    warm = all(20 <= celsius <= 40 for celsius in temperatures)
    expect(f"temperatures {list(temperatures)} °C", len(temperatures) == 10 and warm)
    expect("all ten servos at rest", adapter.velocities() == (0,) * 10)
    # The request as the document prints it, with its length of 0.
    check = adapter.ask(bytes.fromhex("AA FE 00 00 FE 93 FF"))
    expect(f"self-check {check.hex()}", check == bytes([0xFF, 0x03]))
    telemetry_agrees(adapter)


def torque(adapter: Adapter) -> None:
    adapter.torque(False)
    wait_until("torque is off", lambda: adapter.joints()[2] == IDLE)
    adapter.move((CENTRE + 100,) * 6, gripper=500, speed=5000)
    time.sleep(0.3)
    expect("it does not move without torque", adapter.joints() == ((CENTRE,) * 6, 0, IDLE))
    telemetry_agrees(adapter)
    adapter.torque(True)
    wait_until("torque is on", lambda: adapter.joints()[2] == LOCKED)


def motion(adapter: Adapter) -> None:
    target = (2161, 1820, 2389, 2048, 2560, 1024)
    adapter.cyclic.forget()
    adapter.move(target, gripper=500, speed=700)
    fastest = 0
    while adapter.joints()[:2] != (target, 500):
        fastest = max(fastest, *adapter.velocities()[:JOINT_SERVOS])
    expect(f"joints reach {target}, at up to {fastest} ticks/s", fastest == 700)
    expect("all servos at rest again", adapter.velocities() == (0,) * 10)

    samples = adapter.cyclic.samples()
    stamps = [int(sample["Stamp"]) for sample in samples]
    expect(f"{len(samples)} samples came meanwhile, one after the other", stamps == sorted(set(stamps)))
    counts = [int(sample["Count"]) for sample in samples]
    expect("none is missing", all((b - a) % 256 == 1 for a, b in zip(counts, counts[1:])))
    falling = [ticks(sample["Joint6"]) for sample in samples]
    expect("joint 6 went down in them", falling == sorted(falling, reverse=True) and len(set(falling)) > 10)
    telemetry_agrees(adapter)


def moves(adapter: Adapter) -> None:
    """Random moves, each compared with what the joints say by ISO-TP and by telemetry."""
    random.seed(4)
    for _ in range(MOVES):
        target = tuple(random.randrange(CENTRE - 300, CENTRE + 300) for _ in range(6))
        gripper = random.randrange(1001)
        adapter.move(target, gripper, speed=5000)
        there = (target, gripper, LOCKED)
        wait_until(f"joints reach {there}", lambda: adapter.joints() == there, quietly=True)
        telemetry_agrees(adapter, quietly=True)
    print(f"ok: {MOVES} random moves, and telemetry says the same", flush=True)


def flow_control(adapter: Adapter) -> None:
    """Receivers that ask for pauses and small blocks get the same answers."""
    before = adapter.joints()
    adapter.arm.stop()
    for block_size, st_min in [(1, 0), (2, 0xF5), (0, 20), (3, 5)]:
        adapter.arm = adapter.connect(ARM_REQUEST, ARM_ANSWER, blocksize=block_size, stmin=st_min)
        asked = all(adapter.joints() == before for _ in range(10))
        adapter.arm.stop()
        expect(f"blocks of {block_size} with STmin {st_min:#x} carry the same", asked)
    adapter.arm = adapter.connect(ARM_REQUEST, ARM_ANSWER)


def refusals(adapter: Adapter) -> None:
    """What is not one whole frame does no harm."""
    before = adapter.joints()
    move = frame(0x06, 0x03, struct.pack("<14H", *[CENTRE + 500, 1000] * 6, 0, 1000))
    wrong = {
        "a wrong checksum": move[:-2] + bytes([move[-2] ^ 1, 0xFF]),
        "a frame cut short": move[:-1],
        "a byte too many": move + b"\xff",
        "two frames": frame(0x06, 0x00) * 2,
        "no frame": bytes(range(60)),
        "one byte": b"\xaa",
    }
    for what, pdu in wrong.items():
        adapter.cyclic.forget()
        counted = adapter.cyclic.errors()["Refused"]
        adapter.arm.send(pdu)
        wait_until(f"{what} is refused", lambda: (NOT_A_FRAME, BY_CAN) in adapter.cyclic.events())
        expect(f"{what} is not answered", adapter.arm.is_silent())
        expect(f"{what} is counted", (adapter.cyclic.errors()["Refused"] - counted) % 256 == 1)
    errors = adapter.arm.send_in_vain(bytes(4000))
    expect(f"4000 bytes are too many: {errors}", [type(error) for error in errors] == [isotp.OverflowError])
    wait_until("they are refused", lambda: (QUEUE_FULL, BY_CAN) in adapter.cyclic.events())
    expect("nothing has moved", adapter.joints() == before)
    telemetry_agrees(adapter)


def commands(adapter: Adapter) -> None:
    """A stream of commands moves the arm, and is missed when it stops."""
    adapter.cyclic.forget()
    start, gripper, _ = adapter.joints()
    target = tuple(2 * CENTRE - ticks for ticks in start)
    sequence = 0
    began = time.monotonic()
    while adapter.joints()[:2] != (target, 500):
        # 0.5 of the stroke, and 1000 ticks/s.
        adapter.command(sequence % 256, target, gripper=0.5, speed=radians(CENTRE + 1000))
        if sequence == 0:
            time.sleep(0.2)
            expect("the start moves nothing", adapter.joints()[:2] == (start, gripper))
        sequence += 1
        time.sleep(0.01)
        expect_quietly("commands move the arm in time", time.monotonic() - began < STEP_TIMEOUT)
    expect(f"{sequence} commands moved the arm to {target}", not adapter.cyclic.events())
    telemetry_agrees(adapter)
    wait_until("that they stop is reported", lambda: (HOST_SILENT, BY_COMMAND) in adapter.cyclic.events())


def wrong_commands(adapter: Adapter) -> None:
    before = adapter.joints()
    target = (CENTRE,) * 6
    wait = 2 * COMMAND_TIMEOUT_MS / 1000

    def refused(what: str, reason: int, send: Callable[[], None]) -> None:
        adapter.cyclic.forget()
        send()
        wait_until(f"{what} is refused", lambda: (reason, BY_COMMAND) in adapter.cyclic.events())

    def command(sequence: int) -> None:
        adapter.command(sequence, target, gripper=0.0, speed=1.0)

    time.sleep(wait)
    refused("a command without a start", STALE, lambda: command(7))
    command(0)
    a, b = adapter.halves(1, target, gripper=0.0, speed=1.0)
    refused("half a command", INCOMPLETE, lambda: adapter.send(a))
    command(0)
    adapter.send(a)
    b.data[7] = 251
    refused("a gripper out of range", OUT_OF_RANGE, lambda: adapter.send(b))
    time.sleep(wait)
    adapter.cyclic.forget()
    for _ in range(20):
        command(0)
        time.sleep(wait / 20)
    expect("a start that repeats itself is no event", not adapter.cyclic.events())
    expect("nothing has moved", adapter.joints() == before)


def telemetry_agrees(adapter: Adapter, quietly: bool = False) -> None:
    """An arm at rest is in the cyclic frames what ISO-TP says it is."""
    joints, gripper, status = adapter.joints()
    adapter.cyclic.forget()
    wait_until("three samples come", lambda: len(adapter.cyclic.samples()) >= 3, quietly=True)
    sample = adapter.cyclic.samples()[-1]
    seen = tuple(ticks(sample[f"Joint{number}"]) for number in range(1, 7))
    said = (seen, round(sample["Gripper"] * 1000), sample["MotionStatus"])
    (expect_quietly if quietly else expect)(f"telemetry says {said}", said == (joints, gripper, status))


def frame(command: int, function: int, data: bytes = b"\xfe") -> bytes:
    """A frame of a Ling arm."""
    body = bytes([command, function, len(data)]) + data
    return b"\xaa" + body + bytes([zlib.crc32(body) & 0xFF, 0xFF])


def varint(number: int) -> bytes:
    """A number in postcard format."""
    if number < 0x80:
        return bytes([number])
    return bytes([number & 0x7F | 0x80]) + varint(number >> 7)


TICK = 2 * 3.141592653589793 / TICKS


def radians(ticks: float) -> float:
    return (ticks - CENTRE) * TICK


def ticks(angle: float) -> int:
    """The ticks of an angle that is a whole number of them."""
    exact = angle / TICK + CENTRE
    expect_quietly(f"{angle} rad are whole ticks", abs(exact - round(exact)) < 1e-6)
    return round(exact)


def expect(what: str, holds: bool) -> None:
    """Prints what holds; ends the program if it does not."""
    expect_quietly(what, holds)
    print(f"ok: {what}", flush=True)


def expect_quietly(what: str, holds: bool) -> None:
    if not holds:
        sys.exit(f"FAILED: {what}")


def wait_until(what: str, holds: Callable[[], bool], quietly: bool = False) -> None:
    """Asks again and again until it holds; ends the program when patience does."""
    start = time.monotonic()
    while not holds():
        if time.monotonic() - start > STEP_TIMEOUT:
            sys.exit(f"FAILED: not within {STEP_TIMEOUT:.0f} s: {what}")
        time.sleep(0.001)
    if not quietly:
        print(f"ok: {what}, after {time.monotonic() - start:.1f} s", flush=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], int(sys.argv[2]))
