//! Log formats of a CAN bus.

pub(super) mod asc;
pub(super) mod blf;
pub(super) mod candump;
pub(super) mod csv;
pub(super) mod gvret;
pub(super) mod printer;
mod record;
pub(super) mod trc;

#[cfg(test)]
mod tests;

use super::doubts::{Doubt, Place};
use super::format::Format;
use super::input::Input;
use super::lines::{self, LineReader, Lines};
use super::unit::{Read, Take, Unit};
use crate::error::Error;
use asc::Asc;
use candump::Candump;
use csv::Csv;
use gvret::Gvret;
use printer::Printer;
pub(super) use record::{Logged, Time, decimal, frame};
use record::{MICROS, MILLIS, SECONDS, byte, data, identifier, number, time};
use trc::Trc;

/// The lines of logs: more than four times as long as the longest of every format.
const LINES: Lines = Lines {
    max: 4 * 1024,
    are_ended: true,
};

/// Passes each record of a log to `take`.
pub(super) fn read(input: &mut Input<'_>, format: Format, take: &mut Take<'_>) -> Result<(), Error> {
    let reader: &mut dyn LineReader = match format {
        Format::Blf => return blf::read(input, take),
        Format::Asc => &mut Asc::new(),
        Format::Trc => &mut Trc::default(),
        Format::Csv => &mut Csv,
        Format::Gvret => &mut Gvret::default(),
        Format::Printer => &mut Printer,
        _ => &mut Candump,
    };
    lines::read(input, LINES, reader, take)
}
