//! Bytes in hexadecimal, as text.

#[cfg(test)]
extern crate std;

use core::fmt;

/// Bytes as `AA 06 00`.
///
/// ```
/// assert_eq!(armwire::text::Hex(&[0xAA, 0x06, 0x00]).to_string(), "AA 06 00");
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Hex<'a>(pub &'a [u8]);

impl fmt::Display for Hex<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, byte) in self.0.iter().enumerate() {
            write!(f, "{}{byte:02X}", if i == 0 { "" } else { " " })?;
        }
        Ok(())
    }
}

/// The bytes of a text in hexadecimal.
#[cfg(all(test, any(feature = "ling", feature = "xarm", feature = "alpha1")))]
pub(crate) fn hex(text: &str) -> std::vec::Vec<u8> {
    text.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}
