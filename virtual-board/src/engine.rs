//! A machine, whatever its chip.

use std::collections::BTreeMap;
use std::fmt::Debug;

use crate::board::Error;
use crate::report::{Crash, Report};
use crate::time::Nanos;
use crate::trace::Trace;

/// What lets a run stop early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Watched {
    Nothing,
    /// Whatever happens on the USB wire, the end of a frame on the CAN bus, the start of the boot loader.
    Everything,
    /// The nodes on the CAN bus have received something from the board.
    Heard,
}

/// What happened that a program may wait for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct News {
    /// Something on the USB wire, or a frame ended on the CAN bus.
    pub(crate) any: bool,
    /// A frame ended on the CAN bus, and nodes have some of the board's that were not read.
    pub(crate) heard: bool,
    /// The power was cut in the middle of a flash operation.
    pub(crate) cut: bool,
}

/// Where a run stopped.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopped {
    pub(crate) at: Nanos,
    /// Instructions since power-on.
    pub(crate) instructions: u64,
    /// The time in which the core executed them.
    pub(crate) busy: Nanos,
    pub(crate) trace: Trace,
    /// The firmware has just crashed.
    pub(crate) crash: Option<Crash>,
    pub(crate) in_boot_loader: bool,
}

/// A machine, whatever its chip. Virtual time passes in [`run`](Self::run) only.
pub(crate) trait Engine: Debug + Send {
    /// Runs until this instant, or until what is watched for happens, or until the firmware crashes.
    fn run(&mut self, until: Nanos, watched: Watched) -> Result<Stopped, Error>;

    /// What the run has met so far.
    fn report(&mut self) -> Result<Report, Error>;

    /// How often the core came to each instruction since this was last asked. The first time, it begins to count.
    fn profile(&mut self) -> Result<BTreeMap<u64, u64>, Error>;

    /// Reads a word of memory or of a register, as a debugger does. `None` if there is nothing at the address.
    fn read(&mut self, address: u64) -> Result<Option<u32>, Error>;

    /// Writes a word to memory or to a register, as a debugger does. Whether there is anything at the address.
    fn write(&mut self, address: u64, value: u32) -> Result<bool, Error>;

    /// Lets the core stand still until the next reset, or lets it go.
    fn hold(&mut self, held: bool) -> Result<(), Error>;

    /// What the firmware logged over RTT since this was last asked.
    fn log(&mut self) -> Vec<u8>;
}
