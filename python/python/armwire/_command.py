"""The `armwire` command."""

import signal
import sys

from . import _armwire


def main() -> None:
    """Run the command with the program's arguments."""
    # Python's own handler only sets a flag, which this call never checks.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_armwire.run(["armwire", *sys.argv[1:]]))
