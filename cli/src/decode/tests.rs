//! Recordings and logs, decoded whole and in pieces.

mod files;
mod units;

use std::fmt;
use std::io::{self, Write};

use armwire::ling::legacy::{Firmware, JointState, Legacy, Response, SERVOS};
use armwire::messages::Messages;

use super::output::Item;
use super::*;

/// A source that returns at most this number of bytes at a time.
pub(super) struct Pieces<'a>(pub(super) &'a [u8], pub(super) usize);

impl Read for Pieces<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let n = self.1.min(bytes.len()).min(self.0.len());
        bytes[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
        Ok(n)
    }
}

/// A line whose logs are those of the program that controls the arm.
pub(super) fn line(arm: ArmKind, from: Option<Speaker>) -> Line {
    let tx = Speaker::Host;
    Line { arm, from, tx }
}

/// The entries of a recording, and the error if there is one. Both are the same for pieces of any size.
pub(super) fn printed(
    recording: &[u8],
    format: Option<Format>,
    arm: ArmKind,
    from: Option<Speaker>,
) -> (Vec<String>, Option<String>) {
    let read = |piece| {
        let out = Entries::default();
        let head = Head::new("log".to_owned(), Box::new(Pieces(recording, piece)), &out);
        let decoded = decode_recording(head, &out, format, line(arm, from));
        (out.into_lines(), decoded.err().map(|problem| problem.to_string()))
    };
    let whole = read(usize::MAX);
    for piece in [1, 2, 7, 1000] {
        assert_eq!(read(piece), whole, "in pieces of {piece}");
    }
    whole
}

/// The entries of a recording of bytes.
fn of_line(bytes: &[u8], arm: ArmKind, from: Option<Speaker>) -> Vec<String> {
    let (lines, error) = printed(bytes, Some(Format::Raw), arm, from);
    assert_eq!(error, None);
    lines
}

fn lines(bytes: &[u8]) -> Vec<String> {
    of_line(bytes, ArmKind::Ling, None)
}

#[test]
fn frames_and_noise_have_their_offsets() {
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
fn damaged_frames_are_shown_once_with_inner_frames() {
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
fn sender_decides_the_meaning_of_frames() {
    let bytes = [0xF2, 0x2F, 0xAA, 0xED, 0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED];
    let lines = |from| of_line(&bytes, ArmKind::Alpha1, Some(from));
    let of_arm = lines(Speaker::Arm);
    assert_eq!(of_arm[0], "       0  F2 2F AA ED\n          from the arm: stop: done");
    assert_eq!(
        of_arm.last().unwrap(),
        "bytes: 14, frames: 1, noise bytes: 3, padding bytes: 7"
    );
    let of_host = lines(Speaker::Host);
    assert!(of_host.contains(&"       4  F2 2F 00 00 00 00 00 00 00 ED\n          to the arm: stop".to_owned()));
    assert_eq!(of_host.last().unwrap(), "bytes: 14, frames: 1, noise bytes: 4");
}

#[test]
fn answer_of_a_servo_is_not_guessed() {
    let offset_or_what = [0xFA, 0xAF, 1, 0xAA, 0, 0, 0, 0, 0xAB, 0xED];
    let lines = of_line(
        &[&offset_or_what[..], &[0xAB]].concat(),
        ArmKind::Alpha1,
        Some(Speaker::Arm),
    );
    assert!(lines[0].ends_with("no message: command FA: an answer of a servo, but none is expected"));
    assert_eq!(lines[1], "      10  AB\n          noise: no frame starts here");
}

/// A frame on the servo bus of an Alpha1: row and data.
fn servo_frame(row: u8, data: [u8; 6]) -> Vec<u8> {
    let sum = data.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    [&[row, row.rotate_left(4)][..], &data, &[sum, 0xED]].concat()
}

#[test]
fn servo_bus_is_decoded_in_both_directions() {
    let conversation = [
        servo_frame(0xFA, [3, 1, 90, 50, 0, 50]),
        vec![0xAD],
        servo_frame(0xFA, [3, 2, 0, 0, 0, 0]),
        servo_frame(0xFA, [3, 0xAA, 0, 90, 0, 88]),
        servo_frame(0xFA, [3, 0xD4, 0, 0, 0, 0]),
        servo_frame(0xFA, [3, 0xAA, 0, 0, 0, 6]),
        servo_frame(0xFA, [3, 0xCD, 0, 4, 0, 0]),
        servo_frame(0xFA, [4, 0xAA, 0, 3, 0, 0]),
        servo_frame(0xFC, [4, 1, 0, 0, 0, 0]),
        servo_frame(0xFC, [4, 0xAA, 1, 2, 3, 4]),
        servo_frame(0xFA, [0, 1, 0xFF, 0, 0, 0]),
    ];
    let lines = of_line(&conversation.concat(), ArmKind::Alpha1Servo, None);
    let meanings: Vec<_> = lines
        .iter()
        .filter_map(|line| line.split("\n          ").nth(1))
        .collect();
    assert_eq!(
        meanings,
        [
            "to the arm: move servo 3 to 90° in 1 s, completion time 1 s",
            "from the arm: servo 3: understood",
            "to the arm: read angles of servo 3, and release it",
            "from the arm: servo 3: released, at 88°, sent to 90°",
            "to the arm: read offset of servo 3",
            "from the arm: servo 3: offset +2.00°",
            "to the arm: change id of servo 3 to 4",
            "from the arm: servo 4: was 3",
            "to the arm: read version of servo 4",
            "from the arm: servo 4: version 01 02 03 04",
            "to the arm: release all servos",
        ]
    );
    assert_eq!(lines.last().unwrap(), "bytes: 101, frames: 11, noise bytes: 0");
}

#[test]
fn servo_answers_without_their_request_are_ambiguous() {
    let answer = servo_frame(0xFA, [3, 0xAA, 0, 0, 0, 6]);
    let other = servo_frame(0xFA, [5, 0xD4, 0, 0, 0, 0]);
    let acknowledged = servo_frame(0xFA, [3, 4, 1, 0, 0, 0]);
    for before in [vec![], other, acknowledged] {
        let lines = of_line(&[&before[..], &answer].concat(), ArmKind::Alpha1Servo, None);
        let text = "no message: an answer of servo 3, ambiguous: its request is not before it";
        assert!(lines.iter().any(|line| line.ends_with(text)), "{lines:?}");
    }
    let (_, error) = printed(&answer, None, ArmKind::Alpha1Servo, Some(Speaker::Arm));
    assert!(error.unwrap().contains("one wire has both directions"));
}

#[test]
fn bytes_after_documented_fields_are_shown() {
    let frame = [0xAA, 0x04, 0x0E, 0x03, 0x02, 0x07, 0x08, 0xA1, 0xFF];
    let lines = lines(&frame);
    assert_eq!(
        lines[0],
        "       0  AA 04 0E 03 02 07 08 A1 FF\n          from the arm: stroke: 100 mm, extra: 07 08"
    );
}

#[test]
fn error_frame_is_shown_with_its_bytes() {
    let frame = [0xAA, 0xEE, 0x00, 0x02, 0x01, 0x03, 0x36, 0xFF];
    for from in [None, Some(Speaker::Arm)] {
        assert_eq!(
            of_line(&frame, ArmKind::Ling, from)[0],
            "       0  AA EE 00 02 01 03 36 FF\n          from the arm: error frame AA EE 00 02 01 03 36 FF"
        );
    }
}

#[test]
fn hid_report_padding_is_no_noise() {
    let mut report = [0; 64];
    report[..4].copy_from_slice(&[0xF3, 0x3F, 0xEE, 0xED]);
    let lines = of_line(&[report; 2].concat(), ArmKind::Alpha1, Some(Speaker::Arm));
    assert!(lines[0].ends_with("from the arm: play: failed"));
    assert!(lines[1].starts_with("      64  F3 3F EE ED\n"));
    assert_eq!(lines[2], "bytes: 128, frames: 2, noise bytes: 0, padding bytes: 120");
}

#[test]
fn endless_stray_bytes_are_shown_in_parts() {
    let lines = lines(&[0x11; 2500]);
    let places: Vec<_> = lines
        .iter()
        .map(|line| line.split_whitespace().next().unwrap())
        .collect();
    assert_eq!(places, ["0", "1024", "2048", "bytes:"]);
    assert_eq!(lines[3], "bytes: 2500, frames: 0, noise bytes: 2500");
}

#[test]
fn stray_bytes_are_joined_whatever_they_might_begin() {
    let lines = of_line(&[0x11, 0xFB, 0x22, 0x00], ArmKind::Alpha1, Some(Speaker::Arm));
    assert_eq!(lines[0], "       0  11 FB 22\n          noise: no frame starts here");
    assert_eq!(lines[1], "bytes: 4, frames: 0, noise bytes: 3, padding bytes: 1");
}

#[test]
fn overlong_frame_is_shown_as_a_whole() {
    let frame = [&[0, 1, 0, 2, 1, 0][..], &[7; 256]].concat();
    let heartbeat = [0, 0, 0, 1, 0, 2, 0, 0];
    let of_arm = |bytes: &[u8]| of_line(bytes, ArmKind::Xarm, Some(Speaker::Arm));
    let lines = of_arm(&[&frame[..], &frame, &heartbeat].concat());
    for (line, offset) in lines.iter().zip(["       0 ", "     262 "]) {
        assert!(line.starts_with(offset) && line.matches(" 07").count() == 256, "{line}");
        assert!(line.ends_with("noise: length field is 256, must be 2..=254"), "{line}");
    }
    assert_eq!(lines[3], "bytes: 532, frames: 1, noise bytes: 524");
    let lines = of_arm(&frame[..100]);
    assert!(lines[0].ends_with("noise: length field is 256, must be 2..=254; the recording ends within it"));
    assert_eq!(lines[1], "bytes: 100, frames: 0, noise bytes: 100");
}

#[test]
fn broken_stream_is_shown_up_to_its_break() {
    let (lines, error) = printed(
        &[0, 1, 0, 9, 7, 7],
        Some(Format::Raw),
        ArmKind::Xarm,
        Some(Speaker::Arm),
    );
    assert_eq!(
        lines,
        [
            "       0  00 01 00 09\n          noise: byte 3 is 0x09, expected 0x00 or 0x01 or 0x02 or 0x03",
            "bytes: 4, frames: 0, noise bytes: 4, the rest not read"
        ]
    );
    assert!(error.unwrap().starts_with("log: "));
}

#[test]
fn legacy_arm_is_recognised_after_noise() {
    let state = JointState {
        firmware: Firmware::V6_0,
        servos: [2048; SERVOS],
    };
    let mut frame = [0; 64];
    let n = Legacy
        .encode_response(&Response::Joints(state), None, &mut frame)
        .unwrap();
    let lines = lines(&[&[0x11; 1500][..], &frame[..n].repeat(3)].concat());
    assert!(
        lines[0].starts_with("This is a Ling arm of the older generation"),
        "{lines:?}"
    );
    assert!(
        lines[3].ends_with("from the arm: joints: +0.00° +0.00° +0.00° +0.00° +0.00° +0.00°"),
        "{lines:?}"
    );
    assert_eq!(
        lines.last().unwrap(),
        &format!("bytes: {}, frames: 3, noise bytes: 1500", 1500 + 3 * n)
    );
}

/// An output that keeps nothing.
pub(super) struct Nowhere;

impl Output for Nowhere {
    fn item(&self, item: &Item<'_>) {
        write!(io::sink(), "{item}").unwrap();
    }

    fn remark(&self, text: fmt::Arguments<'_>) {
        write!(io::sink(), "{text}").unwrap();
    }
}

#[test]
fn memory_does_not_grow_with_a_recording() {
    /// Maximum memory, in bytes. The buffers of input, bytes and window take half of it.
    const MAX_MEMORY: u64 = 512 * 1024;
    const TOTAL: usize = 1024 * 1024;
    let state = [0, 9, 0, 2, 0, 3, 13, 0x10, 4];
    let heartbeat = [0, 0, 0, 1, 0, 2, 0, 0];
    let longest = [&[0, 1, 0, 2, 1, 0, 1, 0x10][..], &[b'x'; 254]].concat();
    let stopped = [0xF2, 0x2F, 0xAA, 0xED];
    let hardware = *b"\xF1\x1F\x0CAlpha1_V2.0h\xED";
    let joints = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
    let damaged = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9B, 0xFF];
    for (arm, from, stream) in [
        (ArmKind::Xarm, Speaker::Arm, [&state[..], &longest].concat()),
        (ArmKind::Xarm, Speaker::Host, heartbeat.to_vec()),
        (
            ArmKind::Alpha1,
            Speaker::Arm,
            [&stopped[..], &hardware, &[0; 44]].concat(),
        ),
        (ArmKind::Alpha1, Speaker::Host, vec![0xF3, 0x3F, 60]),
        (ArmKind::Alpha1, Speaker::Arm, vec![0]),
        (ArmKind::Alpha1, Speaker::Arm, vec![0x11]),
        (ArmKind::Alpha1, Speaker::Arm, vec![0xF1]),
        (
            ArmKind::Ling,
            Speaker::Host,
            [&joints[..], &damaged, &[0x11; 3]].concat(),
        ),
        (ArmKind::Ling, Speaker::Host, vec![0xAA]),
    ] {
        let recording = stream.repeat(TOTAL / stream.len());
        let measured = allocation_counter::measure(|| {
            let source = Box::new(Pieces(&recording, usize::MAX));
            let head = Head::new("log".to_owned(), source, &Nowhere);
            decode_recording(head, &Nowhere, Some(Format::Raw), line(arm, Some(from))).unwrap();
        });
        let memory = measured.bytes_max;
        assert!(
            memory < MAX_MEMORY,
            "{arm:?} with {:02X?}: {memory} bytes",
            &stream[..1]
        );
    }
}
