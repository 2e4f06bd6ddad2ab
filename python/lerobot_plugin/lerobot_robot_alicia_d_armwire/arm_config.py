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

    def check_reading(self, max_age: str) -> None:
        """Check the rate of readings, and the option with this name, their maximum age.

        Raises:
            ValueError: One is out of range.
        """
        if self.reading_rate_hz not in range(1, 1001):
            raise ValueError(f"reading_rate_hz is {self.reading_rate_hz}, must be 1 to 1000")
        max_age_s = getattr(self, max_age)
        if not (max_age_s > 0 and math.isfinite(max_age_s)):
            raise ValueError(f"{max_age} is {max_age_s}, must be over 0")
