//! What can go wrong, each in one line that says what to do.

use std::fmt;
#[cfg(unix)]
use std::fs;
use std::io::{self, ErrorKind};
#[cfg(unix)]
use std::os::unix::fs::MetadataExt;

use armwire::framing::Reason;
use armwire::ling::legacy::OlderGeneration;
use armwire_bridge::config::ConfigError;
use armwire_bridge::control::{self, Failure, Malformed};
use armwire_bridge::isotp;
#[cfg(unix)]
use rustix::io::Errno;

use crate::control::usb;
use crate::{can, hex, port};

/// Why a command fails.
#[derive(Debug)]
pub(crate) enum Problem {
    /// The arguments do not go together.
    Usage(String),
    /// The port cannot be opened.
    Open { port: String, error: io::Error },
    /// The port failed while it was open.
    Lost { port: String, error: io::Error },
    /// The port takes no bytes.
    Stuck { port: String },
    /// The arm is one that is sent nothing.
    Older { port: String, older: OlderGeneration },
    /// The arm, which talks unasked, has stopped.
    Silent { port: String },
    /// There is no such CAN interface, or it cannot be used.
    CanInterface { name: String, error: io::Error },
    /// What is on the port does not talk as an SLCAN adapter.
    NoSlcan { name: String, baud: u32 },
    /// The CAN adapter refused a command, or a frame.
    CanRefused { name: String, what: String },
    /// A message could not be carried on CAN.
    IsoTp {
        name: String,
        error: isotp::Error,
        doubts: String,
    },
    /// The adapter has more to say than it may.
    TooLong { name: String, error: isotp::Refused },
    /// There is no adapter with a control port there.
    NoControl { name: String },
    /// The control port is there, but cannot be used.
    Usb { name: String, error: nusb::Error },
    /// There are several adapters, and the port does not tell which.
    Several { name: String, serials: Vec<String> },
    /// The adapter did not answer a request.
    NoReply { name: String, millis: u64, doubts: String },
    /// What the adapter said cannot be read.
    Malformed { name: String, error: Malformed },
    /// The adapter does not know a request.
    Unsupported { name: String, version: u16 },
    /// The adapter cannot be as it was told to be.
    BadConfig { name: String, error: ConfigError },
    /// The adapter could not do what it was asked.
    Failed { name: String, failure: Failure },
    /// The host's name says nothing to the system.
    Resolve { name: String, error: io::Error },
    /// The host cannot be connected to.
    Connect { name: String, error: io::Error },
    /// The arm closed the connection.
    Closed { name: String },
    /// The connection failed while it was open.
    Disconnected { name: String, error: io::Error },
    /// What arrives on the connection cannot be read, nor can anything after it.
    Broken {
        name: String,
        arm: &'static str,
        /// After how many bytes, and why.
        offset: u64,
        reason: Reason,
    },
    /// The arm did not answer.
    NoAnswer {
        name: String,
        /// What it should be, with its article.
        arm: &'static str,
        /// What to ask oneself about the line.
        doubts: String,
        heard: Box<Heard>,
    },
    /// The arm's answer has a value or a length that its protocol does not have.
    Unacceptable { name: String, error: String },
    /// The arm answered that it did not do what it was asked.
    Refused { name: String, what: String },
    /// What was decoded up to here cannot be read any further.
    Undecodable {
        name: String,
        offset: usize,
        reason: Reason,
    },
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
    pub(crate) unknown: Option<String>,
    /// Requests of our own that came back.
    pub(crate) echoes: usize,
    /// Frames with a wrong checksum.
    pub(crate) checksums: usize,
    /// Whether bytes start as the answer should.
    pub(crate) begun: bool,
}

impl Heard {
    fn fmt_cause(&self, f: &mut fmt::Formatter<'_>, arm: &str, doubts: &str) -> fmt::Result {
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
            return write!(f, "no answer in {millis} ms, asked {times}: {doubts}");
        }
        // A frame whose checksum happens to be good proves nothing where others are damaged.
        if let Some(error) = &self.unknown
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
        let first = hex::show(&self.bytes[..self.bytes.len().min(16)]);
        if self.echoes > 0 {
            return write!(
                f,
                "only our own requests come back: is the arm powered, and are RX and TX not joined? (first bytes: {first})"
            );
        }
        write!(
            f,
            "{count} bytes arrive, but no frame of {arm}: {doubts} (first bytes: {first})"
        )
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(text) => f.write_str(text),
            Self::Open { port, error } => {
                write!(f, "{port}: ")?;
                fmt_open(f, port, error)
            }
            Self::Lost { port, error } => write!(f, "{port}: the port is gone ({error}): was it unplugged?"),
            Self::Stuck { port } => write!(f, "{port}: the port takes no bytes: is the adapter stuck?"),
            Self::Older { port, older } => {
                write!(f, "{port}: this is {older} 'armwire monitor' shows its joints.")
            }
            Self::Silent { port } => write!(f, "{port}: the arm has stopped talking: is it still powered?"),
            Self::CanInterface { name, error } => {
                write!(f, "{name}: ")?;
                fmt_can(f, name, error)
            }
            Self::NoSlcan { name, baud } => write!(
                f,
                "{name}: no answer to SLCAN: is it a CAN adapter that speaks it, and at {baud} baud?"
            ),
            Self::CanRefused { name, what } => write!(f, "{name}: the CAN adapter {what}"),
            Self::IsoTp { name, error, doubts } => write!(f, "{name}: {error}: {doubts}"),
            Self::TooLong { name, error } => write!(f, "{name}: {error}: does another program talk to the adapter?"),
            Self::NoControl { name } => write!(
                f,
                "{name}: this is not the port of an armwire adapter, which has a control port beside it (of a virtual \
                 board: control:PATH)"
            ),
            Self::Usb { name, error } => {
                write!(f, "{name}: ")?;
                fmt_usb(f, error)
            }
            Self::Several { name, serials } => write!(
                f,
                "{name}: there are several adapters ({}), and this system does not tell whose port it is: unplug the others",
                serials.join(", ")
            ),
            Self::NoReply { name, millis, doubts } => {
                write!(f, "{name}: the adapter does not answer in {millis} ms: {doubts}")
            }
            Self::Malformed { name, error } => write!(
                f,
                "{name}: the adapter says what cannot be read ({error}): is its firmware newer than this program?"
            ),
            Self::Unsupported { name, version } => write!(
                f,
                "{name}: the adapter does not know this request: it speaks version {version} of the control port, this \
                 program version {}",
                control::VERSION
            ),
            Self::BadConfig { name, error } => write!(f, "{name}: the adapter cannot be like that: {error}"),
            Self::Failed { name, failure } => match failure {
                Failure::Flash => write!(f, "{name}: the adapter's flash does not take the configuration"),
                Failure::Busy => write!(f, "{name}: the adapter is busy with another such request: try again"),
                Failure::StreamArmed => write!(f, "{name}: refused while a host streams motion: stop it and try again"),
                Failure::LineHeld => write!(
                    f,
                    "{name}: the host on USB holds the line to the arm: close the program on the adapter's serial port, \
                     or end 'armwire hold'"
                ),
                Failure::TooManySaves { wait_s } => write!(
                    f,
                    "{name}: not saved: so many saves would wear the flash out; the next may come in {wait_s} s"
                ),
                Failure::SupplyLow => write!(
                    f,
                    "{name}: not saved: the adapter's 3.3 V supply is below 2.9 V, too low to write flash"
                ),
            },
            Self::Resolve { name, error } => write!(f, "{name}: no such host ({error}): give its address instead?"),
            Self::Connect { name, error } => {
                write!(f, "{name}: ")?;
                fmt_connect(f, error)
            }
            Self::Closed { name } => write!(
                f,
                "{name}: the connection was closed from there: was the arm switched off, or does it take no more?"
            ),
            Self::Disconnected { name, error } => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut => {
                    write!(f, "{name}: the connection takes no bytes: is the arm still there?")
                }
                _ => write!(f, "{name}: the connection is gone ({error}): was the arm switched off?"),
            },
            Self::Broken {
                name,
                arm,
                offset,
                reason,
            } => write!(
                f,
                "{name}: what arrives there is no message of {arm} (byte {offset}: {reason}): is it this arm, and its \
                 control port?"
            ),
            Self::NoAnswer {
                name,
                arm,
                doubts,
                heard,
            } => {
                write!(f, "{name}: ")?;
                heard.fmt_cause(f, arm, doubts)
            }
            Self::Unacceptable { name, error } => write!(f, "{name}: the arm's answer cannot be accepted: {error}"),
            Self::Refused { name, what } => write!(f, "{name}: {what}"),
            Self::Undecodable { name, offset, reason } => write!(
                f,
                "{name}: the stream is broken at byte {offset}: {reason}: is it one direction of one connection, from its \
                 start?"
            ),
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

fn fmt_connect(f: &mut fmt::Formatter<'_>, error: &io::Error) -> fmt::Result {
    match error.kind() {
        ErrorKind::ConnectionRefused => {
            f.write_str("nothing listens there: is it the arm's address, and has the arm started?")
        }
        ErrorKind::TimedOut | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => write!(
            f,
            "cannot be reached ({error}): is it the arm's address, is the arm on, and is this computer in its network?"
        ),
        _ => write!(f, "cannot be connected to: {error}"),
    }
}

fn fmt_open(f: &mut fmt::Formatter<'_>, port: &str, error: &io::Error) -> fmt::Result {
    match error.kind() {
        // Another program has locked the port, or keeps all others from opening it.
        ErrorKind::WouldBlock | ErrorKind::ResourceBusy if cfg!(unix) => write!(
            f,
            "in use by another program: close that one first ('fuser -v {port}' names it)"
        ),
        ErrorKind::NotFound => fmt_no_such_port(f),
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

fn fmt_no_such_port(f: &mut fmt::Formatter<'_>) -> fmt::Result {
    match port::available().as_slice() {
        [] => write!(f, "no such port, nor any other: is the adapter plugged in?"),
        names => write!(f, "no such port; there are: {}", names.join(", ")),
    }
}

fn fmt_no_such_interface(f: &mut fmt::Formatter<'_>) -> fmt::Result {
    match can::interfaces().as_slice() {
        [] => f.write_str("no such CAN interface, nor any other: 'ip link' lists the interfaces there are"),
        names => write!(f, "no such CAN interface; there are: {}", names.join(", ")),
    }
}

/// `name` is the port's, `can:` and the interface.
fn fmt_can(f: &mut fmt::Formatter<'_>, name: &str, error: &io::Error) -> fmt::Result {
    match error.kind() {
        ErrorKind::NotFound => fmt_no_such_interface(f),
        ErrorKind::NetworkDown => {
            let interface = name.strip_prefix("can:").unwrap_or(name);
            let interface = interface.split('/').next().unwrap_or(interface);
            write!(
                f,
                "the interface is down: 'sudo ip link set {interface} up type can bitrate 1000000' starts it"
            )
        }
        // The kernel's queue is full for so long.
        ErrorKind::StorageFull | ErrorKind::WouldBlock | ErrorKind::TimedOut => write!(
            f,
            "the bus takes no frames: is there another node on it, at the same bit rate, and are both ends terminated?"
        ),
        _ => write!(f, "the CAN interface fails: {error}"),
    }
}

fn fmt_usb(f: &mut fmt::Formatter<'_>, error: &nusb::Error) -> fmt::Result {
    match error.kind() {
        nusb::ErrorKind::PermissionDenied if cfg!(target_os = "linux") => {
            let (vendor, product) = usb::VENDOR_AND_PRODUCT;
            write!(
                f,
                "permission denied for the control port: put 'SUBSYSTEM==\"usb\", ATTR{{idVendor}}==\"{vendor:04x}\", \
                 ATTR{{idProduct}}==\"{product:04x}\", TAG+=\"uaccess\"' in /etc/udev/rules.d/70-armwire.rules, run \
                 'sudo udevadm control --reload', and plug the adapter in again"
            )
        }
        nusb::ErrorKind::Busy => f.write_str("the control port is in use by another program: close that one first"),
        nusb::ErrorKind::Disconnected => f.write_str("the adapter is gone: was it unplugged?"),
        _ => write!(f, "the control port cannot be opened: {error}"),
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
    use super::*;

    fn heard(bytes: &[u8]) -> Heard {
        Heard {
            bytes: bytes.to_vec(),
            count: bytes.len(),
            ..Heard::default()
        }
    }

    fn line(heard: Heard) -> String {
        let problem = Problem::NoAnswer {
            name: "COM3".to_owned(),
            arm: "a Ling arm",
            doubts: "is it on?".to_owned(),
            heard: Box::new(heard),
        };
        problem.to_string()
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
                unknown: Some("command EE function 00: unknown".to_owned()),
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
