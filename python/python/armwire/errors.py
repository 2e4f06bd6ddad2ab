"""The exceptions of this package.

Every text says where something went wrong, what it was, and what to look at.

=====================  ==============================================================================================
Exception              Cause
=====================  ==============================================================================================
`PortError`            The port or host cannot be opened: absent, in use, not allowed.
`PortLostError`        The port was open and is gone: unplugged, switched off.
`AbsentError`          Nothing came back: no arm, no power, another baud rate.
`DamagedError`         Answers came with wrong checksums or cut short: cable, ground, power.
`LateError`            The answer came after its time. It is discarded, and never taken for a later one.
`WrongArmError`        Bytes came, but no answer of this arm: another arm, another program on the line.
`RefusedError`         The arm or adapter answered that it does not do it, or does not know the request.
`UnacceptableError`    The answer is well-formed and has a value that the protocol does not have.
`OlderArmError`        A Ling arm from before late 2025, whose protocol is another one. Nothing was sent to it.
`ClosedError`          The object was closed before.
=====================  ==============================================================================================

Values that a caller may not give, such as an angle out of range, are a `ValueError`, and nothing is sent.
"""

__all__ = [
    "AbsentError",
    "ArmwireError",
    "ClosedError",
    "DamagedError",
    "LateError",
    "NoAnswerError",
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
    """The port was open and is gone."""


class NoAnswerError(ArmwireError, TimeoutError):
    """No answer that could be used came in time."""


class AbsentError(NoAnswerError):
    """Nothing came back."""


class DamagedError(NoAnswerError):
    """Answers came damaged."""


class LateError(NoAnswerError):
    """The answer came after its time."""


class WrongArmError(NoAnswerError):
    """Bytes came, but no answer of this arm."""


class RefusedError(ArmwireError):
    """The arm or adapter does not do it."""


class UnacceptableError(ArmwireError):
    """The answer has a value that the protocol does not have."""


class OlderArmError(ArmwireError):
    """The arm is of the older generation."""


class ClosedError(ArmwireError):
    """The object was closed before."""
