"""The vendor's SDK of the xArm on ports of our choice, and a virtual arm for it to talk to."""

import logging
import re
import signal
import subprocess
import sys
from typing import Any

from xarm.core.config.x_config import XCONF
from xarm.core.utils.log import logger
from xarm.wrapper import XArmAPI
from xarm.x3.report import ReportDataStructure

# How long the virtual arm may take to start or end, in seconds.
STEP_TIMEOUT = 10.0

# What the SDK has to complain of.
complaints: list[str] = []


class _Complaints(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        complaints.append(record.getMessage())


logger.handlers[:] = [_Complaints(level=logging.WARNING)]

# The SDK knows what is in a report from the number of the port it comes from.
_create = ReportDataStructure.create
ReportDataStructure.create = classmethod(
    lambda cls, port, **options: _create(30002 if port == XCONF.SocketConf.TCP_REPORT_RICH_PORT else port, **options)
)


class VirtualArm:
    """`armwire sim xarm` with these arguments, on free ports."""

    def __init__(self, armwire: str, *args: str) -> None:
        ports = ["--listen", "127.0.0.1:0"]
        if "--no-report" not in args:
            ports += ["--report-listen", "127.0.0.1:0"]
        self._process = subprocess.Popen([armwire, "sim", "xarm", *ports, *args], stdout=subprocess.PIPE, text=True)
        line = self._process.stdout.readline()
        found = re.findall(r"127\.0\.0\.1:(\d+)", line)
        if not found:
            sys.exit(f"FAILED: the virtual arm says {line!r}")
        self._ports = [int(port) for port in found]

    def connect(self, **options: Any) -> XArmAPI:
        """A new connection of the SDK."""
        XCONF.SocketConf.TCP_CONTROL_PORT = self._ports[0]
        # Where there are no reports there is no port either.
        XCONF.SocketConf.TCP_REPORT_RICH_PORT = self._ports[-1] if len(self._ports) > 1 else 1
        # The SDK takes a socket file in /tmp that another program may have left there for the arm.
        return XArmAPI("127.0.0.1", forbid_uds=True, **options)

    def wait(self) -> str:
        """Waits until it ends by itself, successfully, and returns the last line it says."""
        out, _ = self._process.communicate(timeout=STEP_TIMEOUT)
        if self._process.returncode != 0:
            sys.exit(f"FAILED: the virtual arm ended with {self._process.returncode}")
        return out.strip()

    def stop(self) -> str:
        """Ends it as Ctrl-C does, and returns the last line it says."""
        self._process.send_signal(signal.SIGINT)
        return self.wait()

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> "VirtualArm":
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
