//! Faults, moments, and recovery limits.

use armwire_virtual_board::Nanos;

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs, reason = "they have names, which are in the table")]
pub enum Fault {
    ByteDropped,
    ByteDuplicated,
    ByteLate,
    ByteCorrupted,
    RequestByteDropped,
    RequestByteCorrupted,
    FramingError,
    NoiseFlag,
    NoiseBurst,
    Overrun,
    InterruptsMasked,
    ArmCablePulled,
    ArmReset,
    NakStorm,
    BusReset,
    Suspend,
    Unplug,
    ControlAbandoned,
    ResetInControl,
    UnplugInControl,
    HaltCleared,
    InterfaceSetAgain,
    ConfigurationSetAgain,
    NeverReads,
    FullPackets,
    BusOff,
    ErrorPassive,
    NoAcknowledge,
    Flood,
    OutOfSequence,
    PowerLossInSave,
    Panic,
    Watchdog,
}

/// The moment of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Moment {
    /// No request is open, and the line is idle.
    Idle,
    /// Bytes go to the arm.
    Request,
    /// Bytes come from the arm.
    Answer,
    /// A request of several CAN frames is under way.
    IsoTp,
    /// The host has a packet for the adapter on its way.
    UsbPacket,
    /// Any moment.
    Any,
}

impl Moment {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Idle,
        Self::Request,
        Self::Answer,
        Self::IsoTp,
        Self::UsbPacket,
        Self::Any,
    ];

    /// The name in the table.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Request => "in a request",
            Self::Answer => "in an answer",
            Self::IsoTp => "in ISO-TP",
            Self::UsbPacket => "in a USB packet",
            Self::Any => "any",
        }
    }
}

/// Restart of the board by a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restart {
    /// Power was lost and came back.
    Power,
    /// The firmware panicked.
    Panic,
    /// The watchdog was not fed.
    Watchdog,
}

impl Fault {
    /// All of them, as in the table.
    pub const ALL: [Self; 33] = [
        Self::ByteDropped,
        Self::ByteDuplicated,
        Self::ByteLate,
        Self::ByteCorrupted,
        Self::RequestByteDropped,
        Self::RequestByteCorrupted,
        Self::FramingError,
        Self::NoiseFlag,
        Self::NoiseBurst,
        Self::Overrun,
        Self::InterruptsMasked,
        Self::ArmCablePulled,
        Self::ArmReset,
        Self::NakStorm,
        Self::BusReset,
        Self::Suspend,
        Self::Unplug,
        Self::ControlAbandoned,
        Self::ResetInControl,
        Self::UnplugInControl,
        Self::HaltCleared,
        Self::InterfaceSetAgain,
        Self::ConfigurationSetAgain,
        Self::NeverReads,
        Self::FullPackets,
        Self::BusOff,
        Self::ErrorPassive,
        Self::NoAcknowledge,
        Self::Flood,
        Self::OutOfSequence,
        Self::PowerLossInSave,
        Self::Panic,
        Self::Watchdog,
    ];

    /// The description in the table.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ByteDropped => "UART: a byte of an answer is lost",
            Self::ByteDuplicated => "UART: a byte of an answer is duplicated",
            Self::ByteLate => "UART: a byte of an answer is 0.1 to 20 ms late",
            Self::ByteCorrupted => "UART: a bit of an answer is flipped",
            Self::RequestByteDropped => "UART: a byte of a request is lost",
            Self::RequestByteCorrupted => "UART: a bit of a request is flipped",
            Self::FramingError => "UART: a framing error",
            Self::NoiseFlag => "UART: a noise error",
            Self::NoiseBurst => "UART: a burst of 20 to 200 bytes of noise and errors",
            Self::Overrun => "UART: an overrun, because the DMA is late",
            Self::InterruptsMasked => "UART: interrupts masked for 11 to 30 ms while the arm sends",
            Self::ArmCablePulled => "UART: the cable unplugged for 1 to 60 ms",
            Self::ArmReset => "the arm restarts in the middle of an answer",
            Self::NakStorm => "USB: 100 to 1000 NAKs in each direction",
            Self::BusReset => "USB: a bus reset",
            Self::Suspend => "USB: suspended for 5 to 60 ms",
            Self::Unplug => "USB: unplugged for 5 to 60 ms",
            Self::ControlAbandoned => "USB: 1 to 5 control transfers abandoned after 0 to 400 µs",
            Self::ResetInControl => "USB: a bus reset in the middle of a control transfer",
            Self::UnplugInControl => "USB: unplugged in the middle of a control transfer",
            Self::HaltCleared => "USB: CLEAR_FEATURE(HALT) in each direction, 1 to 4 times",
            Self::InterfaceSetAgain => "USB: SET_INTERFACE, 1 to 4 times",
            Self::ConfigurationSetAgain => "USB: SET_CONFIGURATION again",
            Self::NeverReads => "USB: a host that does not read for 100 to 200 ms and keeps sending requests",
            Self::FullPackets => "USB: frames that fill 64-byte packets exactly",
            Self::BusOff => "CAN: a shorted bus for 1 to 30 ms, bus-off",
            Self::ErrorPassive => "CAN: 17 to 30 frames destroyed, error passive",
            Self::NoAcknowledge => "CAN: no acknowledge for 2 to 30 ms",
            Self::Flood => "CAN: another node floods the bus for 2 to 30 ms",
            Self::OutOfSequence => "CAN: an ISO-TP frame out of sequence",
            Self::PowerLossInSave => "power lost while the configuration is written",
            Self::Panic => "memory corruption that makes the firmware panic",
            Self::Watchdog => "the core stuck with interrupts masked, until the watchdog resets",
        }
    }

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

    /// The restart that the fault causes.
    pub const fn restart(self) -> Option<Restart> {
        match self {
            Self::PowerLossInSave => Some(Restart::Power),
            Self::Panic => Some(Restart::Panic),
            Self::Watchdog => Some(Restart::Watchdog),
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
