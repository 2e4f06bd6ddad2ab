//! The result of a function.

use core::ffi::{CStr, c_char};

/// The result of a function. After an error nothing has changed.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireStatus {
    /// Done.
    Ok = 0,
    /// A pointer is NULL.
    Null,
    /// The header is of another version than the library. Only from `init`.
    Version,
    /// The client or device was not initialized.
    NotInitialized,
    /// The memory holds another client or device: of another protocol, or of the other side.
    WrongType,
    /// A request is in flight, or the rest of a cancelled one is still to be transmitted.
    Busy,
    /// The buffer is too short for the message.
    BufferTooShort,
    /// A value is out of its range. `fault` has the value and its range.
    OutOfRange,
    /// The protocol has no message of this kind.
    UnknownKind,
}

impl ArmwireStatus {
    const fn text(self) -> &'static CStr {
        match self {
            Self::Ok => c"done",
            Self::Null => c"a pointer is NULL",
            Self::Version => c"header and library are of different versions",
            Self::NotInitialized => c"the client or device was not initialized",
            Self::WrongType => c"the memory holds another client or device",
            Self::Busy => c"a request is already in flight",
            Self::BufferTooShort => c"the buffer is too short for the message",
            Self::OutOfRange => c"a value is out of its range",
            Self::UnknownKind => c"the protocol has no message of this kind",
        }
    }
}

impl From<Result<(), ArmwireStatus>> for ArmwireStatus {
    fn from(result: Result<(), ArmwireStatus>) -> Self {
        match result {
            Ok(()) => Self::Ok,
            Err(status) => status,
        }
    }
}

/// A status of any number, as C may pass one.
const ALL: [ArmwireStatus; 9] = [
    ArmwireStatus::Ok,
    ArmwireStatus::Null,
    ArmwireStatus::Version,
    ArmwireStatus::NotInitialized,
    ArmwireStatus::WrongType,
    ArmwireStatus::Busy,
    ArmwireStatus::BufferTooShort,
    ArmwireStatus::OutOfRange,
    ArmwireStatus::UnknownKind,
];

/// The text of an `ArmwireStatus`, in English. Never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_status_text(status: u32) -> *const c_char {
    let known = ALL.iter().find(|known| **known as u32 == status);
    known.map_or(c"unknown status", |known| known.text()).as_ptr()
}
