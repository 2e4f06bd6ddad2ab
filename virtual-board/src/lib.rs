//! A virtual board: the shipped firmware image, unmodified, on a modelled STM32F405RG or STM32G431CB with a USB host and an
//! arm at its edges.
//!
//! ```no_run
//! use armwire::Micros;
//! use armwire_sim::ling::{Config as ArmConfig, LingArm};
//! use armwire_virtual_board::usb::cdc::LineCoding;
//! use armwire_virtual_board::{Config, VirtualBoard};
//!
//! let arm = LingArm::new(ArmConfig::follower());
//! let mut board = VirtualBoard::start(Config::new("armwire-firmware.elf", arm))?;
//! board.usb().attach();
//! board.usb().open(0, LineCoding::new(1_000_000))?;
//! board.usb().write(&[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF])?;
//! board.run_until(Micros::from_millis(5), |board| board.usb().unread() > 0)?;
//! println!("{} after power-on: {:02x?}", board.now(), board.usb().read());
//! board.check()?;
//! # Ok::<(), armwire_virtual_board::Error>(())
//! ```
//!
//! The core, its interrupt controller and most peripherals are the emulator library's, `rigless`. Its STM32F427 becomes
//! an F405 in `stm32f405`; what it lacks is here: the USB controller in `otg`, the host at the other end of the cable in
//! [`usb`], the CAN controller in `bxcan`, the other nodes on its bus in [`can`], the serial [line](mod@line) to the arm.
//! Section numbers without a name are those of RM0090, the part's reference manual. `docs/virtual-board.md` says which
//! test holds which behaviour, and what none of it shows.
//!
//! Time is virtual: an instruction takes a cycle at 168 MHz, sleep jumps to the next event, and two runs give the same
//! [trace](VirtualBoard::trace_hash). There are no wait states and no contention for the bus: latencies are lower bounds,
//! and [`Config::instruction_cost`] shows how much they depend on it.
#![forbid(unsafe_code)]

mod board;
mod bxcan;
pub mod can;
mod chip;
pub mod core;
mod crystal;
mod engine;
pub mod flash;
pub mod latency;
mod library;
pub mod line;
mod machine;
mod mcu;
mod otg;
pub mod report;
#[cfg(unix)]
pub mod serve;
mod shared;
mod soc;
mod stm32f405;
mod time;
mod timing;
mod trace;
pub mod usb;

pub use board::{Can, Config, Emulator, Error, Pipe, Uart, Usb, VirtualBoard};
pub use chip::Chip;
pub use crystal::Crystal;
pub use line::Arm;
pub use mcu::stm32f405::Reenabled;
pub use time::Nanos;
pub use timing::Timing;
