//! What a run has met that it should not have: accesses to what is not modelled, crashes, resets.

use std::fmt;

use crate::time::Nanos;

/// How the firmware showed that it is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crash {
    /// A panic.
    Panic,
    /// A hard fault.
    HardFault,
    /// An exception or interrupt that the firmware has no handler for.
    UnexpectedException,
    /// A fault that no handler can be called for: the core is locked up.
    Lockup,
    /// The core has no model of what the firmware needs of it.
    Unmodelled,
}

impl fmt::Display for Crash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Panic => "panic",
            Self::HardFault => "hard fault",
            Self::UnexpectedException => "unexpected exception",
            Self::Lockup => "lock-up of the core",
            Self::Unmodelled => "an instruction without a model",
        })
    }
}

/// The crash that a function of this name stands for. Only the whole name counts for handlers: the linker may give others
/// that contain it, such as an unused `_HardFault`, the address of a function that runs.
pub(crate) fn crash_of(name: &str) -> Option<Crash> {
    match name {
        "HardFault" => Some(Crash::HardFault),
        "DefaultHandler" => Some(Crash::UnexpectedException),
        _ if name.contains("rust_begin_unwind") => Some(Crash::Panic),
        _ => None,
    }
}

/// Something that should not have happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Violation {
    /// An access to an address where there is nothing.
    Unmapped {
        /// The address.
        address: u64,
        /// The instruction that made the first such access.
        program_counter: u64,
    },
    /// An access to a register whose peripheral has no model: it kept what was written, and did nothing.
    Unimplemented {
        /// The peripheral.
        instance: &'static str,
        /// The register.
        register: &'static str,
        /// The instruction that made the first such access.
        program_counter: u64,
        /// How often it was read.
        reads: u64,
        /// How often it was written.
        writes: u64,
    },
    /// An access that a peripheral refused, as one whose clock is off does.
    Refused {
        /// The address.
        address: u64,
        /// Why.
        reason: String,
    },
    /// A state of a peripheral that the manual forbids.
    Forbidden {
        /// The peripheral.
        instance: &'static str,
        /// The register.
        register: &'static str,
        /// What is forbidden, and where the manual says so.
        reason: &'static str,
    },
    /// The firmware crashed.
    Crashed {
        /// How.
        crash: Crash,
        /// When.
        at: Nanos,
    },
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unmapped {
                address,
                program_counter,
            } => {
                write!(
                    f,
                    "access to {address:#010x}, where nothing is, by the instruction at {program_counter:#010x}"
                )
            }
            Self::Unimplemented {
                instance,
                register,
                program_counter,
                reads,
                writes,
            } => write!(
                f,
                "{instance}.{register} has no model: {reads} reads, {writes} writes, first at {program_counter:#010x}"
            ),
            Self::Refused { address, reason } => write!(f, "access to {address:#010x} refused: {reason}"),
            Self::Forbidden {
                instance,
                register,
                reason,
            } => write!(f, "{instance}.{register}: {reason}"),
            Self::Crashed { crash, at } => write!(f, "{crash} at {at}"),
        }
    }
}

/// What makes a run fail: everything that is not on the [allow-list](ALLOWED).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violations(pub Vec<Violation>);

impl fmt::Display for Violations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the firmware did what the virtual board does not model")?;
        self.0.iter().try_for_each(|violation| write!(f, "\n  {violation}"))
    }
}

impl std::error::Error for Violations {}

/// Why the part started over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The firmware asked for it.
    Software,
    /// The independent watchdog was not fed.
    Watchdog,
    /// The power came back.
    Power,
}

/// A restart of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Restart {
    /// When.
    pub at: Nanos,
    /// Why.
    pub cause: Cause,
}

/// What a run has met.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Everything that is not modelled or not allowed, the [allow-list](ALLOWED) not yet taken away.
    pub violations: Vec<Violation>,
    /// Every restart of the part, in order.
    pub restarts: Vec<Restart>,
}

impl Report {
    /// What is not on the allow-list.
    ///
    /// # Errors
    ///
    /// When there is anything.
    pub fn check(&self) -> Result<(), Violations> {
        let bad: Vec<Violation> = self
            .violations
            .iter()
            .filter(|found| !allowed(found))
            .cloned()
            .collect();
        if bad.is_empty() { Ok(()) } else { Err(Violations(bad)) }
    }
}

fn allowed(found: &Violation) -> bool {
    match found {
        Violation::Unimplemented { instance, register, .. } => ALLOWED
            .iter()
            .any(|allowed| allowed.instance == *instance && allowed.register == *register),
        _ => false,
    }
}

/// A register that has no model and that the firmware may use all the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Allowed {
    /// The peripheral.
    pub instance: &'static str,
    /// The register.
    pub register: &'static str,
    /// Why nothing is lost.
    pub reason: &'static str,
}

/// The allow-list. Everything else that has no model fails a run.
pub const ALLOWED: [Allowed; 2] = [
    Allowed {
        instance: "PWR",
        register: "CR bit 15",
        reason: "reserved in the STM32F405; the HAL writes the two bits of VOS that the STM32F42x has there",
    },
    Allowed {
        instance: "RCC",
        register: "DCKCFGR",
        reason: "not in the STM32F405; the HAL writes the zeros to it that the STM32F42x has there at reset",
    },
];
