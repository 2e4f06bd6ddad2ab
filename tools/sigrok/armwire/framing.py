"""Verdicts on the front of a window, and helpers for the frames of all protocols."""


class Frame:
    """A whole frame of this length."""

    def __init__(self, length):
        self.len = length


class Padding:
    """Filler between frames, which is not an error."""

    def __init__(self, length):
        self.len = length


class Need:
    """No verdict before more bytes arrive."""

    def __init__(self, missing):
        self.missing = missing

    def truncated(self):
        """Return the verdict if the line goes idle before."""
        return Noise("line went idle with {} bytes missing".format(self.missing))


class Noise:
    """Bytes outside of frames. One of them is removed, and `shown` are shown."""

    def __init__(self, reason, shown=1):
        self.len = 1
        self.reason, self.shown = reason, shown


class Stray:
    """Bytes that do not begin a frame."""

    def __init__(self, length):
        self.len = length


class Field:
    """A value in a frame, and its position."""

    def __init__(self, at, length, text):
        self.at, self.len, self.text = at, length, text


class Message:
    """The meaning of a frame, its sender's line, and the values in it."""

    def __init__(self, side, text, fields):
        self.side, self.text, self.fields = side, text, fields


class Data:
    """The data of a frame, which may have more bytes in all. Noted values become fields."""

    def __init__(self, frame, start, end, total=None):
        self.bytes = frame[start:end]
        self.start = start
        self.total = total or end - start
        self.fields = []

    def note(self, at, length, text):
        """Note a value with its position in the data."""
        self.fields.append(Field(self.start + at, length, text))

    def le16(self, at):
        """Return a little-endian word."""
        return int.from_bytes(self.bytes[at : at + 2], "little")

    def be16(self, at):
        """Return a big-endian word."""
        return int.from_bytes(self.bytes[at : at + 2], "big")


def verify(window, total, start, checksum, tail):
    """Return the verdict on a frame of this length, with a checksum of the bytes from `start`, and a terminator."""
    if len(window) < total:
        return Need(total - len(window))
    got, end = window[total - 2], window[total - 1]
    if end != tail:
        return Noise("end mark 0x{:02x}, expected 0x{:02x}".format(end, tail))
    expected = checksum(window[start : total - 2])
    if got != expected:
        return Noise("checksum 0x{:02x}, expected 0x{:02x}".format(got, expected), total)
    return Frame(total)


def wrong_length(got, least, most):
    """Return the verdict on a length outside of its limits."""
    return Noise("length field is {}, must be {}..={}".format(got, least, most))


def wrong_byte(at, got, expected):
    """Return the verdict on a byte that is not one of the allowed values."""
    return Noise("byte {} is 0x{:02x}, expected {}".format(at, got, expected))


def fact(name, text):
    """Return a name and its text, unless the text is empty."""
    return "{}: {}".format(name, text) if text else name


def hexadecimal(data):
    """Return bytes as `AA 06 00`."""
    return " ".join("{:02X}".format(byte) for byte in data)


def escaped(data):
    """Return bytes as text, with escapes for non-printable ones."""
    escapes = {9: "\\t", 10: "\\n", 13: "\\r", 34: '\\"', 39: "\\'", 92: "\\\\"}
    return "".join(escapes.get(byte, chr(byte) if 32 <= byte < 127 else "\\x{:02x}".format(byte)) for byte in data)
