//! What the tests know of the chips, where these differ.

use std::ops::Range;

use armwire_virtual_board::Chip;

/// Addresses and figures of a chip.
#[derive(Clone, Debug)]
pub struct Facts {
    /// Whether its CAN is CAN FD.
    pub can_fd: bool,
    /// Cycles of the core in a second.
    pub core_hz: u64,
    /// What the firmware adds to a call or an answer at most, in nanoseconds. The goal is a tenth of the time that the answer
    /// takes on the line, 21 µs, which the STM32G431 misses.
    pub latency: u64,
    /// Where the configuration is in the flash, in bytes from its start: two sectors or pages.
    pub config_flash: Range<usize>,
    /// The counter of the clock's timer, and the compare value that tells what is due.
    pub clock_count: u64,
    /// See [`clock_count`](Self::clock_count).
    pub clock_due: u64,
    /// CR1 of the arm's UART, with the receiver off and with it and its idle interrupt on.
    pub uart_control: u64,
    /// See [`uart_control`](Self::uart_control).
    pub uart_deaf: u32,
    /// See [`uart_control`](Self::uart_control).
    pub uart_listening: u32,
}

/// What the tests know of a chip.
pub const fn facts(chip: Chip) -> Facts {
    match chip {
        // TIM5 and USART2 (RM0090, table 1, 18.4, 30.6.4: UE 13, TE 3, RE 2, IDLEIE 4).
        Chip::Stm32f405 => Facts {
            can_fd: false,
            core_hz: 168_000_000,
            latency: 21_000,
            config_flash: 0x4000..0xC000,
            clock_count: 0x4000_0C24,
            clock_due: 0x4000_0C38,
            uart_control: 0x4000_440C,
            uart_deaf: 1 << 13 | 1 << 3,
            uart_listening: 1 << 13 | 1 << 3 | 1 << 2 | 1 << 4,
        },
        // TIM2 and USART2 (RM0440, table 3, 30.5, 37.8.2: UE 0, TE 3, RE 2, IDLEIE 4).
        Chip::Stm32g431 => Facts {
            can_fd: true,
            core_hz: 160_000_000,
            latency: 26_000,
            config_flash: 0x1F000..0x20000,
            clock_count: 0x4000_0024,
            clock_due: 0x4000_0038,
            uart_control: 0x4000_4400,
            uart_deaf: 1 | 1 << 3,
            uart_listening: 1 | 1 << 3 | 1 << 2 | 1 << 4,
        },
    }
}

/// The chip that the image under test is for.
///
/// # Panics
///
/// As [`path`](super::path), and if the image is for no chip that the board can have.
pub fn chip() -> Chip {
    Chip::of_image(&super::path()).expect("an image for a chip that the board can have")
}
