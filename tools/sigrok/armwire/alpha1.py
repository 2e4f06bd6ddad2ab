"""Frames and messages of the UBTECH Alpha1 and of its servos."""

from .framing import (
    Data,
    Frame,
    Message,
    Need,
    Noise,
    Padding,
    Stray,
    escaped,
    fact,
    hexadecimal,
    verify,
    wrong_byte,
    wrong_length,
)

RX, TX = 0, 1
TAIL = 0xED
SUCCESS, FAILURE = 0xAA, 0xEE
ACT, SERVO, SERVO_VERSION = 0xFB, 0xFA, 0xFC
SERVOS, MAX_ANGLE, MAX_SERVO = 20, 240, 240
NO_ANGLE = 0xFF
CHANGE_ID = 0xCD
OLDEST_FIRMWARE = b"2015121519"

# Lengths of the data by the header's first byte. The first byte of a counted text is its length, including itself. A
# status has no checksum.
COUNTED, STATUS = "counted", "status"
LAYOUTS = {
    TX: {
        0xF1: 6,
        0xEF: 6,
        0xF2: 6,
        0xF5: 6,
        0xFB: 29,
        0xF4: 6,
        0xF9: 6,
        0xF3: COUNTED,
        0xFA: 6,
        0xFC: 6,
    },
    RX: {
        0xF1: COUNTED,
        0xEF: 4,
        0xF2: STATUS,
        0xF5: 11,
        0xFB: 6,
        0xF4: STATUS,
        0xF9: STATUS,
        0xF3: STATUS,
        0xFA: 6,
        0xFC: 6,
    },
}


def checksum(data):
    """Return the low byte of the sum."""
    return sum(data) & 0xFF


def seconds(units):
    """Return a time in units of 20 ms as text."""
    return "{:.7g} s".format(units * 0.02)


def as_angle(byte):
    """Return an angle as text."""
    return "{}°".format(byte) if byte <= MAX_ANGLE else "{} (out of range)".format(byte)


def is_servo(number):
    """Return true for the id of a single servo."""
    return 1 <= number <= MAX_SERVO


# Requests. Each function takes the data and returns the meaning, or None for data of other values.


def plain(first, text):
    """Return the decoder of a request without a value: its data is this byte and zeros."""
    return lambda data: text if data.bytes == bytes([first, 0, 0, 0, 0, 0]) else None


def act(data):
    """Return the meaning of a frame of an action."""
    if data.bytes[:6] != b"\1\0\0\0\0\0":
        return None
    angles = []
    for nth, byte in enumerate(data.bytes[6 : 6 + SERVOS], 1):
        angles.append("-" if byte == NO_ANGLE else as_angle(byte))
        data.note(5 + nth, 1, "servo {}: {}".format(nth, angles[-1]))
    time, interval = seconds(data.bytes[26]), seconds(data.be16(27))
    data.note(26, 1, "time: " + time)
    data.note(27, 2, "interval: " + interval)
    return "act {} in {}, next after {}".format(" ".join(angles), time, interval)


def offset_tool(data):
    """Return the meaning of a switch of the offset tool."""
    texts = {b"\1\0\0\0\0\0": "disconnect the offset tool", b"\1\1\0\0\0\0": "connect the offset tool"}
    return texts.get(data.bytes)


def usb_type(data):
    """Return the meaning of a change of the USB type."""
    texts = {
        b"\1\0\0\0\0\0": "be a disk on USB",
        b"\2\0\0\0\0\0": "be a serial port on USB",
        b"\3\0\0\0\0\0": "be a HID device on USB",
    }
    return texts.get(data.bytes)


def play(data):
    """Return the meaning of a request to play an action."""
    return "play '{}'".format(escaped(data.bytes[1:]))


# Requests to servos. Each function takes the data from the servo's id on, and the name of the servo.


def servo_move(data, servo):
    """Return the meaning of a move, or of a release."""
    if data.bytes[2] == NO_ANGLE:
        return "release " + servo
    angle, time, lock = as_angle(data.bytes[2]), seconds(data.bytes[3]), seconds(data.be16(4))
    data.note(2, 1, "angle: " + angle)
    data.note(3, 1, "time: " + time)
    data.note(4, 2, "completion time: " + lock)
    return "move {} to {} in {}, completion time {}".format(servo, angle, time, lock)


def servo_led(data, servo):
    """Return the meaning of a setting of the LED."""
    return None if any(data.bytes[3:]) else "light of {} to {}".format(servo, data.bytes[2])


def servo_read_angles(data, servo):
    """Return the meaning of a read of the angles."""
    return None if any(data.bytes[2:]) else "read angles of {}, and release it".format(servo)


def servo_change_id(data, servo):
    """Return the meaning of a change of the id."""
    if data.bytes[2] or any(data.bytes[4:]) or not is_servo(data.bytes[3]):
        return None
    return "change id of {} to {}".format(servo, data.bytes[3])


def thirds(data):
    """Return an offset in thirds of a degree."""
    return int.from_bytes(data.bytes[4:6], "big", signed=True)


def servo_set_offset(data, servo):
    """Return the meaning of a setting of the offset."""
    if any(data.bytes[2:4]) or abs(thirds(data)) > 90:
        return None
    return "set offset of {} to {:+.2f}°".format(servo, thirds(data) / 3)


def servo_read_offset(_data, servo):
    """Return the meaning of a read of the offset."""
    return "read offset of " + servo


# Answers to them.


def servo_angles(data):
    """Return the angles of a servo."""
    data.note(2, 2, "target: {}°".format(data.be16(2)))
    data.note(4, 2, "actual: {}°".format(data.be16(4)))
    return "released, at {}°, sent to {}°".format(data.be16(4), data.be16(2))


def servo_id_changed(data):
    """Return the old id of a servo."""
    return "was {}".format(data.bytes[3])


def servo_offset_set(_data):
    """Return the confirmation of an offset."""
    return "offset set"


def servo_offset(data):
    """Return the offset of a servo."""
    return "offset {:+.2f}°".format(thirds(data) / 3)


# Requests to servos by command. Moves and LED settings are for one servo or all, and answered by one byte.
SERVO_REQUESTS = {
    0x01: servo_move,
    0x04: servo_led,
    0x02: servo_read_angles,
    CHANGE_ID: servo_change_id,
    0xD2: servo_set_offset,
    0xD4: servo_read_offset,
}
FOR_ALL = (0x01, 0x04)
SERVO_ANSWERS = {
    0x02: servo_angles,
    CHANGE_ID: servo_id_changed,
    0xD2: servo_offset_set,
    0xD4: servo_offset,
}


def servo_request(data):
    """Return the meaning of a request to a servo, or to all."""
    number, command = data.bytes[0], data.bytes[1]
    meaning = SERVO_REQUESTS.get(command)
    if not meaning or not (is_servo(number) or (number == 0 and command in FOR_ALL)):
        return None
    return meaning(data, "servo {}".format(number) if number else "all servos")


def version_request(data):
    """Return the meaning of a read of a servo's version."""
    if data.bytes[1:] != b"\1\0\0\0\0" or not is_servo(data.bytes[0]):
        return None
    return "read version of servo {}".format(data.bytes[0])


# Answers of the robot.


def status(name, at):
    """Return the decoder of an answer with an outcome at this offset."""

    def meaning(data):
        outcome = {SUCCESS: "done", FAILURE: "failed"}.get(data.bytes[at])
        return None if outcome is None or any(data.bytes[at + 1 :]) else "{}: {}".format(name, outcome)

    return meaning


def hardware_version(data):
    """Return the version of the hardware."""
    return "arm: Alpha1, " + fact("hardware", escaped(data.bytes[1:]))


def running(data):
    """Return the running servos."""
    mask = int.from_bytes(data.bytes, "big")
    servos = [str(nth) for nth in range(1, 33) if mask >> (nth - 1) & 1]
    return "servos that run: " + (" ".join(servos) or "none")


def firmware_version(data):
    """Return the version of the firmware."""
    outcome, version = data.bytes[0], data.bytes[1:]
    if outcome == FAILURE:
        return "firmware: not reported, the robot failed"
    if outcome != SUCCESS:
        return None
    oldest = ", before {}, the first for this protocol".format(escaped(OLDEST_FIRMWARE))
    return "firmware: " + escaped(version) + (oldest if version < OLDEST_FIRMWARE else "")


# Messages of the robot by sender and by the header's first byte.
MESSAGES = {
    TX: {
        0xF1: plain(0, "read hardware version"),
        0xEF: plain(0, "read servo states"),
        0xF2: plain(0, "stop"),
        0xF5: plain(1, "read firmware version"),
        0xFB: act,
        0xF4: offset_tool,
        0xF9: usb_type,
        0xF3: play,
        0xFA: servo_request,
        0xFC: version_request,
    },
    RX: {
        0xF1: hardware_version,
        0xEF: running,
        0xF2: status("stop", 0),
        0xF5: firmware_version,
        0xFB: status("act", 1),
        0xF4: status("offset tool", 0),
        0xF9: status("USB type", 0),
        0xF3: status("play", 0),
    },
}


class Alpha1:
    """The protocol of the robot and of its servos. It remembers the last request to a servo.

    Servos do not repeat a request in their answers, and acknowledge some by a single byte.
    """

    def __init__(self):
        self.request = None

    def acknowledgement(self):
        """Return the byte that acknowledges the last request, or None."""
        if self.request is None:
            return None
        number, command, _ = self.request
        return (number + 0xAA) & 0xFF if is_servo(number) and command in FOR_ALL else None

    def scan(self, window, side):
        """Return the verdict on the front of a window."""
        first = window[0]
        layout = LAYOUTS[side].get(first)
        if layout and (len(window) == 1 or window[1] == swapped(first)):
            return scan_frame(window, layout)
        if side == RX and first == self.acknowledgement():
            return Frame(1)
        if first == 0:
            return Padding(1)
        return Stray(1)

    def message(self, frame, side):
        """Return the meaning of a frame."""
        if len(frame) == 1:
            number = self.request[0]
            self.request = None
            return Message(RX, "servo {}: understood".format(number), [])
        row = frame[0]
        data = Data(frame, 2, len(frame) - (1 if LAYOUTS[side][row] == STATUS else 2))
        if row in (SERVO, SERVO_VERSION):
            side, text = self.servo(row, data)
        elif row == ACT and frame[2] != 1:
            text = "no message: a frame of the robot's Bluetooth protocol"
        else:
            text = MESSAGES[side][row](data)
        return Message(side, text or "no message: " + hexadecimal(frame), data.fields)

    def servo(self, row, data):
        """Return the sender and the meaning of a servo's frame. The status identifies an answer, whatever the line."""
        if data.bytes[1] in (SUCCESS, FAILURE):
            return RX, self.servo_answer(row, data)
        self.request = (data.bytes[0], data.bytes[1], data.bytes[3]) if row == SERVO else None
        return TX, MESSAGES[TX][row](data)

    def is_expected(self, row, data):
        """Return true for an answer to the last request. A changed id is that of the answer."""
        if self.request is None or row != SERVO:
            return False
        asked, command, changed = self.request
        number, outcome = data.bytes[0], data.bytes[1]
        if command != CHANGE_ID:
            return number == asked
        if outcome == SUCCESS:
            return (number, data.bytes[3]) == (changed, asked)
        return number in (asked, changed)

    def servo_answer(self, row, data):
        """Return the meaning of a servo's answer to the last request."""
        number, outcome = data.bytes[0], data.bytes[1]
        if not is_servo(number):
            return None
        answer = SERVO_ANSWERS.get(self.request[1]) if self.is_expected(row, data) else None
        if row == SERVO and answer is None:
            return "no message: an answer of servo {}, ambiguous: its request is not before it".format(number)
        if outcome == FAILURE:
            text = "failed"
        elif row == SERVO:
            text = answer(data)
        else:
            text = "version " + hexadecimal(data.bytes[2:])
        return "servo {}: {}".format(number, text)


def swapped(byte):
    """Return a byte with its nibbles swapped: the second byte of a header."""
    return (byte << 4 | byte >> 4) & 0xFF


def scan_frame(window, layout):
    """Return the verdict on a window that begins with a header."""
    if len(window) < 3:
        return Need(1)
    third = window[2]
    if window[0] == ACT and third != 1:
        # Frames of the robot's Bluetooth protocol have the same header, followed by their length instead of 01.
        return verify(window, third + 1, 2, checksum, TAIL) if third >= 6 else wrong_byte(2, third, "0x01")
    if layout == STATUS:
        return scan_status(window)
    if layout == COUNTED:
        return verify(window, third + 4, 2, checksum, TAIL) if third else wrong_length(third, 1, 255)
    return verify(window, layout + 4, 2, checksum, TAIL)


def scan_status(window):
    """Return the verdict on an answer without a checksum."""
    if len(window) < 4:
        return Need(1)
    if window[2] not in (SUCCESS, FAILURE):
        return wrong_byte(2, window[2], "0xaa or 0xee")
    if window[3] != TAIL:
        return Noise("end mark 0x{:02x}, expected 0x{:02x}".format(window[3], TAIL))
    return Frame(4)
