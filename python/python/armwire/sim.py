"""Virtual arms, for tests without hardware. They need Linux or macOS.

Each is a context manager with a `port` for the class of its arm::

    with armwire.sim.ling() as virtual, armwire.Ling(virtual.port) as arm:
        arm.move_deg([10, -20, 0, 0, 0, 45], gripper_permille=500, speed_deg_s=100)

They run in their own threads, in real time, without Python's lock. A virtual arm follows the document of the real arm.
None has been compared with a real arm.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

from . import _armwire
from ._ling import JointState, joint_state
from ._open import Open
from ._units import DEG_PER_TICK, count, position_ticks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

__all__ = [
    "Faults",
    "ServoState",
    "VirtualAlpha1",
    "VirtualAlpha1Servos",
    "VirtualLing",
    "VirtualOlderLing",
    "VirtualSo101",
    "VirtualXArm",
    "alpha1",
    "alpha1_servos",
    "ling",
    "older_ling",
    "so101",
    "xarm",
]


@dataclass(frozen=True)
class Faults:
    """Faults on a line in both directions, as rates in parts per million of bytes or as counts."""

    drop: int = 0
    """The byte does not arrive."""
    corrupt: int = 0
    """One bit of the byte is flipped."""
    duplicate: int = 0
    """The byte arrives twice."""
    delay: int = 0
    """The byte and those after it are delayed by up to 5 ms."""
    noise: int = 0
    """A random byte arrives before the byte."""

    def counts(self) -> tuple[int, int, int, int, int]:
        """Return all rates, in this order."""
        drop, corrupt, duplicate, delay, noise = (count("a rate of faults", rate, 1_000_000) for rate in astuple(self))
        return drop, corrupt, duplicate, delay, noise


class VirtualLing(Open):
    """A virtual Ling arm on a pseudo-terminal. See `ling`."""

    def __init__(
        self, *, leader: bool, turnaround_us: int, seed: int, plant: str | None, force_feedback: str | None
    ) -> None:
        self._arm = _armwire.VirtualLing(leader, turnaround_us, seed, plant, force_feedback)
        super().__init__(self._arm.port, self._arm)

    def joints(self) -> JointState:
        """The arm's true state, independent of its line and without the noise of a reading."""
        return joint_state(self._arm.joints())

    def push_joints_deg(self, joints: ArrayLike) -> bool:
        """Move the joints by hand, at once, and let go. Returns true if they moved: torque on blocks them."""
        ticks = position_ticks(joints, DEG_PER_TICK, "degrees")
        return all([self._arm.push_joint(joint, tick) for joint, tick in enumerate(ticks)])

    def push_gripper_permille(self, gripper: int) -> bool:
        """Move the gripper by hand, at once. Returns true if it moved."""
        return self._arm.push_gripper(count("gripper in thousandths", gripper, 1000))

    def remove_obstacle(self) -> None:
        """Remove the obstacle of the plant."""
        self._arm.remove_obstacle()

    def set_faulty(self, servo: int, faulty: bool = True) -> None:
        """Make the self-check report a servo, by its id from 1, as faulty or as normal."""
        self._arm.set_faulty(count("servo", servo, 255), faulty)

    def set_faults(self, faults: Faults) -> None:
        """Set the fault rates of the line from now on."""
        self._arm.set_faults(faults.counts())

    def injected(self) -> Faults:
        """Counts of injected faults."""
        return Faults(*self._arm.injected())

    def requests(self) -> int:
        """Number of requests received, executed or not."""
        return self._arm.requests()


class VirtualOlderLing(Open):
    """A virtual Ling arm of the older generation. See `older_ling`."""

    def __init__(self) -> None:
        arm = _armwire.VirtualOlderLing()
        super().__init__(arm.port, arm)


class VirtualXArm(Open):
    """A virtual xArm on a TCP port. See `xarm`."""

    def __init__(self, *, axes: int) -> None:
        arm = _armwire.VirtualXArm(count("axes", axes, 255))
        super().__init__(arm.port, arm)


class VirtualAlpha1(Open):
    """A virtual Alpha1 on a pseudo-terminal. See `alpha1`."""

    def __init__(self) -> None:
        self._arm = _armwire.VirtualAlpha1()
        super().__init__(self._arm.port, self._arm)

    def set_faults(self, faults: Faults) -> None:
        """Set the fault rates of the line from now on."""
        self._arm.set_faults(faults.counts())

    def playing(self) -> str | None:
        """The current action."""
        return self._arm.playing()


class VirtualAlpha1Servos(Open):
    """Virtual servos of an Alpha1 on a separate bus. See `alpha1_servos`."""

    def __init__(self, ids: Sequence[int]) -> None:
        self._arm = _armwire.VirtualAlpha1Servos([count("servo id", servo, 240) for servo in ids])
        super().__init__(self._arm.port, self._arm)

    def set_faults(self, faults: Faults) -> None:
        """Set the fault rates of the line from now on."""
        self._arm.set_faults(faults.counts())


@dataclass(frozen=True)
class ServoState:
    """The true state of a servo of a virtual SO-101."""

    id: int
    position: int
    """The position that it reports, in steps: the encoder's less the offset, within a turn."""
    encoder: float
    """The position of its encoder, in steps over several turns."""
    torque: bool


class VirtualSo101(Open):
    """A virtual SO-101 on a pseudo-terminal. See `so101`."""

    def __init__(self, *, ids: Sequence[int], models: Sequence[int], volts: float, seed: int) -> None:
        self._arm = _armwire.VirtualSo101(
            [count("servo id", servo, 255) for servo in ids],
            [count("model", model, 65_535) for model in models],
            volts,
            seed,
        )
        super().__init__(self._arm.port, self._arm)

    def order(self, line: str) -> None:
        """Carry out an order, such as "late 1" or "silent 3", as `armwire sim so101 --stdin` takes it.

        Raises:
            ValueError: It is no order, has a wrong value, names a servo that the arm does not have, or moves one that
                holds its position by hand.
        """
        self._arm.order(line)

    def state(self) -> list[ServoState]:
        """The true state of each servo, from the base on, independent of the line."""
        return [ServoState(*servo) for servo in self._arm.state()]

    def set_faults(self, faults: Faults) -> None:
        """Set the fault rates of the line from now on."""
        self._arm.set_faults(faults.counts())

    def injected(self) -> Faults:
        """Counts of injected faults."""
        return Faults(*self._arm.injected())


def ling(
    *,
    leader: bool = False,
    turnaround_us: int = 200,
    seed: int = 1,
    plant: str | None = None,
    force_feedback: str | None = None,
) -> VirtualLing:
    """Start a virtual Ling arm.

    Args:
        leader: Simulate a leader, which is moved by hand: `push_joints_deg`.
        turnaround_us: Time from the end of a request to the start of its answer, in microseconds.
        seed: Seed of the faults: equal seeds give equal faults.
        plant: Lag, sag and noise of the joints, as `armwire sim ling --plant` takes it: "typical", the default,
            "ideal", or a list such as "typical,sag=26". The command's help has all words.
        force_feedback: Simulate a leader with force feedback, with the words that `armwire sim ling --force-feedback`
            takes, such as "apply=300ms"; "" for none.

    Raises:
        ValueError: The plant or the force feedback has an unknown word, or a value that is out of range.
    """
    return VirtualLing(
        leader=leader, turnaround_us=turnaround_us, seed=seed, plant=plant, force_feedback=force_feedback
    )


def older_ling() -> VirtualOlderLing:
    """Start a virtual Ling arm of the older generation, which transmits unsolicited and accepts no request."""
    return VirtualOlderLing()


def xarm(*, axes: int = 6) -> VirtualXArm:
    """Start a virtual xArm with 5, 6 or 7 axes, on a free port of this machine."""
    return VirtualXArm(axes=axes)


def alpha1() -> VirtualAlpha1:
    """Start a virtual Alpha1."""
    return VirtualAlpha1()


def alpha1_servos(ids: Sequence[int] = tuple(range(1, 17))) -> VirtualAlpha1Servos:
    """Start the servos of an Alpha1 on their own bus."""
    return VirtualAlpha1Servos(ids)


def so101(
    *, ids: Sequence[int] = (1, 2, 3, 4, 5, 6), models: Sequence[int] = (777,), volts: float = 7.4, seed: int = 1
) -> VirtualSo101:
    """Start a virtual SO-101, which fails on order.

    A test gives an order, and then uses its own program, on `port`::

        with armwire.sim.so101() as virtual:
            bus = open_my_bus(virtual.port)
            virtual.order("late 1")

    Args:
        ids: Ids of the servos, from the arm's base on.
        models: Model of each servo, or one for all: 777 is an STS3215, 2825 an STS3250.
        volts: Supply in volts. Outside the servos' limits, which are 4 and 8 V, they report an error.
        seed: Seed of the random faults: equal seeds give equal faults.

    Raises:
        ValueError: An id is above 253 or occurs twice, or a value is out of range.
    """
    return VirtualSo101(ids=ids, models=models, volts=volts, seed=seed)
