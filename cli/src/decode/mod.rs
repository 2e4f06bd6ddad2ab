//! `armwire decode`: the frames in a recording, their meaning, and the bytes between them.

mod account;
mod bus;
#[cfg(feature = "recordings")]
mod capture;
mod content;
mod detect;
pub(crate) mod doubts;
mod format;
mod framed;
mod input;
mod lines;
mod log;
#[cfg(feature = "recordings")]
pub(crate) mod mcap;
mod meaning;
mod output;
mod packed;
#[cfg(feature = "recordings")]
mod pcapng;
mod recording;
mod servo_bus;
mod sides;
mod station;
mod sum;
mod text;
mod unit;
mod xarm_line;

#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::{self, BufRead, IsTerminal, Read, stdin, stdout};
use std::path::PathBuf;

use clap::Args;

use crate::args::{ArmKind, Speaker};
use crate::error::Error;
use crate::output::print_error;
use crate::status::{Status, StatusArg};
use account::{Account, Verdict};
use doubts::Place;
use format::Format;
use input::{Head, Input};
use output::{Console, Entries, Output};
#[cfg(feature = "recordings")]
use pcapng::Packets;
use sides::Line;
use text::dump::Order;
use unit::{Bytes, Take, Unit};

/// The arguments of `armwire decode`.
#[derive(Args)]
pub(crate) struct Decode {
    /// Recording, or - for standard input: an MCAP file of 'armwire monitor'; the bytes of a line, raw, in hexadecimal, as
    /// a hex dump, or in a program's log; a log of a CAN bus from candump, Vector (ASC, BLF), PEAK (TRC), python-can (CSV,
    /// TXT) or SavvyCAN (GVRET CSV); or a capture of CAN or USB from Wireshark (pcap, pcapng). It may be compressed by gzip
    /// or zstd.
    #[arg(default_value = "-")]
    file: PathBuf,
    /// Format of the recording. By default it is detected from the first bytes.
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Kind of arm. MCAP recordings contain it.
    #[arg(long, value_enum, default_value_t)]
    arm: ArmKind,
    /// Sender of all bytes, whatever marks of direction the recording has. Without it the marks are hints, and frames
    /// decide; Ling frames, MCAP recordings and alpha1-servo identify the sender; the numbers of an xarm tell answers from
    /// requests if the first frame is a request only; other frames of xarm and alpha1 without a mark are taken as the
    /// arm's. A servo's answers are shown as bytes there: their meaning depends on the request.
    #[arg(long, value_enum, value_name = "WHO")]
    from: Option<Speaker>,
    /// Sender of the bytes that a log calls TX, sent or written: arm if its program runs on the arm's side.
    #[arg(long, value_enum, value_name = "WHO", default_value = "host")]
    tx: Speaker,
    /// Exit with status 3 if a part of the recording was not understood, was noise or was cut, or if there is no frame.
    #[arg(long)]
    strict: bool,
    /// Write frames and stray bytes to this pcapng file for Wireshark; - is standard output. Only the summary is printed.
    /// An existing file is not replaced.
    #[cfg(feature = "recordings")]
    #[arg(long, value_name = "OUT")]
    pcapng: Option<PathBuf>,
    #[command(flatten)]
    status: StatusArg,
}

impl Decode {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let (name, source): (_, Box<dyn Read>) = if self.file.as_os_str() == "-" {
            ("standard input".to_owned(), Box::new(stdin().lock()))
        } else {
            let name = self.file.display().to_string();
            match File::open(&self.file) {
                Ok(file) => (name, Box::new(self.with_status(file))),
                Err(error) => return Err(Error::at(&name, error)),
            }
        };
        let out = self.output()?;
        let head = Head::new(name.clone(), source, &*out);
        let line = Line {
            arm: self.arm,
            from: self.from,
            tx: self.tx,
        };
        let decoded = decode_recording(head, &*out, self.format, line);
        // Items before an error are shown before it. A failed output ends the input early.
        out.finish().map_err(Error::Output)?;
        let Verdict { warnings, flaws } = decoded?;
        let reasons = match self.strict {
            true => [warnings, flaws].concat(),
            false => warnings,
        };
        if reasons.is_empty() {
            return Ok(());
        }
        let error = Error::NotUnderstood {
            name,
            reasons: reasons.join(", "),
        };
        match self.strict {
            true => Err(error),
            false => {
                print_error(&error);
                Ok(())
            }
        }
    }

    /// The file, whose progress is shown unless the items are on the terminal.
    fn with_status(&self, file: File) -> Watched {
        let len = file.metadata().map_or(0, |metadata| metadata.len());
        let is_hidden = len == 0 || (stdout().is_terminal() && !self.writes_packets());
        Watched {
            file,
            read: 0,
            len,
            status: (!is_hidden).then(|| self.status.bar(len)),
        }
    }

    /// Returns true if the items go to a file.
    fn writes_packets(&self) -> bool {
        #[cfg(feature = "recordings")]
        return self.pcapng.is_some();
        #[cfg(not(feature = "recordings"))]
        false
    }

    /// The file for packets, or the console.
    fn output(&self) -> Result<Box<dyn Output>, Error> {
        #[cfg(feature = "recordings")]
        if let Some(path) = &self.pcapng {
            return Ok(Box::new(Packets::create(path)?));
        }
        Ok(Box::new(Console::new()))
    }
}

/// A file that shows how much of it was read.
struct Watched {
    file: File,
    /// Number of bytes read, of so many.
    read: u64,
    len: u64,
    status: Option<Status>,
}

impl Read for Watched {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let n = self.file.read(bytes)?;
        self.read += n as u64;
        let (read, len) = (self.read, self.len);
        if let Some(status) = &mut self.status {
            status.show_at(read, || format!("{} of {} MB", read / 1_000_000, len / 1_000_000));
        }
        Ok(n)
    }
}

/// The output of `armwire decode` for a recording: an entry for each frame and for the bytes between frames, and the
/// sum.
///
/// # Errors
///
/// The error message for an input that cannot be decoded.
pub fn decode(input: &[u8], arm: ArmKind, from: Option<Speaker>) -> Result<Vec<String>, String> {
    let out = Entries::default();
    let head = Head::new("input".to_owned(), Box::new(input), &out);
    let line = Line {
        arm,
        from,
        tx: Speaker::Host,
    };
    match decode_recording(head, &out, None, line) {
        Ok(_) | Err(Error::Undecodable { .. }) => Ok(out.into_lines()),
        Err(error) => Err(error.to_string()),
    }
}

/// Decodes a recording.
fn decode_recording(
    mut head: Head<'_>,
    out: &dyn Output,
    format: Option<Format>,
    line: Line,
) -> Result<Verdict, Error> {
    if format != Some(Format::Raw) {
        head = head.unpacked();
    }
    let format = format.map_or_else(|| detect::detect(&mut head), Ok)?;
    let mut account = Account::new(format, line, out)?;
    let order = match format {
        Format::Dump => Some(detect::dump_order(&mut head)?),
        Format::DumpBe => Some(Order::Big),
        Format::DumpLe => Some(Order::Little),
        _ => None,
    };
    let beginning = head.beginning();
    let mut input = match format {
        Format::Raw | Format::Blf | Format::Mcap | Format::Pcap => head.into_input(),
        _ => head.into_text()?,
    };
    let read = match format {
        Format::Raw => read_raw(&mut input, &mut account),
        _ => read(&mut input, format, order, &mut |place, unit| account.take(place, unit)),
    };
    account.finish(input.name(), &beginning, read)
}

/// Passes each unit of a recording in this format to `take`. The words of a hex dump have this order of bytes.
fn read(input: &mut Input<'_>, format: Format, order: Option<Order>, take: &mut Take<'_>) -> Result<(), Error> {
    match format {
        #[cfg(feature = "recordings")]
        Format::Mcap => mcap::read(input, take),
        #[cfg(feature = "recordings")]
        Format::Pcap => capture::read(input, take),
        #[cfg(not(feature = "recordings"))]
        Format::Mcap | Format::Pcap => Err(input.refused("this build of armwire reads no such files")),
        _ if format.is_of_line() => text::read(input, format, order, take),
        _ => log::read(input, format, take),
    }
}

/// Reads bytes as they are.
fn read_raw(input: &mut Input<'_>, account: &mut Account<'_>) -> Result<(), Error> {
    while !account.is_broken() {
        let place = Place::Byte(input.offset());
        let piece = match input.fill_buf() {
            Ok(piece) => piece,
            Err(error) => return Err(input.failed(error)),
        };
        let len = piece.len();
        if len == 0 {
            break;
        }
        account.take(place, Ok(Unit::Bytes(Bytes::new(piece))));
        input.consume(len);
    }
    Ok(())
}
