"""The vendor's SDK of the xArm on free ports, with a virtual arm."""

import logging
import re
import signal
import subprocess
from typing import Any, Self

from xarm.core.config.x_config import XCONF
from xarm.core.utils.log import logger
from xarm.wrapper import XArmAPI
from xarm.x3.report import ReportDataStructure

from checks import STEP_TIMEOUT, require

# The SDK's warnings and errors.
warnings: list[str] = []


class _Warnings(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        warnings.append(record.getMessage())


logger.handlers[:] = [_Warnings(level=logging.WARNING)]

# The SDK determines the format of a report from its port number.
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
        self._ports = [int(port) for port in re.findall(r"127\.0\.0\.1:(\d+)", line)]
        require(f"the virtual arm prints its ports: {line!r}", bool(self._ports))

    def connect(self, **options: Any) -> XArmAPI:
        """A new connection of the SDK."""
        XCONF.SocketConf.TCP_CONTROL_PORT = self._ports[0]
        # Port 1 is closed: without reports there is no report port.
        XCONF.SocketConf.TCP_REPORT_RICH_PORT = self._ports[-1] if len(self._ports) > 1 else 1
        # Otherwise the SDK prefers a socket file in /tmp, possibly that of another program.
        return XArmAPI("127.0.0.1", forbid_uds=True, **options)

    def wait(self) -> str:
        """Waits until the program succeeds. Returns its last line."""
        out, _ = self._process.communicate(timeout=STEP_TIMEOUT)
        code = self._process.returncode
        require(f"the virtual arm ends with exit code 0, not {code}", code == 0)
        return out.strip()

    def stop(self) -> str:
        """Interrupts the program like Ctrl-C. Returns its last line."""
        self._process.send_signal(signal.SIGINT)
        return self.wait()

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
