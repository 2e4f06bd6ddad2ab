//! The errors of a board.

use std::io;
use std::path::PathBuf;

use crate::report::{Crash, Violations};
use crate::time::Nanos;
use crate::usb::enumerate::EnumerateError;
use crate::usb::host::TransferError;

/// Errors of a board.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The image cannot be run.
    #[error("{}: {reason}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// A program or package that the emulator of an RP2040 needs is not installed.
    #[error("an image for an RP2040 needs {missing}, which `cargo xtask pico` installs")]
    NoEmulator {
        /// The program or package.
        missing: &'static str,
    },
    /// The emulator of an RP2040 has no interface for gdb.
    #[error("gdb cannot debug an image for an RP2040 here")]
    NoDebugger,
    /// The port for gdb is not available.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// The address.
        address: String,
        /// The error.
        error: io::Error,
    },
    /// The run ended unexpectedly.
    #[error("the virtual board stopped: {0}")]
    Ended(String),
    /// The firmware crashed.
    #[error("the firmware crashed at {at}: {crash}")]
    Crashed {
        /// The cause.
        crash: Crash,
        /// The time.
        at: Nanos,
    },
    /// The power failed in the middle of a flash operation.
    #[error("the power was cut at {at}, in flash operation {operation}")]
    PowerCut {
        /// The time.
        at: Nanos,
        /// The number of the operation, from 1.
        operation: u32,
    },
    /// There is neither memory nor a register at an address.
    #[error("nothing at {address:#010x}")]
    Nothing {
        /// The address.
        address: u64,
    },
    /// The flash content has the wrong size.
    #[error("{got} bytes for the flash, which has {size}")]
    FlashSize {
        /// The size given, in bytes.
        got: usize,
        /// The size of the flash, in bytes.
        size: usize,
    },
    /// The image is for no supported chip.
    #[error("the image's vector table has {interrupts} interrupts, unlike that of any supported chip")]
    UnknownChip {
        /// Interrupts in the image's vector table.
        interrupts: u64,
    },
    /// The awaited event did not occur in time.
    #[error("the awaited event did not occur within {limit}")]
    TimedOut {
        /// The time limit.
        limit: Nanos,
    },
    /// No device pulled D+ up.
    #[error("no USB device appeared within {limit}")]
    NoDevice {
        /// The time limit.
        limit: Nanos,
    },
    /// The device could not be enumerated.
    #[error("USB enumeration: {0}")]
    Enumerate(#[from] EnumerateError),
    /// A request failed.
    #[error("USB request: {0}")]
    Transfer(#[from] TransferError),
    /// The device does not have this serial port.
    #[error("the device has {count} serial ports, not number {nth}")]
    NoPort {
        /// The requested port, from 0.
        nth: usize,
        /// The number of ports.
        count: usize,
    },
    /// The device has no vendor-specific interface with a pair of bulk endpoints.
    #[error("the device has no vendor-specific interface")]
    NoVendor,
    /// The interface is not open.
    #[error("the interface of the device is not open")]
    NotOpen,
    /// The node does not support FD frames, or is listen-only.
    #[error("the CAN node cannot send this frame: it has no FD support, or is listen-only")]
    FdFrame,
    /// The pty for the serial port failed.
    #[error("pty: {0}")]
    Serve(io::Error),
    /// The run has violations.
    #[error(transparent)]
    Violations(#[from] Violations),
}
