//! Log formats of a CAN bus.

pub(super) mod asc;
pub(super) mod blf;
pub(super) mod candump;
pub(super) mod csv;
pub(super) mod gvret;
#[cfg(feature = "recordings")]
pub(super) mod pcap;
pub(super) mod printer;
mod record;
pub(super) mod trc;

#[cfg(test)]
mod tests;

use super::doubts::{Doubt, Place};
use super::format::Format;
use super::input::Input;
use crate::error::Error;
use asc::Asc;
use candump::Candump;
use csv::Csv;
use gvret::Gvret;
use printer::Printer;
use record::{Logged, MICROS, MILLIS, SECONDS, byte, data, decimal, frame, identifier, number, time};
pub(super) use record::{Record, Take, TextLog, Time};
use trc::Trc;

/// Passes each record of a log to `take`. Recordings of a line have no records.
pub(super) fn read(input: &mut Input<'_>, format: Format, take: &mut Take<'_>) -> Result<(), Error> {
    match format {
        Format::Raw
        | Format::Hex
        | Format::Dec
        | Format::Dump
        | Format::DumpBe
        | Format::DumpLe
        | Format::Log
        | Format::Mcap => Ok(()),
        Format::Blf => blf::read(input, take),
        #[cfg(feature = "recordings")]
        Format::Pcap => pcap::read(input, take),
        #[cfg(not(feature = "recordings"))]
        Format::Pcap => Err(Error::at(input.name(), "this build of armwire reads no captures")),
        Format::Candump => read_lines(input, &mut Candump, take),
        Format::Asc => read_lines(input, &mut Asc::new(), take),
        Format::Trc => read_lines(input, &mut Trc::default(), take),
        Format::Csv => read_lines(input, &mut Csv, take),
        Format::Gvret => read_lines(input, &mut Gvret::default(), take),
        Format::Printer => read_lines(input, &mut Printer, take),
    }
}

/// Passes each record of a log with one record per line to `take`.
fn read_lines(input: &mut Input<'_>, log: &mut dyn TextLog, take: &mut Take<'_>) -> Result<(), Error> {
    while let Some(line) = input.line()? {
        let place = Place::Line(line.number, &line.text);
        // A file system may fill the end of a log with them when the power fails.
        let text = line.text.trim_matches('\0');
        if text.len() < line.text.len() {
            take(place, Err("NUL bytes".into()));
        }
        if text.trim().is_empty() {
            continue;
        }
        let record = match log.record(text) {
            // The missing end may change its meaning.
            Ok(Record::Frame(_)) | Err(_) if !line.is_whole => Err("the line is too long".into()),
            Ok(Record::Other) | Err(_) if !line.is_ended => Err(Doubt::cut()),
            record => record,
        };
        take(place, record);
    }
    Ok(())
}
