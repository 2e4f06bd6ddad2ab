"""Decodes the cyclic frames of an armwire adapter with cantools, by docs/armwire.dbc.

Usage: dbc.py < FRAMES

A frame is a line of JSON: {"id": 512, "data": "0008000800080000"}. For each, a line of JSON comes out: the message, the
node, the value of each signal, and the names that the file gives to values:
{"message": "JointsA", "node": 0, "values": {"Joint1": 0.0, …}, "names": {}}
A frame that is not in the file, or not as it says, is an error.
"""

import json
import sys
from pathlib import Path

import cantools

FILE = Path(__file__).parents[2] / "docs/armwire.dbc"
# The low bits of an identifier are the node.
NODE = 0xF


class Dbc:
    """What docs/armwire.dbc says, for every node."""

    def __init__(self) -> None:
        # Strict: no signal may overlap another or reach beyond its frame.
        self._database = cantools.database.load_file(FILE, strict=True)

    def decode(self, identifier: int, data: bytes) -> tuple[str, dict[str, float]]:
        """The name of a frame and its values, numbers all of them."""
        try:
            message = self._database.get_message_by_frame_id(identifier & ~NODE)
        except KeyError:
            raise ValueError(f"no message has identifier {identifier:#05x}") from None
        if len(data) != message.length:
            raise ValueError(f"{message.name} has {message.length} bytes, not {len(data)}")
        return message.name, message.decode(data, decode_choices=False)

    def names(self, name: str, values: dict[str, float]) -> dict[str, str]:
        """What those values are called that have a name."""
        named = {}
        for signal in self._database.get_message_by_name(name).signals:
            choice = (signal.choices or {}).get(values[signal.name])
            if choice is not None:
                named[signal.name] = str(choice)
        return named

    def encode(self, name: str, node: int, values: dict[str, float]) -> tuple[int, bytes]:
        """A frame with those of these values that are its own: its identifier and data.

        A value out of range is an error.
        """
        message = self._database.get_message_by_name(name)
        own = {signal.name: values[signal.name] for signal in message.signals}
        return message.frame_id | node, message.encode(own)


def main() -> None:
    dbc = Dbc()
    for number, line in enumerate(sys.stdin, start=1):
        try:
            frame = json.loads(line)
            identifier, data = frame["id"], bytes.fromhex(frame["data"])
            name, values = dbc.decode(identifier, data)
        except (KeyError, ValueError) as error:
            sys.exit(f"line {number}, {line.strip()}: {type(error).__name__}: {error}")
        decoded = {"message": name, "node": identifier & NODE, "values": values, "names": dbc.names(name, values)}
        print(json.dumps(decoded))


if __name__ == "__main__":
    if len(sys.argv) != 1:
        sys.exit(__doc__)
    main()
