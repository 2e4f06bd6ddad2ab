//! UBTECH Alpha1: a humanoid of 16 servos, on USB, and the servos on their own bus.
