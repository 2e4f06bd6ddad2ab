//! The list of boards. `docs/boards.md` has the source of each fact.

use crate::Chip::{Rp2040, Stm32f405, Stm32g431};
use crate::Port::{A, B, C, D, Gp};
use crate::{Board, CanPins, Led, Pin, Uart};

/// All boards.
pub const BOARDS: &[Board] = &[
    STM32F405,
    STM32G431,
    WEACT_F405,
    WEACT_G431,
    PYBOARD,
    FEATHER_F405,
    OLIMEX_H405,
    BLACK_F407VE,
    F4_DISCOVERY,
    PICO,
];

/// PB8 and PB9, which most boards leave free.
const CAN: CanPins = CanPins {
    rx: Pin(B, 8),
    tx: Pin(B, 9),
};

/// A board without a name, with the pins of WeAct's.
const STM32F405: Board = Board {
    name: "stm32f405",
    title: "another board with an STM32F405RG",
    chip: Stm32f405,
    probe_rs: "STM32F405RGTx",
    crystal: 8,
    uart: Uart::Usart2,
    led: Led {
        pin: Pin(B, 2),
        on: true,
    },
    can: Some(CAN),
};

/// A board without a name, with the pins of WeAct's.
const STM32G431: Board = Board {
    name: "stm32g431",
    title: "another board with an STM32G431CB",
    chip: Stm32g431,
    probe_rs: "STM32G431CBTx",
    crystal: 8,
    uart: Uart::Usart2,
    led: Led {
        pin: Pin(C, 6),
        on: true,
    },
    can: Some(CAN),
};

const WEACT_F405: Board = Board {
    name: "weact-f405",
    title: "WeAct STM32F405 core board",
    ..STM32F405
};

const WEACT_G431: Board = Board {
    name: "weact-g431",
    title: "WeAct STM32G431 core board",
    probe_rs: "STM32G431CBUx",
    ..STM32G431
};

/// Its blue LED: the others are at the pins of the debugger. PB2 is the accelerometer's interrupt.
const PYBOARD: Board = Board {
    name: "pyboard",
    title: "pyboard 1.1",
    crystal: 12,
    led: Led {
        pin: Pin(B, 4),
        on: true,
    },
    ..STM32F405
};

/// PA2 is not connected, and PA3 measures the battery.
const FEATHER_F405: Board = Board {
    name: "feather-f405",
    title: "Adafruit Feather STM32F405 Express",
    crystal: 12,
    uart: Uart::Usart3,
    led: Led {
        pin: Pin(C, 1),
        on: true,
    },
    ..STM32F405
};

const OLIMEX_H405: Board = Board {
    name: "olimex-h405",
    title: "Olimex STM32-H405",
    led: Led {
        pin: Pin(C, 12),
        on: false,
    },
    ..STM32F405
};

const BLACK_F407VE: Board = Board {
    name: "black-f407ve",
    title: "black STM32F407VET6 board",
    probe_rs: "STM32F407VETx",
    led: Led {
        pin: Pin(A, 6),
        on: false,
    },
    ..STM32F405
};

/// PB9 is the I2C bus of its audio DAC.
const F4_DISCOVERY: Board = Board {
    name: "f4-discovery",
    title: "STM32F4DISCOVERY",
    probe_rs: "STM32F407VGTx",
    led: Led {
        pin: Pin(D, 12),
        on: true,
    },
    can: Some(CanPins {
        rx: Pin(D, 0),
        tx: Pin(D, 1),
    }),
    ..STM32F405
};

const PICO: Board = Board {
    name: "pico",
    title: "Raspberry Pi Pico",
    chip: Rp2040,
    probe_rs: "RP2040",
    crystal: 12,
    led: Led {
        pin: Pin(Gp, 25),
        on: true,
    },
    uart: Uart::Uart1,
    can: None,
};

impl Board {
    /// The board of this name.
    pub const fn find(name: &str) -> Option<&'static Self> {
        let mut i = 0;
        while i < BOARDS.len() {
            if is_equal(BOARDS[i].name.as_bytes(), name.as_bytes()) {
                return Some(&BOARDS[i]);
            }
            i += 1;
        }
        None
    }
}

/// `==`, which is not const.
const fn is_equal(a: &[u8], b: &[u8]) -> bool {
    let mut i = 0;
    while i < a.len() && i < b.len() && a[i] == b[i] {
        i += 1;
    }
    i == a.len() && i == b.len()
}
