"""Faults of a virtual SO-101, and what a program makes of each.

Each result is a few words, computed from what the program returned and from the arm's true state at that time.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

from armwire import sim
from armwire.sim import VirtualSo101

from programs import IDS, Program

# Number of readings after a fault.
READINGS = 12
# Pauses between readings, in seconds: of a moving arm, and of one at rest until all bytes of a reading have arrived.
PERIOD, PAUSE = 1 / 60, 0.05
# Speed of a moving arm, in steps per second: 8 steps in a period.
SPEED = 500
# A time by which a late answer has arrived, and after which the supply is back and a lost torque shows, in seconds.
OVER = 0.5
# Delay of a late answer, in milliseconds: it is not near the end of any number of timeouts of a program.
LATE = 75
# The distance by which a joint without torque has sunk by then, in steps, if it sinks at all.
SUNK = 50
VOLTS = 7.4
REGISTERS = ["position", "voltage", "torque"]
# Random faults, per million bytes: most readings of six servos have one.
RANDOM = 10_000


@dataclass(frozen=True)
class Trial:
    """A program with an open port on an arm."""

    arm: VirtualSo101
    program: Program
    volts: float
    """The supply."""

    def readings(self, count: int = READINGS, pause: float = PAUSE) -> Iterator[str]:
        """What each of this many readings of all positions is: see `reading`."""
        for _ in range(count):
            yield self.reading()
            time.sleep(pause)

    def reading(self) -> str:
        """Read all positions. A position is right if the servo was there at any time of the call."""
        before = self.arm.state()
        read = attempt(self.program.positions)
        after = self.arm.state()
        if isinstance(read, Failure):
            return read.name
        if any(read.get(servo) is None for servo in IDS):
            return "servos missing"
        spans = (sorted((one.position, other.position)) for one, other in zip(before, after, strict=True))
        positions = zip((read[servo] for servo in IDS), spans, strict=True)
        return "right" if all(low - 1 <= position <= high + 1 for position, (low, high) in positions) else "wrong"

    def register(self, servo: int, name: str) -> str:
        """Read a register of one servo."""
        state = self.arm.state()[servo - 1]
        truth = {"position": state.position, "voltage": round(self.volts * 10), "torque": state.torque}[name]
        read = attempt(lambda: self.program.read(servo, name))
        if isinstance(read, Failure):
            return read.name
        return "no value" if read is None else "right" if read == truth else "wrong"

    def registers(self, servo: int, pause: float = PAUSE) -> dict[str, str]:
        """Read all registers of one servo, one after the other."""
        outcomes = {}
        for name in REGISTERS:
            outcomes[name] = self.register(servo, name)
            time.sleep(pause)
        return outcomes

    def move(self, goal: int) -> None:
        """Set this goal for every servo, and wait until the arm has moved and stands still."""
        start = self.arm.state()
        self.program.set_goals(goal)
        while self.arm.state() == start:
            time.sleep(PAUSE)
        rest(self.arm)

    def torque(self) -> str:
        """The servos with torque."""
        return " ".join(str(servo.id) for servo in self.arm.state() if servo.torque) or "none"


def rest(arm: VirtualSo101) -> None:
    """Wait until the arm stands still."""
    last = None
    while (state := arm.state()) != last:
        last = state
        time.sleep(PAUSE)


@dataclass(frozen=True)
class Failure:
    """A call that raised."""

    name: str


def attempt(call: Callable[[], Any]) -> Any:
    """Call, and return the value or the failure. An exception that no `except Exception` catches is a panic."""
    try:
        return call()
    except Exception:
        return Failure("error")
    except BaseException:
        return Failure("panic")


def told(outcomes: Iterable[str]) -> str:
    """Outcomes one after the other, equal ones once."""
    return ", then ".join(outcome for outcome, _ in groupby(outcomes))


def told_to_end(outcomes: Iterable[str]) -> str:
    """The same after a fault that is over. What is not right at the end is `for ever`."""
    runs = [(outcome, len(list(run))) for outcome, run in groupby(outcomes)]
    outcome, length = runs[-1]
    return told(outcome for outcome, _ in runs) + (" for ever" if outcome != "right" and length > 1 else "")


def any_of(outcomes: Iterable[str]) -> str:
    """Outcomes in any order, equal ones once."""
    return " or ".join(sorted(set(outcomes), key=["right", "error", "servos missing", "wrong", "panic"].index))


def by_register(rounds: list[dict[str, str]]) -> str:
    """Outcomes of registers in several rounds, equal ones together."""
    registers = defaultdict(list)
    for name in rounds[0]:
        registers[told_to_end(read[name] for read in rounds)].append(name)
    if len(registers) == 1:
        return next(iter(registers))
    return "; ".join(f"{' and '.join(names)}: {outcome}" for outcome, names in registers.items())


def moving(trial: Trial) -> None:
    trial.program.set_speeds(SPEED)
    trial.program.set_goals(3900)


def nominal(trial: Trial) -> str:
    trial.program.set_speeds(SPEED)
    trial.program.set_goals(2300)
    outcomes = list(trial.readings(pause=PERIOD))
    rest(trial.arm)
    return told([*outcomes, trial.reading(), *trial.registers(2).values()])


def late(trial: Trial) -> str:
    moving(trial)
    trial.arm.order(f"late 1:{LATE}")
    first = trial.reading()
    time.sleep(OVER)
    return told_to_end([first, *trial.readings(pause=PERIOD)])


def late_registers(trial: Trial) -> str:
    trial.move(1000)
    trial.arm.order(f"late 1:{LATE}")
    return by_register([trial.registers(1, pause=0) for _ in range(4)])


def readings(trial: Trial) -> str:
    return told(trial.readings(3))


def error_bit(trial: Trial) -> str:
    return f"all: {told(trial.readings(3))}; servo 2: {trial.register(2, 'position')}"


def echo(trial: Trial) -> str:
    registers = by_register([trial.registers(2)])
    return f"all: {told(trial.readings(3))}; servo 2: {registers}"


def damaged(trial: Trial) -> str:
    trial.arm.order("damaged 3")
    return told_to_end(trial.readings())


def twice(trial: Trial) -> str:
    trial.arm.order("twice 1")
    outcomes = list(trial.readings(3))
    trial.arm.order("twice 6")
    return told_to_end([*outcomes, *trial.readings()])


def random_faults(trial: Trial) -> str:
    return any_of(trial.readings(40, 0))


def brownout(trial: Trial) -> str:
    moving(trial)
    trial.arm.order("brownout 8")
    outcomes = list(trial.readings(3, PERIOD))
    time.sleep(OVER)
    return f"{told([*outcomes, *trial.readings(3)])}; torque then: {trial.torque()}"


def sag(trial: Trial) -> str:
    trial.move(2500)
    return f"{trial.reading()}, {2500 - trial.arm.state()[1].position} steps below the goal"


@dataclass(frozen=True)
class Scene:
    """A scene: what fails, and what is looked at."""

    title: str
    look: Callable[[Trial], str]
    volts: float = VOLTS
    orders: tuple[str, ...] = ()
    """Orders before the look."""
    faults: sim.Faults = field(default_factory=sim.Faults)
    """Random faults at the look. What they leave behind is random, too: the end is not looked at."""
    from_start: bool = False
    """The fault is there before the program opens the port. It then does not switch the torque on."""


SCENES = {
    "nominal": Scene("nothing fails: positions in a motion and at rest, registers", nominal),
    "late": Scene(f"an answer is {LATE} ms late, in a motion", late),
    "registers": Scene("the same at rest, with registers of two lengths", late_registers),
    "silent": Scene("servo 3 does not answer", readings, orders=("silent 3",)),
    "unplugged": Scene("servos 4 to 6 are unplugged", readings, orders=("unplugged 4",)),
    "error": Scene("servo 2 reports an error bit", error_bit, orders=("error 2 1",)),
    "voltage": Scene("the supply is below the limit of all servos", error_bit, volts=3.9, from_start=True),
    "echo": Scene("the board echoes", echo, orders=("echo",), from_start=True),
    "lost": Scene("1 % of all bytes are lost, at rest", random_faults, faults=sim.Faults(drop=RANDOM)),
    "noise": Scene("noise, 1 % of all bytes, at rest", random_faults, faults=sim.Faults(noise=RANDOM)),
    "damaged": Scene("an answer is damaged", damaged),
    "twice": Scene("the first and the last answer of a reading come twice", twice),
    "brownout": Scene("the supply drops for 300 ms in a motion", brownout),
    "sag": Scene("joints sag by 30 steps", sag, orders=("sag 30",)),
}


def run(program: type[Program], scene: Scene) -> str:
    """Run a scene with a program: what it read, how it closed, and which torque it left on."""
    with sim.so101(volts=scene.volts) as arm:
        if scene.from_start:
            give(arm, scene)
        opened = attempt(lambda: program(arm.port))
        if isinstance(opened, Failure):
            return f"open: {opened.name}"
        trial = Trial(arm, opened, scene.volts)
        if not scene.from_start:
            opened.switch_torque_on()
            give(arm, scene)
        words = [scene.look(trial)]
        if scene.faults != sim.Faults():
            return words[0]
        closed = attempt(opened.close)
        before = arm.state()
        # A SYNC_WRITE has no answer: it may be under way.
        time.sleep(OVER)
        if isinstance(closed, Failure):
            words.append(f"close: {closed.name}")
        if (left := trial.torque()) != "none":
            words.append(f"torque left on: {left}")
        if any(abs(servo.encoder - last.encoder) > SUNK for servo, last in zip(arm.state(), before, strict=True)):
            words.append("sinks after close")
        return "; ".join(words)


def give(arm: VirtualSo101, scene: Scene) -> None:
    """Give the orders of a scene, and set its faults."""
    for order in scene.orders:
        arm.order(order)
    arm.set_faults(scene.faults)
