//! GPIOA (RM0090, chapter 8): the library's, with the arm's line at PA2.
//!
//! The line learns whether the pin is the UART's. While it is, and the UART does not drive it, the arm may see it low.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::Layout;
use rigless::soc::stm32f427::generated::gpioa::Register;
use rigless::soc::stm32f427::peripherals::gpio::Gpio;
use rigless::time::EventId;

use crate::line::{AnyLine, LOW, Pin};
use crate::shared::lock;

/// The pin that the UART sends on.
const PIN: u64 = 2;
/// MODER of a pin that is an output, and of one that a peripheral has (8.4.1).
const OUTPUT: u64 = 0b01;
const ALTERNATE: u64 = 0b10;

/// The port.
#[derive(Debug)]
pub(super) struct PortA {
    library: Gpio,
    line: AnyLine,
}

impl PortA {
    pub(super) fn new(line: AnyLine) -> Self {
        lock(&line).set_pin(Pin::Free);
        Self {
            library: Gpio::default(),
            line,
        }
    }
}

/// Who drives the pin.
fn pin(registers: &RegisterFile) -> Pin {
    let is_high = registers.get(Register::Odr) >> PIN & 1 != 0;
    match registers.get(Register::Moder) >> (2 * PIN) & 0b11 {
        ALTERNATE => Pin::Uart,
        OUTPUT if !is_high => Pin::Low,
        _ => Pin::Free,
    }
}

impl Device for PortA {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.library.read(register, registers, context)
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.library.write(register, value, registers, context);
        let mut line = lock(&self.line);
        let was_low = line.is_pin_low();
        line.set_pin(pin(registers));
        if line.is_pin_low() && !was_low {
            context.tell(register.spec().name, LOW);
        }
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.library.on_event(event, registers, context);
    }

    fn reset(&mut self) {
        *self = Self::new(self.line.clone());
    }
}
