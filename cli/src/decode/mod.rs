//! `armwire decode`: the frames in a recording, what they mean, and what is between them.

mod candump;

use std::fs;
use std::io::{Read, Write, stdin, stdout};
use std::path::PathBuf;

use armwire::alpha1::Alpha1;
use armwire::framing::{Reason, Scan};
use armwire::ling::Ling;
use armwire::ling::legacy::{Detector, Legacy};
use armwire::xarm::XArm;
use clap::{Args, ValueEnum};

use crate::args::ArmKind;
use crate::describe::Arm;
use crate::error::Error;
use crate::hex;
use crate::printable::cut;

/// What some editors begin UTF-8 text with.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// The arguments of `armwire decode`.
#[derive(Args)]
pub(crate) struct Decode {
    /// A file with the bytes as they are, or as hexadecimal text such as 'AA 06 00 01 FE 9A FF'; or a log of a CAN bus,
    /// written by 'candump -L'; - is standard input.
    #[arg(default_value = "-")]
    file: PathBuf,
    /// Which arm it is.
    #[arg(long, value_enum, default_value_t)]
    arm: ArmKind,
    /// Whose bytes they are. Frames of ling tell. Those of xarm and alpha1 do not: they are the arm's unless you say
    /// otherwise; what a servo of alpha1 answers would take its request to tell, and is shown as it is.
    #[arg(long, value_enum, value_name = "WHO")]
    from: Option<Speaker>,
}

/// Who says something.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Speaker {
    /// What controls the arm.
    Host,
    /// The arm.
    Arm,
}

/// What is in a recording.
struct Decoded {
    /// One line for each frame and each run of noise, and one for the sum.
    lines: Vec<String>,
    /// Where and why the stream broke, on a line that loses nothing.
    broken: Option<(usize, Reason)>,
}

impl Decode {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let (name, input) = self.read()?;
        let decoded = decode_input(&name, &input, self.arm, self.from)?;
        print(&decoded.lines)?;
        match decoded.broken {
            Some((offset, reason)) => Err(Error::at(
                &name,
                format_args!(
                    "the stream is broken at byte {offset}: {reason}: is it one direction of one connection, from its start?"
                ),
            )),
            None => Ok(()),
        }
    }

    fn read(&self) -> Result<(String, Vec<u8>), Error> {
        let mut input = Vec::new();
        let (name, result) = if self.file.as_os_str() == "-" {
            let result = stdin().read_to_end(&mut input).map(|_| input);
            ("standard input".to_owned(), result)
        } else {
            (self.file.display().to_string(), fs::read(&self.file))
        };
        match result {
            Ok(input) => Ok((name, input)),
            Err(error) => Err(Error::at(&name, error)),
        }
    }
}

/// What `armwire decode` prints of a recording: lines for frames and what is between them, the last of them the sum.
///
/// # Errors
///
/// What it says of an input that means nothing.
pub fn decode(input: &[u8], arm: ArmKind, from: Option<Speaker>) -> Result<Vec<String>, String> {
    match decode_input("input", input, arm, from) {
        Ok(decoded) => Ok(decoded.lines),
        Err(problem) => Err(problem.to_string()),
    }
}

fn decode_input(name: &str, input: &[u8], arm: ArmKind, from: Option<Speaker>) -> Result<Decoded, Error> {
    let bytes = match input.strip_prefix(BYTE_ORDER_MARK).unwrap_or(input) {
        text if may_be_text(text) && candump::is_log(text) => {
            let lines = decode_log(name, &String::from_utf8_lossy(text), arm)?;
            return Ok(Decoded { lines, broken: None });
        }
        text if may_be_text(text) => &parse_hex(name, text)?,
        _ => input,
    };
    Ok(match arm {
        ArmKind::Ling => decode_ling(bytes, from),
        ArmKind::Xarm => decode_line::<XArm>(bytes, from.or(Some(Speaker::Arm))),
        ArmKind::Alpha1 => decode_line::<Alpha1>(bytes, from.or(Some(Speaker::Arm))),
    })
}

/// A log of a CAN bus, on which there is no xArm.
fn decode_log(name: &str, text: &str, arm: ArmKind) -> Result<Vec<String>, Error> {
    let lines = match arm {
        ArmKind::Ling => candump::decode::<Ling>(text),
        ArmKind::Alpha1 => candump::decode::<Alpha1>(text),
        ArmKind::Xarm => return Err(Error::Usage("an xarm is not on a CAN bus".to_owned())),
    };
    lines.map_err(|(line, text)| {
        let text = cut(&text);
        let what = format!("line {line}: '{text}' is not such as (1.000000) can0 600#0201FE, as 'candump -L' writes");
        Error::at(name, what)
    })
}

fn print(lines: &[String]) -> Result<(), Error> {
    let mut out = stdout().lock();
    lines
        .iter()
        .try_for_each(|line| writeln!(out, "{line}"))
        .map_err(Error::Output)
}

/// Whether it may be hexadecimal text. No recording is taken for it, for every frame has a byte that no such text has:
/// AA in those of ling, ED of alpha1, 00 of xarm.
fn may_be_text(input: &[u8]) -> bool {
    input.is_ascii() && !input.contains(&0)
}

/// The bytes that hexadecimal text means.
fn parse_hex(name: &str, text: &[u8]) -> Result<Vec<u8>, Error> {
    let text = String::from_utf8_lossy(text);
    let mut bytes = Vec::new();
    for (i, line) in text.lines().enumerate() {
        bytes.extend(hex::parse(line).map_err(|word| {
            let (line, word) = (i + 1, cut(word));
            Error::at(
                name,
                format_args!("line {line}: '{word}' is not a byte or bytes in hexadecimal"),
            )
        })?);
    }
    Ok(bytes)
}

/// The frames of a recording of a Ling arm, which may be of the older generation.
fn decode_ling(bytes: &[u8], from: Option<Speaker>) -> Decoded {
    let Some(legacy) = Detector::new().hear(bytes) else {
        return decode_line::<Ling>(bytes, from);
    };
    let mut decoded = decode_line::<Legacy>(bytes, from);
    decoded.lines.insert(0, format!("This is {legacy}"));
    decoded
}

/// The frames of a recording, and what is between them.
fn decode_line<P: Arm>(bytes: &[u8], from: Option<Speaker>) -> Decoded {
    let arm = P::default();
    let expect = expected(&arm, from);
    let mut lines = Vec::new();
    let mut broken = None;
    let (mut frames, mut noise_bytes, mut padding, mut offset) = (0, 0, 0, 0);
    // The end of the last damaged frame: its bytes are not shown again as noise.
    let mut damaged = 0;
    while offset < bytes.len() {
        let rest = &bytes[offset..];
        // The end of the recording is as good as an idle line.
        let (len, reason) = match arm.scan_idle(rest, expect) {
            Scan::Frame(len) => {
                lines.push(entry(offset, &rest[..len], &meaning(&arm, &rest[..len], expect, from)));
                frames += 1;
                offset += len;
                continue;
            }
            Scan::Padding(len) => {
                padding += len;
                offset += len;
                continue;
            }
            Scan::Noise(_, Reason::Stray) => (stray(&arm, rest, expect), Reason::Stray),
            Scan::Noise(len, reason) if len > rest.len() => {
                let text = format!("noise: {reason}; the recording ends within it");
                lines.push(entry(offset, rest, &text));
                noise_bytes += rest.len();
                break;
            }
            Scan::Noise(len, reason) => (len, reason),
            Scan::Broken(reason) => {
                let len = decided(&arm, rest, expect);
                lines.push(entry(offset, &rest[..len], &format!("noise: {reason}")));
                broken = Some((offset, reason));
                noise_bytes += len;
                offset += len;
                break;
            }
            Scan::Need(_) => {
                lines.push(entry(offset, rest, "the recording ends within a frame"));
                noise_bytes += rest.len();
                break;
            }
        };
        let (mut start, mut end) = (offset, offset + len);
        match reason {
            // All of it is shown, though but its first byte is given up: what follows may be a frame.
            Reason::Checksum { .. } => {
                end = offset + decided(&arm, rest, expect);
                damaged = damaged.max(end);
            }
            Reason::Stray => start = start.max(damaged),
            _ => {}
        }
        if start < end {
            lines.push(entry(start, &bytes[start..end], &format!("noise: {reason}")));
        }
        noise_bytes += len;
        offset += len;
    }
    let mut sum = format!("bytes: {}, frames: {frames}, noise bytes: {noise_bytes}", bytes.len());
    if padding > 0 {
        sum += &format!(", filling: {padding}");
    }
    if broken.is_some() {
        sum += &format!(", not read: {}", bytes.len() - offset);
    }
    lines.push(sum);
    Decoded { lines, broken }
}

fn entry(offset: usize, bytes: &[u8], text: &str) -> String {
    format!("{offset:8}  {}\n          {text}", hex::show(bytes))
}

/// The expectation of a decoder that hears this side of the line.
fn expected<P: Arm>(arm: &P, from: Option<Speaker>) -> P::Expect {
    match from {
        Some(Speaker::Host) => arm.requests(),
        Some(Speaker::Arm) | None => arm.unsolicited(),
    }
}

/// How many bytes at the front are stray.
fn stray<P: Arm>(arm: &P, bytes: &[u8], expect: P::Expect) -> usize {
    let mut len = 0;
    while len < bytes.len()
        && let Scan::Noise(n, Reason::Stray) = arm.scan(&bytes[len..], expect)
    {
        len += n;
    }
    len
}

/// How many bytes it took to say what the front is: all of a frame that is damaged.
fn decided<P: Arm>(arm: &P, bytes: &[u8], expect: P::Expect) -> usize {
    let undecided = |&len: &usize| matches!(arm.scan(&bytes[..len], expect), Scan::Need(_));
    (1..bytes.len()).take_while(undecided).count() + 1
}

fn meaning<P: Arm>(arm: &P, frame: &[u8], expect: P::Expect, from: Option<Speaker>) -> String {
    let envelope = P::envelope(frame);
    let request = arm.parse_request(frame);
    let request = request.map(|request| format!("to the arm: {}{envelope}", P::show_request(&request)));
    let response = arm.parse_response(frame, expect);
    let response = response.map(|response| format!("from the arm: {}{envelope}", P::show_response(&response)));
    match (from, request, response) {
        (Some(Speaker::Host), Ok(text), _) | (Some(Speaker::Arm), _, Ok(text)) => text,
        (Some(Speaker::Host), Err(error), _) | (Some(Speaker::Arm), _, Err(error)) => format!("no message: {error}"),
        (None, Ok(text), _) | (None, _, Ok(text)) => text,
        (None, Err(request), Err(response)) => format!("no message: as a request, {request}; as an answer, {response}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(bytes: &[u8]) -> Vec<String> {
        decode_line::<Ling>(bytes, None).lines
    }

    #[test]
    fn frames_and_noise_are_told_with_their_offsets() {
        let mut bytes = vec![0x11, 0xAA, 0x06];
        bytes.extend([0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]);
        bytes.extend([0xAA, 0x04, 0x0E, 0x01, 0x01, 0x96, 0xFF, 0xAA, 0x01]);
        let lines = lines(&bytes);
        assert!(lines[0].starts_with("       0  11\n"));
        assert!(
            lines
                .iter()
                .any(|line| line.starts_with("       3  AA 06 00") && line.ends_with("read joints"))
        );
        assert!(lines.iter().any(|line| line.ends_with("from the arm: stroke: 75 mm")));
        assert_eq!(lines.last().unwrap(), "bytes: 19, frames: 2, noise bytes: 5");
    }

    #[test]
    fn a_damaged_frame_is_shown_whole_and_once_and_a_frame_inside_it_too() {
        let damaged = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9B, 0xFF];
        assert_eq!(
            lines(&[&damaged[..], &[0x11]].concat()),
            [
                "       0  AA 06 00 01 FE 9B FF\n          noise: checksum 0x9b, expected 0x9a",
                "       7  11\n          noise: no frame starts here",
                "bytes: 8, frames: 0, noise bytes: 8"
            ]
        );
        let good = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
        let lines = lines(&[&[0xAA, 0x06, 0x00, 0x05], &good[..]].concat());
        assert!(lines[0].starts_with("       0  AA 06 00 05 AA 06 00 01 FE 9A FF\n"));
        assert!(lines[1].starts_with("       4  AA 06 00 01 FE 9A FF\n"));
        assert_eq!(lines[2], "bytes: 11, frames: 1, noise bytes: 4");
    }

    #[test]
    fn whose_bytes_they_are_decides_what_frames_are() {
        let bytes = [0xF2, 0x2F, 0xAA, 0xED, 0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED];
        let lines = |from| decode_line::<Alpha1>(&bytes, Some(from)).lines;
        let of_arm = lines(Speaker::Arm);
        assert_eq!(of_arm[0], "       0  F2 2F AA ED\n          from the arm: stop: done");
        assert_eq!(
            of_arm.last().unwrap(),
            "bytes: 14, frames: 1, noise bytes: 3, filling: 7"
        );
        let of_host = lines(Speaker::Host);
        assert!(of_host.contains(&"       4  F2 2F 00 00 00 00 00 00 00 ED\n          to the arm: stop".to_owned()));
        assert_eq!(of_host.last().unwrap(), "bytes: 14, frames: 1, noise bytes: 4");
    }

    #[test]
    fn what_a_servo_answers_is_not_guessed() {
        let offset_or_what = [0xFA, 0xAF, 1, 0xAA, 0, 0, 0, 0, 0xAB, 0xED];
        let lines = decode_line::<Alpha1>(&[&offset_or_what[..], &[0xAB]].concat(), Some(Speaker::Arm)).lines;
        assert!(lines[0].ends_with("no message: command FA: an answer of a servo, but none is expected"));
        assert_eq!(lines[1], "      10  AB\n          noise: no frame starts here");
    }

    #[test]
    fn reports_on_usb_hid_are_filled_up_without_noise() {
        let mut report = [0; 64];
        report[..4].copy_from_slice(&[0xF3, 0x3F, 0xEE, 0xED]);
        let lines = decode_line::<Alpha1>(&[report; 2].concat(), Some(Speaker::Arm)).lines;
        assert!(lines[0].ends_with("from the arm: play: failed"));
        assert!(lines[1].starts_with("      64  F3 3F EE ED\n"));
        assert_eq!(lines[2], "bytes: 128, frames: 2, noise bytes: 0, filling: 120");
    }

    #[test]
    fn hexadecimal_text_is_understood_in_its_usual_forms() {
        for text in ["AA 06 00", "aa0600", "0xAA,0x06, 0x00", "aa:06:00", "AA\n06\r\n\n00\n"] {
            assert_eq!(parse_hex("-", text.as_bytes()).unwrap(), [0xAA, 0x06, 0x00], "{text}");
        }
    }

    #[test]
    fn what_is_not_hexadecimal_is_told_with_its_line() {
        for (text, line, word) in [("AA\n0G", 2, "0G"), ("AAA", 1, "AAA"), ("+1", 1, "+1")] {
            let error = parse_hex("log", text.as_bytes()).unwrap_err().to_string();
            assert!(
                error.starts_with(&format!("log: line {line}: '{word}' is not")),
                "{error}"
            );
        }
    }
}
