//! A machine, independent of its chip.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::ops::Range;

use crate::error::Error;
use crate::report::{Crash, Report};
use crate::time::Nanos;
use crate::trace::Trace;

/// The events that stop a run early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Watched {
    Nothing,
    /// Any event on the USB wire, the end of a frame on the CAN bus, the start of the boot loader.
    Everything,
    /// The nodes on the CAN bus have received a frame of the board.
    CanReceived,
}

/// Events that a program may wait for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct News {
    /// An event on the USB wire, or the end of a frame on the CAN bus.
    pub(crate) any: bool,
    /// A frame ended on the CAN bus, and nodes have unread frames of the board.
    pub(crate) can_received: bool,
    /// The power was cut in the middle of a flash operation.
    pub(crate) cut: bool,
}

/// The state in which a run stopped.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopped {
    pub(crate) at: Nanos,
    /// Instructions since power-on.
    pub(crate) instructions: u64,
    /// Time in which the core executed them.
    pub(crate) busy: Nanos,
    pub(crate) trace: Trace,
    /// The firmware has just crashed.
    pub(crate) crash: Option<Crash>,
    pub(crate) in_boot_loader: bool,
}

/// The bytes of a stack that [`Engine::move_stack`] takes along.
pub(crate) const FRAMES: u32 = 512;

/// A machine, independent of its chip. Virtual time advances only in [`run`](Self::run).
pub(crate) trait Engine: Debug + Send {
    /// Runs until this instant, a watched event, or a crash of the firmware.
    fn run(&mut self, until: Nanos, watched: Watched) -> Result<Stopped, Error>;

    /// The report of the run so far.
    fn report(&self) -> Report;

    /// Number of executions of each instruction since the last call. The first call starts the count.
    fn profile(&mut self) -> BTreeMap<u64, u64>;

    /// Reads a word of memory or of a register, as a debugger does. `None` for a hole.
    fn read(&mut self, address: u64) -> Option<u32>;

    /// Writes a word to memory or to a register, as a debugger does. Returns false for a hole.
    fn write(&mut self, address: u64, value: u32) -> bool;

    /// Stops the core until the next reset, or releases it.
    fn hold(&mut self, held: bool);

    /// Restarts the chip as that which has written its flash does.
    fn restart_after_flashing(&mut self);

    /// Moves the top of the stack to this address, with its last [`FRAMES`] bytes.
    fn move_stack(&mut self, to: u32);

    /// Makes reads of these offsets of the flash bus errors, until one of the bytes changes.
    fn break_flash(&mut self, offsets: Range<usize>);

    /// Changes the flash content from this offset on.
    fn write_flash(&mut self, offset: usize, bytes: &[u8]);

    /// The firmware's RTT log since the last call.
    fn log(&mut self) -> Vec<u8>;
}
