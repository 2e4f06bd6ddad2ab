//! Faults, moments, and recovery limits.

use armwire_virtual_board::Nanos;
use armwire_virtual_board::report::Cause;
use strum::{Display, VariantArray};

/// A fault. It is displayed as in the table.
#[derive(Clone, Copy, Debug, Display, PartialEq, Eq, VariantArray)]
#[allow(missing_docs, reason = "each has its description in the table")]
pub enum Fault {
    #[strum(to_string = "UART: a byte of an answer is lost")]
    ByteDropped,
    #[strum(to_string = "UART: a byte of an answer is duplicated")]
    ByteDuplicated,
    #[strum(to_string = "UART: a byte of an answer is 0.1 to 20 ms late")]
    ByteLate,
    #[strum(to_string = "UART: a bit of an answer is flipped")]
    ByteCorrupted,
    #[strum(to_string = "UART: a byte of a request is lost")]
    RequestByteDropped,
    #[strum(to_string = "UART: a bit of a request is flipped")]
    RequestByteCorrupted,
    #[strum(to_string = "UART: a framing error")]
    FramingError,
    #[strum(to_string = "UART: a noise error")]
    NoiseFlag,
    #[strum(to_string = "UART: a burst of 20 to 200 bytes of noise and errors")]
    NoiseBurst,
    #[strum(to_string = "UART: an overrun, because the DMA is late")]
    Overrun,
    #[strum(to_string = "UART: interrupts masked for 11 to 30 ms while the arm sends")]
    InterruptsMasked,
    #[strum(to_string = "UART: the cable unplugged for 1 to 60 ms")]
    ArmCablePulled,
    #[strum(to_string = "the arm restarts in the middle of an answer")]
    ArmReset,
    #[strum(to_string = "USB: 100 to 1000 NAKs in each direction")]
    NakStorm,
    #[strum(to_string = "USB: a bus reset")]
    BusReset,
    #[strum(to_string = "USB: suspended for 5 to 60 ms")]
    Suspend,
    #[strum(to_string = "USB: unplugged for 5 to 60 ms")]
    Unplug,
    #[strum(to_string = "USB: 1 to 5 control transfers abandoned after 0 to 400 µs")]
    ControlAbandoned,
    #[strum(to_string = "USB: a bus reset in the middle of a control transfer")]
    ResetInControl,
    #[strum(to_string = "USB: unplugged in the middle of a control transfer")]
    UnplugInControl,
    #[strum(to_string = "USB: CLEAR_FEATURE(HALT) in each direction, 1 to 4 times")]
    HaltCleared,
    #[strum(to_string = "USB: SET_INTERFACE, 1 to 4 times")]
    InterfaceSetAgain,
    #[strum(to_string = "USB: SET_CONFIGURATION again")]
    ConfigurationSetAgain,
    #[strum(to_string = "USB: a host that does not read for 100 to 200 ms and keeps sending requests")]
    NeverReads,
    #[strum(to_string = "USB: frames that fill 64-byte packets exactly")]
    FullPackets,
    #[strum(to_string = "CAN: a shorted bus for 1 to 30 ms, bus-off")]
    BusOff,
    #[strum(to_string = "CAN: 17 to 30 frames destroyed, error passive")]
    ErrorPassive,
    #[strum(to_string = "CAN: no acknowledge for 2 to 30 ms")]
    NoAcknowledge,
    #[strum(to_string = "CAN: another node floods the bus for 2 to 30 ms")]
    Flood,
    #[strum(to_string = "CAN: an ISO-TP frame out of sequence")]
    OutOfSequence,
    #[strum(to_string = "power lost while the configuration is written")]
    PowerLossInSave,
    #[strum(to_string = "memory corruption that makes the firmware panic")]
    Panic,
    #[strum(to_string = "the core stuck with interrupts masked, until the watchdog resets")]
    Watchdog,
}

/// The moment of a fault.
#[derive(Clone, Copy, Debug, Display, PartialEq, Eq, VariantArray)]
pub enum Moment {
    /// No request is open, and the line is idle.
    #[strum(to_string = "idle")]
    Idle,
    /// Bytes go to the arm.
    #[strum(to_string = "in a request")]
    Request,
    /// Bytes come from the arm.
    #[strum(to_string = "in an answer")]
    Answer,
    /// A request of several CAN frames is under way.
    #[strum(to_string = "in ISO-TP")]
    IsoTp,
    /// The host has a packet for the adapter on its way.
    #[strum(to_string = "in a USB packet")]
    UsbPacket,
    /// Any moment.
    #[strum(to_string = "any")]
    Any,
}

impl Fault {
    /// Time limit, from the end of the fault, for the next answer to each host and to the poll.
    ///
    /// An adapter gives up a request after at most 50 ms. Polls wait another 50 ms for late answers. A host of this
    /// campaign gives up after 150 ms. After a restart of the adapter or its USB, the host enumerates it and opens the
    /// port.
    pub const fn limit(self) -> Nanos {
        Nanos::from_millis(match self {
            Self::NakStorm => 50,
            // The fault's 64 requests are answered first.
            Self::FullPackets => 400,
            Self::NeverReads => 250,
            Self::BusReset | Self::Unplug | Self::Suspend => 250,
            Self::ResetInControl | Self::UnplugInControl | Self::ConfigurationSetAgain => 250,
            Self::PowerLossInSave | Self::Panic | Self::Watchdog => 400,
            _ => 200,
        })
    }

    /// The cause of the restart by the fault.
    pub const fn restart(self) -> Option<Cause> {
        match self {
            Self::PowerLossInSave => Some(Cause::Power),
            Self::Panic => Some(Cause::Software),
            Self::Watchdog => Some(Cause::Watchdog),
            _ => None,
        }
    }

    /// True if the fault loses nothing.
    pub const fn is_lossless(self) -> bool {
        matches!(
            self,
            Self::NakStorm
                | Self::FullPackets
                | Self::NoiseFlag
                | Self::ControlAbandoned
                | Self::HaltCleared
                | Self::InterfaceSetAgain
        )
    }

    /// True if the fault may follow another: it ends at once and leaves all hosts connected.
    pub const fn is_brief(self) -> bool {
        matches!(
            self,
            Self::ByteDropped
                | Self::ByteDuplicated
                | Self::ByteLate
                | Self::ByteCorrupted
                | Self::RequestByteDropped
                | Self::RequestByteCorrupted
                | Self::FramingError
                | Self::Overrun
                | Self::NakStorm
                | Self::ControlAbandoned
                | Self::HaltCleared
                | Self::InterfaceSetAgain
                | Self::ErrorPassive
                | Self::OutOfSequence
        )
    }
}
