//! Properties of the chips, where they differ.

use std::num::NonZeroU32;
use std::ops::Range;

use armwire_virtual_board::{Chip, Nanos};

/// Addresses and figures of a chip.
#[derive(Clone, Debug)]
pub struct Facts {
    /// True for a chip with CAN.
    pub can: bool,
    /// True for CAN FD.
    pub can_fd: bool,
    /// Core cycles per second.
    pub core_hz: u64,
    /// Maximum time that the firmware adds to a call or an answer, in nanoseconds.
    pub latency: u64,
    /// Offsets of the configuration in the flash, in bytes: two sectors or pages.
    pub config_flash: Range<usize>,
    /// Factor by which a slower core still processes each frame of a full CAN bus, without other load.
    pub flooded: NonZeroU32,
    /// Duration of the erase of one of them, typical and maximum.
    pub erase: [Nanos; 2],
    /// Duration of bytes in both directions at once at a rate, as a multiple of their time on the line, at most. The
    /// RP2040 pauses after each burst to the arm.
    pub duplex: fn(baud: u32) -> f64,
    /// Share of the line's limit that the fastest polls reach, at least. The goal is 0.95. A new compiler may cost the rest.
    pub fastest_poll: f64,
    /// Maximum time in nanoseconds from the end of an exchange to the poll that it delayed.
    pub delayed_poll: u64,
    /// Bytes of a burst that still go out after it was cut.
    pub fifo: u64,
    /// Flash operations of a save, at least: into a page with room, and with an erase.
    pub save_operations: [usize; 2],
    /// True if the virtual board has variants of the peripherals: where a manual leaves a behaviour open.
    pub has_variants: bool,
    /// True if the UART reports noise.
    pub reports_noise: bool,
    /// The serial number that the adapter has from the virtual board's unique id.
    pub serial: &'static str,
    /// Registers of an STM32.
    registers: Option<Registers>,
}

/// Registers of an STM32, with values.
#[derive(Clone, Copy, Debug)]
pub struct Registers {
    /// RCC_CR.
    pub clock_control: u64,
    /// GPIOA. Its pin 2 sends to the arm.
    pub gpioa: u64,
    /// The port and the pin of the status LED.
    pub led: (u64, usize),
    /// The counter of the clock's timer, and the compare value of the next deadline.
    pub clock_count: u64,
    /// See [`clock_count`](Self::clock_count).
    pub clock_due: u64,
    /// CR1 of the arm's UART, its value with the receiver off, and its value with receiver and idle interrupt on.
    pub uart_control: u64,
    /// See [`uart_control`](Self::uart_control).
    pub uart_receiver_off: u32,
    /// See [`uart_control`](Self::uart_control).
    pub uart_receiver_on: u32,
}

impl Facts {
    /// The variants of a peripheral that a test tries, of these.
    pub fn variants<T>(&self, variants: impl IntoIterator<Item = T>) -> impl Iterator<Item = T> {
        let tried = if self.has_variants { usize::MAX } else { 1 };
        variants.into_iter().take(tried)
    }

    /// The registers.
    ///
    /// # Panics
    ///
    /// If the chip is no STM32.
    pub fn registers(&self) -> Registers {
        self.registers.expect("the test is for an STM32")
    }
}

/// The properties of a chip.
pub const fn facts(chip: Chip) -> Facts {
    match chip {
        // Addresses of RM0090, table 1; TIM5 (18.4), USART2 (30.6.4: UE 13, TE 3, RE 2, IDLEIE 4); erases of DS8626, 5.3.12.
        Chip::Stm32f405 => Facts {
            can: true,
            can_fd: false,
            core_hz: 168_000_000,
            latency: 21_000,
            config_flash: 0x4000..0xC000,
            flooded: NonZeroU32::new(4).unwrap(),
            erase: [Nanos::from_millis(250), Nanos::from_millis(500)],
            duplex: |_| 1.03,
            fastest_poll: 0.92,
            delayed_poll: 60_000,
            fifo: 0,
            save_operations: [4, 5],
            has_variants: true,
            reports_noise: true,
            serial: "200041000B35315035563033",
            registers: Some(Registers {
                clock_control: 0x4002_3800,
                gpioa: 0x4002_0000,
                led: (0x4002_0400, 2),
                clock_count: 0x4000_0C24,
                clock_due: 0x4000_0C38,
                uart_control: 0x4000_440C,
                uart_receiver_off: 1 << 13 | 1 << 3,
                uart_receiver_on: 1 << 13 | 1 << 3 | 1 << 2 | 1 << 4,
            }),
        },
        // Addresses of RM0440, table 3; TIM2 (30.5), USART2 (37.8.2: UE 0, TE 3, RE 2, IDLEIE 4); erases of DS12589.
        Chip::Stm32g431 => Facts {
            can: true,
            can_fd: true,
            core_hz: 160_000_000,
            latency: 27_500,
            config_flash: 0x1F000..0x20000,
            flooded: NonZeroU32::new(3).unwrap(),
            erase: [Nanos(22_020_000), Nanos(24_470_000)],
            duplex: |_| 1.03,
            fastest_poll: 0.92,
            delayed_poll: 60_000,
            fifo: 0,
            save_operations: [4, 5],
            has_variants: true,
            reports_noise: true,
            serial: "200041000B35315035563033",
            registers: Some(Registers {
                clock_control: 0x4002_1000,
                gpioa: 0x4800_0000,
                led: (0x4800_0800, 6),
                clock_count: 0x4000_0024,
                clock_due: 0x4000_0038,
                uart_control: 0x4000_4400,
                uart_receiver_off: 1 | 1 << 3,
                uart_receiver_on: 1 | 1 << 3 | 1 << 2 | 1 << 4,
            }),
        },
        // Erases of W25Q16JV, 9.6. The flash's unique id has eight bytes.
        Chip::Rp2040 => Facts {
            can: false,
            can_fd: false,
            core_hz: 125_000_000,
            latency: 60_000,
            config_flash: 0x1F_E000..0x20_0000,
            flooded: NonZeroU32::MIN,
            erase: [Nanos::from_millis(45), Nanos::from_millis(400)],
            duplex: |baud| match baud {
                2_000_000 => 1.25,
                1_000_000 => 1.06,
                _ => 1.03,
            },
            fastest_poll: 0.85,
            delayed_poll: 100_000,
            fifo: 32,
            save_operations: [2, 3],
            has_variants: false,
            reports_noise: false,
            serial: "200041000B353150",
            registers: None,
        },
    }
}

/// The chip of the image under test.
///
/// # Panics
///
/// See [`path`](super::path). Also if the image is for no supported chip.
pub fn chip() -> Chip {
    Chip::of_image(&super::path()).expect("an image for a chip that the board can have")
}
