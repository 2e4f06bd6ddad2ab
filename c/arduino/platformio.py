"""PlatformIO script that links the library for the board's processor."""

import os

Import("env")  # noqa: F821

FOLDERS = {
    "cortex-m0": "cortex-m0",
    "cortex-m0plus": "cortex-m0plus",
    "cortex-m4": "cortex-m4/fpv4-sp-d16-hard",
    "esp32c3": "esp32c3",
}

board = env.BoardConfig()  # noqa: F821
names = [board.get("build.cpu", ""), board.get("build.mcu", "")]
folder = next((FOLDERS[name] for name in names if name in FOLDERS), None)
if folder is None:
    raise SystemExit("armwire has no library for " + " ".join(filter(None, names)))
env.Append(LIBPATH=[os.path.join(os.getcwd(), "src", folder)], LIBS=["armwire_c"])  # noqa: F821
