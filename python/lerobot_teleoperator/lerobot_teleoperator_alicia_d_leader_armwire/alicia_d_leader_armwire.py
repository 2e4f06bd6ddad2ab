"""A leader arm for LeRobot."""

import logging
from functools import cached_property
from typing import Any

from lerobot.teleoperators import Teleoperator
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

import armwire
from lerobot_robot_alicia_d_armwire.patience import Patience
from lerobot_robot_alicia_d_armwire.pose import CALIBRATION, FEATURES, lerobot_errors, observed, start_reader

from .config_alicia_d_leader_armwire import AliciaDLeaderArmwireConfig

logger = logging.getLogger(__name__)


class AliciaDLeaderArmwire(Teleoperator):
    """A leader arm, moved by hand."""

    config_class = AliciaDLeaderArmwireConfig
    name = "alicia_d_leader_armwire"

    def __init__(self, config: AliciaDLeaderArmwireConfig) -> None:
        super().__init__(config)
        self.config = config
        self._arm: armwire.Ling | None = None
        self._reader: armwire.Reader[armwire.JointState] | None = None
        self._patience = Patience(config.observation_timeout_s)

    @cached_property
    def action_features(self) -> dict[str, type]:
        """Joints and gripper."""
        return dict(FEATURES)

    @cached_property
    def feedback_features(self) -> dict[str, type]:
        """Return no features: the arm accepts no feedback."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Return true if the arm is open."""
        return self._arm is not None

    @property
    def waits(self) -> int:
        """The number of waits for a pose, because the newest was too old."""
        return self._patience.waits

    def connect(self, calibrate: bool = True) -> None:
        """Open the port. The torque stays as it is.

        Raises:
            DeviceNotConnectedError: The arm cannot be opened or does not answer; the text has the reason.
        """
        if self._arm is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected.")
        try:
            with lerobot_errors():
                self._arm = armwire.Ling(self.config.port, baud=self.config.baud)
                info = self._arm.read_info()
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
        """Do nothing: the arm needs no configuration."""

    def get_action(self) -> dict[str, Any]:
        """Return the newest pose, without waiting for the arm unless it is too old.

        Raises:
            TimeoutError: The newest pose is older than `action_max_age_s`, and no other comes within
                `observation_timeout_s`.
            DeviceNotConnectedError: The port was lost, or the arm is no Alicia-D; the text has the reason.
        """
        self._connected()
        assert self._reader is not None
        with lerobot_errors():
            return dict(observed(self._reader, (), self.config.action_max_age_s, self._patience))

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing: the arm accepts no feedback."""

    def disconnect(self) -> None:
        """Close the port."""
        self._connected()
        self._close()
        logger.info("%s disconnected. Actions waited %d times.", self, self.waits)

    def _close(self) -> None:
        for opened in (self._reader, self._arm):
            if opened is not None:
                opened.close()
        self._arm = self._reader = None

    def _connected(self) -> armwire.Ling:
        if self._arm is None:
            raise DeviceNotConnectedError(f"{self} is not connected. Run `.connect()` first.")
        return self._arm
