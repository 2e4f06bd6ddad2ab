"""Frames and messages of Ling / Alicia-D arms of both generations."""

import zlib
from math import pi

from .framing import Data, Message, Need, Stray, escaped, fact, hexadecimal, verify, wrong_length

RX, TX = 0, 1
HEADER, TAIL = 0xAA, 0xFF
MAX_DATA = 64
NO_VALUE = b"\xfe"
# The command of the arm's error frame. The sources contradict each other on its content.
ERROR = 0xEE
# The self-check request as printed in the document: length 0, and one data byte.
SELF_CHECK = b"\xaa\xfe\x00\x00\xfe"

JOINTS, CENTRE, TICKS = 6, 2048, 4096
MAX_TICKS, MAX_SPEED, MAX_OPENING = 4095, 5000, 1000
LEADER, FOLLOWER = 6, 10
STROKES = (50, 75, 100)
KINDS = {b"ADL": "Ling leader", b"ADF": "Ling follower"}
# The data bytes of an Alicia-D's answer with joints, and other robots that answer with another number.
OWN_JOINTS = (15, 16)
ROBOTS = {33: "Bessica-D"}
STATUS = {
    0x00: "idle",
    0x01: "locked",
    0x10: "syncing",
    0x11: "syncing, locked",
    0xE1: "overheating",
    0xE2: "overheat protection",
}


# A force-feedback leader: its modes, verdicts, torques and currents.
MODES = {0: "position", 1: "current"}
MODE_RESULTS = ("accepted", "invalid", "unsupported or not queued")
MODE_STATE = 52
FORCES = (
    ("residual torque", "Nm"),
    ("requested current", "A"),
    ("output current", "A"),
    ("measured current", "A"),
)
INHIBIT = (
    (0x01, "not in teleoperation"),
    (0x04, "link or sample older than 30 ms"),
    (0x08, "hardware fault"),
    (0x10, "unsupported"),
)
SWITCH = {0: "off", 1: "on"}
FEEDBACK = (
    ("requested", "switch"),
    ("effective", "switch"),
    ("inhibit", "mask"),
    ("sync", "switch"),
    ("torque", "switch"),
    ("requested torque", "switch"),
    ("transition", "number"),
    ("raw grip", "number"),
    ("requested mode", "number"),
)
# The lengths of the documented fields in answers.
LENGTHS = {
    (0x01, 0x00): 24,
    (0x04, 0x0E): 1,
    (0x05, 0x01): 3,
    (0x06, 0x00): 15,
    (0x06, 0x20): 10,
    (0x06, 0x24): MODE_STATE,
    (0xFE, 0x00): 2,
}


def checksum(body):
    """Return the low byte of CRC-32/ISO-HDLC."""
    return zlib.crc32(body) & 0xFF


def parity(data):
    """Return the sum modulo 2, which is the check of the older generation."""
    return sum(data) & 1


def degrees(ticks):
    """Return an angle in degrees."""
    return ticks * 360 / TICKS


def angle(ticks):
    """Return the angle of a position as text."""
    return "{:+.2f}°".format(degrees(ticks - CENTRE))


def note_joint(data, at, nth, ticks):
    """Note the position of a joint."""
    data.note(at, 2, "joint {}: {} ticks, {:+.4f} rad".format(nth, ticks, (ticks - CENTRE) / TICKS * 2 * pi))


def joints(data, offsets):
    """Return the positions of the joints at these offsets as text."""
    texts = []
    for nth, at in enumerate(offsets, 1):
        ticks = data.le16(at)
        note_joint(data, at, nth, ticks)
        texts.append(angle(ticks) + (" (out of range)" if ticks > MAX_TICKS else ""))
    return "joints: " + " ".join(texts)


# Requests. Each function takes the data and returns the meaning, or None for data of another length or value.


def no_value(text):
    """Return the decoder of a request without a value."""
    return lambda data: text if data.bytes == NO_VALUE else None


def torque(data):
    """Return the meaning of a switch of the torque."""
    return {b"\x00": "torque off", b"\x01": "torque on"}.get(data.bytes)


def temperature(data):
    """Return the meaning of a read of the temperatures, or of their limit."""
    if len(data.bytes) != 1:
        return None
    if data.bytes == NO_VALUE:
        return "read temperatures"
    data.note(0, 1, "limit: {} °C".format(data.bytes[0]))
    return "set temperature limit {} °C".format(data.bytes[0])


def move(data):
    """Return the meaning of targets and speeds."""
    if len(data.bytes) != 4 * (JOINTS + 1):
        return None
    axes = [(data.le16(at), data.le16(at + 2)) for at in range(0, len(data.bytes), 4)]
    opening, gripper_speed = axes.pop()
    if opening > MAX_OPENING or any(ticks > MAX_TICKS or speed > MAX_SPEED for ticks, speed in axes):
        return None
    for nth, (ticks, speed) in enumerate(axes):
        note_joint(data, 4 * nth, nth + 1, ticks)
        data.note(4 * nth + 2, 2, "speed: {} ticks/s".format(speed))
    data.note(4 * JOINTS, 2, "gripper: {} thousandths".format(opening))
    data.note(4 * JOINTS + 2, 2, "speed: {} ticks/s".format(gripper_speed))
    targets = " ".join("{} at {:.1f}°/s".format(angle(ticks), degrees(speed)) for ticks, speed in axes)
    return "move {}, gripper {:.1f} % at {} ticks/s".format(targets, opening / 10, gripper_speed)


def self_check_request(data):
    """Return the meaning of a request for a self-check. It is well-formed with and without the usual data byte."""
    return "self-check" if data.bytes in (b"", NO_VALUE) else None


def set_mode(data):
    """Return the meaning of a change of the control mode."""
    mode = MODES.get(data.bytes[0]) if len(data.bytes) == 1 else None
    return "set control mode " + mode if mode else None


def force_feedback_request(data):
    """Return the meaning of a switch or a read of the force feedback."""
    texts = {b"\x00": "force feedback off", b"\x01": "force feedback on", NO_VALUE: "read force feedback"}
    return texts.get(data.bytes)


# Answers.


def information(data):
    """Return serial number and versions."""
    if len(data.bytes) != 24:
        return None
    serial = escaped(data.bytes[:16].split(b"\0")[0])
    versions = [int.from_bytes(data.bytes[at : at + 4], "little") for at in (16, 20)]
    hardware, firmware = ("v{}.{:02}".format(version // 100, version % 100) for version in versions)
    data.note(0, 16, fact("serial", serial))
    data.note(16, 4, "hardware: " + hardware)
    data.note(20, 4, "firmware: " + firmware)
    kind = KINDS.get(data.bytes[:3], "Ling, of unknown kind")
    return "arm: {}, {}, hardware: {}, firmware: {}".format(kind, fact("serial", serial), hardware, firmware)


def stroke(data):
    """Return the stroke of the gripper."""
    if len(data.bytes) != 1 or data.bytes[0] >= len(STROKES):
        return None
    return "stroke: {} mm".format(STROKES[data.bytes[0]])


def joint_state(data):
    """Return the positions of joints and gripper, and the motion status."""
    if len(data.bytes) != 15:
        return None
    positions, gripper, code = joints(data, range(0, 12, 2)), data.le16(12), data.bytes[14]
    status = STATUS.get(code, "unknown status 0x{:02x}".format(code))
    if data.total not in OWN_JOINTS:
        robot = ROBOTS.get(data.total)
        status = "not an Alicia-D{} ({} data bytes)".format(" but a " + robot if robot else "", data.total)
    data.note(12, 2, "gripper: {} thousandths".format(gripper))
    data.note(14, 1, "status: " + status)
    opening = "(out of range)" if gripper > MAX_OPENING else "open"
    return "{}, gripper: {:.1f} % {}, status: {}".format(positions, gripper / 10, opening, status)


def temperatures(data):
    """Return the temperature of each servo."""
    if len(data.bytes) not in (LEADER, FOLLOWER):
        return None
    for nth, celsius in enumerate(data.bytes):
        data.note(nth, 1, "servo {}: {} °C".format(nth + 1, celsius))
    return "temperatures: {} °C".format(" ".join(map(str, data.bytes)))


def velocities(data):
    """Return the velocity of each servo."""
    if len(data.bytes) not in (2 * LEADER, 2 * FOLLOWER):
        return None
    ticks = [data.le16(at) for at in range(0, len(data.bytes), 2)]
    for nth, velocity in enumerate(ticks):
        data.note(2 * nth, 2, "servo {}: {} ticks/s".format(nth + 1, velocity))
    return "velocities: {} °/s".format(" ".join("{:.1f}".format(degrees(velocity)) for velocity in ticks))


def self_check(data):
    """Return the faulty servos."""
    if len(data.bytes) != 2:
        return None
    faulty = [nth for nth in range(1, FOLLOWER + 1) if not data.le16(0) >> (nth - 1) & 1]
    if not faulty:
        return "self-check: all {} servos normal".format(FOLLOWER)
    hint = " (a leader has none of 7 to 10)" if faulty[-4:] == [7, 8, 9, 10] else ""
    return "self-check: servos not normal: {}{}".format(", ".join(map(str, faulty)), hint)


# Answers of a force-feedback leader, from the vendor's candidate document. The first byte is a version.


def mode_reply(data):
    """Return the verdict on a requested mode."""
    if len(data.bytes) != 3 or data.bytes[0] != 1 or data.bytes[2] >= len(MODE_RESULTS):
        return None
    mode, result = MODES.get(data.bytes[1], "0x{:02x}".format(data.bytes[1])), MODE_RESULTS[data.bytes[2]]
    data.note(1, 1, "requested mode: " + mode)
    data.note(2, 1, "result: " + result)
    return "requested mode: {}, result: {}".format(mode, result)


def joint_numbers(mask):
    """Return the numbers of the joints in a mask."""
    return " ".join(str(nth + 1) for nth in range(8) if mask >> nth & 1) or "none"


def thousandths(value):
    """Return a value in thousandths as text."""
    return "{}{}.{:03}".format("-" if value < 0 else "", abs(value) // 1000, abs(value) % 1000)


def mode_state(data):
    """Return the applied mode, the torques and the currents."""
    if len(data.bytes) != MODE_STATE or data.bytes[0] != 1 or data.bytes[1] not in MODES:
        return None
    mode, blocked, valid = MODES[data.bytes[1]], joint_numbers(data.bytes[2]), joint_numbers(data.bytes[3])
    texts = ["mode: " + mode, "blocked: " + blocked, "valid: " + valid]
    for at, text in enumerate(texts, 1):
        data.note(at, 1, text)
    for place, (name, unit) in enumerate(FORCES):
        values = []
        for joint in range(JOINTS):
            at = 4 + 8 * joint + 2 * place
            values.append(thousandths((data.le16(at) + 0x8000) % 0x10000 - 0x8000))
            data.note(at, 2, "joint {} {}: {} {}".format(joint + 1, name, values[-1], unit))
        texts.append("{}s: {} {}".format(name, " ".join(values), unit))
    return ", ".join(texts)


def inhibition(mask):
    """Return the reasons in a mask."""
    reasons = [reason for bit, reason in INHIBIT if mask & bit]
    rest = mask & ~sum(bit for bit, _ in INHIBIT)
    return "; ".join(reasons + ["unknown 0x{:02x}".format(rest)] * (rest > 0)) or "none"


def force_feedback(data):
    """Return the state of the force feedback."""
    if len(data.bytes) != len(FEEDBACK) + 1 or data.bytes[0] != 2:
        return None
    texts = []
    for at, (name, meaning) in enumerate(FEEDBACK, 1):
        value = {"switch": SWITCH.get, "mask": inhibition, "number": str}[meaning](data.bytes[at])
        if value is None:
            return None
        texts.append("{}: {}".format(name, value))
    for at, text in enumerate(texts, 1):
        data.note(at, 1, text)
    return ", ".join(texts)


# Messages of each line by command and function.
MESSAGES = {
    TX: {
        (0x01, 0x00): no_value("read information"),
        (0x03, 0x00): no_value("set zero position"),
        (0x04, 0x00): no_value("set gripper stroke 50 mm"),
        (0x04, 0x01): no_value("set gripper stroke 75 mm"),
        (0x04, 0x02): no_value("set gripper stroke 100 mm"),
        (0x04, 0x0E): no_value("read gripper stroke"),
        (0x05, 0x00): torque,
        (0x06, 0x00): no_value("read joints"),
        (0x06, 0x01): temperature,
        (0x06, 0x02): no_value("read velocities"),
        (0x05, 0x01): set_mode,
        (0x06, 0x03): move,
        (0x06, 0x20): force_feedback_request,
        (0x06, 0x24): no_value("read control mode"),
        (0xFE, 0x00): self_check_request,
    },
    RX: {
        (0x01, 0x00): information,
        (0x04, 0x0E): stroke,
        (0x06, 0x00): joint_state,
        (0x06, 0x01): temperatures,
        (0x05, 0x01): mode_reply,
        (0x06, 0x02): velocities,
        (0x06, 0x20): force_feedback,
        (0x06, 0x24): mode_state,
        (0xFE, 0x00): self_check,
    },
}


def documented_length(key, length):
    """Return the length of the documented fields in an answer of this length. Arms may send more."""
    if key == (0x06, 0x01):
        return LEADER if length < FOLLOWER else FOLLOWER
    if key == (0x06, 0x02):
        return 2 * (LEADER if length < 2 * FOLLOWER else FOLLOWER)
    return LENGTHS.get(key, length)


# The older generation, which only sends. Nine servos move six joints.


def older_joints(data):
    """Return the positions of the joints."""
    return joints(data, (0, 4, 8, 12, 14, 16))


def older_gripper(data):
    """Return the raw position of the gripper, and the buttons."""
    values = (data.le16(1), data.le16(3), data.bytes[5], data.bytes[6])
    places = (("gripper", 1, 2), ("potentiometer", 3, 2), ("sync button", 5, 1), ("attitude button", 6, 1))
    texts = ["{}: {}".format(name, value) for (name, _, _), value in zip(places, values)]
    for (_, at, length), text in zip(places, texts):
        data.note(at, length, text)
    return ", ".join(texts)


# Messages of the older generation by command and length. No message of the current generation begins with these bytes.
OLDER = {
    (0x04, 0x12): older_joints,
    (0x14, 0x12): older_joints,
    (0x02, 0x07): older_gripper,
    (0x12, 0x07): older_gripper,
}


class Ling:
    """The protocol of both generations. A frame identifies its generation."""

    def scan(self, window, _side):
        """Return the verdict on the front of a window."""
        if window[0] != HEADER:
            stray = window.find(HEADER)
            return Stray(len(window) if stray < 0 else stray)
        if len(window) < 4:
            return Need(4 - len(window))
        if (window[1], window[2]) in OLDER:
            return verify(window, window[2] + 5, 3, parity, TAIL)
        if window[3] > MAX_DATA:
            return wrong_length(window[3], 0, MAX_DATA)
        length = 1 if window.startswith(SELF_CHECK) else window[3]
        return verify(window, length + 6, 1, checksum, TAIL)

    def message(self, frame, side):
        """Return the meaning of a frame. It identifies its sender, whatever the line."""
        key = (frame[1], frame[2])
        older = OLDER.get(key)
        for sender, meaning in ((RX, older),) if older else ((TX, MESSAGES[TX].get(key)), (RX, MESSAGES[RX].get(key))):
            start, end = 3 if older else 4, len(frame) - 2
            is_answer = sender == RX and not older
            fields_end = min(start + documented_length(key, end - start), end) if is_answer else end
            data = Data(frame, start, fields_end, end - start)
            text = meaning(data) if meaning else None
            if text and fields_end < end:
                extra = "extra: " + hexadecimal(frame[fields_end:end])
                data.note(fields_end - start, end - fields_end, extra)
                text += ", " + extra
            if text:
                return Message(sender, text, data.fields)
        if frame[1] == ERROR:
            return Message(RX, "error frame " + hexadecimal(frame), [])
        return Message(side, "no message: " + hexadecimal(frame), [])
