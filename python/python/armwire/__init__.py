"""Robot arms from Python: Ling / Alicia-D, UFACTORY xArm, UBTECH Alpha1.

    with armwire.Ling("/dev/ttyACM0") as arm:
        print(arm.read_joints_deg())

Units are in the names. `armwire.aio` has the same classes for asyncio, `armwire.sim` virtual arms, `armwire.errors` the
exceptions, `armwire.compat` the calls of a vendor's SDK, `armwire.plot` figures, and `armwire.joints_file` the units of
other programs.
"""

from . import aio, errors
from ._adapter import Adapter, AdapterIdentity, JointRecording, Telemetry
from ._alpha1 import Alpha1
from ._armwire import VERSION as __version__
from ._ling import ControlMode, ForceFeedback, Inhibit, JointState, LineErrors, Ling, LingInfo, ModeState, MotionStatus
from ._reader import Reader, ReaderCounts, Reading
from ._xarm import Answer, XArm, XArmSerials, XArmState, XArmVersion
from .errors import ArmwireError

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
