//! `armwire decode`: the frames in a recording, what they mean, and what is between them.

use std::fs;
use std::io::{Read, Write, stdin, stdout};
use std::path::PathBuf;

use armwire::ling::{Frame, Ling, MAX_FRAME, OVERHEAD};
use armwire::{Decoder, Noise, Protocol, Reason};
use clap::Args;

use crate::describe::{self, hex};
use crate::problem::Problem;

/// Where a frame says how many data bytes it has.
const LENGTH: usize = 3;
/// What some editors begin UTF-8 text with.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// The arguments of `armwire decode`.
#[derive(Args)]
pub(crate) struct Decode {
    /// A file with the bytes as they are, or as hexadecimal text such as 'AA 06 00 01 FE 9A FF'; - is standard input.
    #[arg(default_value = "-")]
    file: PathBuf,
}

impl Decode {
    pub(crate) fn run(&self) -> Result<(), Problem> {
        let (name, input) = self.read()?;
        // A recording of a line is never all ASCII, for every frame begins with AA.
        let bytes = match input.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&input) {
            text if text.is_ascii() => parse_hex(&name, text)?,
            _ => input,
        };
        let mut out = stdout().lock();
        for line in lines(&bytes) {
            writeln!(out, "{line}").map_err(Problem::Output)?;
        }
        Ok(())
    }

    fn read(&self) -> Result<(String, Vec<u8>), Problem> {
        let mut input = Vec::new();
        let (name, result) = if self.file.as_os_str() == "-" {
            let result = stdin().read_to_end(&mut input).map(|_| input);
            ("standard input".to_owned(), result)
        } else {
            (self.file.display().to_string(), fs::read(&self.file))
        };
        match result {
            Ok(input) => Ok((name, input)),
            Err(error) => Err(Problem::Input { name, error }),
        }
    }
}

/// The bytes that hexadecimal text means: pairs of digits, with or without white space, commas, colons and 0x.
fn parse_hex(name: &str, text: &[u8]) -> Result<Vec<u8>, Problem> {
    let text = String::from_utf8_lossy(text);
    let mut bytes = Vec::new();
    for (i, line) in text.lines().enumerate() {
        for word in line.split([' ', '\t', ',', ':']).filter(|word| !word.is_empty()) {
            let digits = word.strip_prefix("0x").or(word.strip_prefix("0X")).unwrap_or(word);
            let pair = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok();
            let word_bytes: Option<Vec<u8>> = match digits.as_bytes().as_chunks::<2>() {
                (pairs, []) if digits.bytes().all(|digit| digit.is_ascii_hexdigit()) => {
                    pairs.iter().map(|digits| pair(digits)).collect()
                }
                _ => None,
            };
            bytes.extend(word_bytes.ok_or_else(|| Problem::Text {
                name: name.to_owned(),
                line: i + 1,
                word: word.to_owned(),
            })?);
        }
    }
    Ok(bytes)
}

/// One line for each frame and each run of noise, and one for the sum.
fn lines(bytes: &[u8]) -> Vec<String> {
    let mut lines = Vec::new();
    let (mut frames, mut noise_bytes, mut offset) = (0, 0, 0);
    // The end of the last damaged frame: its bytes are not shown again as noise.
    let mut damaged = 0;
    let mut decoder = Decoder::<Ling, MAX_FRAME>::new();
    let mut rest = bytes;
    loop {
        let noise = match decoder.next(()) {
            Some(Ok(frame)) => {
                let len = frame.data.len() + OVERHEAD;
                lines.push(format!(
                    "{offset:8}  {}\n          {}",
                    hex(&bytes[offset..offset + len]),
                    meaning(frame)
                ));
                frames += 1;
                offset += len;
                continue;
            }
            Some(Err(noise)) => noise,
            None if !rest.is_empty() => {
                rest = decoder.push(rest);
                continue;
            }
            // The end of the recording is as good as an idle line.
            None => match decoder.idle(()) {
                Some(noise) => noise,
                None => break,
            },
        };
        let Noise { len, reason, .. } = noise;
        let (mut start, mut end) = (offset, offset + len);
        match reason {
            // All of it is shown, though the decoder drops but its header and looks for a frame inside.
            Reason::Checksum { .. } => {
                end = bytes.len().min(offset + usize::from(bytes[offset + LENGTH]) + OVERHEAD);
                damaged = damaged.max(end);
            }
            Reason::Stray => start = start.max(damaged),
            _ => {}
        }
        if start < end {
            lines.push(format!(
                "{start:8}  {}\n          noise: {reason}",
                hex(&bytes[start..end])
            ));
        }
        noise_bytes += len;
        offset += len;
    }
    lines.push(format!(
        "bytes: {}, frames: {frames}, noise bytes: {noise_bytes}",
        bytes.len()
    ));
    lines
}

fn meaning(frame: Frame<'_>) -> String {
    match (Ling::parse_request(frame), Ling::parse_response(frame, ())) {
        (Ok(request), _) => format!("to the arm: {}", describe::request(&request)),
        (_, Ok(response)) => format!("from the arm: {}", describe::response(&response)),
        (Err(request), Err(response)) => format!("no message: as a request, {request}; as an answer, {response}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert!(
            lines
                .iter()
                .any(|line| line.ends_with("from the arm: gripper stroke 75 mm"))
        );
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
