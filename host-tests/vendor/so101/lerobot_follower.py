"""Uses the SO-101 follower of LeRobot as its programs do, and prints each step with its result.

The result is `right` if the arm's true state is what LeRobot asked for or reports.
"""

import builtins
import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from armwire import sim
from lerobot.motors import motors_bus
from lerobot.robots.so_follower import SOFollower, SOFollowerRobotConfig

from scenes import rest

# Positions of the joints before the calibration, and how far a hand moves each to both sides.
BEFORE, RANGE = [1900, 2300, 1500, 2048, 2500, 2000], 400
WRIST_ROLL, GRIPPER = 4, 5
MIDDLE = 2047
# An action in degrees from the middle of each range, for the gripper in percent of it, and its tolerance.
ACTION, TOLERANCE = [10.0, -20.0, 15.0, 5.0, -10.0, 30.0], 1.0


def main() -> None:
    """Run all steps. An exception of LeRobot ends them."""
    with sim.so101() as arm, TemporaryDirectory() as folder:
        for step, is_right in steps(arm, SOFollower(SOFollowerRobotConfig(arm.port, calibration_dir=Path(folder)))):
            print(f"{step}|{'right' if is_right else 'wrong'}")


def steps(arm: sim.VirtualSo101, follower: SOFollower) -> Iterator[tuple[str, bool]]:
    """Each step, and whether the arm is then as it should be."""
    push(arm, BEFORE)
    builtins.input = lambda prompt="": ""
    motors_bus.enter_pressed = hand(arm)
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        follower.connect()
    low, high = MIDDLE - RANGE, MIDDLE + RANGE
    ranges = [(0, 4095) if joint == WRIST_ROLL else (low, high) for joint in range(6)]
    is_homed = all(near(servo.encoder, position) for servo, position in zip(arm.state(), BEFORE, strict=True))
    is_middle = all(near(servo.position, MIDDLE) for servo in arm.state())
    yield "`connect` of an arm without calibration: `set_half_turn_homings`", is_homed and is_middle
    saved = [(one.range_min, one.range_max) for one in follower.calibration.values()]
    yield "`record_ranges_of_motion`, with a hand that moves the joints", saved == ranges
    yield "`configure`, which ends with torque", all(servo.torque for servo in arm.state())
    follower.send_action(dict(zip(follower.action_features, ACTION, strict=True)))
    rest(arm)
    positions = [servo.position for servo in arm.state()]
    true = [(position - MIDDLE) * 360 / 4096 for position in positions[:GRIPPER]]
    true.append((positions[GRIPPER] - low) * 100 / (high - low))
    yield "`send_action`", all(abs(one - other) < TOLERANCE for one, other in zip(true, ACTION, strict=True))
    observed = follower.get_observation().values()
    yield "`get_observation`", all(abs(one - other) < TOLERANCE for one, other in zip(observed, true, strict=True))
    follower.disconnect()
    yield "`disconnect`", not any(servo.torque for servo in arm.state())
    arm.order("unplugged 1")
    arm.order("clear")
    follower.bus.connect()
    yield "`is_calibrated` after the supply was off", follower.is_calibrated
    follower.bus.disconnect()


def hand(arm: sim.VirtualSo101) -> Callable[[], bool]:
    """Stands in for the Enter key: a hand moves all joints to both ends, then Enter is pressed."""
    targets = iter([MIDDLE - RANGE, MIDDLE + RANGE, MIDDLE])

    def enter_pressed() -> bool:
        target = next(targets, None)
        if target is not None:
            push(arm, [target] * 6)
        return target is None

    return enter_pressed


def push(arm: sim.VirtualSo101, positions: list[int]) -> None:
    """Move all joints by hand."""
    for servo, position in enumerate(positions, 1):
        arm.order(f"hand {servo} {position}")


def near(one: float, other: float) -> bool:
    """The same position, but for the dead zone."""
    return abs(one - other) <= 1


if __name__ == "__main__":
    main()
