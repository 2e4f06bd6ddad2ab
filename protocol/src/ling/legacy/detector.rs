//! Whether a line carries the older generation.

use thiserror::Error;

use super::{BAUD_RATES, Legacy, MAX_FRAME};
use crate::decoder::{Decoder, Kind};
use crate::messages::Messages;

/// So many frames in succession are no chance.
///
/// Random bytes are a joint or gripper frame, at a given place, once in 2³⁸; three in succession are not met.
const ENOUGH: u8 = 3;

/// There is an arm of the older generation on the line. As text it is for whoever uses the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[error(
    "a Ling arm of the older generation: its firmware is from before late 2025, when frames got a function byte. armwire \
     reads its joints but sends it nothing; for all else, ask the vendor for a firmware update. (Such arms talk at {} or \
     {} baud.)",
    BAUD_RATES[0],
    BAUD_RATES[1]
)]
pub struct OlderGeneration;

/// Tells from what is heard on a line whether an arm of the older generation talks there.
///
/// It takes three joint or gripper frames with nothing between them that is no frame. It knows where they lie in the
/// stream, not when: chunks make no difference. Good frames of other kinds neither count nor break the succession;
/// frames of the current generation break it.
///
/// Once it has told, it tells so for good.
///
/// ```
/// use armwire::ling::legacy::{Detector, OlderGeneration};
///
/// let joints = [
///     0xAA, 0x14, 0x12, 0xA9, 0x07, 0xA9, 0x07, 0xE6, 0x0C, 0x19, 0x03, 0x6D, 0x06, 0x92, 0x09, 0x2F, 0x07, 0xED,
///     0x04, 0x81, 0x08, 0x00, 0xFF,
/// ];
/// let mut detector = Detector::new();
/// assert_eq!(detector.hear(&joints), None);
/// assert_eq!(detector.hear(&joints), None);
/// assert_eq!(detector.hear(&joints), Some(OlderGeneration));
/// ```
#[derive(Debug, Default)]
pub struct Detector {
    decoder: Decoder<MAX_FRAME>,
    /// Frames in succession, up to [`ENOUGH`].
    succession: u8,
}

impl Detector {
    /// A detector that has heard nothing.
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            succession: 0,
        }
    }

    /// Hears what came from the arm next, and says what was found, now or before.
    pub fn hear(&mut self, mut bytes: &[u8]) -> Option<OlderGeneration> {
        while self.succession < ENOUGH {
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
