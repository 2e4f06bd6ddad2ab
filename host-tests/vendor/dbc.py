"""The cyclic frames of an armwire adapter, by cantools and docs/armwire.dbc.

Usage: dbc.py

Checks that cantools takes the file, that every value comes back as it was put in a frame, and that no two of 16 nodes
share an identifier.
"""

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
        self.messages = self._database.messages

    def decode(self, identifier: int, data: bytes) -> tuple[str, dict[str, float]]:
        """The name of a frame and its values, numbers all of them."""
        try:
            message = self._database.get_message_by_frame_id(identifier & ~NODE)
        except KeyError:
            raise ValueError(f"no message has identifier {identifier:#05x}") from None
        if len(data) != message.length:
            raise ValueError(f"{message.name} has {message.length} bytes, not {len(data)}")
        return message.name, message.decode(data, decode_choices=False)

    def encode(self, name: str, node: int, values: dict[str, float]) -> tuple[int, bytes]:
        """A frame with those of these values that are its own: its identifier and data.

        A value out of range is an error.
        """
        message = self._database.get_message_by_name(name)
        own = {signal.name: values[signal.name] for signal in message.signals}
        return message.frame_id | node, message.encode(own)


def main() -> None:
    dbc = Dbc()
    identifiers = set()
    for message in dbc.messages:
        for node in range(NODE + 1):
            for extreme in ("minimum", "maximum"):
                values = {signal.name: getattr(signal, extreme) for signal in message.signals}
                identifier, data = dbc.encode(message.name, node, values)
                name, decoded = dbc.decode(identifier, data)
                same = all(abs(decoded[signal] - value) < 1e-9 for signal, value in values.items())
                if name != message.name or not same:
                    sys.exit(f"FAILED: {message.name} with {values} came back as {name} with {decoded}")
            identifiers.add(identifier)
    if len(identifiers) != len(dbc.messages) * (NODE + 1):
        sys.exit("FAILED: two nodes share an identifier")
    print(f"cantools has {FILE.name}: {len(dbc.messages)} messages, {len(identifiers)} identifiers")


if __name__ == "__main__":
    if len(sys.argv) != 1:
        sys.exit(__doc__)
    main()
