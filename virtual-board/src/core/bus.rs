//! The core's connection to everything except plain memory.
//!
//! Flash and RAM are in [`Memory`], which the core owns and accesses directly. Every other address
//! reaches the chip through [`Bus`]: peripherals, system memory, aliases, holes. The core keeps the System Control Space
//! and the Data Watchpoint and Trace unit for itself (ARM DDI 0403E, B3.2 and C1.8).

use super::memory::{Memory, Width};

/// The purpose of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A load or store.
    Data,
    /// An instruction fetch. Its width is [`Width::Half`].
    Fetch,
    /// A read or write by the debugger. It should have no side effect where the chip can avoid one.
    Debug,
}

/// One transfer on the bus. Its address is a multiple of its width.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    /// The first byte.
    pub address: u32,
    /// The size.
    pub width: Width,
    /// The core's cycle at which the instruction began.
    pub cycle: u64,
    /// The address of the instruction.
    pub pc: u32,
    /// The purpose of the transfer.
    pub purpose: Purpose,
    /// True if the core is privileged.
    pub privileged: bool,
}

/// A bus error: no device at the address, or no support for this transfer. The core takes a BusFault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusError;

/// The chip, as seen by the core.
///
/// Every event up to [`Access::cycle`] has been processed before the call: [`Core::run`](super::Core::run) executes no
/// instruction that begins at or after its deadline.
pub trait Bus {
    /// Reads from an address outside flash and RAM. The value's upper bits beyond the width are ignored.
    fn read(&mut self, access: Access, memory: &mut Memory) -> Result<u32, BusError>;

    /// Writes to an address outside RAM. Writes to flash come here, too. The value's upper bits beyond the width are 0.
    fn write(&mut self, access: Access, value: u32, memory: &mut Memory) -> Result<(), BusError>;

    /// Returns true if the last transfer changed something that the board must handle before the next instruction: the
    /// level of an interrupt line, the time of the next event, a reset. The core checks after each transfer, and stops
    /// with [`Stop::Attention`](super::Stop::Attention).
    fn needs_attention(&self) -> bool;

    /// Wait states of a transfer. Counted by [`Timing::CortexM4`](super::Timing::CortexM4) only.
    fn wait_cycles(&self, _access: Access) -> u32 {
        0
    }
}

/// A chip without peripherals, for a program that uses the core and its memory alone.
#[derive(Clone, Copy, Debug)]
pub struct NoPeripherals;

impl Bus for NoPeripherals {
    fn read(&mut self, _: Access, _: &mut Memory) -> Result<u32, BusError> {
        Err(BusError)
    }

    fn write(&mut self, _: Access, _: u32, _: &mut Memory) -> Result<(), BusError> {
        Err(BusError)
    }

    fn needs_attention(&self) -> bool {
        false
    }
}
