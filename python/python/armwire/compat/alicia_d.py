"""The calls of `alicia_d_sdk` 6.1.0. A script needs one changed import.

    from armwire.compat.alicia_d import create_robot  # instead of alicia_d_sdk

======================================  ===============================================================================
Call of the SDK                         Here
======================================  ===============================================================================
`create_robot(port, …)`                 Same. `port` is required: there is no search. Arguments about models and
                                        backends are accepted and ignored.
`connect`, `disconnect`,                Same.
`is_connected`
`get_robot_state(info_type, timeout)`   Same values. `timeout` is ignored: a read takes at most half a second.
                                        `gripper_type` is always read from the arm and may be 75 mm.
`set_robot_state(…)`                    Same. A value out of range is a `ValueError`; the SDK clamps it. A motion of an
                                        arm without torque is a `RefusedError`.
`set_home(…)`                           Same.
`torque_control("on" | "off")`          Same, and verified.
`zero_calibration()`                    Same, with its two questions.
`print_state(…)`                        Same, without the pose.
`get_pose`, `set_pose`                  `NotImplementedError`: RoboCore has the kinematics.
`plan_…`, `solve_ik_for_trajectory`     `NotImplementedError`: RoboCore has the planning.
`robot.servo_driver`, `data_parser`     Absent: use `robot.arm`, an `armwire.Ling`.
======================================  ===============================================================================

The exceptions of `armwire.errors` replace the SDK's plain `Exception`. Angles are rounded to the nearest position; the
SDK rounds towards -180°. Speeds are not rounded to multiples of 50 ticks/s, and velocities are not limited to 5000
ticks/s.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from .. import _ling
from .._units import JOINTS, seconds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

__all__ = ["JointState", "SynriaRobotAPI", "create_robot"]

# The SDK's names of motion states.
_STATUS_TEXTS: dict[int, str] = {
    _ling.MotionStatus.IDLE: "idle",
    _ling.MotionStatus.LOCKED: "locked",
    _ling.MotionStatus.SYNCING: "sync",
    _ling.MotionStatus.SYNC_LOCKED: "sync_locked",
    _ling.MotionStatus.OVERHEATING: "overheat",
    _ling.MotionStatus.OVERHEAT_PROTECTION: "overheat_protect",
}
# Servos in the SDK's self-check, for every arm.
_CHECKED_SERVOS = 10
# The SDK's tolerance of the gripper's target, in thousandths.
_NEAR_GRIPPER = 5
_TICKS_PER_DEG = 4096 / 360


class JointState(NamedTuple):
    """The SDK's joint state."""

    angles: list[float]
    """Angles of six joints, in radians."""
    gripper: float
    """Gripper opening, 0 closed to 1000 open."""
    timestamp: float
    """Time of this computer, in seconds since the epoch."""
    run_status_text: str


class SynriaRobotAPI:
    """The calls of the SDK's class of this name that need only the arm."""

    def __init__(self, port: str, *, auto_connect: bool = True) -> None:
        if not port:
            raise ValueError("the port is required, for example /dev/ttyACM0: 'armwire list' shows the ports")
        self._port = port
        self._arm: _ling.Ling | None = None
        self._target_rad: list[float] | None = None
        self._target_gripper: int | None = None
        self.robot_type: str | None = None
        if auto_connect:
            self.connect()

    @property
    def arm(self) -> _ling.Ling:
        """The arm as an `armwire.Ling`, which has more calls."""
        if self._arm is None:
            raise ConnectionError(f"{self._port}: not connected")
        return self._arm

    def connect(self) -> bool:
        """Open the port and identify the arm."""
        if self._arm is None:
            arm = _ling.Ling(self._port)
            try:
                self.robot_type = arm.read_info().kind
            except BaseException:
                arm.close()
                raise
            self._arm = arm
            self._forget_targets()
        return True

    def disconnect(self) -> None:
        """Close the port."""
        if self._arm is not None:
            self._arm.close()
            self._arm = None

    def is_connected(self) -> bool:
        """Return true if the port is open."""
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
            raise ValueError(f"Unsupported info type: {info_type}, must be one of {', '.join(reads)}")
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
        """Move joints and gripper. An omitted target keeps its last value; after a change of the torque, its position.

        Ctrl-C stops the arm.

        Returns:
            True if all targets are reached, within `tolerance` in radians and 5 thousandths; true without waiting.

        Raises:
            ValueError: `joint_format` is neither `rad` nor `deg`, or a value is out of range; nothing is sent.
        """
        timeout_s = seconds(timeout)
        if joint_format not in ("rad", "deg"):
            raise ValueError(f"joint_format is {joint_format!r}, must be 'rad' or 'deg'")
        joints, gripper = self._target_rad, self._target_gripper
        if target_joints is not None:
            given = np.asarray(target_joints, dtype=np.float64)
            joints = (np.radians(given) if joint_format == "deg" else given).tolist()
        if gripper_value is not None:
            gripper = gripper_value
        if joints is None or gripper is None:
            state = self._joint_gripper()
            joints = state.angles if joints is None else joints
            gripper = int(state.gripper) if gripper is None else gripper
        speed_ticks_s = 5500 if gripper_speed_deg_s is None else round(gripper_speed_deg_s * _TICKS_PER_DEG)
        # Ctrl-C stops the arm as soon as it may move.
        with self.arm._stopped_by_ctrl_c():
            self.arm.move_rad(
                joints, gripper_permille=gripper, speed_rad_s=np.radians(speed_deg_s), gripper_ticks_s=speed_ticks_s
            )
            self._target_rad, self._target_gripper = joints, gripper
            if not wait_for_completion:
                return True
            until = time.monotonic() + timeout_s
            while True:
                state = self._joint_gripper()
                joints_arrived = target_joints is None or bool(
                    np.allclose(state.angles, joints, rtol=0, atol=tolerance)
                )
                gripper_arrived = gripper_value is None or abs(state.gripper - gripper) <= _NEAR_GRIPPER
                if joints_arrived and gripper_arrived:
                    return True
                if time.monotonic() >= until:
                    return False
                time.sleep(_ling.PERIOD_S)

    def set_home(self, speed_deg_s: ArrayLike = 10, gripper_speed_deg_s: float | None = 483.4) -> None:
        """Move to zero with the gripper open and wait."""
        self.set_robot_state([0.0] * JOINTS, 1000, speed_deg_s=speed_deg_s, gripper_speed_deg_s=gripper_speed_deg_s)

    def torque_control(self, command: str, timeout: float = 1.0) -> bool:
        """Switch the torque `on` or `off` and verify it."""
        if command not in ("on", "off"):
            raise ValueError("command must be 'on' or 'off'")
        # With the torque off, the arm may be moved by hand.
        self._forget_targets()
        self.arm.set_torque(command == "on")
        return True

    def zero_calibration(self) -> bool:
        """Make the current pose the zero position, after two prompts; the torque goes off between them."""
        input("This erases the factory's zero position, and the arm falls: hold it. Enter continues, Ctrl-C cancels.")
        self.arm.set_torque(False)
        input("Move the arm to its zero position by hand, then press Enter.")
        self.arm.set_zero()
        time.sleep(0.1)
        self.arm.set_torque(True)
        self._forget_targets()
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
        """Not implemented: see the table of this module."""
        _kinematics("get_pose")

    def set_pose(self, *args: object, **kwargs: object) -> NoReturn:
        """Not implemented: see the table of this module."""
        _kinematics("set_pose")

    def plan_joint_trajectory(self, *args: object, **kwargs: object) -> NoReturn:
        """Not implemented: see the table of this module."""
        _kinematics("plan_joint_trajectory")

    def plan_cartesian_trajectory(self, *args: object, **kwargs: object) -> NoReturn:
        """Not implemented: see the table of this module."""
        _kinematics("plan_cartesian_trajectory")

    def solve_ik_for_trajectory(self, *args: object, **kwargs: object) -> NoReturn:
        """Not implemented: see the table of this module."""
        _kinematics("solve_ik_for_trajectory")

    def _forget_targets(self) -> None:
        self._target_rad = self._target_gripper = None

    def _joint_gripper(self) -> JointState:
        state = self.arm.read_joints()
        text = "unknown" if state.foreign_data_bytes else _STATUS_TEXTS.get(state.status, "unknown")
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
    """Open the arm on a port. The SDK's arguments about models and backends are ignored."""
    return SynriaRobotAPI(port, auto_connect=auto_connect)


def _dotted(version: str) -> str:
    """A version in the SDK's notation: v6.10 is 6.1.0."""
    return ".".join(version.removeprefix("v").replace(".", ""))


def _kinematics(call: str) -> NoReturn:
    raise NotImplementedError(f"{call}: not implemented, use RoboCore for kinematics and planning")
