//! Errors in bytes and values, with their offset.

use core::ffi::c_char;
use core::slice;

#[cfg(feature = "alpha1")]
use armwire::alpha1;
use armwire::framing::Reason;
#[cfg(feature = "xarm")]
use armwire::xarm;
use armwire::{Cause, MessageId, OutOfRange, ParseError};

use crate::memory;
use crate::text::Writer;

/// The kind of an `ArmwireFault`. The members that it sets are named in parentheses.
#[repr(u8)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireFaultCode {
    /// No error.
    None = 0,
    /// Noise: no frame starts here.
    Stray,
    /// Noise: the length field of a frame is out of range. (`got`, `min`, `max`)
    Length,
    /// Noise: a byte of a frame is not one of the allowed values. (`offset`, `got`, `expected_bytes`, `expected_len`)
    FrameByte,
    /// Noise: a checksum does not match. (`got`; `min` is the checksum of the received bytes)
    Checksum,
    /// Noise: a frame has no terminator. (`got`; `min` is the terminator)
    Tail,
    /// Noise: the line went idle before the end of a frame. (`got` is the number of missing bytes)
    Truncated,
    /// A request ended while it was partly transmitted, on TCP.
    Abandoned,
    /// The message is not documented.
    Unknown,
    /// A servo's answer without a pending request.
    Unexpected,
    /// A frame of the robot's Bluetooth protocol.
    Bluetooth,
    /// A command that starts the boot loader of a servo.
    BootLoader,
    /// A message has the wrong length. (`got`, `expected_lengths`, `expected_len`)
    DataLength,
    /// A data byte is not one of the allowed values. (`offset`, `got`, `expected_bytes`, `expected_len`)
    DataByte,
    /// A value in a message is out of its range. (`offset`, `got`, `min`, `max`, `what`, `unit`)
    DataValue,
    /// A value that was passed in is out of its range. (`got`, `min`, `max`, `what`, `unit`; `offset` is its index in
    /// an array, from 0)
    Value,
    /// An error without a code in this version.
    Other,
}

/// All codes: C may pass any number.
const CODES: [ArmwireFaultCode; 17] = [
    ArmwireFaultCode::None,
    ArmwireFaultCode::Stray,
    ArmwireFaultCode::Length,
    ArmwireFaultCode::FrameByte,
    ArmwireFaultCode::Checksum,
    ArmwireFaultCode::Tail,
    ArmwireFaultCode::Truncated,
    ArmwireFaultCode::Abandoned,
    ArmwireFaultCode::Unknown,
    ArmwireFaultCode::Unexpected,
    ArmwireFaultCode::Bluetooth,
    ArmwireFaultCode::BootLoader,
    ArmwireFaultCode::DataLength,
    ArmwireFaultCode::DataByte,
    ArmwireFaultCode::DataValue,
    ArmwireFaultCode::Value,
    ArmwireFaultCode::Other,
];

/// The message of a faulty frame.
#[repr(u8)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireMessageKind {
    /// None.
    None = 0,
    /// A command: `message_id`.
    Command,
    /// A command and its function: `message_id` and `message_function`.
    Function,
    /// A register: `message_id`.
    Register,
    /// Standard Modbus: the unit in `message_id`, and the function in `message_function`.
    Modbus,
}

/// An error in bytes or a value. `armwire_fault_text` writes it as text.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireFault {
    /// The kind: an `ArmwireFaultCode`.
    pub code: u8,
    /// The message of the frame: an `ArmwireMessageKind`.
    pub message: u8,
    /// Command, register or Modbus unit.
    pub message_id: u8,
    /// Function.
    pub message_function: u8,
    /// The offset in bytes: from the start of the frame for noise, from the start of the data for a message.
    pub offset: u32,
    /// The actual value, byte or length.
    pub got: i32,
    /// The minimum.
    pub min: i32,
    /// The maximum.
    pub max: i32,
    /// The allowed bytes.
    pub expected_bytes: *const u8,
    /// The allowed lengths.
    pub expected_lengths: *const usize,
    /// The number of allowed bytes or lengths.
    pub expected_len: usize,
    /// The name of the value, UTF-8, not terminated.
    pub what: *const u8,
    /// Length of `what` in bytes.
    pub what_len: usize,
    /// The unit of the value, UTF-8, not terminated.
    pub unit: *const u8,
    /// Length of `unit` in bytes.
    pub unit_len: usize,
}

/// A rejected value that C passed in, with its index in an array.
#[derive(Clone, Copy)]
pub(crate) struct Refused {
    index: usize,
    error: OutOfRange<i32>,
}

impl Refused {
    /// No value was rejected.
    pub(crate) const NONE: Self = Self::with(0, OutOfRange::new("", "", 0, 0, 0));

    const fn with(index: usize, error: OutOfRange<i32>) -> Self {
        Self { index, error }
    }

    /// The value at this index.
    pub(crate) fn at<T: Into<i32>>(index: usize) -> impl Fn(OutOfRange<T>) -> Self {
        move |error| {
            let (got, min, max) = (error.got.into(), error.min.into(), error.max.into());
            Self::with(index, OutOfRange::new(error.what, error.unit, got, min, max))
        }
    }

    /// A single value.
    pub(crate) fn only<T: Into<i32>>(error: OutOfRange<T>) -> Self {
        Self::at(0)(error)
    }

    /// A length.
    pub(crate) fn length(error: OutOfRange<usize>) -> Self {
        let [got, min, max] = [error.got, error.min, error.max].map(number);
        Self::with(0, OutOfRange::new(error.what, error.unit, got, min, max))
    }

    /// The fault for C.
    pub(crate) fn fault(&self) -> ArmwireFault {
        let mut fault = ArmwireFault::default();
        if !self.error.what.is_empty() {
            fault.code = ArmwireFaultCode::Value as u8;
            fault.set_range(self.index, self.error);
        }
        fault
    }
}

/// A length as a number, saturated.
fn number(length: usize) -> i32 {
    i32::try_from(length).unwrap_or(i32::MAX)
}

impl ArmwireFault {
    const fn set_bytes(&mut self, offset: usize, got: u8, expected: &'static [u8]) {
        (self.offset, self.got) = (offset as u32, got as i32);
        (self.expected_bytes, self.expected_len) = (expected.as_ptr(), expected.len());
    }

    fn set_range(&mut self, offset: usize, error: OutOfRange<i32>) {
        self.offset = offset as u32;
        (self.got, self.min, self.max) = (error.got, error.min, error.max);
        (self.what, self.what_len) = (error.what.as_ptr(), error.what.len());
        (self.unit, self.unit_len) = (error.unit.as_ptr(), error.unit.len());
    }

    /// Sets the reason of noise in an empty fault.
    pub(crate) fn set_noise(&mut self, reason: Reason) {
        let code = match reason {
            Reason::Stray => ArmwireFaultCode::Stray,
            Reason::Length { min, max, got } => {
                (self.got, self.min, self.max) = (got.into(), min.into(), max.into());
                ArmwireFaultCode::Length
            }
            Reason::Byte { offset, got, expected } => {
                self.set_bytes(offset.into(), got, expected);
                ArmwireFaultCode::FrameByte
            }
            Reason::Checksum { expected, got } => {
                (self.got, self.min) = (got.into(), expected.into());
                ArmwireFaultCode::Checksum
            }
            Reason::Tail { expected, got } => {
                (self.got, self.min) = (got.into(), expected.into());
                ArmwireFaultCode::Tail
            }
            Reason::Truncated { missing } => {
                self.got = number(missing);
                ArmwireFaultCode::Truncated
            }
            Reason::Abandoned => ArmwireFaultCode::Abandoned,
            _ => ArmwireFaultCode::Other,
        };
        self.code = code as u8;
    }

    /// Sets the error of a message in an empty fault.
    pub(crate) fn set_message(&mut self, error: ParseError) {
        let (message, id, function) = match error.message {
            MessageId::Command(command) => (ArmwireMessageKind::Command, command, 0),
            MessageId::Function { command, function } => (ArmwireMessageKind::Function, command, function),
            #[cfg(feature = "xarm")]
            MessageId::XArm(xarm::MessageId::Register(register)) => (ArmwireMessageKind::Register, register, 0),
            #[cfg(feature = "xarm")]
            MessageId::XArm(xarm::MessageId::Modbus { unit, function }) => (ArmwireMessageKind::Modbus, unit, function),
            _ => (ArmwireMessageKind::None, 0, 0),
        };
        (self.message, self.message_id, self.message_function) = (message as u8, id, function);
        let code = match error.cause {
            Cause::Unknown | Cause::ErrorFrame => ArmwireFaultCode::Unknown,
            #[cfg(feature = "alpha1")]
            Cause::Alpha1(alpha1::Cause::Unexpected) => ArmwireFaultCode::Unexpected,
            #[cfg(feature = "alpha1")]
            Cause::Alpha1(alpha1::Cause::Bluetooth) => ArmwireFaultCode::Bluetooth,
            #[cfg(feature = "alpha1")]
            Cause::Alpha1(alpha1::Cause::BootLoader) => ArmwireFaultCode::BootLoader,
            Cause::Length { expected, got } => {
                self.got = number(got);
                (self.expected_lengths, self.expected_len) = (expected.as_ptr(), expected.len());
                ArmwireFaultCode::DataLength
            }
            Cause::Byte { offset, expected, got } => {
                self.set_bytes(offset, got, expected);
                ArmwireFaultCode::DataByte
            }
            Cause::Value { offset, error } => {
                self.set_range(offset, error);
                ArmwireFaultCode::DataValue
            }
            _ => ArmwireFaultCode::Other,
        };
        self.code = code as u8;
    }

    /// The error of a message, without its cause.
    #[cfg(feature = "xarm")]
    pub(crate) fn parse_error(&self) -> Option<ParseError> {
        let kind = |kind: ArmwireMessageKind| self.message == kind as u8;
        let message = if kind(ArmwireMessageKind::Register) {
            xarm::MessageId::Register(self.message_id)
        } else if kind(ArmwireMessageKind::Modbus) {
            xarm::MessageId::Modbus {
                unit: self.message_id,
                function: self.message_function,
            }
        } else {
            return None;
        };
        let cause = Cause::Unknown;
        Some(ParseError {
            message: MessageId::XArm(message),
            cause,
        })
    }

    /// Writes the text of the Rust crate.
    ///
    /// # Safety
    ///
    /// The pointers were set by this library, or are NULL.
    unsafe fn write(&self, out: &mut Writer<'_>) {
        self.write_message(out);
        // SAFETY: guaranteed by the caller.
        let bytes = unsafe { list(self.expected_bytes, self.expected_len) };
        let (got, min, offset) = (self.got, self.min, i64::from(self.offset));
        match CODES.into_iter().find(|code| *code as u8 == self.code) {
            Some(ArmwireFaultCode::None) => out.text("no error"),
            Some(ArmwireFaultCode::Stray) => out.text("no frame starts here"),
            Some(ArmwireFaultCode::Length) => {
                out.text("length field is ").number(got);
                self.write_limits(out)
            }
            Some(ArmwireFaultCode::FrameByte) => {
                out.text("byte ")
                    .number(offset)
                    .text(" is 0x")
                    .hex_lower(got)
                    .text(", expected ");
                either(out, bytes, |out, byte| out.text("0x").hex_lower(byte))
            }
            Some(ArmwireFaultCode::Checksum) => out
                .text("checksum 0x")
                .hex_lower(got)
                .text(", expected 0x")
                .hex_lower(min),
            Some(ArmwireFaultCode::Tail) => out
                .text("end mark 0x")
                .hex_lower(got)
                .text(", expected 0x")
                .hex_lower(min),
            Some(ArmwireFaultCode::Truncated) => out.text("line went idle with ").number(got).text(" bytes missing"),
            Some(ArmwireFaultCode::Abandoned) => out.text("a request ended while it was partly transmitted"),
            Some(ArmwireFaultCode::Unknown) => out.text("unknown"),
            Some(ArmwireFaultCode::Unexpected) => out.text("an answer of a servo, but none is expected"),
            Some(ArmwireFaultCode::Bluetooth) => out.text("a frame of the robot's Bluetooth protocol"),
            Some(ArmwireFaultCode::BootLoader) => {
                out.text("it would start a servo's boot loader, which is not offered")
            }
            Some(ArmwireFaultCode::DataLength) => {
                out.number(got).text(" data bytes, expected ");
                // SAFETY: guaranteed by the caller.
                let lengths = unsafe { list(self.expected_lengths, self.expected_len) };
                either(out, lengths, |out, len| out.number(len as i64))
            }
            Some(ArmwireFaultCode::DataByte) => {
                out.text("data byte ")
                    .number(offset)
                    .text(" is ")
                    .hex_upper(got)
                    .text(", must be ");
                either(out, bytes, |out, byte| out.hex_upper(byte))
            }
            Some(ArmwireFaultCode::DataValue) => {
                // SAFETY: guaranteed by the caller.
                unsafe { self.write_value(out) };
                out.text(" (data byte ").number(offset).text(")")
            }
            // SAFETY: guaranteed by the caller.
            Some(ArmwireFaultCode::Value) => unsafe { self.write_value(out) },
            Some(ArmwireFaultCode::Other) | None => out.text("an error of another version"),
        };
    }

    fn write_message(&self, out: &mut Writer<'_>) {
        let kind = |kind: ArmwireMessageKind| self.message == kind as u8;
        let (id, function) = (self.message_id, self.message_function);
        if kind(ArmwireMessageKind::Command) {
            out.text("command ").hex_upper(id);
        } else if kind(ArmwireMessageKind::Function) {
            out.text("command ")
                .hex_upper(id)
                .text(" function ")
                .hex_upper(function);
        } else if kind(ArmwireMessageKind::Register) {
            out.text("register ").number(id);
        } else if kind(ArmwireMessageKind::Modbus) {
            out.text("standard Modbus, unit ")
                .number(id)
                .text(", function ")
                .number(function);
        } else {
            return;
        }
        out.text(": ");
    }

    /// # Safety
    ///
    /// The pointers were set by this library, or are NULL.
    unsafe fn write_value<'w, 'a>(&self, out: &'w mut Writer<'a>) -> &'w mut Writer<'a> {
        // SAFETY: guaranteed by the caller.
        let (what, unit) = unsafe { (list(self.what, self.what_len), list(self.unit, self.unit_len)) };
        let space = if unit.is_empty() { "" } else { " " };
        out.bytes(what).text(" is ").number(self.got).text(space).bytes(unit);
        self.write_limits(out)
    }

    fn write_limits<'w, 'a>(&self, out: &'w mut Writer<'a>) -> &'w mut Writer<'a> {
        out.text(", must be ").number(self.min).text("..=").number(self.max)
    }
}

/// Choices as `a or b or c`.
fn either<'w, 'a, T: Copy>(
    out: &'w mut Writer<'a>,
    choices: &[T],
    write: for<'c> fn(&'c mut Writer<'a>, T) -> &'c mut Writer<'a>,
) -> &'w mut Writer<'a> {
    for (i, choice) in choices.iter().enumerate() {
        out.text(if i == 0 { "" } else { " or " });
        write(out, *choice);
    }
    out
}

/// # Safety
///
/// `list` is NULL, or has `len` values that never change.
unsafe fn list<T>(list: *const T, len: usize) -> &'static [T] {
    match list.is_null() {
        true => &[],
        // SAFETY: guaranteed by the caller.
        false => unsafe { slice::from_raw_parts(list, len) },
    }
}

/// Writes the text of a fault to `out`, terminated by NUL, and returns its length without the NUL. The text is
/// truncated if its length is not less than `size`. 128 bytes hold every text.
///
/// # Safety
///
/// `fault` was written by this library, or is all zero. `out` is NULL, or has `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_fault_text(fault: Option<&ArmwireFault>, out: *mut c_char, size: usize) -> usize {
    // SAFETY: guaranteed by the caller.
    let Ok(room) = (unsafe { memory::room(out.cast(), size) }) else {
        return 0;
    };
    let mut writer = Writer::new(room);
    if let Some(fault) = fault {
        // SAFETY: guaranteed by the caller.
        unsafe { fault.write(&mut writer) };
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::{String, ToString};
    use std::vec;

    use super::*;

    fn text(fault: &ArmwireFault) -> String {
        let mut out = [0; 256];
        // SAFETY: the fault was written by the library, and `out` has this many bytes.
        let len = unsafe { armwire_fault_text(Some(fault), out.as_mut_ptr(), out.len()) };
        let bytes = out[..len].iter().map(|byte| *byte as u8).collect();
        assert_eq!(out[len], 0);
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn noise_has_the_text_of_the_rust_crate() {
        let reasons = [
            Reason::Stray,
            Reason::Length {
                min: 1,
                max: 64,
                got: 65535,
            },
            Reason::Byte {
                offset: 3,
                got: 0xAB,
                expected: &[0x0C, 0xEE],
            },
            Reason::Checksum {
                expected: 0x5F,
                got: 0x0A,
            },
            Reason::Tail { expected: 0xFF, got: 0 },
            Reason::Truncated { missing: 10 },
            Reason::Abandoned,
        ];
        for reason in reasons {
            let mut fault = ArmwireFault::default();
            fault.set_noise(reason);
            assert_eq!(text(&fault), reason.to_string());
        }
    }

    #[test]
    fn messages_have_the_text_of_the_rust_crate() {
        let messages = vec![
            MessageId::Command(0xFA),
            MessageId::Function {
                command: 6,
                function: 0x0E,
            },
            #[cfg(feature = "xarm")]
            MessageId::XArm(xarm::MessageId::Register(10)),
            #[cfg(feature = "xarm")]
            MessageId::XArm(xarm::MessageId::Modbus { unit: 1, function: 127 }),
        ];
        let causes = vec![
            Cause::Unknown,
            #[cfg(feature = "alpha1")]
            Cause::Alpha1(alpha1::Cause::Unexpected),
            #[cfg(feature = "alpha1")]
            Cause::Alpha1(alpha1::Cause::Bluetooth),
            #[cfg(feature = "alpha1")]
            Cause::Alpha1(alpha1::Cause::BootLoader),
            Cause::Length {
                expected: &[6, 10],
                got: 3,
            },
            Cause::Byte {
                offset: 1,
                expected: &[1, 2, 4, 0xCD, 0xD2, 0xD4],
                got: 0xEF,
            },
            Cause::Value {
                offset: 4,
                error: OutOfRange::new("servo offset", "thirds of a degree", -91, -90, 90),
            },
            Cause::Value {
                offset: 0,
                error: OutOfRange::new("joint", "", 8, 1, 7),
            },
        ];
        for message in messages {
            for cause in &causes {
                let error = ParseError { message, cause: *cause };
                let mut fault = ArmwireFault::default();
                fault.set_message(error);
                assert_eq!(text(&fault), error.to_string());
            }
        }
    }

    #[test]
    fn rejected_values_have_the_rust_crates_texts() {
        for got in [i32::MIN, -1, 0, 9, 10, 4096, i32::MAX] {
            let error = OutOfRange::new("joint position", "ticks", got, 0, 4095);
            assert_eq!(text(&Refused::only(error).fault()), error.to_string());
        }
        assert_eq!(text(&Refused::NONE.fault()), "no error");
    }
}
