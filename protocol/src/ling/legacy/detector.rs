//! Detection of arms of the older generation.

use thiserror::Error;

use super::{BAUD_RATES, Legacy, MAX_FRAME};
use crate::decoder::{Decoder, Kind};
use crate::messages::Messages;

/// Number of consecutive frames that make a detection.
///
/// Random bytes form a joint or gripper frame at a given place with probability 2⁻³⁸; three consecutive ones do not
/// occur.
const REQUIRED_FRAMES: u8 = 3;

/// The detection of an arm of the older generation, with a text for the user of the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[error(
    "a Ling arm of the older generation (firmware from before late 2025, {} or {} baud). armwire reads its joints and \
     sends nothing to it. All other functions need a firmware update from the vendor.",
    BAUD_RATES[0],
    BAUD_RATES[1]
)]
pub struct OlderGeneration;

/// Detects an arm of the older generation from its bytes.
///
/// A detection takes three joint or gripper frames without noise in between. It depends on their order in the stream,
/// not on time: the size of chunks has no effect. Valid frames of other kinds neither count nor break the sequence;
/// frames of the current generation break it.
///
/// A detection is permanent.
///
/// ```
/// use armwire::ling::legacy::{Detector, OlderGeneration};
///
/// let joints = [
///     0xAA, 0x14, 0x12, 0xA9, 0x07, 0xA9, 0x07, 0xE6, 0x0C, 0x19, 0x03, 0x6D, 0x06, 0x92, 0x09, 0x2F, 0x07, 0xED,
///     0x04, 0x81, 0x08, 0x00, 0xFF,
/// ];
/// let mut detector = Detector::new();
/// assert_eq!(detector.push(&joints), None);
/// assert_eq!(detector.push(&joints), None);
/// assert_eq!(detector.push(&joints), Some(OlderGeneration));
/// ```
#[derive(Debug, Default)]
pub struct Detector {
    decoder: Decoder<Legacy, MAX_FRAME>,
    /// Number of consecutive frames, up to [`REQUIRED_FRAMES`].
    succession: u8,
}

impl Detector {
    /// A detector without received bytes.
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            succession: 0,
        }
    }

    /// Processes the next bytes from the arm. Returns the detection, also if it was made earlier.
    pub fn push(&mut self, mut bytes: &[u8]) -> Option<OlderGeneration> {
        while self.succession < REQUIRED_FRAMES {
            let Some(item) = self.decoder.next(&Legacy, ()) else {
                if bytes.is_empty() {
                    return None;
                }
                bytes = self.decoder.push(bytes);
                continue;
            };
            match item.kind {
                Kind::Frame if Legacy.parse_response(item.bytes, ()).is_ok() => self.succession += 1,
                Kind::Frame | Kind::Padding => {}
                Kind::Noise(_) | Kind::Broken(_) => self.succession = 0,
            }
        }
        Some(OlderGeneration)
    }
}
