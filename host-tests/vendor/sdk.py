"""The serial layer of the vendor's SDK, without the rest of it, on a port without modem lines."""

import importlib.util
import sys
import types
from pathlib import Path
from typing import Any

import serial


def servo_driver(port: str) -> tuple[Any, list[str]]:
    """A `ServoDriver` of the SDK for this port, not connected yet, and a list of what the SDK will complain of.

    Its reader thread swallows exceptions, so damaged frames show up nowhere else.
    """
    _import_only_the_packages("alicia_d_sdk", "alicia_d_sdk.utils")
    # A pty has no DTR and RTS, and the SDK takes no for an answer only from these two.
    serial.Serial.setDTR = serial.Serial.setRTS = lambda self, value=True: None

    from alicia_d_sdk.hardware import ServoDriver
    from alicia_d_sdk.utils.logger import LogLevel, logger

    complaints: list[str] = []

    def record(content: str, type: str) -> None:
        if type in ("warning", "error"):
            complaints.append(content)

    logger.set_min_level(LogLevel.WARNING)
    logger._write_log = record
    return ServoDriver(port=port), complaints


def _import_only_the_packages(*names: str) -> None:
    """Makes modules of a package importable without running its `__init__`, which imports kinematics and PyTorch."""
    root = importlib.util.find_spec(names[0])
    if root is None or root.origin is None:
        sys.exit(f"{names[0]} is not installed")
    site = Path(root.origin).parent.parent
    for name in names:
        package = types.ModuleType(name)
        package.__path__ = [str(site.joinpath(*name.split(".")))]
        sys.modules[name] = package
