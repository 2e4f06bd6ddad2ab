//! A virtual board: the shipped firmware image, unmodified, on a model of the STM32F405RG or STM32G431CB, or on an
//! emulated RP2040, with a USB host and an arm.
//!
//! ```no_run
//! use armwire_bridge::Duration;
//! use armwire_sim::ling::{Config as ArmConfig, LingArm};
//! use armwire_virtual_board::usb::cdc::LineCoding;
//! use armwire_virtual_board::{Config, VirtualBoard};
//!
//! let arm = LingArm::new(ArmConfig::follower());
//! let mut board = VirtualBoard::start(Config::new("armwire-firmware.elf", arm))?;
//! board.usb().attach();
//! board.usb().open(0, LineCoding::new(1_000_000))?;
//! board.usb().write(&[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF])?;
//! board.run_until(Duration::from_millis(5), |board| board.usb().unread() > 0)?;
//! println!("{} after power-on: {:02x?}", board.now(), board.usb().read());
//! board.check()?;
//! # Ok::<(), armwire_virtual_board::Error>(())
//! ```
//!
//! [`core`] is a Cortex-M4, independent of the chip; `soc` has the common parts of all chips; `mcu` has the STM32F405
//! and the STM32G431, one file per peripheral, register by register; `rp2040` runs an RP2040 in the process of an
//! emulator. [`usb`] has the USB host, [`can`] the other nodes on the CAN bus, and [line](mod@line) the serial line to
//! the arm. Section numbers without a name are those of RM0090, the reference manual of the STM32F405.
//! `docs/virtual-board.md` lists the modelled behaviour with its tests, and the limits.
//!
//! Time is virtual: an instruction takes a cycle, sleep jumps to the next event, and runs are reproducible by their
//! [trace](VirtualBoard::trace_hash). With one cycle per instruction, latencies are lower bounds;
//! [`Config::exact_cycles`] counts the cycles of a Cortex-M4.
#![forbid(unsafe_code)]

mod board;
pub mod can;
mod chip;
pub mod core;
mod crystal;
mod engine;
mod error;
pub mod flash;
mod image;
pub mod latency;
pub mod line;
mod mcu;
pub mod report;
mod revision;
mod rp2040;
#[cfg(unix)]
pub mod serve;
mod shared;
mod soc;
mod time;
mod timing;
mod trace;
pub mod usb;

pub use board::{Can, Config, Pipe, Uart, Usb, VirtualBoard};
pub use chip::Chip;
pub use crystal::Crystal;
pub use error::Error;
pub use line::Arm;
pub use mcu::stm32f405::{ArmUart, OtgVariant, Reenabled};
pub use mcu::stm32g431::EccRegister;
pub use revision::Rp2040Revision;
pub use time::Nanos;
pub use timing::Timing;
