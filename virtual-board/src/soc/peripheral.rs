//! A peripheral's registers, as seen by the bus.

use crate::time::Nanos;

/// The reason for a refused access. The run fails; the access reads 0, or writes nothing unless the manual specifies
/// otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refused {
    /// The peripheral has no register at this offset.
    NoRegister,
    /// The register has no model.
    Unimplemented(&'static str),
    /// The manual forbids it.
    Forbidden {
        register: &'static str,
        /// The forbidden state, and the section of the manual.
        reason: &'static str,
    },
}

/// An access or a state that the manual forbids.
pub(crate) const fn forbidden(register: &'static str, reason: &'static str) -> Refused {
    Refused::Forbidden { register, reason }
}

/// Refuses a write that sets a bit besides those of the register.
pub(crate) const fn check_reserved(register: &'static str, value: u32, bits: u32) -> Result<(), Refused> {
    match value & !bits {
        0 => Ok(()),
        _ => Err(forbidden(register, "a reserved bit is set")),
    }
}

/// Refuses a write that sets a bit without a model.
pub(crate) const fn check_modelled(register: &'static str, value: u32, bits: u32) -> Result<(), Refused> {
    match value & !bits {
        0 => Ok(()),
        _ => Err(Refused::Unimplemented(register)),
    }
}

/// A peripheral with 32-bit registers.
///
/// Calls are made at their instant, in order: events due before an access have been executed.
pub(crate) trait Peripheral {
    /// Reads the register at `offset`, a multiple of 4, with its side effects.
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused>;

    /// Writes the register at `offset`, a multiple of 4.
    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused>;

    /// Reads a register for the debugger, without side effects where the model can avoid them.
    fn peek(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        self.read(offset, now)
    }

    /// Resets the registers, unless a reset of the chip does not affect them.
    fn reset(&mut self, _now: Nanos) {}

    /// Executes the events due at `now`.
    fn advance(&mut self, _now: Nanos) {}

    /// The time of the next internal event.
    fn due(&self) -> Option<Nanos> {
        None
    }
}

/// A peripheral whose registers have no model.
#[derive(Debug)]
pub(crate) struct NoModel;

impl Peripheral for NoModel {
    fn read(&mut self, _: u32, _: Nanos) -> Result<u32, Refused> {
        Err(Refused::Unimplemented("all registers"))
    }

    fn write(&mut self, _: u32, _: u32, _: Nanos) -> Result<(), Refused> {
        Err(Refused::Unimplemented("all registers"))
    }
}

/// The bits of `old` where `mask` has none, those of `new` where it has.
#[inline]
pub(crate) const fn merge(old: u32, new: u32, mask: u32) -> u32 {
    old & !mask | new & mask
}

/// The field of a register at this bit with this mask, shifted down.
#[inline]
pub(crate) const fn field(value: u32, at: u32, mask: u32) -> u32 {
    value >> at & mask
}
