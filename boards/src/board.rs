//! A board, and what it consists of.

/// A board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// The name in options, in file names and in the adapter's identity: 1 to 16 lower-case letters, digits and `-`.
    pub name: &'static str,
    /// The name under which it is sold.
    pub title: &'static str,
    /// The chip that its image is built for.
    pub chip: Chip,
    /// probe-rs's name of the mounted chip.
    pub probe_rs: &'static str,
    /// The crystal's frequency in megahertz. The firmware measures it.
    pub crystal: u32,
    /// The UART to the arm.
    pub uart: Uart,
    /// The status LED.
    pub led: Led,
    /// The pins of the CAN controller, to and from a transceiver; `None` for a chip without one.
    pub can: Option<CanPins>,
}

/// A chip with its own image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chip {
    /// STM32F405RG. Images for it also run on an STM32F407, which has more peripherals.
    Stm32f405,
    /// STM32G431CB.
    Stm32g431,
    /// RP2040.
    Rp2040,
}

/// A UART, with its pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Uart {
    /// On PA2 and PA3.
    Usart2,
    /// On PB10 and PB11.
    Usart3,
    /// UART1 of an RP2040, on GP4 and GP5.
    Uart1,
}

/// A LED at a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Led {
    /// The pin.
    pub pin: Pin,
    /// The level that lights the LED: true for high.
    pub on: bool,
}

/// The pins of a CAN controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CanPins {
    /// From the transceiver.
    pub rx: Pin,
    /// To the transceiver.
    pub tx: Pin,
}

/// A pin of a chip: `Pin(Port::B, 8)` is PB8, `Pin(Port::Gp, 25)` is GP25.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin(pub Port, pub u8);

/// A port: 16 pins of an STM32, or all pins of an RP2040.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs)]
pub enum Port {
    A,
    B,
    C,
    D,
    Gp,
}

impl Chip {
    /// The name of the chip.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stm32f405 => "stm32f405",
            Self::Stm32g431 => "stm32g431",
            Self::Rp2040 => "rp2040",
        }
    }

    /// The name of the board for which its image is built unless another is named.
    pub const fn board(self) -> &'static str {
        match self {
            Self::Stm32f405 => "stm32f405",
            Self::Stm32g431 => "stm32g431",
            Self::Rp2040 => "pico",
        }
    }
}

impl Uart {
    /// The pin to the arm.
    pub const fn tx(self) -> Pin {
        match self {
            Self::Usart2 => Pin(Port::A, 2),
            Self::Usart3 => Pin(Port::B, 10),
            Self::Uart1 => Pin(Port::Gp, 4),
        }
    }

    /// The pin from the arm.
    pub const fn rx(self) -> Pin {
        match self {
            Self::Usart2 => Pin(Port::A, 3),
            Self::Usart3 => Pin(Port::B, 11),
            Self::Uart1 => Pin(Port::Gp, 5),
        }
    }
}

impl core::fmt::Display for Pin {
    /// `PB8`, `GP25`.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            Port::Gp => write!(f, "GP{}", self.1),
            port => write!(f, "P{port:?}{}", self.1),
        }
    }
}
