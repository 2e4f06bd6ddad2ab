//! The comma-separated log of python-can.

use armwire_bridge::Instant;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::{Doubt, LineReader, Logged, Read, SECONDS, Time, Unit, frame, identifier, number, time};

/// The first line of such a log.
pub(in crate::decode) const HEADER: &str = "timestamp,arbitration_id,extended,remote,error,dlc,data";

/// A parser of such logs:
///
/// ```text
/// timestamp,arbitration_id,extended,remote,error,dlc,data
/// 1609459200.123456,0x60f,0,0,0,8,B6oGAAH+mv8=
/// ```
pub(in crate::decode) struct Csv;

impl LineReader for Csv {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        let line = line.trim();
        if line == HEADER {
            return Ok(Unit::Comment);
        }
        let mut fields = line.split(',');
        let mut field = |what: &str| fields.next().ok_or_else(|| Doubt::missing(what));
        let time = timestamp(field("timestamp")?)?;
        let id = field("arbitration_id")?;
        let id = identifier(id.strip_prefix("0x").unwrap_or(id), 16)?;
        let is_extended = flag(field("extended")?)?;
        let is_remote = flag(field("remote")?)?;
        let is_error = flag(field("error")?)?;
        let dlc = number(field("dlc")?, 10).ok_or_else(|| Doubt::missing("length of the data"))? as usize;
        let data = STANDARD.decode(field("data")?);
        let data = data.map_err(|error| Doubt::new("no data in base64", format!("data in base64: {error}")))?;
        if fields.next().is_some() {
            return Err("more than 7 fields".into());
        }
        let frame = match is_remote || is_error {
            true => None,
            false if data.len() != dlc => return Err(Doubt::short(dlc, data.len())),
            // The log does not distinguish FD frames from others of the same length.
            false => frame(id, is_extended, dlc > 8, &data)?,
        };
        Ok(Unit::Can(Logged::whole(time, "", frame)))
    }
}

/// Converts a time. Python writes times below 0.1 ms with an exponent, such as 1e-05.
fn timestamp(text: &str) -> Result<Time<'_>, Doubt> {
    let small = text.contains('e').then(|| text.parse::<f64>().ok()).flatten();
    match small {
        Some(seconds) if (0.0..1.0).contains(&seconds) => {
            Ok(Time::seconds(Instant::from_micros((seconds * 1e6) as u64), text))
        }
        _ => time(text, SECONDS),
    }
}

fn flag(text: &str) -> Result<bool, Doubt> {
    match text {
        "0" => Ok(false),
        "1" => Ok(true),
        _ => Err(Doubt::word(text, "neither 0 nor 1")),
    }
}
