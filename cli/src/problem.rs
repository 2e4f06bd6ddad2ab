//! What can go wrong, each in one line that says what to do.

use std::fmt;
#[cfg(unix)]
use std::fs;
use std::io::{self, ErrorKind};
#[cfg(unix)]
use std::os::unix::fs::MetadataExt;

use armwire::ling::ParseError;
#[cfg(unix)]
use rustix::io::Errno;
use serial2::SerialPort;

use crate::describe::hex;

/// Why a command fails.
#[derive(Debug)]
pub(crate) enum Problem {
    /// The port cannot be opened.
    Open { port: String, error: io::Error },
    /// The port failed while it was open.
    Lost { port: String, error: io::Error },
    /// The port takes no bytes.
    Stuck { port: String },
    /// The arm did not answer.
    NoAnswer { port: String, baud: u32, heard: Box<Heard> },
    /// A virtual arm could not be served.
    #[cfg(unix)]
    Serve(io::Error),
    /// Something to read could not be read.
    Input { name: String, error: io::Error },
    /// Something is not what it should be.
    Text { name: String, line: usize, word: String },
    /// The output went nowhere.
    Output(io::Error),
    /// Ctrl-C could not be caught.
    Signals(ctrlc::Error),
}

/// What was heard instead of an answer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Heard {
    /// How often the arm was asked.
    pub(crate) sends: u8,
    /// In how many milliseconds.
    pub(crate) millis: u64,
    /// The bytes that arrived, as far as they are kept.
    pub(crate) bytes: Vec<u8>,
    /// How many there were.
    pub(crate) count: usize,
    /// Good frames from an arm, though not the answer.
    pub(crate) frames: usize,
    /// The first good frame that is no message of the protocol.
    pub(crate) unknown: Option<ParseError>,
    /// Requests of our own that came back.
    pub(crate) echoes: usize,
    /// Frames with a wrong checksum.
    pub(crate) checksums: usize,
    /// Whether bytes start as the answer should.
    pub(crate) begun: bool,
}

impl Heard {
    /// Whether a frame of the older generation of Ling arms was among it: `AA command length data parity FF`, the parity
    /// that of the data's sum.
    fn is_older_ling(&self) -> bool {
        (0..self.bytes.len()).any(|start| match &self.bytes[start..] {
            &[0xAA, _, len, ref rest @ ..] if len > 0 => {
                let (data, end) = rest.split_at(rest.len().min(usize::from(len)));
                let parity = data.iter().fold(0, |sum, byte| sum ^ byte) & 1;
                matches!(end, [check, 0xFF, ..] if *check == parity)
            }
            _ => false,
        })
    }

    fn fmt_cause(&self, f: &mut fmt::Formatter<'_>, baud: u32) -> fmt::Result {
        let &Self {
            sends,
            millis,
            count,
            checksums,
            ..
        } = self;
        let times = match sends {
            1 => "once".to_owned(),
            sends => format!("{sends} times"),
        };
        if count == 0 {
            return write!(
                f,
                "no answer in {millis} ms, asked {times}: is the arm powered, is it on this port, \
                 and does it talk at {baud} baud?"
            );
        }
        if self.is_older_ling() {
            return write!(
                f,
                "this is a Ling arm with firmware of the older generation (frames without a function byte), \
                 which is not supported: update the arm's firmware"
            );
        }
        // A frame whose checksum happens to be good proves nothing where others are damaged.
        if let Some(error) = self.unknown
            && checksums == 0
        {
            return write!(
                f,
                "the arm answers with {error}: does its firmware refuse the request, or not know it?"
            );
        }
        if checksums > 0 || self.begun {
            return write!(
                f,
                "the answers arrive damaged ({count} bytes, wrong checksums: {checksums}): check cable, ground and power"
            );
        }
        if self.frames > 0 {
            return write!(
                f,
                "frames arrive, but not the answer, asked for {times}: does another program talk to the arm?"
            );
        }
        let first = hex(&self.bytes[..self.bytes.len().min(16)]);
        if self.echoes > 0 {
            return write!(
                f,
                "only our own requests come back: is the arm powered, and are RX and TX not joined? (first bytes: {first})"
            );
        }
        write!(
            f,
            "{count} bytes arrive, but no frame of a Ling arm: is {baud} the baud rate, and is it this arm? \
             (first bytes: {first})"
        )
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open { port, error } => {
                write!(f, "{port}: ")?;
                fmt_open(f, port, error)
            }
            Self::Lost { port, error } => write!(f, "{port}: the port is gone ({error}): was it unplugged?"),
            Self::Stuck { port } => write!(f, "{port}: the port takes no bytes: is the adapter stuck?"),
            Self::NoAnswer { port, baud, heard } => {
                write!(f, "{port}: ")?;
                heard.fmt_cause(f, *baud)
            }
            #[cfg(unix)]
            Self::Serve(error) => write!(f, "cannot serve a virtual arm: {error}"),
            Self::Input { name, error } => write!(f, "{name}: {error}"),
            Self::Text { name, line, word } => {
                write!(f, "{name}: line {line}: '{word}' is not a byte or bytes in hexadecimal")
            }
            Self::Output(error) => write!(f, "cannot write the output: {error}"),
            Self::Signals(error) => write!(f, "cannot catch Ctrl-C: {error}"),
        }
    }
}

fn fmt_open(f: &mut fmt::Formatter<'_>, port: &str, error: &io::Error) -> fmt::Result {
    match error.kind() {
        // Another program has locked the port, or keeps all others from opening it.
        ErrorKind::WouldBlock | ErrorKind::ResourceBusy if cfg!(unix) => write!(
            f,
            "in use by another program: close that one first ('fuser -v {port}' names it)"
        ),
        ErrorKind::NotFound => {
            let ports = SerialPort::available_ports().unwrap_or_default();
            let names: Vec<_> = ports.iter().map(|port| port.to_string_lossy()).collect();
            match names.as_slice() {
                [] => write!(f, "no such port, nor any other: is the adapter plugged in?"),
                names => write!(f, "no such port; there are: {}", names.join(", ")),
            }
        }
        #[cfg(unix)]
        ErrorKind::PermissionDenied => match group(port) {
            Some(group) => write!(
                f,
                "permission denied: add yourself to the group '{group}' ('sudo usermod -aG {group} $USER') and log in again"
            ),
            None => f.write_str(
                "permission denied: add yourself to the group that owns it (often dialout or uucp) and log in again",
            ),
        },
        // What Windows says of a port that is open already.
        #[cfg(not(unix))]
        ErrorKind::PermissionDenied => f.write_str("in use by another program: close that one first"),
        #[cfg(unix)]
        _ if Errno::from_io_error(error) == Some(Errno::NOTTY) => f.write_str("not a serial port"),
        _ => write!(f, "cannot be opened: {error}"),
    }
}

/// The group that owns a port, if that is one for users.
#[cfg(unix)]
fn group(port: &str) -> Option<String> {
    let gid = fs::metadata(port).ok()?.gid();
    let groups = fs::read_to_string("/etc/group").ok()?;
    // Each line is `name:password:id:members`.
    let mut fields = groups.lines().map(|line| line.split(':').collect::<Vec<_>>());
    let owner = fields.find(|fields| fields.get(2).is_some_and(|id| id.parse() == Ok(gid)))?;
    (gid != 0).then(|| owner[0].to_owned())
}

#[cfg(test)]
mod tests {
    use armwire::ling::Cause;

    use super::*;

    fn heard(bytes: &[u8]) -> Heard {
        Heard {
            bytes: bytes.to_vec(),
            count: bytes.len(),
            ..Heard::default()
        }
    }

    fn line(heard: Heard) -> String {
        let (port, baud, heard) = ("COM3".to_owned(), 1_000_000, Box::new(heard));
        Problem::NoAnswer { port, baud, heard }.to_string()
    }

    #[test]
    fn an_arm_of_the_older_generation_is_told_by_its_frames() {
        assert!(line(heard(&[0x00, 0xAA, 0x12, 0x03, 1, 2, 4, 1, 0xFF, 0xAA])).contains("older generation"));
        assert!(line(heard(&[0xAA, 0x12, 0x03, 1, 2, 4, 0, 0xFF])).contains("no frame of a Ling arm"));
        assert!(line(heard(&[0xAA, 0x12, 0xFF, 1, 2])).contains("first bytes: AA 12 FF 01 02"));
    }

    #[test]
    fn an_arm_that_was_asked_once_was_not_asked_1_times() {
        let asked = |sends| line(Heard { sends, ..heard(&[]) });
        assert!(asked(1).contains("asked once:") && asked(3).contains("asked 3 times:"));
    }

    #[test]
    fn every_cause_is_one_line() {
        let causes = [
            heard(&[]),
            heard(&[1; 500]),
            Heard {
                checksums: 1,
                ..heard(&[1])
            },
            Heard {
                unknown: Some(ParseError {
                    command: 0xEE,
                    function: 0x00,
                    cause: Cause::Unknown,
                }),
                begun: true,
                ..heard(&[1])
            },
            Heard {
                echoes: 1,
                ..heard(&[1])
            },
            Heard {
                frames: 1,
                ..heard(&[1])
            },
        ];
        let mut lines = causes.map(line);
        assert!(lines.iter().all(|line| !line.contains('\n') && line.len() < 200));
        lines.sort();
        assert!(lines.windows(2).all(|pair| pair[0] != pair[1]));
    }
}
