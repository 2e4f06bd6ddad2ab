"""A pose for LeRobot: by name, joints in degrees, the gripper from 0 (closed) to 1000 (open)."""

from __future__ import annotations

import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from lerobot.utils.errors import DeviceNotConnectedError

import armwire

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from .patience import Patience

JOINTS = tuple(f"joint{number}" for number in range(1, 7))
GRIPPER = "gripper"
FEATURES: dict[str, type] = {f"{name}.pos": float for name in (*JOINTS, GRIPPER)}

CALIBRATION = (
    "The servos of an Alicia-D store the factory's zero position: no calibration is needed. `armwire set-zero PORT` "
    "makes the current pose the zero position permanently. Leader and follower need the same zero pose."
)


def pose(state: armwire.JointState) -> dict[str, float]:
    """The pose in an arm's joint state.

    Raises:
        UnacceptableError: It is another robot than an Alicia-D, or a value is out of range.
    """
    if state.foreign_data_bytes:
        raise armwire.errors.UnacceptableError(state.motion_refusal)
    values = [*state.joints_deg.tolist(), float(state.gripper_permille)]
    return dict(zip(FEATURES, values, strict=True))


@contextmanager
def lerobot_errors() -> Iterator[None]:
    """Raise errors of an arm as LeRobot's, with their text."""
    try:
        yield
    except armwire.ArmwireError as error:
        raise DeviceNotConnectedError(str(error)) from error


# Timeout of the first reading.
FIRST_S = 1.0
# Attempts to get an image with its time, while the camera replaces it.
ATTEMPTS = 3


def start_reader(arm: armwire.Ling, rate_hz: int) -> armwire.Reader[armwire.JointState]:
    """Start to read the pose, and wait for the first one.

    Raises:
        ArmwireError: The arm does not answer.
    """
    reader = arm.reader(rate_hz)
    if reader.next_after(0, timeout_s=FIRST_S) is None:
        reader.close()
        raise armwire.errors.AbsentError(f"{arm.port}: no pose was read in {FIRST_S:g} s")
    return reader


def image(camera: Any, patience: Patience) -> tuple[Any, int | None]:
    """The newest image of a camera, and its time in nanoseconds of the monotonic clock, if the camera has it.

    Raises:
        TimeoutError: The newest image is too old for the camera, and no other comes in time.
    """

    def wait(seconds: float) -> None:
        # It returns an image that it has not returned before at once, even if that is too old.
        with suppress(TimeoutError):
            camera.async_read(timeout_ms=seconds * 1000)

    for _ in range(ATTEMPTS):
        before = getattr(camera, "latest_timestamp", None)
        image = patience.get(camera.read_latest, wait)
        after = getattr(camera, "latest_timestamp", None)
        if after is None or after == before:
            break
    if after is None:
        return image, None
    # LeRobot's cameras stamp by `time.perf_counter`.
    return image, round(after * 1e9) + time.monotonic_ns() - time.perf_counter_ns()


def newest_reading(
    reader: armwire.Reader[armwire.JointState], max_age_s: float, patience: Patience
) -> armwire.Reading[armwire.JointState]:
    """The newest reading, which is waited for if it is too old.

    Raises:
        TimeoutError: None comes in time.
        ArmwireError: The port was lost.
    """
    return patience.get(
        lambda: reader.latest(max_age_s=max_age_s),
        lambda seconds: reader.next_after(reader.counts().samples, timeout_s=seconds),
    )


def observed(
    reader: armwire.Reader[armwire.JointState],
    image_times: Iterable[int | None],
    max_age_s: float,
    patience: Patience,
) -> dict[str, float]:
    """The pose at the time of the newest image. Without an image time, or after the newest reading, the newest pose.

    Raises:
        TimeoutError: The newest pose is too old, and no other comes in time.
        ArmwireError: The port was lost.
    """
    newest = newest_reading(reader, max_age_s, patience)
    at = max((time for time in image_times if time is not None), default=None)
    if at is None:
        return pose(newest.pose)
    try:
        return pose(reader.at(at).pose)
    except armwire.errors.NoPoseError:
        return pose(newest.pose)
