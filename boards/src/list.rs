//! The list of boards. `docs/boards.md` has the source of each fact.

use crate::Chip::{Stm32f405, Stm32g431};
use crate::Port::{B, C};
use crate::{Board, CanPins, Led, Pin};

/// All boards.
pub const BOARDS: &[Board] = &[STM32F405, STM32G431];

/// PB8 and PB9, which most boards leave free.
const CAN: CanPins = CanPins {
    rx: Pin(B, 8),
    tx: Pin(B, 9),
};

/// A board without a name, with the pins of WeAct's.
const STM32F405: Board = Board {
    name: "stm32f405",
    title: "any other board with an STM32F405RG",
    chip: Stm32f405,
    probe_rs: "STM32F405RGTx",
    crystal: 8,
    led: Led {
        pin: Pin(B, 2),
        on: true,
    },
    can: CAN,
};

/// A board without a name, with the pins of WeAct's.
const STM32G431: Board = Board {
    name: "stm32g431",
    title: "any other board with an STM32G431CB",
    chip: Stm32g431,
    probe_rs: "STM32G431CBTx",
    crystal: 8,
    led: Led {
        pin: Pin(C, 6),
        on: true,
    },
    can: CAN,
};
