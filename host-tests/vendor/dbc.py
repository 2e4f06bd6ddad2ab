"""Encoder and decoder of an armwire adapter's cyclic frames, with cantools and docs/armwire.dbc.

Usage: dbc.py

Checks that cantools loads the file, that each value survives encoding and decoding, and that the identifiers of all 16
nodes differ.
"""

import sys
from pathlib import Path

import cantools

from checks import require

FILE = Path(__file__).parents[2] / "docs/armwire.dbc"
# The bits of an identifier that are the node id.
NODE_MASK = 0xF


class Dbc:
    """The messages of docs/armwire.dbc, for every node."""

    def __init__(self) -> None:
        # Strict: signals neither overlap nor exceed their frame.
        self._database = cantools.database.load_file(FILE, strict=True)
        self.messages = self._database.messages

    def decode(self, identifier: int, data: bytes) -> tuple[str, dict[str, float]]:
        """The name of a frame and its values, as numbers."""
        try:
            message = self._database.get_message_by_frame_id(identifier & ~NODE_MASK)
        except KeyError:
            raise ValueError(f"no message has identifier {identifier:#05x}") from None
        if len(data) != message.length:
            raise ValueError(f"{message.name} has {message.length} bytes, not {len(data)}")
        return message.name, message.decode(data, decode_choices=False)

    def encode(self, name: str, node: int, values: dict[str, float]) -> tuple[int, bytes]:
        """The identifier and data of a frame. Values of other frames are ignored.

        A value out of range is an error.
        """
        message = self._database.get_message_by_name(name)
        own = {signal.name: values[signal.name] for signal in message.signals}
        return message.frame_id | node, message.encode(own)


def main() -> None:
    dbc = Dbc()
    nodes = range(NODE_MASK + 1)
    identifiers = set()
    for message in dbc.messages:
        for node in nodes:
            for extreme in ("minimum", "maximum"):
                values = {signal.name: getattr(signal, extreme) for signal in message.signals}
                identifier, data = dbc.encode(message.name, node, values)
                name, decoded = dbc.decode(identifier, data)
                same = all(abs(decoded[signal] - value) < 1e-9 for signal, value in values.items())
                fact = f"{message.name} with {values} is decoded unchanged, not as {name} with {decoded}"
                require(fact, name == message.name and same)
            identifiers.add(identifier)
    require("each node has its own identifiers", len(identifiers) == len(dbc.messages) * len(nodes))
    print(f"cantools decodes {FILE.name}: {len(dbc.messages)} messages, {len(identifiers)} identifiers")


if __name__ == "__main__":
    if len(sys.argv) != 1:
        sys.exit(__doc__)
    main()
