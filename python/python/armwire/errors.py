"""The exceptions of this package.

Every message names the port, the error and possible causes.

=====================  ==============================================================================================
Exception              Cause
=====================  ==============================================================================================
`PortError`            The port or host cannot be opened: absent, in use, not permitted.
`PortLostError`        The open port was lost: unplugged, switched off.
`AbsentError`          No bytes arrived: no arm, no power, wrong baud rate.
`DamagedError`         Answers had wrong checksums or were truncated: cable, ground, power, another program.
`ErrorFrameError`      The arm answered with an error frame. No document explains it; the text has its bytes.
`LateError`            The answer arrived after the timeout. It is discarded and never matched to a later request.
`WrongArmError`        Bytes arrived, but no answer of this protocol: another arm, or another program on the line.
`RefusedError`         The arm or adapter refused the request or does not support it.
`NotReachedError`      The arm is at rest away from its target, or still moves after the time-out.
`NotStoppedError`      The arm may still move after `stop`: only the switch of its supply stops it.
`NoPoseError`          A reader has no pose that is new enough, or none for that time.
`UnacceptableError`    The answer is well-formed, with a value outside the protocol's range.
`OlderArmError`        A Ling arm from before late 2025, with a different protocol. Nothing was sent to it.
`ClosedError`          The object is closed.
=====================  ==============================================================================================

Invalid arguments, such as an angle out of range, raise `ValueError`, and nothing is sent.
"""

__all__ = [
    "AbsentError",
    "ArmwireError",
    "ClosedError",
    "DamagedError",
    "ErrorFrameError",
    "LateError",
    "NoAnswerError",
    "NoPoseError",
    "NotReachedError",
    "NotStoppedError",
    "OlderArmError",
    "PortError",
    "PortLostError",
    "RefusedError",
    "UnacceptableError",
    "WrongArmError",
]


class ArmwireError(Exception):
    """Any error of an arm, an adapter or a port."""


class PortError(ArmwireError, OSError):
    """The port or host cannot be opened."""


class PortLostError(PortError):
    """The open port was lost."""


class NoAnswerError(ArmwireError, TimeoutError):
    """No valid answer arrived before the timeout."""


class AbsentError(NoAnswerError):
    """No bytes arrived."""


class DamagedError(NoAnswerError):
    """Answers were damaged."""


class LateError(NoAnswerError):
    """The answer arrived after the timeout."""


class WrongArmError(NoAnswerError):
    """Bytes arrived, but no answer of this protocol."""


class RefusedError(ArmwireError):
    """The arm or adapter refused the request."""


class NotReachedError(ArmwireError, TimeoutError):
    """The arm is at rest away from its target, or still moves after the time-out."""


class NotStoppedError(ArmwireError):
    """The arm may still move after a stop. Only the switch of its supply stops it."""


class NoPoseError(ArmwireError):
    """A reader has no pose that is new enough, or none for that time."""


class UnacceptableError(ArmwireError):
    """The answer has a value outside the protocol's range."""


class ErrorFrameError(ArmwireError):
    """The arm answered with an error frame."""


class OlderArmError(ArmwireError):
    """The arm is of the older generation."""


class ClosedError(ArmwireError):
    """The object is closed."""
