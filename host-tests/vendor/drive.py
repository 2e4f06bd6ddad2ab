"""Drives a virtual follower arm with the vendor's SDK, and checks all received values.

Usage: drive.py PORT

The arm has just been switched on: at its zero position, gripper closed, torque on.
"""

import math
import sys
import time
from pathlib import Path
from typing import Any

from checks import expect, require, wait_until
from ling import JOINT_SERVOS, POSE, SERIAL_NUMBER, TICK
from sdk import servo_driver

ZERO = [0.0] * 6


class Arm:
    """The SDK's calls. A call that the SDK gives up ends the program."""

    def __init__(self, port: str) -> None:
        # Without this port, the SDK takes the first serial port, which may be a real arm.
        expect(f"{port} exists", Path(port).exists())
        self._driver, self.warnings = servo_driver(port)
        expect("the port opens", self._driver.connect())

    def read(self, name: str) -> Any:
        """The arm's answer to a request, as decoded by the SDK."""
        require(f"{name} is answered", self._driver.acquire_info(name, wait=True))
        return self._driver.data_parser.get_info(name)

    def joints(self) -> list[float]:
        """The joint angles, in degrees."""
        return [math.degrees(angle) for angle in self.read("joint_gripper").angles]

    def send(self, name: str) -> None:
        """Sends a command without an answer."""
        expect(f"{name} is sent", self._driver.acquire_info(name, wait=True))

    def move(self, joints: list[float], gripper: int, speed: float = 60.0) -> None:
        """Starts a move to these angles, in degrees, at this speed, in degrees/s."""
        radians = [math.radians(angle) for angle in joints]
        sent = self._driver.set_joint_and_gripper(radians, gripper, speed_deg_s=speed)
        expect("the move is sent", sent)

    def close(self) -> None:
        self._driver.disconnect()


def main(port: str) -> None:
    arm = Arm(port)
    check_identity(arm)
    check_rest(arm)
    check_motion(arm)
    check_torque(arm)
    check_zero(arm)
    arm.close()
    expect(f"the SDK has no warnings: {arm.warnings}", not arm.warnings)
    print("the vendor's SDK drives the arm")


def check_identity(arm: Arm) -> None:
    version = arm.read("version")
    expect(f"serial number {version['serial_number']}", version["serial_number"] == SERIAL_NUMBER)
    expect(f"hardware {version['hardware_version']}", version["hardware_version"] == "1.1.0")
    expect(f"firmware {version['firmware_version']}", version["firmware_version"] == "6.1.0")
    gripper = arm.read("gripper_type")
    expect(f"gripper type {gripper}", gripper == "50mm")


def check_rest(arm: Arm) -> None:
    state = arm.read("joint_gripper")
    expect(f"joints at {format_degrees(arm.joints())}", is_near(arm.joints(), ZERO))
    expect(f"gripper at {state.gripper}, closed", state.gripper == 0)
    expect(f"status {state.run_status_text}", state.run_status_text == "locked")
    temperatures = arm.read("temperature")
    expect(f"temperatures {temperatures} °C", len(temperatures) == 10 and all(20 <= t <= 40 for t in temperatures))
    expect("all ten servos are at rest", arm.read("velocity") == [0.0] * 10)
    check = arm.read("self_check")
    expect(f"self-check {check['raw_mask']:#05x}", check["raw_mask"] == 0x3FF and all(check["bits"]))


def check_motion(arm: Arm) -> None:
    arm.move(POSE, gripper=500)
    fastest = 0.0

    def has_arrived() -> bool:
        nonlocal fastest
        fastest = max(fastest, *arm.read("velocity")[:JOINT_SERVOS])
        return is_near(arm.joints(), POSE)

    wait_until(f"joints reach {format_degrees(POSE)}", has_arrived)
    wait_until("the gripper reaches 500", lambda: arm.read("joint_gripper").gripper == 500)
    # 60 °/s are 683 ticks/s, which the SDK rounds to 700.
    expect(f"the joints move at up to {fastest:.1f} °/s", abs(fastest - math.degrees(700 * TICK)) < 1)
    expect("all servos are at rest again", arm.read("velocity") == [0.0] * 10)


def check_torque(arm: Arm) -> None:
    arm.send("torque_off")
    wait_until("torque is off", lambda: arm.read("joint_gripper").run_status_text == "idle")
    arm.move(ZERO, gripper=0, speed=400.0)
    time.sleep(0.5)
    expect("the arm does not move without torque", is_near(arm.joints(), POSE))
    arm.send("torque_on")
    wait_until("torque is on", lambda: arm.read("joint_gripper").run_status_text == "locked")
    arm.move(ZERO, gripper=1000, speed=120.0)
    wait_until("the arm moves to its zero position", lambda: is_near(arm.joints(), ZERO))
    wait_until("the gripper opens", lambda: arm.read("joint_gripper").gripper == 1000)


def check_zero(arm: Arm) -> None:
    arm.move(POSE, gripper=1000, speed=120.0)
    wait_until("the arm moves away", lambda: is_near(arm.joints(), POSE))
    arm.send("zero_cali")
    wait_until("this position reads as zero", lambda: is_near(arm.joints(), ZERO))
    expect("zeroing switches the torque off", arm.read("joint_gripper").run_status_text == "idle")
    arm.send("torque_on")
    arm.move(POSE, gripper=0, speed=120.0)
    wait_until("the arm moves to the same angles from the new zero", lambda: is_near(arm.joints(), POSE))


def is_near(angles: list[float], goals: list[float]) -> bool:
    """True if each angle is within one tick of its goal: the SDK rounds towards zero."""
    return all(abs(angle - goal) <= math.degrees(TICK) for angle, goal in zip(angles, goals, strict=True))


def format_degrees(angles: list[float]) -> str:
    return "[" + ", ".join(f"{angle:.1f}" for angle in angles) + "]°"


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
