"""A UBTECH Alpha1, and its servos."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal

from . import _armwire
from ._open import Open
from ._units import baud_rate, count

# Maximum number of servos in an action, and the number of an Alpha1.
SERVOS, INSTALLED = 20, 16


class Alpha1(Open):
    """An Alpha1 or its servo bus on a port.

    Calls time out after 250 ms. Reads of the robot are retried twice and time out after 750 ms. Other
    threads run during a call and may use the same object: calls are serialised. Ctrl-C ends a call. Calls raise the
    exceptions of `armwire.errors`: `RefusedError` if the robot or a servo reports failure, which has no reason.

    Args:
        port: A serial port such as `/dev/ttyACM0`; `tcp:HOST:PORT`.
        baud: The serial port's baud rate; 115200 by default.

    Raises:
        PortError: The port cannot be opened.
    """

    def __init__(self, port: str, *, baud: int | None = None) -> None:
        self._port = _armwire.Alpha1Port(port, baud_rate(baud))
        super().__init__(port, self._port)

    def read_hardware_version(self) -> bytes:
        """Read the hardware version. Its character set is not documented."""
        return self._port.read_hardware_version()

    def read_firmware_version(self) -> str:
        """Read the firmware version, year first: 2016010100. 2015121519 is the oldest with this protocol."""
        return self._port.read_firmware_version().decode("ascii", "backslashreplace")

    def read_running_servos(self) -> tuple[int, ...]:
        """Read the numbers of the running servos, 1 to 32. The others of the robot's 16 can be turned by hand."""
        return tuple(self._port.read_running_servos())

    def act(
        self, angles_deg: Mapping[int, int], *, release: Collection[int] = (), time_s: float, interval_s: float
    ) -> None:
        """Move servos together.

        Args:
            angles_deg: Whole degrees, 0 to 240, by servo, 1 to 20.
            release: Servos without an angle. Their motors may be switched off: a load that they hold falls. Each of
                servos 1 to 16 has an angle or is released; an Alpha1 has no servos 17 to 20.
            time_s: Duration of the motion, up to 5.1 s, in steps of 20 ms.
            interval_s: Time from its end until the robot accepts the next frame, up to 1310.7 s.

        Raises:
            ValueError: A value is out of range, or a servo has neither an angle nor a release, or both.
        """
        for servo in (*angles_deg, *release):
            if not 1 <= servo <= SERVOS:
                raise ValueError(f"servo is {servo}, must be 1 to {SERVOS}")
        for servo in (*release, *range(1, INSTALLED + 1)):
            if (servo in angles_deg) is (servo in release):
                both = "an angle and" if servo in release else "neither an angle nor"
                raise ValueError(f"servo {servo} has {both} a release")
        angles: list[int | None] = [None] * SERVOS
        for servo, degrees in angles_deg.items():
            angles[servo - 1] = count("servo angle in degrees", degrees, 240)
        self._port.act(angles, time_s, interval_s)

    def play(self, name: str | bytes) -> None:
        """Play the action with this name. Pass a non-ASCII name as bytes; the robot's encoding may be GBK."""
        self._port.play(name.encode() if isinstance(name, str) else name)

    def stop(self) -> None:
        """Stop the current action."""
        self._port.stop()

    def set_offset_tool(self, connected: bool) -> None:
        """Connect or disconnect the servo offset tool. Bluetooth is not available while it is connected."""
        self._port.set_offset_tool(connected)

    def set_usb_type(self, usb: Literal["disk", "serial", "hid"]) -> None:
        """Set the robot's USB device type. The port may close. A disk accepts no requests."""
        self._port.set_usb_type(usb)

    def move_servo(self, servo: int, angle_deg: int, *, time_s: float, lock_s: float) -> None:
        """Move a servo, 1 to 240, or all servos: 0.

        Args:
            servo: The servo's id. The call returns after its acknowledgement; 0 has no acknowledgement.
            angle_deg: Whole degrees, 0 to 240.
            time_s: Duration of the motion, up to 5.1 s.
            lock_s: The completion time, up to 1310.7 s.
        """
        angle = count("servo angle in degrees", angle_deg, 240)
        self._port.move_servo(_id(servo), angle, time_s, lock_s)

    def release_servo(self, servo: int) -> None:
        """Switch the motor of a servo, or of all servos (0), off: a load that it holds falls."""
        self._port.release_servo(_id(servo))

    def set_servo_led(self, servo: int, led: int) -> None:
        """Switch the LED of a servo, or of all servos (0): 0 or 1. The sources contradict each other on the meaning."""
        self._port.set_servo_led(_id(servo), count("LED", led, 255))

    def read_servo_angles_deg(self, servo: int) -> tuple[int, int]:
        """Read target and actual angle. The servo switches its motor off to answer: a load that it holds falls."""
        return self._port.read_servo_angles(_id(servo))

    def change_servo_id(self, servo: int, to: int) -> None:
        """Change a servo's id, 1 to 240."""
        self._port.change_servo_id(_id(servo), _id(to))

    def set_servo_offset_thirds_deg(self, servo: int, thirds: int) -> None:
        """Set a servo's zero offset in thirds of a degree, -90 to 90."""
        if not -90 <= thirds <= 90:
            raise ValueError(f"servo offset is {thirds} thirds of a degree, must be -90 to 90")
        self._port.set_servo_offset(_id(servo), thirds)

    def read_servo_offset_thirds_deg(self, servo: int) -> int:
        """Read a servo's zero offset in thirds of a degree."""
        return self._port.read_servo_offset(_id(servo))

    def read_servo_version(self, servo: int) -> bytes:
        """Read a servo's firmware version: four bytes of undocumented meaning."""
        return self._port.read_servo_version(_id(servo))


def _id(servo: int) -> int:
    return count("servo id", servo, 240)
