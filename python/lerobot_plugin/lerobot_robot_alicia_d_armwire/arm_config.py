"""The options that leader and follower share."""

import math
from dataclasses import dataclass


@dataclass(kw_only=True)
class ArmConfig:
    """The port of an arm, and the rate of its readings."""

    port: str
    """The port: a serial port, `tcp:HOST:PORT`, `can:IFACE/NODE` or `slcan:PORT@BITRATE/NODE`."""
    baud: int | None = None
    """The serial port's baud rate; 1000000 by default."""
    reading_rate_hz: int = 200
    """Readings of the pose per second, 1 to 1000."""
    observation_timeout_s: float = 1.0
    """Maximum wait for the next pose or image while the newest is too old, in seconds, 0 to 60. Then it is an error."""

    def check_reading(self, max_age: str) -> None:
        """Check the rate of readings, the wait for one, and the option with this name, their maximum age.

        Raises:
            ValueError: One is out of range.
        """
        if self.reading_rate_hz not in range(1, 1001):
            raise ValueError(f"reading_rate_hz is {self.reading_rate_hz}, must be 1 to 1000")
        if not 0 <= self.observation_timeout_s <= 60:
            raise ValueError(f"observation_timeout_s is {self.observation_timeout_s}, must be 0 to 60")
        max_age_s = getattr(self, max_age)
        if not (max_age_s > 0 and math.isfinite(max_age_s)):
            raise ValueError(f"{max_age} is {max_age_s}, must be over 0")
