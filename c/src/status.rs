//! The result of a function.

use core::ffi::{CStr, c_char};

/// The result of a function. An error changes nothing.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireStatus {
    /// Success.
    Ok = 0,
    /// A pointer is NULL.
    Null,
    /// The header and the library have different versions. Only from `init`.
    Version,
    /// The client or device was not initialized.
    NotInitialized,
    /// The memory contains another type: of another protocol, or a device instead of a client.
    WrongType,
    /// A request is in flight, or a cancelled request is still being transmitted.
    Busy,
    /// The buffer is too short for the message.
    BufferTooShort,
    /// A value is out of its range. `fault` returns the value and its range.
    OutOfRange,
    /// The protocol has no message of this kind.
    UnknownKind,
}

impl ArmwireStatus {
    const fn text(self) -> &'static CStr {
        match self {
            Self::Ok => c"success",
            Self::Null => c"a pointer is NULL",
            Self::Version => c"the header and the library have different versions",
            Self::NotInitialized => c"the client or device was not initialized",
            Self::WrongType => c"the memory contains another client or device",
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

/// All statuses: C may pass any number.
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
