"""The serial layer of the vendor's SDK without its other modules, on a port without modem lines."""

import importlib.util
import sys
import types
from pathlib import Path
from typing import Any

import serial


def servo_driver(port: str) -> tuple[Any, list[str]]:
    """A `ServoDriver` of the SDK for this port, not connected yet, and the list of the SDK's warnings and errors.

    The SDK's reader thread swallows exceptions. Damaged frames appear only in this list.
    """
    _register_packages("alicia_d_sdk", "alicia_d_sdk.utils")
    # A pty has no DTR and RTS. The SDK handles only an error of these two methods.
    serial.Serial.setDTR = serial.Serial.setRTS = lambda self, value=True: None

    from alicia_d_sdk.hardware import ServoDriver
    from alicia_d_sdk.utils.logger import LogLevel, logger

    warnings: list[str] = []

    def record(content: str, type: str) -> None:
        if type in ("warning", "error"):
            warnings.append(content)

    logger.set_min_level(LogLevel.WARNING)
    logger._write_log = record
    return ServoDriver(port=port), warnings


def _register_packages(*names: str) -> None:
    """Makes modules of a package importable without its `__init__`, which imports kinematics and PyTorch."""
    root = importlib.util.find_spec(names[0])
    if root is None or root.origin is None:
        sys.exit(f"{names[0]} is not installed")
    site = Path(root.origin).parent.parent
    for name in names:
        package = types.ModuleType(name)
        package.__path__ = [str(site.joinpath(*name.split(".")))]
        sys.modules[name] = package
