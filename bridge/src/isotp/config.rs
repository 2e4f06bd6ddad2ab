//! Parameters of an endpoint.

use armwire::OutOfRange;
use armwire::time::Duration;

use crate::can::Id;

/// The kind of frames an endpoint sends. It receives both kinds, of any length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Link {
    /// Classic frames, padded to 8 bytes.
    Classic,
    /// FD frames of up to 64 bytes, padded to 8 bytes or the next valid length.
    Fd,
}

/// Parameters of an [`Endpoint`](super::Endpoint): its sending, its requests to senders, and its timeouts.
///
/// ```
/// use armwire_bridge::Duration;
/// use armwire_bridge::can::Id;
/// use armwire_bridge::isotp::{Config, Link, SeparationTime};
///
/// // A receiver with a FIFO of few frames.
/// let config = Config {
///     block_size: 8,
///     st_min: SeparationTime::from_millis(1).unwrap(),
///     ..Config::new(Link::Classic, Id::new(0x612).unwrap())
/// };
/// assert_eq!(config.n_cr, Duration::from_millis(1_000));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// The kind of frames it sends.
    pub link: Link,
    /// The identifier of all frames it sends, flow control included.
    pub tx: Id,
    /// BS, requested from senders: the number of consecutive frames before the next flow control, 0 for no limit.
    pub block_size: u8,
    /// STmin, requested from senders: the minimum time between consecutive frames.
    pub st_min: SeparationTime,
    /// N_As: the timeout for a due frame of a PDU in transfer to [leave](super::Endpoint::transmitted) the controller.
    pub n_as: Duration,
    /// N_Bs: the timeout for the other side's flow control frame.
    pub n_bs: Duration,
    /// N_Cr: the timeout for the other side's consecutive frame. It starts when flow control is handed over, and again
    /// when flow control has left. It therefore also covers flow control that never leaves, and there is no N_Ar.
    pub n_cr: Duration,
    /// The maximum number of consecutive WAIT frames from the other side. The standard limits the sender of WAIT frames
    /// (N_WFTmax); one without a limit would block the endpoint forever.
    pub max_waits: u8,
}

impl Config {
    /// No limits for senders; all timeouts are the standard's 1000 ms (section 9.8); the tenth consecutive WAIT aborts
    /// the transfer.
    pub const fn new(link: Link, tx: Id) -> Self {
        Self {
            link,
            tx,
            block_size: 0,
            st_min: SeparationTime::ZERO,
            n_as: Duration::from_millis(1_000),
            n_bs: Duration::from_millis(1_000),
            n_cr: Duration::from_millis(1_000),
            max_waits: 9,
        }
    }
}

/// STmin, the minimum time between consecutive frames: 0 to 127 ms, or 100 to 900 µs.
///
/// ```
/// use armwire_bridge::Duration;
/// use armwire_bridge::isotp::SeparationTime;
///
/// assert_eq!(SeparationTime::from_millis(20).unwrap().duration(), Duration::from_micros(20_000));
/// assert_eq!(SeparationTime::from_hundreds_of_micros(9).unwrap().to_byte(), 0xF9);
///
/// // A value that the standard reserves counts as the longest there is.
/// assert_eq!(SeparationTime::from_byte(0x80), SeparationTime::from_millis(127).unwrap());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SeparationTime(u8);

impl SeparationTime {
    /// No separation: as fast as the bus allows.
    pub const ZERO: Self = Self(0);

    /// Maximum number of milliseconds.
    const MAX_MILLIS: u8 = 0x7F;

    /// `millis` milliseconds, 0..=127.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for more than 127 ms.
    pub const fn from_millis(millis: u8) -> Result<Self, OutOfRange> {
        if millis > Self::MAX_MILLIS {
            return Err(out_of_range("ms", millis, 0, Self::MAX_MILLIS));
        }
        Ok(Self(millis))
    }

    /// `hundreds` times 100 µs, 1..=9.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for a value outside 1 to 9.
    pub const fn from_hundreds_of_micros(hundreds: u8) -> Result<Self, OutOfRange> {
        match hundreds {
            1..=9 => Ok(Self(0xF0 | hundreds)),
            _ => Err(out_of_range("times 100 µs", hundreds, 1, 9)),
        }
    }

    /// Decodes the byte of a flow control frame. A reserved value is read as 127 ms.
    pub const fn from_byte(byte: u8) -> Self {
        match byte {
            0..=Self::MAX_MILLIS | 0xF1..=0xF9 => Self(byte),
            _ => Self(Self::MAX_MILLIS),
        }
    }

    /// Encodes the byte of a flow control frame.
    pub const fn to_byte(self) -> u8 {
        self.0
    }

    /// The separation as a duration.
    pub const fn duration(self) -> Duration {
        let micros = match self.0 {
            millis @ 0..=Self::MAX_MILLIS => millis as u32 * 1_000,
            hundreds => (hundreds & 0x0F) as u32 * 100,
        };
        Duration::from_micros(micros as u64)
    }
}

const fn out_of_range(unit: &'static str, got: u8, min: u16, max: u8) -> OutOfRange {
    OutOfRange {
        what: "separation time",
        unit,
        got: got as u16,
        min,
        max: max as u16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separation_time_has_two_ranges() {
        for value in 0..=u8::MAX {
            let millis = SeparationTime::from_millis(value).map(SeparationTime::duration);
            match value {
                0..=127 => assert_eq!(millis, Ok(Duration::from_millis(value.into()))),
                _ => assert_eq!(millis, Err(out_of_range("ms", value, 0, 127))),
            }
            let hundreds = SeparationTime::from_hundreds_of_micros(value).map(SeparationTime::duration);
            match value {
                1..=9 => assert_eq!(hundreds, Ok(Duration::from_micros(u64::from(value) * 100))),
                _ => assert_eq!(hundreds, Err(out_of_range("times 100 µs", value, 1, 9))),
            }
        }
    }
}
