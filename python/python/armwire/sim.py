"""Virtual arms, for tests without hardware. They need Linux or macOS.

Each is a context manager with a `port` that the class of its arm takes::

    with armwire.sim.ling() as virtual, armwire.Ling(virtual.port) as arm:
        arm.move_deg([10, -20, 0, 0, 0, 45], gripper_permille=500, speed_deg_s=100)

They run in threads of their own, in real time, without Python's lock. A virtual arm does what the document of the real
one says; nothing here has met a real arm.
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
    "VirtualAlpha1",
    "VirtualAlpha1Servos",
    "VirtualLing",
    "VirtualOlderLing",
    "VirtualXArm",
    "alpha1",
    "alpha1_servos",
    "ling",
    "older_ling",
    "xarm",
]


@dataclass(frozen=True)
class Faults:
    """Faults on a line, both ways: how often a byte meets each, in parts per million; or how often it has happened."""

    drop: int = 0
    """The byte does not arrive."""
    corrupt: int = 0
    """One of its bits is flipped."""
    duplicate: int = 0
    """It arrives twice."""
    delay: int = 0
    """It is up to 5 ms late, and what follows it."""
    noise: int = 0
    """A random byte arrives before it."""

    def counts(self) -> tuple[int, int, int, int, int]:
        """All of them, in this order."""
        drop, corrupt, duplicate, delay, noise = (count("a rate of faults", rate, 1_000_000) for rate in astuple(self))
        return drop, corrupt, duplicate, delay, noise


class VirtualLing(Open):
    """A virtual Ling arm on a pseudo-terminal. See `ling`."""

    def __init__(self, *, leader: bool, turnaround_us: int, seed: int) -> None:
        self._arm = _armwire.VirtualLing(leader, turnaround_us, seed)
        super().__init__(self._arm.port, self._arm)

    def joints(self) -> JointState:
        """The state of the arm itself, whatever its line does."""
        return joint_state(self._arm.joints())

    def push_joints_deg(self, joints: ArrayLike) -> bool:
        """Move the joints by hand, at once. Returns whether the arm gave way: it does not while its torque is on."""
        ticks = position_ticks(joints, DEG_PER_TICK, "degrees")
        return all([self._arm.push_joint(joint, tick) for joint, tick in enumerate(ticks)])

    def push_gripper_permille(self, gripper: int) -> bool:
        """Move the gripper by hand, at once. Returns whether it gave way."""
        return self._arm.push_gripper(count("gripper in thousandths", gripper, 1000))

    def set_faulty(self, servo: int, faulty: bool = True) -> None:
        """Make the self-check report a servo, by its id from 1, as faulty, or as normal."""
        self._arm.set_faulty(count("servo", servo, 255), faulty)

    def set_faults(self, faults: Faults) -> None:
        """Set what the line does to bytes from now on."""
        self._arm.set_faults(faults.counts())

    def injected(self) -> Faults:
        """How often each fault has happened."""
        return Faults(*self._arm.injected())

    def requests(self) -> int:
        """How many requests the arm has heard, obeyed or not."""
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
        """Set what the line does to bytes from now on."""
        self._arm.set_faults(faults.counts())

    def playing(self) -> str | None:
        """The action that it plays."""
        return self._arm.playing()


class VirtualAlpha1Servos(Open):
    """Virtual servos of an Alpha1 on a bus of their own. See `alpha1_servos`."""

    def __init__(self, ids: Sequence[int]) -> None:
        self._arm = _armwire.VirtualAlpha1Servos([count("servo id", servo, 240) for servo in ids])
        super().__init__(self._arm.port, self._arm)

    def set_faults(self, faults: Faults) -> None:
        """Set what the line does to bytes from now on."""
        self._arm.set_faults(faults.counts())


def ling(*, leader: bool = False, turnaround_us: int = 200, seed: int = 1) -> VirtualLing:
    """Start a virtual Ling arm.

    Args:
        leader: A leader, which is moved by hand: `push_joints_deg`.
        turnaround_us: From the end of a request to the start of its answer, in microseconds.
        seed: The same seed makes the same faults.
    """
    return VirtualLing(leader=leader, turnaround_us=turnaround_us, seed=seed)


def older_ling() -> VirtualOlderLing:
    """Start a virtual Ling arm of the older generation, which talks unasked and obeys nothing."""
    return VirtualOlderLing()


def xarm(*, axes: int = 6) -> VirtualXArm:
    """Start a virtual xArm with 5, 6 or 7 axes, on a free port of this machine."""
    return VirtualXArm(axes=axes)


def alpha1() -> VirtualAlpha1:
    """Start a virtual Alpha1."""
    return VirtualAlpha1()


def alpha1_servos(ids: Sequence[int] = tuple(range(1, 17))) -> VirtualAlpha1Servos:
    """Start servos of an Alpha1 on a bus of their own."""
    return VirtualAlpha1Servos(ids)
