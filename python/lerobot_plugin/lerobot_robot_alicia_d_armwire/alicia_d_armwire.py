"""A follower arm for LeRobot."""

import logging
import math
import threading
import time
from collections.abc import Callable
from functools import cached_property
from typing import Any

from lerobot.cameras import make_cameras_from_configs
from lerobot.robots import Robot
from lerobot.robots.utils import ensure_safe_goal_position
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

import armwire

from .config_alicia_d_armwire import AliciaDArmwireConfig
from .patience import Patience
from .pose import (
    CALIBRATION,
    FEATURES,
    GRIPPER,
    JOINTS,
    image,
    lerobot_errors,
    newest_reading,
    observed,
    pose,
    start_reader,
)

logger = logging.getLogger(__name__)

# Ranges of joints and gripper. Actions out of range are clamped, and the sent values are returned.
MIN_DEG, MAX_DEG = -180.0, 179.912
MAX_GRIPPER = 1000.0
# Pause before a failed stop is retried, in seconds.
RETRY_S = 0.5


class AliciaDArmwire(Robot):
    """A follower arm. It stops at its current position when actions time out."""

    config_class = AliciaDArmwireConfig
    name = "alicia_d_armwire"

    def __init__(self, config: AliciaDArmwireConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras = make_cameras_from_configs(config.cameras)
        self._arm: armwire.Ling | None = None
        self._reader: armwire.Reader[armwire.JointState] | None = None
        self._patience = Patience(config.observation_timeout_s)
        self._watchdog: _Watchdog | None = None
        # One motion at a time, an action or a stop.
        self._motion = threading.Condition()
        # False before the first action: there is no motion to stop.
        self._has_moved = False

    @cached_property
    def observation_features(self) -> dict[str, type | tuple[int, int, int]]:
        """Joints, gripper, and the images of the cameras."""
        cameras = self.config.cameras.items()
        return {**FEATURES, **{name: (camera.height, camera.width, 3) for name, camera in cameras}}

    @cached_property
    def action_features(self) -> dict[str, type]:
        """Joints and gripper."""
        return dict(FEATURES)

    @property
    def is_connected(self) -> bool:
        """Return true if the arm and all cameras are open."""
        return self._arm is not None and all(camera.is_connected for camera in self.cameras.values())

    @property
    def waits(self) -> int:
        """The number of waits for a pose or an image, because the newest was too old."""
        return self._patience.waits

    def connect(self, calibrate: bool = True) -> None:
        """Open the port and switch the torque on: the arm holds its pose.

        Raises:
            DeviceNotConnectedError: The arm cannot be opened or does not answer; the text has the reason.
        """
        if self._arm is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected.")
        try:
            with lerobot_errors():
                self._arm = armwire.Ling(self.config.port, baud=self.config.baud)
                info = self._arm.read_info()
                if info.kind == "leader":
                    raise armwire.errors.WrongArmError(f"{self.config.port}: {info.serial} is a leader, not a follower")
                if self.config.park_on_disconnect:
                    self._arm.read_park_pose_deg()
                for camera in self.cameras.values():
                    camera.connect()
                self.configure()
                self._reader = start_reader(self._arm, self.config.reading_rate_hz)
        except BaseException:
            self._close()
            raise
        logger.info("%s connected: %s, firmware %s", self, info.serial, info.firmware)

    @property
    def is_calibrated(self) -> bool:
        """Return true: the arm stores its zero position."""
        return True

    def calibrate(self) -> None:
        """Log instructions for the zero position. It has no other effect."""
        logger.info(CALIBRATION)

    def configure(self) -> None:
        """Switch the torque on."""
        self._connected().set_torque(True)

    def get_observation(self) -> dict[str, Any]:
        """Return the newest pose and images, without waiting for the arm unless they are too old.

        The pose is that at the time of the newest image, if its camera has one, and else the newest.

        Raises:
            TimeoutError: The newest pose is older than `observation_max_age_s`, or an image is too old for its camera,
                and no other comes within `observation_timeout_s`.
            DeviceNotConnectedError: The port was lost, or the arm is no Alicia-D; the text has the reason.
        """
        self._connected()
        assert self._reader is not None
        max_age_s = self.config.observation_max_age_s
        with lerobot_errors():
            if self.cameras:
                # A wait for the pose is over before the images are taken: they are as new as the pose.
                newest_reading(self._reader, max_age_s, self._patience)
            images = {name: image(camera, self._patience) for name, camera in self.cameras.items()}
            times = (time for _, time in images.values())
            observation: dict[str, Any] = observed(self._reader, times, max_age_s, self._patience)
        return {**observation, **{name: image for name, (image, _) in images.items()}}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Start a move to a pose.

        Returns:
            The sent pose: clamped to the arm's range and to `max_relative_target`.

        Raises:
            ValueError: A joint or the gripper is missing or not a number; nothing is sent.
            DeviceNotConnectedError: The pose cannot be sent, or the torque is off; the text has the reason.
        """
        arm = self._connected()
        goal = _checked(action)
        with self._motion, lerobot_errors():
            try:
                goal = self._limited(arm, goal)
                self._has_moved = True
                arm.move_deg(
                    [goal[name] for name in JOINTS],
                    gripper_permille=round(goal[GRIPPER]),
                    speed_deg_s=self.config.speed_deg_s,
                    gripper_ticks_s=self.config.gripper_ticks_s,
                )
            finally:
                if self._has_moved:
                    self._feed()
        return {f"{name}.pos": value for name, value in goal.items()}

    def disconnect(self) -> None:
        """Stop or park and close the arm, and close the cameras. The arm holds its pose if the torque stays on.

        At rest the stop ends the stream of actions at an adapter, which then keeps the torque on.
        """
        arm = self._connected()
        try:
            if self._watchdog is not None:
                self._watchdog.end()
            self._close_reader()
            try:
                self._stop()
            except armwire.ArmwireError as error:
                logger.warning("%s was not stopped: %s", self, error)
            if self.config.park_on_disconnect:
                try:
                    arm.park()
                except armwire.ArmwireError as error:
                    logger.warning("%s was not parked: %s", self, error)
            if self.config.disable_torque_on_disconnect:
                try:
                    arm.set_torque(False)
                except armwire.ArmwireError as error:
                    logger.warning("the torque of %s was not switched off: %s", self, error)
        finally:
            self._close()
        logger.info("%s disconnected. Observations waited %d times.", self, self.waits)

    def _connected(self) -> armwire.Ling:
        if self._arm is None:
            raise DeviceNotConnectedError(f"{self} is not connected. Run `.connect()` first.")
        return self._arm

    def _close(self) -> None:
        if self._watchdog is not None:
            self._watchdog.end()
            self._watchdog = None
        self._close_reader()
        if self._arm is not None:
            self._arm.close()
            self._arm = None
        self._has_moved = False
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()

    def _close_reader(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _feed(self) -> None:
        """Restart the timeout of actions."""
        if self._watchdog is None and self.config.action_timeout_s > 0:
            self._watchdog = _Watchdog(self.config.action_timeout_s, self._motion, self._stop)
        if self._watchdog is not None:
            self._watchdog.feed()

    def _limited(self, arm: armwire.Ling, goal: dict[str, float]) -> dict[str, float]:
        """Limit the goal to the configured distance from the current joints."""
        limit = self.config.max_relative_target
        if limit is None:
            return goal
        limits = limit if isinstance(limit, dict) else dict.fromkeys(JOINTS, float(limit))
        present = pose(arm.read_joints())
        pairs = {name: (goal[name], present[f"{name}.pos"]) for name in limits}
        return {**goal, **ensure_safe_goal_position(pairs, limits)}

    def _stop(self) -> None:
        """Stop the motion of the actions. The gripper keeps its goal, to keep its grip.

        Raises:
            ArmwireError: The arm does not answer, or still moves.
        """
        with self._motion:
            if self._arm is not None and self._has_moved:
                self._arm.stop()


class _Watchdog:
    """A watchdog thread: stops the arm on timeout, retries until it succeeds, and then waits for the next feed."""

    def __init__(self, timeout_s: float, changed: threading.Condition, stop: Callable[[], None]) -> None:
        self._timeout_s = timeout_s
        self._stop = stop
        self._changed = changed
        self._due: float | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="action watchdog", daemon=True)
        self._thread.start()

    def feed(self) -> None:
        with self._changed:
            self._due = time.monotonic() + self._timeout_s
            self._changed.notify()

    def end(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        with self._changed:
            failures = 0
            while not self._ended:
                left = None if self._due is None else self._due - time.monotonic()
                if left is None or left > 0:
                    self._changed.wait(left)
                    continue
                try:
                    self._stop()
                    self._due = None
                    failures = 0
                    logger.warning("no action for %g s: the arm was stopped", self._timeout_s)
                except armwire.ArmwireError as error:
                    self._due = time.monotonic() + RETRY_S
                    failures += 1
                    if failures == 1:
                        logger.warning("no action for %g s, the arm is not stopped: %s", self._timeout_s, error)


def _checked(action: dict[str, Any]) -> dict[str, float]:
    """The goal by name, clamped to the arm's range."""
    goal: dict[str, float] = {}
    for name in (*JOINTS, GRIPPER):
        value = float(action[f"{name}.pos"]) if f"{name}.pos" in action else math.nan
        if not math.isfinite(value):
            raise ValueError(f"{name}.pos of the action is {action.get(f'{name}.pos', 'missing')}, must be a number")
        low, high = (0.0, MAX_GRIPPER) if name == GRIPPER else (MIN_DEG, MAX_DEG)
        goal[name] = min(max(value, low), high)
    return goal
