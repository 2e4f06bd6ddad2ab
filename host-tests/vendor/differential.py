"""Compares the vendor's parser with armwire's on damaged streams: lost frames and false frames of each.

Usage: differential.py FILE

FILE is the output of `host-tests/examples/differential.rs`. The vendor's parser is polled after each byte, which suits
it best: it parses only when new bytes arrive, and returns one frame per call.
"""

import sys
from dataclasses import dataclass, field
from typing import Any

from sdk import servo_driver

# The first words of lines with a frame.
FRAME_KINDS = ("sent", "intact", "ours", "reference")


@dataclass
class Row:
    """A damaged stream: its sent frames, its intact ones, and those delivered by armwire and the reference decoder."""

    name: str
    stream: bytes = b""
    frames: dict[str, list[bytes]] = field(default_factory=lambda: {kind: [] for kind in FRAME_KINDS})

    def lost(self, delivered: list[bytes]) -> int:
        """The number of intact frames that were not delivered."""
        return len(set(self.frames["intact"]) - set(delivered))

    def false(self, delivered: list[bytes]) -> int:
        """The number of delivered frames that were never sent."""
        sent = {*self.frames["sent"], *self.frames["intact"]}
        return sum(frame not in sent for frame in delivered)


class Port:
    """A serial port with at most one byte to read."""

    is_open = True

    def __init__(self) -> None:
        self.waiting = b""

    @property
    def in_waiting(self) -> int:
        return len(self.waiting)

    def read(self, size: int) -> bytes:
        data, self.waiting = self.waiting[:size], self.waiting[size:]
        return data

    def close(self) -> None:
        self.is_open = False


def main(path: str) -> None:
    driver, _ = servo_driver("not a port")
    new_parser = type(driver.serial_comm)
    # The SDK warns of each damaged frame.
    from alicia_d_sdk.utils.logger import LogLevel, logger

    logger.set_min_level(LogLevel.ERROR)
    faults = []
    print(f"{'damage':26} intact  lost: vendor  ours  reference   false: vendor  ours  reference")
    rows = read_rows(path)
    for row in rows:
        vendor, ours, reference = parse(new_parser(), row.stream), row.frames["ours"], row.frames["reference"]
        lost = [row.lost(delivered) for delivered in (vendor, ours, reference)]
        false = [row.false(delivered) for delivered in (vendor, ours, reference)]
        intact = len(row.frames["intact"])
        print(
            f"{row.name:26} {intact:6} {lost[0]:13} {lost[1]:5} {lost[2]:10} {false[0]:15} {false[1]:5} {false[2]:10}"
        )
        if ours != reference:
            faults.append(f"{row.name}: ours and the reference decoder deliver different frames")
        if (lost[0], false[0]) < (lost[1], false[1]):
            faults.append(f"{row.name}: the vendor's parser is better than ours")
        if not set(row.frames["intact"]) & set(vendor):
            faults.append(f"{row.name}: the vendor's parser delivers no intact frame, nothing is compared")
        if row.name == "nothing" and (any(lost) or any(false)):
            faults.append("an undamaged stream is not delivered unchanged")
    if not rows:
        faults.append(f"{path} has no rows")
    if faults:
        sys.exit("\n".join(f"FAILED: {fault}" for fault in faults))


def read_rows(path: str) -> list[Row]:
    rows: list[Row] = []
    with open(path, encoding="ascii") as file:
        for line in file:
            kind, rest = line.rstrip("\n").split(" ", 1)
            if kind == "row":
                rows.append(Row(rest))
            elif kind == "stream":
                rows[-1].stream = bytes.fromhex(rest)
            else:
                rows[-1].frames[kind].append(bytes.fromhex(rest))
    return rows


def parse(parser: Any, stream: bytes) -> list[bytes]:
    """The frames delivered by the vendor's parser."""
    parser.serial_port = port = Port()
    frames = []
    for byte in stream:
        port.waiting += bytes([byte])
        if frame := parser.read_frame():
            frames.append(bytes(frame))
    return frames


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
