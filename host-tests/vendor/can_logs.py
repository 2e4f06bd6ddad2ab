"""Writes a log of every kind that python-can, can-utils and tshark write, and compares the counts of `armwire decode`."""

import random
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can

READ_JOINTS = bytes.fromhex("AA060001FE9AFF")
# The kinds of logs of python-can.
KINDS = ["log", "asc", "blf", "csv", "trc", "txt"]
FRAMES = 400


def messages() -> Iterator[can.Message]:
    """Frames of every kind, those of an adapter at node 15 among them."""
    chance = random.Random(1)
    time = 1_609_459_200.0
    for _ in range(FRAMES):
        time += 0.001
        kind = chance.randrange(7)
        common = {"timestamp": time, "channel": chance.randrange(2), "is_extended_id": False}
        if kind == 0:
            yield can.Message(arbitration_id=0x60F, data=b"\x07" + READ_JOINTS, **common)
        elif kind == 1:
            yield can.Message(arbitration_id=0x60E, data=b"\x00\x07" + READ_JOINTS + bytes(3), is_fd=True, **common)
        elif kind == 2:
            yield can.Message(arbitration_id=0x123, data=chance.randbytes(chance.randrange(9)), **common)
        elif kind == 3:
            data = chance.randbytes(chance.choice([12, 16, 20, 24, 32, 48, 64]))
            yield can.Message(arbitration_id=0x7DF, data=data, is_fd=True, bitrate_switch=True, **common)
        elif kind == 4:
            yield can.Message(arbitration_id=0x1ABCDE, data=b"\x01", **common | {"is_extended_id": True})
        elif kind == 5:
            yield can.Message(arbitration_id=0x60F, is_remote_frame=True, dlc=4, **common)
        else:
            yield can.Message(arbitration_id=0, is_error_frame=True, **common)


def requests(written: list[can.Message]) -> int:
    """Number of requests to the arm."""
    return sum(READ_JOINTS in bytes(message.data) for message in written)


def check(armwire: str, log: Path, frames: int, pdus: int) -> None:
    """Compares the sum of a log with these counts."""
    done = subprocess.run([armwire, "decode", "--strict", log], capture_output=True, text=True)
    total = re.search(r"^CAN frames: (\d+), PDUs: (\d+), lost: 0, ", done.stdout, re.MULTILINE)
    assert done.returncode == 0 and total, f"{log}: {done.stdout[-500:]}{done.stderr}"
    counts = int(total[1]), int(total[2])
    assert counts == (frames, pdus), f"{log}: {counts}, not {(frames, pdus)}"
    print(f"{log.name}: {frames} frames, {pdus} requests")


def main() -> None:
    """Write the logs, and check them."""
    armwire, folder = sys.argv[1], Path(sys.argv[2])
    written = list(messages())
    for kind in KINDS:
        log = folder / f"python-can.{kind}"
        log.unlink(missing_ok=True)
        with can.Logger(log) as logger:
            for message in written:
                logger.on_message_received(message)
        if kind == "txt":
            # python-can does not read it.
            read = written
        else:
            with can.LogReader(log) as reader:
                read = list(reader)
        assert read, f"{log}: no frame"
        check(armwire, log, len(read), requests(read))

    # The refusal of a database names the command that converts it.
    database, converted = folder / "python-can.db", folder / "converted.log"
    database.unlink(missing_ok=True)
    with can.Logger(database) as logger:
        for message in written:
            logger.on_message_received(message)
    done = subprocess.run([armwire, "decode", database], capture_output=True, text=True)
    assert done.returncode == 1 and "python -m can.logconvert" in done.stderr, done
    subprocess.run([sys.executable, "-m", "can.logconvert", database, converted], check=True)
    with can.LogReader(converted) as reader:
        read = list(reader)
    check(armwire, converted, len(read), requests(read))

    # can-utils: from candump's log to ASC, and back.
    asc, back = folder / "can-utils.asc", folder / "can-utils.log"
    with (folder / "python-can.log").open() as log, asc.open("w") as out:
        subprocess.run(["log2asc", "can0", "can1"], stdin=log, stdout=out, check=True)
    check(armwire, asc, FRAMES, requests(written))
    with asc.open() as log, back.open("w") as out:
        subprocess.run(["asc2log"], stdin=log, stdout=out, check=True)
    check(armwire, back, FRAMES, requests(written))

    # Wireshark reads BLF.
    capture = folder / "wireshark.pcapng"
    capture.unlink(missing_ok=True)
    subprocess.run(["tshark", "-r", folder / "python-can.blf", "-w", capture], check=True, stderr=subprocess.DEVNULL)
    counted = subprocess.run(["capinfos", "-cMT", "-r", capture], check=True, capture_output=True, text=True).stdout
    check(armwire, capture, int(counted.split()[-1]), requests(written))


if __name__ == "__main__":
    main()
