//! The jumper check: bytes sent at TX must come back at RX, and no others.
//!
//! Only read requests are sent, each at the rate of the arm that would understand it. Nothing more is sent if anything
//! but the same bytes comes back.

use std::time::Duration;

use armwire::{alpha1, ling};
use armwire_bridge::LineCoding;

use super::bench::{Bench, payload};
use super::report::{Passed, Trouble, ensure};
use super::usb::Pipe;
use crate::hex;

/// Listening time at each rate, before anything is sent. Older Ling arms transmit unsolicited.
const LISTEN_TIME: Duration = Duration::from_millis(300);
/// Timeout of an arm's response.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(200);
/// Maximum bytes of a response in a message.
const SHOWN: usize = 24;

/// Rates of unsolicited transmissions: those of Ling arms (the second only of older ones) and of Alpha1.
const RATES: [u32; 3] = [1_000_000, 921_600, 115_200];

/// The arms that answer a request, their rates, and a read request. Older Ling arms answer no request. The bus of
/// Alpha1's servos has one wire, and a two-wire UART receives no answer from it.
const ARMS: [(&str, u32, &[u8]); 2] = [
    ("a Ling arm", 1_000_000, &ling::READ_INFO),
    ("an Alpha1", 115_200, &alpha1::READ_FIRMWARE_VERSION),
];

/// Detects the jumper, or an arm in its place.
pub(super) fn find(bench: &mut Bench<'_>) -> Result<Passed, Trouble> {
    for baud in RATES {
        bench.set_line(at_baud(baud))?;
        let unsolicited = listen(bench, LISTEN_TIME)?;
        ensure(
            unsolicited.is_empty(),
            format_args!(
                "bytes arrive at {baud} baud though none were sent ({}): disconnect the arm and join TX and RX with a jumper",
                shown(&unsolicited)
            ),
        )?;
    }
    for (arm, baud, request) in ARMS {
        bench.set_line(at_baud(baud))?;
        bench.usb.send(Pipe::Port, request)?;
        let received = listen(bench, ANSWER_TIMEOUT)?;
        ensure(
            !received.is_empty(),
            "no bytes come back: disconnect the arm and join TX and RX with a jumper",
        )?;
        ensure(
            received == request,
            format_args!(
                "other bytes than those sent come back ({}): is it {arm}? Disconnect it and join TX and RX with a jumper",
                shown(&received)
            ),
        )?;
    }
    is_there(bench)?;
    Ok(Passed::new("TX and RX are joined, and no arm answers".to_owned(), []))
}

/// Checks that the jumper is still in place.
pub(super) fn is_there(bench: &mut Bench<'_>) -> Result<(), Trouble> {
    bench.set_line(LineCoding::LING)?;
    bench.echo(&payload(1, 64))?;
    Ok(())
}

/// The bytes received within this time.
fn listen(bench: &mut Bench<'_>, span: Duration) -> Result<Vec<u8>, Trouble> {
    let until = bench.usb.now() + span;
    let mut received = Vec::new();
    loop {
        let left = until.saturating_sub(bench.usb.now());
        if left.is_zero() {
            return Ok(received);
        }
        received.extend(bench.usb.receive(Pipe::Port, left)?);
    }
}

fn at_baud(baud: u32) -> LineCoding {
    LineCoding {
        baud,
        ..LineCoding::LING
    }
}

/// The first of these bytes as text.
fn shown(bytes: &[u8]) -> String {
    let more = if bytes.len() > SHOWN { " …" } else { "" };
    hex::show(&bytes[..bytes.len().min(SHOWN)]) + more
}
