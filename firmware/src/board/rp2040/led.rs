//! The status LED.

use embassy_rp::gpio::{AnyPin, Level, Output};

use crate::board::this::THIS;

/// The status LED.
pub(crate) struct Led(Output<'static>);

impl Led {
    /// Takes the pin. The LED is off.
    pub(super) fn new() -> Self {
        // SAFETY: nothing else has the pin.
        let pin = unsafe { AnyPin::steal(THIS.led.pin.1) };
        Self(Output::new(pin, Level::from(!THIS.led.on)))
    }

    /// Switches the LED on or off.
    pub(crate) fn set(&mut self, on: bool) {
        self.0.set_level(Level::from(on == THIS.led.on));
    }
}
