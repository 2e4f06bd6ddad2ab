//! Pins of the board's [data](armwire_boards).

use armwire_boards::{Pin, Port};
use embassy_stm32::Peri;
use embassy_stm32::gpio::AnyPin;
use embassy_stm32::pac;
use embassy_stm32::pac::gpio::Gpio;

/// Number of pins of a port.
const PINS: u8 = 16;

/// The registers of a pin's port, and the pin's number there.
pub(super) const fn registers(Pin(port, number): Pin) -> (Gpio, usize) {
    let registers = match port {
        Port::A => pac::GPIOA,
        Port::B => pac::GPIOB,
        Port::C => pac::GPIOC,
        Port::D => pac::GPIOD,
        // The list has no such pin for an STM32.
        Port::Gp => unreachable!(),
    };
    (registers, number as usize)
}

/// Takes a pin for the HAL.
///
/// # Safety
///
/// Nothing else has the pin.
pub(super) unsafe fn take(Pin(port, number): Pin) -> Peri<'static, AnyPin> {
    // SAFETY: see above. The HAL numbers the pins of all ports.
    unsafe { AnyPin::steal(port as u8 * PINS + number) }
}
