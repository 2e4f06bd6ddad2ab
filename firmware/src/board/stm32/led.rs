//! The status LED, by the registers of its pin: it is on before the HAL is.

use armwire_boards::Led as Data;
use embassy_stm32::pac::gpio::vals::Moder;

use super::{enable_port, pin};
use crate::board::this::THIS;

const LED: Data = THIS.led;

/// The status LED.
pub(crate) struct Led(());

impl Led {
    /// Takes the pin. The LED is off.
    pub(super) fn new() -> Self {
        enable_port(LED.pin.0);
        let mut led = Self(());
        led.set(false);
        let (port, pin) = pin::registers(LED.pin);
        port.moder().modify(|w| w.set_moder(pin, Moder::OUTPUT));
        led
    }

    /// Switches the LED on or off.
    pub(crate) fn set(&mut self, on: bool) {
        let (port, pin) = pin::registers(LED.pin);
        port.bsrr().write(|w| match on == LED.on {
            true => w.set_bs(pin, true),
            false => w.set_br(pin, true),
        });
    }
}
