//! Accesses and states that fail a run, each recorded once.

use std::collections::BTreeSet;

use super::peripheral::Refused;
use crate::report::Violation;

/// The violations of a run, in the order of their first occurrence.
#[derive(Clone, Debug, Default)]
pub(crate) struct Recorder {
    violations: Vec<Violation>,
    /// Their addresses.
    addresses: BTreeSet<u32>,
}

impl Recorder {
    pub(crate) fn violations(&self) -> &[Violation] {
        &self.violations
    }

    /// An access to a hole in the memory map.
    pub(crate) fn unmapped(&mut self, address: u32, program_counter: u32) {
        if self.addresses.insert(address) {
            self.violations.push(Violation::Unmapped {
                address: address.into(),
                program_counter: program_counter.into(),
            });
        }
    }

    /// An access that the bus or a peripheral refuses, independent of the register.
    pub(crate) fn refused(&mut self, address: u32, program_counter: u32, reason: &str) {
        if self.addresses.insert(address) {
            self.violations.push(Violation::Refused {
                address: address.into(),
                reason: format!("{reason}, by the instruction at {program_counter:#010x}"),
            });
        }
    }

    /// An access that a register refuses.
    pub(crate) fn register(
        &mut self,
        instance: &'static str,
        refused: Refused,
        address: u32,
        program_counter: u32,
        is_write: bool,
    ) {
        match refused {
            Refused::NoRegister => self.unmapped(address, program_counter),
            Refused::Unimplemented(register) => self.unimplemented(instance, register, program_counter, is_write),
            Refused::Forbidden { register, reason } => self.forbidden(instance, register, reason),
        }
    }

    /// A state that the manual forbids.
    pub(crate) fn forbidden(&mut self, instance: &'static str, register: &'static str, reason: &'static str) {
        let violation = Violation::Forbidden {
            instance,
            register,
            reason,
        };
        if !self.violations.contains(&violation) {
            self.violations.push(violation);
        }
    }

    fn unimplemented(&mut self, instance: &'static str, register: &'static str, pc: u32, is_write: bool) {
        let known = self.violations.iter_mut().find_map(|violation| match violation {
            Violation::Unimplemented {
                instance: i,
                register: r,
                reads,
                writes,
                ..
            } if (*i, *r) == (instance, register) => Some(if is_write { writes } else { reads }),
            _ => None,
        });
        match known {
            Some(count) => *count += 1,
            None => self.violations.push(Violation::Unimplemented {
                instance,
                register,
                program_counter: pc.into(),
                reads: u64::from(!is_write),
                writes: u64::from(is_write),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soc::peripheral::forbidden;

    #[test]
    fn violation_that_repeats_is_kept_once() {
        let mut recorder = Recorder::default();
        for _ in 0..2 {
            recorder.register("RCC", Refused::NoRegister, 0x4002_1010, 0x0800_0100, false);
            recorder.register("RCC", forbidden("CR", "why"), 0x4002_1000, 0x0800_0100, true);
            recorder.refused(0x4000_4400, 0x0800_0100, "its clock is off");
        }
        assert_eq!(recorder.violations().len(), 3);
    }

    #[test]
    fn unmodelled_register_accesses_are_counted() {
        let mut recorder = Recorder::default();
        for is_write in [false, true, true] {
            recorder.register(
                "SYSCFG",
                Refused::Unimplemented("EXTICR1"),
                0x4001_0008,
                0x0800_0100,
                is_write,
            );
        }
        assert_eq!(
            recorder.violations(),
            [Violation::Unimplemented {
                instance: "SYSCFG",
                register: "EXTICR1",
                program_counter: 0x0800_0100,
                reads: 1,
                writes: 2
            }]
        );
    }
}
