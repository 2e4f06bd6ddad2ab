//! Text for C, without `core::fmt`, which has paths to a panic.

use core::ffi::c_char;

use crate::memory;

/// Writes text to the front of a buffer, and counts the bytes that do not fit.
pub(crate) struct Writer<'a> {
    room: &'a mut [u8],
    len: usize,
}

impl<'a> Writer<'a> {
    pub(crate) const fn new(room: &'a mut [u8]) -> Self {
        Self { room, len: 0 }
    }

    fn byte(&mut self, byte: u8) {
        if let Some(to) = self.room.get_mut(self.len) {
            *to = byte;
        }
        self.len = self.len.saturating_add(1);
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        for byte in bytes {
            self.byte(*byte);
        }
        self
    }

    pub(crate) fn text(&mut self, text: &str) -> &mut Self {
        self.bytes(text.as_bytes())
    }

    /// A decimal number.
    pub(crate) fn number(&mut self, number: impl Into<i64>) -> &mut Self {
        let number = number.into();
        if number < 0 {
            self.byte(b'-');
        }
        let mut rest = number.unsigned_abs();
        let mut digits = [0; 20];
        let mut first = digits.len();
        for (place, digit) in digits.iter_mut().enumerate().rev() {
            *digit = b'0'.wrapping_add((rest % 10) as u8);
            rest /= 10;
            first = place;
            if rest == 0 {
                break;
            }
        }
        self.bytes(digits.get(first..).unwrap_or_default())
    }

    /// The last two digits of a hexadecimal number.
    pub(crate) fn hex_upper(&mut self, number: impl Into<i64>) -> &mut Self {
        self.hex(number.into() as u8, b'A')
    }

    /// The last two digits of a hexadecimal number.
    pub(crate) fn hex_lower(&mut self, number: impl Into<i64>) -> &mut Self {
        self.hex(number.into() as u8, b'a')
    }

    fn hex(&mut self, byte: u8, ten: u8) -> &mut Self {
        for digit in [byte >> 4, byte & 0xF] {
            self.byte(match digit {
                0..10 => b'0' + digit,
                _ => ten + (digit - 10),
            });
        }
        self
    }

    /// Bytes from outside. All bytes except printable ASCII, and the backslash, are escaped.
    fn escaped(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            match byte {
                b'\\' => drop(self.text("\\\\")),
                b' '..=b'~' => self.byte(byte),
                _ => drop(self.text("\\x").hex_lower(byte)),
            }
        }
    }

    /// Terminates the text with NUL and returns the length of the whole text.
    pub(crate) fn finish(self) -> usize {
        let last = self.room.len().saturating_sub(1);
        if let Some(end) = self.room.get_mut(self.len.min(last)) {
            *end = 0;
        }
        self.len
    }
}

/// Writes bytes from outside to `out` as printable text, terminated by NUL. A byte that is not printable ASCII becomes
/// a backslash, an x and two digits; a backslash becomes two. Returns the length without the NUL. The text is truncated
/// if its length is not less than `size`.
///
/// # Safety
///
/// `bytes` is NULL, or has `len` bytes; `out` is NULL, or has `size` bytes. The two do not overlap.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_printable(bytes: *const u8, len: usize, out: *mut c_char, size: usize) -> usize {
    // SAFETY: guaranteed by the caller.
    let (bytes, room) = unsafe { (memory::bytes(bytes, len), memory::room(out.cast(), size)) };
    let (Ok(bytes), Ok(room)) = (bytes, room) else {
        return 0;
    };
    let mut writer = Writer::new(room);
    writer.escaped(bytes);
    writer.finish()
}
