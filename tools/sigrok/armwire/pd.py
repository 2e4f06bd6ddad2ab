"""The decoder for sigrok: bytes of a UART in, annotations out."""

import sigrokdecode as srd

from . import alpha1, ling
from .line import Line

PROTOCOLS = {"ling": ling.Ling, "alpha1": alpha1.Alpha1}

# Lines, by their numbers in the UART decoder.
RX, TX = 0, 1

# Bits of a byte on the line.
BYTE_BITS = 10

# Classes of annotations; that of TX is one higher.
FRAME, FIELD, WARNING = 0, 2, 4


class Decoder(srd.Decoder):
    """A decoder that is stacked on the UART decoder."""

    api_version = 3
    id = "armwire"
    name = "Armwire"
    longname = "Robot arms: Ling / Alicia-D, UBTECH Alpha1"
    desc = "Frames of robot arms and their meaning."
    license = "mit"
    inputs = ["uart"]
    outputs = []
    tags = ["Embedded/industrial"]
    options = (
        {"id": "arm", "desc": "Arm", "default": "ling", "values": ("ling", "alpha1")},
        {"id": "idle", "desc": "Silence that ends a frame (bytes)", "default": 100},
    )
    annotations = (
        ("rx-frame", "Frame from the arm"),
        ("tx-frame", "Frame to the arm"),
        ("rx-field", "Field from the arm"),
        ("tx-field", "Field to the arm"),
        ("rx-warning", "Damage from the arm"),
        ("tx-warning", "Damage to the arm"),
    )
    annotation_rows = (
        ("tx-frames", "To the arm", (FRAME + TX,)),
        ("tx-fields", "To the arm: fields", (FIELD + TX,)),
        ("tx-warnings", "To the arm: damage", (WARNING + TX,)),
        ("rx-frames", "From the arm", (FRAME + RX,)),
        ("rx-fields", "From the arm: fields", (FIELD + RX,)),
        ("rx-warnings", "From the arm: damage", (WARNING + RX,)),
    )

    def __init__(self):
        self.reset()

    def reset(self):
        """Discard the bytes of both lines."""
        self.lines = []

    def start(self):
        """Begin a capture."""
        self.out = self.register(srd.OUTPUT_ANN)
        arm = PROTOCOLS[self.options["arm"]]()
        self.lines = [Line(arm, side, self) for side in (RX, TX)]

    def decode(self, ss, es, data):
        """Process a byte, or silence of the length of a byte."""
        kind, side, value = data
        line = self.lines[side]
        if kind == "DATA":
            line.push(ss, es, value[0])
        elif kind == "IDLE" and line.silence(es) >= self.options["idle"] * (es - ss):
            line.idle()

    def frame(self, side, ss, es, text):
        """Show a frame's meaning: the whole text, its name, or a letter."""
        self.put(ss, es, self.out, [FRAME + side, [text, text.split(":")[0], text[0].upper()]])

    def field(self, side, ss, es, text):
        """Show a value in a frame."""
        self.put(ss, es, self.out, [FIELD + side, [text, text.split(": ")[-1]]])

    def warning(self, side, ss, es, text):
        """Show damage."""
        self.put(ss, es, self.out, [WARNING + side, [text, "damage", "!"]])
