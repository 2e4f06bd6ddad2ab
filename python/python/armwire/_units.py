"""Counts on the wire and units in programs: degrees, radians, thousandths.

A joint has 4096 ticks per turn, with zero at 2048. A tick is 45/512 degrees, exact in floating point.
"""

import math
import operator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._armwire import SLOWEST_TICKS_S

Floats = NDArray[np.float64]

MAX_BAUD = 2**32 - 1
MAX_RATE_HZ = 1000

JOINTS = 6
TICKS_PER_TURN = 4096
ZERO = 2048
MAX_TICKS = 4095
MAX_TICKS_PER_S = 5000
DEG_PER_TICK = 360 / TICKS_PER_TURN
RAD_PER_TICK = 2 * np.pi / TICKS_PER_TURN
# Tolerance of rounding errors at the ends of a range, in ticks.
SLACK = 1e-6


def floats(numbers: bytearray) -> Floats:
    """An array of 64-bit floating-point numbers in native byte order, without a copy."""
    return np.frombuffer(numbers, np.float64)


def position_ticks(joints: ArrayLike, unit_per_tick: float, unit: str) -> list[int]:
    """Six positions in ticks, each nearest to an angle.

    Raises:
        ValueError: The number of angles is not six, or one is out of range or not a number.
    """
    values = _six(joints, "joint angles")
    return _ticks("angle", values, values / unit_per_tick + ZERO, 0, MAX_TICKS, ZERO, unit_per_tick, unit)


def speed_ticks(speed: ArrayLike, unit_per_tick: float, unit: str, slowest_ticks_s: int = SLOWEST_TICKS_S) -> list[int]:
    """Six speeds in ticks per second, each nearest to its speed, or to one speed for all joints.

    Raises:
        ValueError: A speed is out of range. An arm may take less than 50 ticks/s (4.4°/s) for 0.
    """
    given = np.asarray(speed, dtype=np.float64)
    values = np.full(JOINTS, given) if given.ndim == 0 else _six(given, "joint speeds")
    ticks, why = values / unit_per_tick, " (an arm may take less for 0)"
    return _ticks("speed", values, ticks, slowest_ticks_s, MAX_TICKS_PER_S, 0, unit_per_tick, unit, why)


def tolerance_ticks(within: float, unit_per_tick: float, unit: str) -> int:
    """A tolerance in ticks, the nearest.

    Raises:
        ValueError: It is less than a tick, more than a turn, or not a number.
    """
    ticks = within / unit_per_tick
    if not 1 - SLACK <= ticks <= MAX_TICKS + 1 + SLACK:
        first, last = unit_per_tick, (MAX_TICKS + 1) * unit_per_tick
        raise ValueError(f"the tolerance is {within:g} {unit}, must be {first:.6g} to {last:.6g}")
    return round(ticks)


def _six(values: ArrayLike, what: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (JOINTS,):
        raise ValueError(f"{what} have the shape {array.shape}, must be {JOINTS} numbers")
    return array


def _ticks(
    what: str,
    values: Floats,
    ticks: Floats,
    low: int,
    high: int,
    zero: int,
    unit_per_tick: float,
    unit: str,
    why: str = "",
) -> list[int]:
    for joint, (value, tick) in enumerate(zip(values.tolist(), ticks.tolist(), strict=True), start=1):
        # NaN fails every comparison and counts as out of range.
        if not low - SLACK <= tick <= high + SLACK:
            first, last = (low - zero) * unit_per_tick, (high - zero) * unit_per_tick
            raise ValueError(f"{what} of joint {joint} is {value:g} {unit}, must be {first:.6g} to {last:.6g}{why}")
    return [int(tick) for tick in np.rint(ticks)]


def seconds(timeout: float) -> float:
    """A time-out in seconds.

    Raises:
        ValueError: It is negative, infinite or not a number.
    """
    if not 0 <= timeout < math.inf:
        raise ValueError(f"the time-out is {timeout} s, must be 0 or more, and finite")
    return timeout


def count(what: str, value: int, maximum: int, minimum: int = 0) -> int:
    """A whole number from `minimum` to `maximum`.

    Raises:
        TypeError: The value is not an integer.
        ValueError: The number is out of range.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{what} is {value!r}, must be an integer") from None
    if not minimum <= number <= maximum:
        raise ValueError(f"{what} is {number}, must be {minimum} to {maximum}")
    return number


def baud_rate(baud: int | None) -> int | None:
    """A baud rate, or `None` for the default.

    Raises:
        TypeError: The value is not an integer.
        ValueError: The number is out of range.
    """
    return None if baud is None else count("baud rate", baud, MAX_BAUD, minimum=1)


def rate(hertz: int) -> int:
    """Readings per second.

    Raises:
        TypeError: The value is not an integer.
        ValueError: The number is out of range.
    """
    return count("rate in Hz", hertz, MAX_RATE_HZ, minimum=1)
