//! The jumper: whether what goes out at PA2 comes back at PA3, and nothing else does.
//!
//! Only requests that read go out, each at the rate of the arm that would understand it. A line on which anything but the
//! same bytes comes back gets nothing more.

use std::time::Duration;

use armwire::{alpha1, ling};
use armwire_bridge::LineCoding;

use super::bench::{Bench, payload};
use super::report::{Passed, Trouble};
use super::usb::Pipe;
use crate::hex;

/// How long the line is listened to before anything is sent, at each rate. Older Ling arms talk unasked.
const LISTEN: Duration = Duration::from_millis(300);
/// How long an arm may take for an answer.
const ANSWER: Duration = Duration::from_millis(200);
/// Bytes of an answer that are shown.
const SHOWN: usize = 24;

/// The rates at which an arm may talk unasked: those of Ling arms, the second only of older ones, and of Alpha1.
const RATES: [u32; 3] = [1_000_000, 921_600, 115_200];

/// The arms that answer a request, their rates, and a request that changes nothing. Older Ling arms have none, and the bus of
/// Alpha1's servos has one wire, on which nothing comes back to a UART with two.
const ARMS: [(&str, u32, &[u8]); 2] = [
    ("a Ling arm", 1_000_000, &ling::READ_INFO),
    ("an Alpha1", 115_200, &alpha1::READ_FIRMWARE_VERSION),
];

/// Looks for the jumper, and for an arm in its place.
pub(super) fn find(bench: &mut Bench<'_>) -> Result<Passed, Trouble> {
    for baud in RATES {
        bench.set_line(at_baud(baud))?;
        let unasked = listen(bench, LISTEN)?;
        if !unasked.is_empty() {
            return Err(Trouble::Failed(format!(
                "bytes come at {baud} baud though none are sent ({}): take the arm off, and put a jumper from PA2 to PA3",
                shown(&unasked)
            )));
        }
    }
    for (arm, baud, request) in ARMS {
        bench.set_line(at_baud(baud))?;
        bench.usb.send(Pipe::Port, request)?;
        let came = listen(bench, ANSWER)?;
        if came.is_empty() {
            return Err(Trouble::Failed(
                "nothing comes back: take the arm off, and put a jumper from PA2 to PA3".to_owned(),
            ));
        }
        if came != request {
            return Err(Trouble::Failed(format!(
                "not what was sent comes back ({}): is it {arm}? Take it off, and put a jumper from PA2 to PA3",
                shown(&came)
            )));
        }
    }
    is_there(bench)?;
    Ok(Passed::new("PA2 and PA3 are joined, and no arm answers".to_owned(), []))
}

/// Whether the jumper is still there.
pub(super) fn is_there(bench: &mut Bench<'_>) -> Result<(), Trouble> {
    bench.set_line(LineCoding::LING)?;
    bench.echo(&payload(1, 64))?;
    Ok(())
}

/// What comes within this time.
fn listen(bench: &mut Bench<'_>, span: Duration) -> Result<Vec<u8>, Trouble> {
    let until = bench.usb.now() + span;
    let mut came = Vec::new();
    loop {
        let left = until.saturating_sub(bench.usb.now());
        if left.is_zero() {
            return Ok(came);
        }
        came.extend(bench.usb.receive(Pipe::Port, left)?);
    }
}

fn at_baud(baud: u32) -> LineCoding {
    LineCoding {
        baud,
        ..LineCoding::LING
    }
}

/// The first of these bytes, for people.
fn shown(bytes: &[u8]) -> String {
    let more = if bytes.len() > SHOWN { " …" } else { "" };
    hex::show(&bytes[..bytes.len().min(SHOWN)]) + more
}
