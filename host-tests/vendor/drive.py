"""Drives a virtual follower arm with the vendor's SDK and checks all that it reads.

Usage: drive.py PORT

The arm is as it is when switched on: at its zero position, its gripper closed, its torque on.
"""

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sdk import servo_driver

# One step of a joint's sensor, in degrees. The SDK rounds towards zero, so a target is reached within one.
TICK = 360 / 4096
# Servos 1 to 9 of a follower move its joints, the tenth its gripper.
JOINT_SERVOS = 9
# How long any motion here may take, in seconds.
STEP_TIMEOUT = 20.0
TARGET = [10.0, -20.0, 30.0, 0.0, 45.0, -90.0]
HOME = [0.0] * 6


class Arm:
    """The SDK's calls, with an exception where the SDK gives up."""

    def __init__(self, port: str) -> None:
        # Otherwise the SDK takes the first serial port it finds, and with it a real arm.
        expect(f"{port} is there", Path(port).exists())
        self._driver, self.complaints = servo_driver(port)
        expect("the port opens", self._driver.connect())

    def read(self, what: str) -> Any:
        """What the arm answers now, as the SDK understands it."""
        if not self._driver.acquire_info(what, wait=True):
            sys.exit(f"FAILED: no answer to {what}")
        return self._driver.data_parser.get_info(what)

    def joints(self) -> list[float]:
        """The joint angles, in degrees."""
        return [math.degrees(angle) for angle in self.read("joint_gripper").angles]

    def tell(self, what: str) -> None:
        """Sends a command that is not answered."""
        expect(f"{what} is sent", self._driver.acquire_info(what, wait=True))

    def move(self, joints: list[float], gripper: int, speed: float = 60.0) -> None:
        """Starts to move to these angles, in degrees, at this speed, in degrees a second."""
        radians = [math.radians(angle) for angle in joints]
        sent = self._driver.set_joint_and_gripper(radians, gripper, speed_deg_s=speed)
        expect("the move is sent", sent)

    def close(self) -> None:
        self._driver.disconnect()


def main(port: str) -> None:
    arm = Arm(port)
    identify(arm)
    rest(arm)
    motion(arm)
    torque(arm)
    zero(arm)
    arm.close()
    expect(f"the SDK has nothing to complain of {arm.complaints}", not arm.complaints)
    print("the vendor's SDK drives the arm")


def identify(arm: Arm) -> None:
    version = arm.read("version")
    expect(f"serial number {version['serial_number']}", version["serial_number"] == "ADFS251205123456")
    expect(f"hardware {version['hardware_version']}", version["hardware_version"] == "1.1.0")
    expect(f"firmware {version['firmware_version']}", version["firmware_version"] == "6.1.0")
    gripper = arm.read("gripper_type")
    expect(f"gripper type {gripper}", gripper == "50mm")


def rest(arm: Arm) -> None:
    state = arm.read("joint_gripper")
    expect(f"joints at {degrees(arm.joints())}", near(arm.joints(), HOME))
    expect(f"gripper at {state.gripper}, closed", state.gripper == 0)
    expect(f"status {state.run_status_text}", state.run_status_text == "locked")
    temperatures = arm.read("temperature")
    expect(f"temperatures {temperatures} °C", len(temperatures) == 10 and all(20 <= t <= 40 for t in temperatures))
    velocities = arm.read("velocity")
    expect("all ten servos at rest", velocities == [0.0] * 10)
    check = arm.read("self_check")
    expect(f"self-check {check['raw_mask']:#05x}", check["raw_mask"] == 0x3FF and all(check["bits"]))


def motion(arm: Arm) -> None:
    arm.move(TARGET, gripper=500)
    fastest = 0.0

    def there() -> bool:
        nonlocal fastest
        fastest = max(fastest, *arm.read("velocity")[:JOINT_SERVOS])
        return near(arm.joints(), TARGET)

    wait_until(f"joints reach {degrees(TARGET)}", there)
    wait_until("gripper reaches 500", lambda: arm.read("joint_gripper").gripper == 500)
    # 60 °/s are 683 ticks/s, of which the SDK makes 700.
    expect(f"the joints moved at up to {fastest:.1f} °/s", abs(fastest - 700 * TICK) < 1)
    expect("all servos at rest again", arm.read("velocity") == [0.0] * 10)


def torque(arm: Arm) -> None:
    arm.tell("torque_off")
    wait_until("torque is off", lambda: arm.read("joint_gripper").run_status_text == "idle")
    arm.move(HOME, gripper=0, speed=400.0)
    time.sleep(0.5)
    expect("it does not move without torque", near(arm.joints(), TARGET))
    arm.tell("torque_on")
    wait_until("torque is on", lambda: arm.read("joint_gripper").run_status_text == "locked")
    arm.move(HOME, gripper=1000, speed=120.0)
    wait_until("it moves home", lambda: near(arm.joints(), HOME))
    wait_until("gripper opens", lambda: arm.read("joint_gripper").gripper == 1000)


def zero(arm: Arm) -> None:
    arm.move(TARGET, gripper=1000, speed=120.0)
    wait_until("it moves away", lambda: near(arm.joints(), TARGET))
    arm.tell("zero_cali")
    wait_until("where it is reads as zero", lambda: near(arm.joints(), HOME))
    expect("zeroing switched the torque off", arm.read("joint_gripper").run_status_text == "idle")
    arm.tell("torque_on")
    arm.move(TARGET, gripper=0, speed=120.0)
    wait_until("the same angles are further on", lambda: near(arm.joints(), TARGET))


def expect(what: str, holds: bool) -> None:
    """Prints what holds; ends the program if it does not."""
    if not holds:
        sys.exit(f"FAILED: {what}")
    print(f"ok: {what}", flush=True)


def wait_until(what: str, holds: Callable[[], bool]) -> None:
    """Asks again and again until it holds; ends the program when patience does."""
    start = time.monotonic()
    while not holds():
        if time.monotonic() - start > STEP_TIMEOUT:
            sys.exit(f"FAILED: not within {STEP_TIMEOUT:.0f} s: {what}")
    print(f"ok: {what}, after {time.monotonic() - start:.1f} s", flush=True)


def near(angles: list[float], wanted: list[float]) -> bool:
    return all(abs(angle - want) <= TICK for angle, want in zip(angles, wanted, strict=True))


def degrees(angles: list[float]) -> str:
    return "[" + ", ".join(f"{angle:.1f}" for angle in angles) + "]°"


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
