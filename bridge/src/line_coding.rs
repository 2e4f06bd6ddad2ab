//! A USB host's line coding (CDC PSTN 1.2, section 6.3.11), within the limits of the UART.

use core::fmt;

use serde::{Deserialize, Serialize};

use armwire::time::Duration;

/// The slowest line, in baud.
pub const MIN_BAUD: u32 = 1_200;

/// The fastest line, in baud.
pub const MAX_BAUD: u32 = 2_000_000;

/// Data bits of every byte. No arm uses another number.
const DATA_BITS: u8 = 8;

/// The line coding, always with 8 data bits.
///
/// ```
/// use armwire_bridge::LineCoding;
///
/// let coding = LineCoding::from_cdc([0x00, 0xC2, 0x01, 0x00, 0, 0, 8]).unwrap();
/// assert_eq!(coding, LineCoding { baud: 115_200, ..LineCoding::default() });
/// assert_eq!(coding.to_cdc(), [0x00, 0xC2, 0x01, 0x00, 0, 0, 8]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LineCoding {
    /// Bits per second, [`MIN_BAUD`] to [`MAX_BAUD`].
    pub baud: u32,
    /// The parity bit.
    pub parity: Parity,
    /// Stop bits.
    pub stop_bits: StopBits,
}

/// The UART's configuration: line coding and wiring.
///
/// ```
/// use armwire_bridge::{LineCoding, UartConfig};
///
/// // It starts as a Ling arm's.
/// assert_eq!(UartConfig::default(), UartConfig { coding: LineCoding::LING, half_duplex: false });
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct UartConfig {
    /// The line coding.
    pub coding: LineCoding,
    /// True if both directions share one wire. Transmitted bytes must then not be received.
    pub half_duplex: bool,
}

/// The parity bit after the data bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Parity {
    /// No parity bit.
    None,
    /// An odd number of ones, including the parity bit.
    Odd,
    /// An even number of ones, including the parity bit.
    Even,
}

/// Stop bits after each byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StopBits {
    /// One stop bit.
    One,
    /// Two stop bits.
    Two,
}

/// The reason for a refused line coding. The previous one stays in effect.
///
/// ```
/// use armwire_bridge::{LineCoding, UnsupportedCoding};
///
/// assert_eq!(LineCoding::from_cdc([0xC0, 0xC6, 0x2D, 0x00, 0, 0, 8]), Err(UnsupportedCoding::Baud(3_000_000)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum UnsupportedCoding {
    /// A baud rate outside [`MIN_BAUD`] to [`MAX_BAUD`].
    Baud(u32),
    /// Data bits other than 8.
    DataBits(u8),
    /// A parity other than none, odd and even, as CDC numbers them.
    Parity(u8),
    /// Stop bits other than one and two, as CDC numbers them.
    StopBits(u8),
}

impl LineCoding {
    /// The Ling arm's line: 1 Mbaud, 8 data bits, no parity, one stop bit.
    pub const LING: Self = Self {
        baud: 1_000_000,
        parity: Parity::None,
        stop_bits: StopBits::One,
    };

    /// Decodes the data of SET_LINE_CODING.
    ///
    /// # Errors
    ///
    /// [`UnsupportedCoding`] names the first field that the UART does not support.
    pub fn from_cdc(bytes: [u8; 7]) -> Result<Self, UnsupportedCoding> {
        let [b0, b1, b2, b3, stop_bits, parity, data_bits] = bytes;
        let baud = u32::from_le_bytes([b0, b1, b2, b3]);
        if !(MIN_BAUD..=MAX_BAUD).contains(&baud) {
            return Err(UnsupportedCoding::Baud(baud));
        }
        let stop_bits = match stop_bits {
            0 => StopBits::One,
            2 => StopBits::Two,
            other => return Err(UnsupportedCoding::StopBits(other)),
        };
        let parity = match parity {
            0 => Parity::None,
            1 => Parity::Odd,
            2 => Parity::Even,
            other => return Err(UnsupportedCoding::Parity(other)),
        };
        if data_bits != DATA_BITS {
            return Err(UnsupportedCoding::DataBits(data_bits));
        }
        Ok(Self {
            baud,
            parity,
            stop_bits,
        })
    }

    /// Encodes the data of GET_LINE_CODING.
    pub const fn to_cdc(self) -> [u8; 7] {
        let [b0, b1, b2, b3] = self.baud.to_le_bytes();
        let stop_bits = match self.stop_bits {
            StopBits::One => 0,
            StopBits::Two => 2,
        };
        let parity = match self.parity {
            Parity::None => 0,
            Parity::Odd => 1,
            Parity::Even => 2,
        };
        [b0, b1, b2, b3, stop_bits, parity, DATA_BITS]
    }

    /// The duration of up to 300 000 bytes on the line without a gap, in whole microseconds, rounded down.
    ///
    /// ```
    /// assert_eq!(armwire_bridge::LineCoding::default().micros(21), 210);
    /// ```
    pub fn micros(self, bytes: usize) -> u64 {
        let bits = self.bits(bytes);
        // Three decimal digits at a time: the core divides no more than 32 bits.
        let bits = bits.saturating_mul(1_000);
        let millis = bits.checked_div(self.baud).unwrap_or(0);
        let rest = bits.checked_rem(self.baud).unwrap_or(0);
        let micros = rest.saturating_mul(1_000).checked_div(self.baud).unwrap_or(0);
        Duration::from_millis(millis.into())
            .as_micros()
            .saturating_add(micros.into())
    }

    /// The duration of a byte on the line, in nanoseconds, rounded down.
    pub(crate) fn nanos_a_byte(self) -> u32 {
        let hundreds = self.bits(1).saturating_mul(100_000_000).checked_div(self.baud);
        hundreds.unwrap_or(0).saturating_mul(10)
    }

    fn bits(self, bytes: usize) -> u32 {
        let parity = u32::from(self.parity != Parity::None);
        let stop = 1 + u32::from(self.stop_bits == StopBits::Two);
        (bytes as u32).saturating_mul(1 + u32::from(DATA_BITS) + parity + stop)
    }
}

/// [`LineCoding::LING`].
impl Default for LineCoding {
    fn default() -> Self {
        Self::LING
    }
}

impl fmt::Display for UnsupportedCoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Baud(got) => write!(f, "{got} baud, the UART supports {MIN_BAUD} to {MAX_BAUD}"),
            Self::DataBits(got) => write!(f, "{got} data bits, the UART supports {DATA_BITS}"),
            Self::Parity(got) => write!(f, "parity {got}, the UART supports none (0), odd (1) and even (2)"),
            Self::StopBits(got) => write!(f, "stop bits {got}, the UART supports one (0) and two (2)"),
        }
    }
}

impl core::error::Error for UnsupportedCoding {}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    fn coding(baud: u32, stop_bits: u8, parity: u8, data_bits: u8) -> Result<LineCoding, UnsupportedCoding> {
        let [b0, b1, b2, b3] = baud.to_le_bytes();
        LineCoding::from_cdc([b0, b1, b2, b3, stop_bits, parity, data_bits])
    }

    #[test]
    fn supported_coding_is_accepted_and_reads_back() {
        for baud in [1_200, 9_600, 115_200, 1_000_000, 2_000_000] {
            for stop_bits in [0, 2] {
                for parity in [0, 1, 2] {
                    let accepted = coding(baud, stop_bits, parity, 8).unwrap();
                    assert_eq!(LineCoding::from_cdc(accepted.to_cdc()), Ok(accepted));
                    assert_eq!(accepted.to_cdc()[4..], [stop_bits, parity, 8]);
                }
            }
        }
    }

    #[test]
    fn byte_time_is_accurate_within_a_frame() {
        for baud in [MIN_BAUD, 9_600, 115_200, 1_000_000, MAX_BAUD] {
            for (stop_bits, parity) in [(0, 0), (2, 1)] {
                let coding = coding(baud, stop_bits, parity, 8).unwrap();
                for bytes in [1, 21, 70] {
                    let micros = u64::from(bytes as u32 * coding.nanos_a_byte() / 1_000);
                    assert!(
                        coding.micros(bytes).abs_diff(micros) <= 3,
                        "{bytes} at {baud}: {micros}"
                    );
                }
            }
        }
    }

    #[test]
    fn unsupported_coding_is_refused_with_reason() {
        assert_eq!(coding(0, 0, 0, 8), Err(UnsupportedCoding::Baud(0)));
        assert_eq!(
            coding(MIN_BAUD - 1, 0, 0, 8),
            Err(UnsupportedCoding::Baud(MIN_BAUD - 1))
        );
        assert_eq!(
            coding(MAX_BAUD + 1, 0, 0, 8),
            Err(UnsupportedCoding::Baud(MAX_BAUD + 1))
        );
        assert_eq!(coding(9_600, 1, 0, 8), Err(UnsupportedCoding::StopBits(1)));
        assert_eq!(coding(9_600, 0, 3, 8), Err(UnsupportedCoding::Parity(3)));
        assert_eq!(coding(9_600, 0, 2, 7), Err(UnsupportedCoding::DataBits(7)));
        assert_eq!(coding(9_600, 0, 0, 9), Err(UnsupportedCoding::DataBits(9)));
        assert_eq!(
            coding(3_000_000, 0, 0, 8).unwrap_err().to_string(),
            "3000000 baud, the UART supports 1200 to 2000000"
        );
    }

    #[test]
    fn line_time_counts_start_parity_and_stop_bits() {
        assert_eq!(coding(115_200, 0, 0, 8).unwrap().micros(100), 8_680);
        assert_eq!(coding(1_000_000, 2, 2, 8).unwrap().micros(10), 120);
        assert_eq!(coding(2_000_000, 0, 0, 8).unwrap().micros(1), 5);
        assert_eq!(coding(MAX_BAUD - 1, 2, 1, 8).unwrap().micros(300_000), 1_800_000);
        assert_eq!(coding(MIN_BAUD + 1, 2, 1, 8).unwrap().micros(300_000), 2_997_502_081);
    }
}
