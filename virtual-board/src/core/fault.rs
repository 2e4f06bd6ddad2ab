//! Reasons that stop an instruction: faults and their status bits (ARM DDI 0403E, B1.5.14, B3.2.15), exception returns,
//! refusals.

/// Numbers of the system exceptions (B1.5.2).
pub(super) mod exception {
    pub(in super::super) const NMI: u16 = 2;
    pub(in super::super) const HARD_FAULT: u16 = 3;
    pub(in super::super) const MEM_MANAGE: u16 = 4;
    pub(in super::super) const BUS_FAULT: u16 = 5;
    pub(in super::super) const USAGE_FAULT: u16 = 6;
    pub(in super::super) const SV_CALL: u16 = 11;
    pub(in super::super) const DEBUG_MONITOR: u16 = 12;
    pub(in super::super) const PEND_SV: u16 = 14;
    pub(in super::super) const SYS_TICK: u16 = 15;
    /// The first external interrupt.
    pub(in super::super) const INTERRUPT_0: u16 = 16;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// The instruction is UNDEFINED.
    Undefined,
    /// The T bit of the EPSR is clear.
    InvalidState,
    /// An exception return with a wrong EXC_RETURN or a wrong stack frame.
    InvalidReturn,
    /// A coprocessor instruction without a coprocessor.
    NoCoprocessor,
    /// An unaligned access where alignment is required, always or by CCR.UNALIGN_TRP.
    Unaligned,
    /// A division by zero, with CCR.DIV_0_TRP.
    DivideByZero,
    /// A load or store with a bus error at this address.
    DataBus(u32),
    /// An instruction fetch with a bus error.
    FetchBus,
    /// A bus error during exception entry.
    StackBus,
    /// A bus error during exception return.
    UnstackBus,
    /// A load or store that the MPU does not permit.
    DataProtection(u32),
    /// An instruction fetch that the MPU or the memory map does not permit.
    FetchProtection,
    /// An MPU violation during exception entry.
    StackProtection,
    /// An MPU violation during exception return.
    UnstackProtection,
    /// A bus error at the vector table.
    Vector,
    /// BKPT without a debugger.
    Breakpoint,
}

impl Fault {
    /// The exception to take if it is enabled and its priority suffices.
    pub(super) fn exception(self) -> u16 {
        match self {
            Self::Undefined
            | Self::InvalidState
            | Self::InvalidReturn
            | Self::NoCoprocessor
            | Self::Unaligned
            | Self::DivideByZero => exception::USAGE_FAULT,
            Self::DataBus(_) | Self::FetchBus | Self::StackBus | Self::UnstackBus => exception::BUS_FAULT,
            Self::DataProtection(_) | Self::FetchProtection | Self::StackProtection | Self::UnstackProtection => {
                exception::MEM_MANAGE
            }
            Self::Vector | Self::Breakpoint => exception::HARD_FAULT,
        }
    }

    /// The bits to set in the CFSR (B3.2.15).
    pub(super) fn cfsr(self) -> u32 {
        match self {
            Self::FetchProtection => 1,
            Self::DataProtection(_) => 1 << 7 | 1 << 1,
            Self::UnstackProtection => 1 << 3,
            Self::StackProtection => 1 << 4,
            Self::FetchBus => 1 << 8,
            Self::DataBus(_) => 1 << 15 | 1 << 9,
            Self::UnstackBus => 1 << 11,
            Self::StackBus => 1 << 12,
            Self::Undefined => 1 << 16,
            Self::InvalidState => 1 << 17,
            Self::InvalidReturn => 1 << 18,
            Self::NoCoprocessor => 1 << 19,
            Self::Unaligned => 1 << 24,
            Self::DivideByZero => 1 << 25,
            Self::Vector | Self::Breakpoint => 0,
        }
    }

    /// The bits to set in the HFSR (B3.2.16), apart from FORCED.
    pub(super) fn hfsr(self) -> u32 {
        match self {
            Self::Vector => 1 << 1,
            Self::Breakpoint => 1 << 31,
            _ => 0,
        }
    }
}

/// The reason why an instruction did not complete normally.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Trap {
    /// It had no effect, and a fault must be taken.
    Fault(Fault),
    /// It has loaded this EXC_RETURN value into the program counter.
    ExceptionReturn(u32),
    /// It was SVC.
    SupervisorCall,
    /// It had no effect: the core does not support it.
    Refused(Refusal),
}

impl From<Fault> for Trap {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<Refusal> for Trap {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

/// An unsupported feature. A run that needs it cannot continue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// An instruction of the floating-point extension, by its mnemonic.
    FloatingPoint(&'static str),
    /// An encoding that the manual calls UNPREDICTABLE.
    Unpredictable,
    /// A register of the private peripheral bus, by its address.
    SystemRegister(u32),
    /// A function of the core, by its name.
    Function(&'static str),
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::FloatingPoint(mnemonic) => write!(f, "floating-point instruction {mnemonic}"),
            Self::Unpredictable => write!(f, "UNPREDICTABLE instruction"),
            Self::SystemRegister(address) => write!(f, "system register {address:#010x}"),
            Self::Function(name) => write!(f, "{name}"),
        }
    }
}
