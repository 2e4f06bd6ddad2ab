"""A UFACTORY xArm."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntFlag
from typing import Generic, Literal, TypeVar

import numpy as np

from . import _armwire
from ._open import Open
from ._reader import Reader
from ._units import Floats, count, rate
from .errors import UnacceptableError

# The register of joint positions, absent from the public document: seven little-endian numbers in radians, as
# read by the vendor's package.
POSITIONS = 42
MAX_JOINTS = 7

T = TypeVar("T")


class XArmState(IntFlag):
    """The arm's state, a part of every answer. A warning or an error does not invalidate the answer."""

    OK = 0
    INVALID = 0x08
    """The request was refused or failed: a `RefusedError`."""
    NOT_READY = 0x10
    """Not ready to move."""
    WARNING = 0x20
    ERROR = 0x40


@dataclass(frozen=True)
class Answer(Generic[T]):
    """A value and the arm's state."""

    value: T
    state: XArmState


@dataclass(frozen=True)
class XArmVersion:
    """The kind of an arm and its software."""

    text: str
    """The version text as sent by the arm, with unprintable characters escaped."""
    axes: int | None
    """The number of axes. This and the following are `None` if the text is not a version."""
    type: int | None
    arm: str | None
    control_box: str | None
    firmware: str | None


@dataclass(frozen=True)
class XArmSerials:
    """Serial numbers; `None` if not printable."""

    arm: str | None
    control_box: str | None


class XArm(Open):
    """An xArm on a host.

    Calls time out after 2 s, those of registers without a method after 10 s. After a timeout, a call waits one more
    second for a late answer. Other threads run during a call and may use the same object: calls are serialised. Ctrl-C
    ends a call. Calls raise the exceptions of `armwire.errors`.

    Args:
        host: For example `192.168.1.10` or `192.168.1.10:502`.
        supervised: Use protocol id 3 instead of 2, as the vendor's package does with firmware 1.8.6 and later.

    Raises:
        PortError: The connection to the host failed.
    """

    def __init__(self, host: str, *, supervised: bool = False) -> None:
        self._port = _armwire.XArmPort(host, supervised)
        super().__init__(host, self._port)

    def reader(self, rate_hz: int) -> Reader[Answer[Floats]]:
        """Read the joints' angles in radians in a thread at this rate, 1 to 1000 per second. See `Reader`.

        Raises:
            ValueError: The rate is out of range.
            PortError: Another reader of this object is open.
        """
        return Reader(self.port, self._port.reader(rate(rate_hz)), _angles)

    def read_version(self) -> Answer[XArmVersion]:
        """Read axes, type and versions."""
        state, (text, version) = self._port.read_version()
        axes, kind, arm, control_box, firmware = version or (None,) * 5
        return _answer(state, XArmVersion(text, axes, kind, arm, control_box, firmware))

    def read_serials(self) -> Answer[XArmSerials]:
        """Read the serial numbers of the arm and of its control box."""
        state, serials = self._port.read_serials()
        return _answer(state, XArmSerials(*serials))

    def read_torque_source(self) -> Answer[Literal["torque", "current"]]:
        """Read the reported quantity: joint torque or servo current."""
        return _answer(*self._port.read_torque_source())

    def read_rotation_radius_mm(self, joint: int) -> Answer[float]:
        """Read the radius of rotation of a joint, 1 to 7, relative to the tool.

        Raises:
            UnacceptableError: The radius is not in the range of 0 to 100 m.
        """
        state, radius = self._port.read_rotation_radius(count("joint", joint, 255))
        if not 0 <= radius <= 100_000:
            raise UnacceptableError(f"{self.port}: rotation radius is {radius:g} mm, must be 0 to 100000")
        return _answer(state, radius)

    def read_joints_rad(self) -> Answer[Floats]:
        """Read the joints' angles in radians: seven numbers. An arm with fewer axes uses the first ones.

        Register 42, absent from the public document.
        """
        state, params = self._port.raw(POSITIONS, b"")
        if len(params) != 4 * MAX_JOINTS:
            raise UnacceptableError(f"{self.port}: register {POSITIONS} has {len(params)} bytes, must be 28")
        return _answer(state, np.array(struct.unpack("<7f", params), dtype=np.float64))

    def read_joints_deg(self) -> Answer[Floats]:
        """Read the joints' angles in degrees. See `read_joints_rad`."""
        answer = self.read_joints_rad()
        return Answer(np.degrees(answer.value), answer.state)

    def reload_dynamics(self) -> Answer[None]:
        """Reload the friction parameters."""
        return _answer(self._port.reload_dynamics(), None)

    def shut_down(self) -> Answer[None]:
        """Shut the control box down. It must be switched on again by hand."""
        return _answer(self._port.shut_down(), None)

    def reboot(self) -> Answer[None]:
        """Restart the control box."""
        return _answer(self._port.reboot(), None)

    def heartbeat(self) -> None:
        """Send a heartbeat. The arm does not answer."""
        self._port.heartbeat()

    def raw(self, register: int, params: bytes = b"") -> Answer[bytes]:
        """Call any other register, without checking its parameters: 42 reads joint positions, 23 moves the arm.

        Args:
            register: 0 to 255, except 1, 2, 4, 5, 6 and 10, which have methods.
            params: At most 252 bytes.
        """
        return _answer(*self._port.raw(count("register", register, 255), params))


def _answer(state: int, value: T) -> Answer[T]:
    return Answer(value, XArmState(state))


def _angles(pose: tuple[int, list[float]]) -> Answer[Floats]:
    state, angles = pose
    return _answer(state, np.array(angles, dtype=np.float64))
