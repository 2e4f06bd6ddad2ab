"""Robot arms from Python: Ling / Alicia-D, UFACTORY xArm, UBTECH Alpha1.

    with armwire.Ling("/dev/ttyACM0") as arm:
        print(arm.read_joints_deg())

Units are in the names. `armwire.aio` has the same classes for asyncio, `armwire.sim` virtual arms, `armwire.errors` the
exceptions, `armwire.compat` the calls of a vendor's SDK, `armwire.plot` figures, and `armwire.joints_file` the units of
other programs.
"""

from importlib import import_module

from ._armwire import VERSION as __version__

# Type checkers take it for true. The module `typing` would cost the command a tenth of its time.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from . import aio, errors
    from ._adapter import Adapter, AdapterIdentity, JointRecording, Telemetry
    from ._alpha1 import Alpha1
    from ._ling import (
        ControlMode,
        ForceFeedback,
        Inhibit,
        JointState,
        LineErrors,
        Ling,
        LingInfo,
        ModeState,
        MotionStatus,
    )
    from ._reader import Reader, ReaderCounts, Reading
    from ._xarm import Answer, XArm, XArmSerials, XArmState, XArmVersion
    from .errors import ArmwireError
else:

    def __getattr__(name: str) -> object:
        """Import a name at its first use: the command needs neither NumPy nor asyncio."""
        for module, names in _NAMES.items():
            if name in names:
                value = getattr(import_module(module, __name__), name)
                globals()[name] = value
                return value
        if name in ("aio", "errors"):
            return import_module(f".{name}", __name__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})

    _NAMES = {
        "._adapter": ("Adapter", "AdapterIdentity", "JointRecording", "Telemetry"),
        "._alpha1": ("Alpha1",),
        "._ling": (
            "ControlMode",
            "ForceFeedback",
            "Inhibit",
            "JointState",
            "LineErrors",
            "Ling",
            "LingInfo",
            "ModeState",
            "MotionStatus",
        ),
        "._reader": ("Reader", "ReaderCounts", "Reading"),
        "._xarm": ("Answer", "XArm", "XArmSerials", "XArmState", "XArmVersion"),
        ".errors": ("ArmwireError",),
    }

__all__ = [
    "Adapter",
    "AdapterIdentity",
    "Alpha1",
    "Answer",
    "ArmwireError",
    "ControlMode",
    "ForceFeedback",
    "Inhibit",
    "JointRecording",
    "JointState",
    "LineErrors",
    "Ling",
    "LingInfo",
    "ModeState",
    "MotionStatus",
    "Reader",
    "ReaderCounts",
    "Reading",
    "Telemetry",
    "XArm",
    "XArmSerials",
    "XArmState",
    "XArmVersion",
    "__version__",
    "aio",
    "errors",
]
