"""Shows the same damaged streams to the parser of the vendor's SDK and counts what it and ours make of them.

Usage: differential.py FILE

FILE is what `host-tests/examples/differential.rs` writes. The vendor's parser is given a byte at a time and asked after
each, which is how it does best: it looks at what it holds only when more comes, and returns one frame each time.
"""

import sys
from dataclasses import dataclass, field
from typing import Any

from sdk import servo_driver

# What a line of the file with a frame begins with.
WORDS = ("sent", "intact", "ours", "reference")


@dataclass
class Row:
    """A stream, what was sent, and who delivered what."""

    name: str
    stream: bytes = b""
    frames: dict[str, list[bytes]] = field(default_factory=lambda: {word: [] for word in WORDS})

    def lost(self, delivered: list[bytes]) -> int:
        """How many frames that arrived intact were not delivered."""
        return len(set(self.frames["intact"]) - set(delivered))

    def false(self, delivered: list[bytes]) -> int:
        """How many frames were delivered that nobody sent."""
        sent = {*self.frames["sent"], *self.frames["intact"]}
        return sum(frame not in sent for frame in delivered)


class Port:
    """A serial port on which one byte is waiting, or none."""

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
    # It says of each damaged frame that it is one.
    from alicia_d_sdk.utils.logger import LogLevel, logger

    logger.set_min_level(LogLevel.ERROR)
    faults = []
    print(f"{'damage':26} intact  lost: vendor  ours  reference   false: vendor  ours  reference")
    rows = read(path)
    for row in rows:
        vendors, ours, reference = vendor(new_parser(), row.stream), row.frames["ours"], row.frames["reference"]
        lost = [row.lost(delivered) for delivered in (vendors, ours, reference)]
        false = [row.false(delivered) for delivered in (vendors, ours, reference)]
        intact = len(row.frames["intact"])
        print(
            f"{row.name:26} {intact:6} {lost[0]:13} {lost[1]:5} {lost[2]:10} {false[0]:15} {false[1]:5} {false[2]:10}"
        )
        if ours != reference:
            faults.append(f"{row.name}: ours does not deliver what the reference does")
        if (lost[0], false[0]) < (lost[1], false[1]):
            faults.append(f"{row.name}: the vendor's does better than ours")
        if not set(row.frames["intact"]) & set(vendors):
            faults.append(f"{row.name}: the vendor's delivers nothing, so nothing was compared")
        if row.name == "nothing" and (any(lost) or any(false)):
            faults.append("an undamaged stream is not delivered as it is")
    if not rows:
        faults.append(f"{path} has no rows")
    if faults:
        sys.exit("\n".join(f"FAILED: {fault}" for fault in faults))


def read(path: str) -> list[Row]:
    """What is in the file."""
    rows: list[Row] = []
    with open(path, encoding="ascii") as file:
        for line in file:
            word, rest = line.rstrip("\n").split(" ", 1)
            if word == "row":
                rows.append(Row(rest))
            elif word == "stream":
                rows[-1].stream = bytes.fromhex(rest)
            else:
                rows[-1].frames[word].append(bytes.fromhex(rest))
    return rows


def vendor(parser: Any, stream: bytes) -> list[bytes]:
    """The frames that the vendor's parser delivers."""
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
