//! The report of a run: violations, crashes, resets.

use std::fmt;

use crate::time::Nanos;

/// The kind of a crash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crash {
    /// A panic.
    Panic,
    /// A hard fault.
    HardFault,
    /// An exception or interrupt without a handler.
    UnexpectedException,
    /// A fault for which no handler can be called: the core is locked up.
    Lockup,
    /// The firmware uses an unmodelled feature of the core.
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

/// The crash that is handled by a function of this name. The whole name must match for handlers: the linker may give other
/// symbols that contain it, for example an unused `_HardFault`, the address of a function that runs.
pub(crate) fn crash_of(name: &str) -> Option<Crash> {
    match name {
        "HardFault" => Some(Crash::HardFault),
        "DefaultHandler" => Some(Crash::UnexpectedException),
        _ if name.contains("rust_begin_unwind") => Some(Crash::Panic),
        _ => None,
    }
}

/// A violation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Violation {
    /// An access to a hole in the memory map.
    Unmapped {
        /// The address.
        address: u64,
        /// The first instruction with this access.
        program_counter: u64,
    },
    /// An access to a register of a peripheral without a model. The register stored writes, without further effect.
    Unimplemented {
        /// The peripheral.
        instance: &'static str,
        /// The register.
        register: &'static str,
        /// The first instruction with this access.
        program_counter: u64,
        /// Number of reads.
        reads: u64,
        /// Number of writes.
        writes: u64,
    },
    /// An access that a peripheral refused, for example because its clock is off.
    Refused {
        /// The address.
        address: u64,
        /// The reason.
        reason: String,
    },
    /// A state of a peripheral that the manual forbids.
    Forbidden {
        /// The peripheral.
        instance: &'static str,
        /// The register.
        register: &'static str,
        /// The forbidden state, and the section of the manual.
        reason: &'static str,
    },
    /// The firmware crashed.
    Crashed {
        /// The kind.
        crash: Crash,
        /// The time.
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
                    "access to unmapped address {address:#010x} by the instruction at {program_counter:#010x}"
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

/// The violations that fail a run: all that are not on the [allow-list](ALLOWED).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violations(pub Vec<Violation>);

impl fmt::Display for Violations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the firmware used features that the virtual board does not model")?;
        self.0.iter().try_for_each(|violation| write!(f, "\n  {violation}"))
    }
}

impl std::error::Error for Violations {}

/// The cause of a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// A request of the firmware.
    Software,
    /// The independent watchdog was not fed.
    Watchdog,
    /// Power-on.
    Power,
}

/// A restart of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Restart {
    /// The time.
    pub at: Nanos,
    /// The cause.
    pub cause: Cause,
}

/// The report of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// All violations, including those on the [allow-list](ALLOWED).
    pub violations: Vec<Violation>,
    /// Every restart of the chip, in order.
    pub restarts: Vec<Restart>,
}

impl Report {
    /// The violations that are not on the allow-list.
    ///
    /// # Errors
    ///
    /// If there are any.
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

/// A register without a model that the firmware may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Allowed {
    /// The peripheral.
    pub instance: &'static str,
    /// The register.
    pub register: &'static str,
    /// The reason why this is harmless.
    pub reason: &'static str,
}

/// The allow-list. Any other register without a model fails a run.
pub const ALLOWED: [Allowed; 3] = [
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
    Allowed {
        instance: "OTG_FS",
        register: "DIEPTSIZ0.MCNT",
        reason: "reserved for endpoint 0; the HAL writes the 1 to it that other endpoints have there",
    },
];
