//! The comma-separated log of GVRET and SavvyCAN.

use armwire_bridge::can::{MAX_CLASSIC, MAX_FD};

use super::{Doubt, LineReader, Logged, MICROS, Read, Unit, data, frame, identifier, number, time};

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

impl LineReader for Gvret {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        let line = line.trim();
        if let Some(columns) = line.strip_prefix(HEADER) {
            self.lacks_direction = match columns {
                columns if columns.starts_with("Dir,Bus,LEN,") => false,
                columns if columns.starts_with("Bus,LEN,") => true,
                _ => return Err("unknown columns".into()),
            };
            return Ok(Unit::Comment);
        }
        let mut fields = line.split(',');
        let mut field = |what: &str| fields.next().ok_or_else(|| Doubt::missing(what));
        let time = time(field("time")?, MICROS)?;
        let id = identifier(field("identifier")?, 16)?;
        let is_extended = match field("Extended")? {
            "true" | "1" => true,
            "false" | "0" => false,
            text => return Err(Doubt::word(text, "neither true nor false")),
        };
        if !self.lacks_direction {
            field("direction")?;
        }
        let bus = field("bus")?;
        let len = field("length")?;
        let len = number(len, 10)
            .map(|len| len as usize)
            .filter(|len| *len <= MAX_FD)
            .ok_or_else(|| Doubt::word(len, "no length from 0 to 64"))?;
        // SavvyCAN writes no more than 8 bytes of an FD frame, and reads the others as 0.
        let fields: Vec<_> = fields.take(len).take_while(|field| !field.is_empty()).collect();
        let there = if fields.len() == MAX_CLASSIC { MAX_CLASSIC } else { len };
        let mut data = data(fields.into_iter(), there.min(len), 16)?;
        let lacking = len - data.len();
        data.resize(len, 0);
        // The log does not distinguish FD frames from others of the same length.
        let frame = frame(id, is_extended, false, &data)?;
        Ok(Unit::Can(Logged {
            time,
            bus: bus.into(),
            frame,
            lacking,
        }))
    }
}
