"""Frames, units and data of the virtual Ling follower arm."""

import math
import zlib

SERIAL_NUMBER = "ADFS251205123456"
# Ticks of a joint's sensor: at 0 rad, and per turn.
CENTRE, TICKS_PER_TURN = 2048, 4096
# One tick, in rad.
TICK = 2 * math.pi / TICKS_PER_TURN
# Servos 1 to 9 move the joints, servo 10 the gripper.
JOINT_SERVOS = 9
# A pose away from the zero position, in degrees.
POSE = [10.0, -20.0, 30.0, 0.0, 45.0, -90.0]


def frame(command: int, function: int, data: bytes = b"\xfe") -> bytes:
    """A frame with this data, by default that of a read request."""
    body = bytes([command, function, len(data)]) + data
    return b"\xaa" + body + bytes([zlib.crc32(body) & 0xFF, 0xFF])


def is_frame(data: bytes) -> bool:
    """True if the bytes are one whole frame."""
    return len(data) > 5 and data == frame(data[1], data[2], data[4:-2])
