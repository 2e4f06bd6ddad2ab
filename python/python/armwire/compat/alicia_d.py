"""The calls of `alicia_d_sdk` 6.1.0, so that a script changes by one import.

    from armwire.compat.alicia_d import create_robot  # instead of alicia_d_sdk

======================================  ===============================================================================
Call of the SDK                         Here
======================================  ===============================================================================
`create_robot(port, …)`                 Same. `port` has to be given: none is searched for. Arguments about models and
                                        backends are accepted and ignored.
`connect`, `disconnect`,                Same.
`is_connected`
`get_robot_state(info_type, timeout)`   Same values. `timeout` is ignored: a read takes half a second at most.
                                        `gripper_type` is always read from the arm, and knows 75 mm.
`set_robot_state(…)`                    Same. A value out of range is a `ValueError`; the SDK sends the nearest.
`set_home(…)`                           Same.
`torque_control("on" | "off")`          Same, and read back.
`zero_calibration()`                    Same, with its two questions.
`print_state(…)`                        Same, without the pose.
`get_pose`, `set_pose`                  `NotImplementedError`: kinematics are RoboCore's; give it the joints.
`plan_…`, `solve_ik_for_trajectory`     `NotImplementedError`: so is planning.
`robot.servo_driver`, `data_parser`     Not there: use `robot.arm`, an `armwire.Ling`.
======================================  ===============================================================================

Where the SDK raises a plain `Exception`, this raises those of `armwire.errors`, which say what is wrong. Angles are
rounded to the nearest position, where the SDK rounds towards -180°; speeds are not rounded to multiples of 50 ticks/s;
velocities are not cut at 5000 ticks/s.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from .. import _ling
from .._units import JOINTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

__all__ = ["JointState", "SynriaRobotAPI", "create_robot"]

# The SDK's names of what an arm is doing.
_STATUS_TEXTS: dict[int, str] = {
    _ling.MotionStatus.IDLE: "idle",
    _ling.MotionStatus.LOCKED: "locked",
    _ling.MotionStatus.SYNCING: "sync",
    _ling.MotionStatus.SYNC_LOCKED: "sync_locked",
    _ling.MotionStatus.OVERHEATING: "overheat",
    _ling.MotionStatus.OVERHEAT_PROTECTION: "overheat_protect",
}
# Of the SDK's self-check, whatever the arm.
_CHECKED_SERVOS = 10
# What the SDK takes for there, of the gripper in thousandths.
_NEAR_GRIPPER = 5
_TICKS_PER_DEG = 4096 / 360


class JointState(NamedTuple):
    """As the SDK has it."""

    angles: list[float]
    """Of six joints, in radians."""
    gripper: float
    """0 closed to 1000 open."""
    timestamp: float
    """Of this computer, in seconds since the epoch."""
    run_status_text: str


class SynriaRobotAPI:
    """The calls of the SDK's class of this name that an arm answers."""

    def __init__(self, port: str, *, auto_connect: bool = True) -> None:
        if not port:
            raise ValueError("the port has to be given, such as /dev/ttyACM0: 'armwire list' shows those there are")
        self._port = port
        self._arm: _ling.Ling | None = None
        self._target_rad: list[float] | None = None
        self.robot_type: str | None = None
        if auto_connect:
            self.connect()

    @property
    def arm(self) -> _ling.Ling:
        """The arm itself, which has more calls."""
        if self._arm is None:
            raise ConnectionError(f"{self._port}: not connected")
        return self._arm

    def connect(self) -> bool:
        """Open the port and identify the arm."""
        if self._arm is None:
            arm = _ling.Ling(self._port)
            try:
                self.robot_type = arm.read_info().kind
                self._target_rad = arm.read_joints_rad().tolist()
            except BaseException:
                arm.close()
                raise
            self._arm = arm
        return True

    def disconnect(self) -> None:
        """Close the port."""
        if self._arm is not None:
            self._arm.close()
            self._arm = None

    def is_connected(self) -> bool:
        """Return whether the port is open."""
        return self._arm is not None

    def get_robot_state(self, info_type: str = "joint_gripper", timeout: float = 1.0, cache: bool = True) -> Any:
        """Read one kind of information; see the SDK's documentation for the kinds and their shapes."""
        reads = {
            "joint_gripper": self._joint_gripper,
            "joint": lambda: self._joint_gripper().angles,
            "gripper": lambda: self._joint_gripper().gripper,
            "version": self._version,
            "temperature": lambda: self.arm.read_temperatures_celsius().astype(float).tolist(),
            "velocity": lambda: self.arm.read_velocities_deg_s().tolist(),
            "gripper_type": lambda: f"{self.arm.read_stroke_mm()}mm",
            "self_check": self._self_check,
        }
        if info_type not in reads:
            raise ValueError(f"Unsupported info type: {info_type}; there are {', '.join(reads)}")
        return reads[info_type]()

    def set_robot_state(
        self,
        target_joints: Sequence[float] | None = None,
        gripper_value: int | None = None,
        joint_format: str = "rad",
        speed_deg_s: ArrayLike = 10,
        gripper_speed_deg_s: float | None = 483.4,
        tolerance: float = 0.1,
        timeout: float = 10.0,
        wait_for_completion: bool = True,
    ) -> bool:
        """Move joints and gripper; what is not given stays as it was set last.

        Returns:
            Whether all is there, within `tolerance` in radians and 5 thousandths; true at once without waiting.
        """
        if target_joints is not None:
            given = np.asarray(target_joints, dtype=np.float64)
            self._target_rad = (np.radians(given) if joint_format == "deg" else given).tolist()
        joints = self._target_rad if self._target_rad is not None else self._joint_gripper().angles
        gripper = self.arm.read_gripper_permille() if gripper_value is None else int(gripper_value)
        speed_ticks_s = 5500 if gripper_speed_deg_s is None else round(gripper_speed_deg_s * _TICKS_PER_DEG)
        self.arm.move_rad(
            joints, gripper_permille=gripper, speed_rad_s=np.radians(speed_deg_s), gripper_ticks_s=speed_ticks_s
        )
        if not wait_for_completion:
            return True
        until = time.monotonic() + timeout
        while True:
            state = self._joint_gripper()
            joints_are_there = target_joints is None or bool(np.allclose(state.angles, joints, rtol=0, atol=tolerance))
            gripper_is_there = gripper_value is None or abs(state.gripper - gripper) <= _NEAR_GRIPPER
            if joints_are_there and gripper_is_there:
                return True
            if time.monotonic() >= until:
                return False
            time.sleep(_ling.PERIOD_S)

    def set_home(self, speed_deg_s: ArrayLike = 10, gripper_speed_deg_s: float | None = 483.4) -> None:
        """Move to zero with the gripper open, and wait."""
        self.set_robot_state([0.0] * JOINTS, 1000, speed_deg_s=speed_deg_s, gripper_speed_deg_s=gripper_speed_deg_s)

    def torque_control(self, command: str, timeout: float = 1.0) -> bool:
        """Switch the torque `on` or `off`, and read it back."""
        if command not in ("on", "off"):
            raise ValueError("command must be 'on' or 'off'")
        self.arm.set_torque(command == "on")
        return True

    def zero_calibration(self) -> bool:
        """Ask twice, switch the torque off in between, and make the pose then the zero position."""
        input("The factory's zero position will be lost, and the arm will fall: hold it. Enter goes on, Ctrl-C ends.")
        self.arm.set_torque(False)
        input("Move the arm to its zero position by hand, then press Enter.")
        self.arm.set_zero()
        time.sleep(0.1)
        self.arm.set_torque(True)
        self._target_rad = None
        return True

    def print_state(self, continuous: bool = False, output_format: str = "deg", fps: float = 200.0) -> None:
        """Print the state, once or until Ctrl-C."""
        while True:
            state = self.arm.read_joints()
            joints, unit = (state.joints_deg, "°") if output_format == "deg" else (state.joints_rad, "rad")
            print(f"Joint angles ({unit}): {np.round(joints, 3).tolist()}, Gripper (0-1000): {state.gripper}")
            print(f"Servo temperature (°C): {self.arm.read_temperatures_celsius().tolist()}")
            print(f"Servo velocity (deg/s): {np.round(self.arm.read_velocities_deg_s(), 1).tolist()}")
            if not continuous:
                return
            time.sleep(1 / fps)

    def get_pose(self, *args: object, **kwargs: object) -> NoReturn:
        """Not there: see the table of this module."""
        _kinematics("get_pose")

    def set_pose(self, *args: object, **kwargs: object) -> NoReturn:
        """Not there: see the table of this module."""
        _kinematics("set_pose")

    def plan_joint_trajectory(self, *args: object, **kwargs: object) -> NoReturn:
        """Not there: see the table of this module."""
        _kinematics("plan_joint_trajectory")

    def plan_cartesian_trajectory(self, *args: object, **kwargs: object) -> NoReturn:
        """Not there: see the table of this module."""
        _kinematics("plan_cartesian_trajectory")

    def solve_ik_for_trajectory(self, *args: object, **kwargs: object) -> NoReturn:
        """Not there: see the table of this module."""
        _kinematics("solve_ik_for_trajectory")

    def _joint_gripper(self) -> JointState:
        state = self.arm.read_joints()
        text = _STATUS_TEXTS.get(state.status, "unknown")
        return JointState(state.joints_rad.tolist(), float(state.gripper_permille), time.time(), text)

    def _version(self) -> dict[str, str]:
        info = self.arm.read_info()
        return {
            "serial_number": info.serial,
            "hardware_version": _dotted(info.hardware),
            "firmware_version": _dotted(info.firmware),
        }

    def _self_check(self) -> dict[str, Any]:
        normal = self.arm.self_check_mask()
        bits = [bool(normal >> servo & 1) for servo in range(_CHECKED_SERVOS)]
        return {"raw_mask": normal, "bits": bits, "timestamp": time.time()}


def create_robot(port: str = "", *args: object, auto_connect: bool = True, **kwargs: object) -> SynriaRobotAPI:
    """Open the arm on a port. Other arguments of the SDK are about models and backends, and ignored."""
    return SynriaRobotAPI(port, auto_connect=auto_connect)


def _dotted(version: str) -> str:
    """The SDK's way to write a version: v6.10 is 6.1.0."""
    return ".".join(version.removeprefix("v").replace(".", ""))


def _kinematics(call: str) -> NoReturn:
    raise NotImplementedError(f"{call}: kinematics and planning are RoboCore's; this package moves joints")
