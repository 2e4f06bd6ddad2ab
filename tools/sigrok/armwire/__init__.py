"""Frames of robot arms on a UART: Ling / Alicia-D of both generations, and UBTECH Alpha1 with its servos.

TX is the line from the host to the arm, RX the line from the arm to the host. Each frame is shown with its meaning and
its fields. Damaged frames and stray bytes are warnings; the next whole frame is found behind any damage.
"""

from .pd import Decoder  # noqa: F401
