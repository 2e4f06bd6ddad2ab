//! A peripheral's registers as the bus sees them.

use crate::time::Nanos;

/// Why an access is not as it should be. The run fails; the access reads 0, or writes nothing unless the manual says
/// otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refused {
    /// The peripheral has no register at this offset.
    NoRegister,
    /// The register has no model.
    Unimplemented(&'static str),
    /// The manual forbids it.
    Forbidden {
        /// The register.
        register: &'static str,
        /// What is forbidden, and the section that says so.
        reason: &'static str,
    },
}

/// An access or a state that the manual forbids.
pub(crate) const fn forbidden(register: &'static str, reason: &'static str) -> Refused {
    Refused::Forbidden { register, reason }
}

/// A peripheral with registers of 32 bits.
///
/// Every call happens at its instant, in order: what was due before an access has been done.
pub(crate) trait Peripheral {
    /// Reads the register at `offset`, a multiple of 4, with what a read does.
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused>;

    /// Writes the register at `offset`, a multiple of 4.
    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused>;

    /// Does what is due at `now`.
    fn advance(&mut self, _now: Nanos) {}

    /// When something is due, whatever the bus does.
    fn due(&self) -> Option<Nanos> {
        None
    }
}

/// The bits of `old` where `mask` has none, those of `new` where it has.
#[inline]
pub(crate) const fn merge(old: u32, new: u32, mask: u32) -> u32 {
    old & !mask | new & mask
}

/// The field of a register at this bit with this mask, moved down.
#[inline]
pub(crate) const fn field(value: u32, at: u32, mask: u32) -> u32 {
    value >> at & mask
}
