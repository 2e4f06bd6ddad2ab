"""The bytes of one line: frames, and the damage between them."""

from .framing import Frame, Need, Padding, Stray

# The longest run of stray bytes in one warning.
MAX_STRAY = 1024


class Byte:
    """A byte and its position in the capture."""

    def __init__(self, ss, es, value):
        self.ss, self.es, self.value = ss, es, value


class Line:
    """A window of bytes without a verdict yet.

    The protocol judges the front of the window. Damage takes only its first byte off, so a false header never costs a
    whole frame behind it.
    """

    def __init__(self, protocol, side, out):
        self.protocol, self.side, self.out = protocol, side, out
        self.window = []
        self.stray = []
        # The end of the last damaged frame. It is shown whole, and its bytes are not shown again.
        self.damaged = 0
        self.last = None

    def push(self, ss, es, value):
        """Push a byte."""
        self.last = es
        self.window.append(Byte(ss, es, value))
        self.scan(is_idle=False)

    def silence(self, now):
        """Return the samples since the last byte."""
        return 0 if self.last is None else now - self.last

    def idle(self):
        """Discard an incomplete frame: the line went idle."""
        self.scan(is_idle=True)
        self.flush()

    def scan(self, is_idle):
        """Remove all bytes with a verdict from the window."""
        while self.window:
            verdict = self.protocol.scan(bytes(byte.value for byte in self.window), self.side)
            if isinstance(verdict, Need):
                if not is_idle:
                    return
                verdict = verdict.truncated()
            self.take(verdict)

    def take(self, verdict):
        """Show the front of the window."""
        front = self.window[: verdict.len]
        del self.window[: verdict.len]
        if isinstance(verdict, Frame):
            self.flush()
            self.show_frame(front)
        elif isinstance(verdict, Padding):
            self.flush()
        elif isinstance(verdict, Stray):
            self.stray += [byte for byte in front if byte.ss >= self.damaged]
            if len(self.stray) >= MAX_STRAY:
                self.flush()
        else:
            self.flush()
            # A frame with a wrong checksum is shown whole.
            whole = (front + self.window)[: verdict.shown]
            if verdict.shown > 1:
                self.damaged = max(self.damaged, whole[-1].es)
            self.out.warning(self.side, whole[0].ss, whole[-1].es, "noise: " + verdict.reason)

    def flush(self):
        """Show the stray bytes."""
        if self.stray:
            self.out.warning(self.side, self.stray[0].ss, self.stray[-1].es, "noise: no frame starts here")
            self.stray = []

    def show_frame(self, front):
        """Show a frame and its fields."""
        message = self.protocol.message(bytes(byte.value for byte in front), self.side)
        side = message.side
        self.out.frame(side, front[0].ss, front[-1].es, message.text)
        for field in message.fields:
            self.out.field(side, front[field.at].ss, front[field.at + field.len - 1].es, field.text)
