//! The comma-separated log of GVRET and SavvyCAN.

use armwire_bridge::can::MAX_FD;

use super::{Logged, MICROS, Record, TextLog, data, frame, identifier, number, time, wrong};

/// First columns of such a log.
pub(in crate::decode) const HEADER: &str = "Time Stamp,ID,Extended,";

/// A parser of such logs:
///
/// ```text
/// Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8
/// 166064000,0000060F,false,Rx,0,8,07,AA,06,00,01,FE,9A,FF,
/// ```
///
/// Older logs have no direction.
#[derive(Default)]
pub(in crate::decode) struct Gvret {
    lacks_direction: bool,
}

impl TextLog for Gvret {
    fn record<'a>(&mut self, line: &'a str) -> Result<Record<'a>, String> {
        let line = line.trim();
        if let Some(columns) = line.strip_prefix(HEADER) {
            self.lacks_direction = match columns {
                columns if columns.starts_with("Dir,Bus,LEN,") => false,
                columns if columns.starts_with("Bus,LEN,") => true,
                _ => return Err("unknown columns".to_owned()),
            };
            return Ok(Record::Comment);
        }
        let mut fields = line.split(',');
        let mut field = |what: &str| fields.next().ok_or_else(|| format!("no {what}"));
        let time = time(field("time")?, MICROS)?;
        let id = identifier(field("identifier")?, 16)?;
        let is_extended = match field("Extended")? {
            "true" | "1" => true,
            "false" | "0" => false,
            text => return Err(wrong(text, "neither true nor false")),
        };
        if !self.lacks_direction {
            field("direction")?;
        }
        let bus = field("bus")?;
        let len = number(field("length")?, 10).filter(|len| *len as usize <= MAX_FD);
        let len = len.ok_or_else(|| format!("no length from 0 to {MAX_FD}"))? as usize;
        // The log does not distinguish FD frames from others of the same length.
        let frame = frame(id, is_extended, len > 8, &data(fields, len, 16)?)?;
        Ok(Record::Frame(Logged { time, bus, frame }))
    }
}
