//! Comparison of the dissector for Wireshark and the decoder for sigrok with `armwire decode`.
//!
//! All get the same recordings: every frame of the documents, from the fuzz corpus, and every short frame that is a message
//! for the command. A new message fails the check until both tools have its text.

mod lines;
mod tools;

use anyhow::{Result, ensure};
use oorandom::Rand32;

use lines::{LINES, Line, SERVO_BUS, document_frames};
use tools::{Item, Tools};

/// Number of complete frames at the end of a recording, which leave no frame pending.
const LAST_FRAMES: usize = 60;
/// Number of damaged or random packets for each link type.
const RANDOM_PACKETS: usize = 10_000;
/// Length of a report on port 30003, in bytes and in numbers.
const REPORT: u8 = 135;
const REPORT_NUMBERS: usize = 32;

/// Compares both tools with the command.
///
/// # Errors
///
/// If a tool is missing, a text differs, or a script fails on damaged or random bytes.
pub(crate) fn check() -> Result<()> {
    let tools = Tools::find()?;
    for line in &LINES {
        compare(&tools, line)?;
    }
    check_servo_bus(&tools)?;
    check_tcp(&tools)?;
    check_random_packets(&tools)
}

/// Compares the texts of a line's recording.
fn compare(tools: &Tools, line: &Line) -> Result<()> {
    let documents = line.document_frames()?;
    let variants: Vec<_> = documents.iter().flat_map(|frame| line.variants(frame)).collect();
    let mut messages = tools.decode(line, &line.short_frames().concat())?;
    messages.retain(|(_, text)| is_message(text));
    let messages = messages.into_iter().map(|(bytes, _)| bytes);
    let end = documents[0].repeat(LAST_FRAMES);
    let frames: Vec<_> = documents.into_iter().chain(messages).collect();
    let recording = [line.damage(&frames), variants.concat(), end].concat();
    let expected = tools.decode(line, &recording)?;
    check_equal(line, "tshark", &expected, &tools.dissect(line, &recording)?)?;
    // An xArm has no UART.
    if line.arm != "xarm" {
        let mut named = tools.annotate(line.arm, &[(line.from, recording)])?;
        let mut expected = expected.clone();
        if line.is_older() {
            // sigrok's decoder identifies the generation frame by frame, and damage has another reason in each.
            named.retain(|text| !is_noise(text));
            expected.retain(|(_, text)| !is_noise(text));
        }
        check_equal(line, "sigrok-cli", &expected, &named)?;
    }
    let messages = expected.iter().filter(|(_, text)| is_message(text)).count();
    let others = expected.len() - messages;
    println!("{line}: {messages} messages and {others} damaged or unknown frames have equal texts");
    Ok(())
}

fn check_equal(line: &Line, tool: &str, expected: &[Item], got: &[String]) -> Result<()> {
    for (nth, (bytes, text)) in expected.iter().enumerate() {
        let got = got.get(nth).map_or("nothing", |got| plain(got));
        // A packet may have one byte of a false header, and the bytes that contradict it are in other packets.
        let is_cut = bytes.len() == 1 && is_noise(text) && got.starts_with("noise: no whole frame");
        ensure!(
            got == plain(text) || is_cut,
            "{line}, item {nth}, {bytes:02X?}: `armwire decode` says '{text}', {tool} '{got}'"
        );
    }
    ensure!(
        got.len() == expected.len(),
        "{tool} names {} of {} items",
        got.len(),
        expected.len()
    );
    Ok(())
}

fn is_noise(text: &str) -> bool {
    text.starts_with("noise: ")
}

fn is_message(text: &str) -> bool {
    !is_noise(text) && plain(text) != NO_MESSAGE
}

const NO_MESSAGE: &str = "no message";

/// A text without the sender, and without the reason of an unknown frame.
fn plain(text: &str) -> &str {
    let text = ["to the arm: ", "from the arm: "]
        .iter()
        .find_map(|sender| text.strip_prefix(sender))
        .unwrap_or(text);
    if text.starts_with(NO_MESSAGE) { NO_MESSAGE } else { text }
}

/// Compares the texts of a recording of the servo bus: answers, whose meaning depends on the request before.
fn check_servo_bus(tools: &Tools) -> Result<()> {
    let mut bus = Vec::new();
    for request in document_frames("alpha1-request", 2)? {
        for answer in document_frames("servo-angles", 3)? {
            if is_servo_answer(&answer, &request) {
                bus.extend([request.clone(), answer]);
            }
        }
    }
    // The first answer has no request before it.
    bus.rotate_left(1);
    let recording = bus.concat();
    let expected = tools.decode(&SERVO_BUS, &recording)?;
    check_equal(&SERVO_BUS, "tshark", &expected, &tools.dissect(&SERVO_BUS, &recording)?)?;
    let named = tools.annotate(SERVO_BUS.protocol(), &[(SERVO_BUS.from, recording)])?;
    check_equal(&SERVO_BUS, "sigrok-cli", &expected, &named)?;
    let answers = expected
        .iter()
        .filter(|(_, text)| text.starts_with("from the arm: servo "));
    let answers = answers.count();
    ensure!(answers > 0, "no answer of a servo has a meaning");
    println!("{answers} answers of servos have the texts for their requests");
    Ok(())
}

/// Returns true if a frame may answer this request. The answer to a move or an LED setting (FA 01 and FA 04) is one byte.
fn is_servo_answer(answer: &[u8], request: &[u8]) -> bool {
    match *request {
        [0xFA, _, 0, ..] => false,
        [0xFA, _, _, 0x01 | 0x04, ..] => answer.len() == 1,
        [row @ (0xFA | 0xFC), ..] => answer.len() > 1 && answer[0] == row,
        _ => false,
    }
}

/// Checks xArm frames and reports in TCP segments of several sizes.
fn check_tcp(tools: &Tools) -> Result<()> {
    for line in LINES.iter().filter(|line| line.arm == "xarm") {
        let mut frames = line.document_frames()?;
        // Standard Modbus is left to Wireshark's own dissector.
        frames.retain(|frame| frame[2..4] != [0, 0]);
        let stream = frames.concat();
        let expected = tools.decode(line, &stream)?;
        let ports = if line.from == "host" {
            "-T 40000,502"
        } else {
            "-T 502,40000"
        };
        for size in [1, 5, 64, stream.len()] {
            let segments: Vec<_> = stream.chunks(size).map(<[u8]>::to_vec).collect();
            let file = tools.capture("tcp", ports, &segments)?;
            check_equal(line, "tshark on TCP", &expected, &tools.tshark(&file, "xarm")?)?;
        }
    }
    let report: Vec<u8> = [
        &[0, 0, 0, REPORT][..],
        &[0x12, 0, 3],
        &0.5_f32.to_le_bytes().repeat(REPORT_NUMBERS),
    ]
    .concat();
    let segments: Vec<_> = report.repeat(3).chunks(100).map(<[u8]>::to_vec).collect();
    let file = tools.capture("reports", "-T 30003,40000", &segments)?;
    let reports = tools.tshark(&file, "xarm")?;
    let is_report = |text: &String| text.starts_with("report: joints +28.65°") && text.ends_with("state 2, mode 1");
    ensure!(
        reports.len() == 3 && reports.iter().all(is_report),
        "tshark names {reports:?} of three reports"
    );
    println!("xArm frames and reports in TCP segments have equal texts");
    Ok(())
}

/// Checks that damaged frames and random bytes cause no error in the script.
fn check_random_packets(tools: &Tools) -> Result<()> {
    let mut random = Rand32::new(1);
    for (arm, options) in [
        ("ling", "-l 147"),
        ("xarm", "-l 148"),
        ("alpha1", "-l 149"),
        ("xarm", "-T 40000,502"),
        ("xarm", "-T 30002,40000"),
    ] {
        let mut frames = Vec::new();
        for line in LINES.iter().filter(|line| line.arm == arm) {
            frames.extend(line.document_frames()?);
        }
        let packets: Vec<_> = (0..RANDOM_PACKETS)
            .map(|_| random_packet(&mut random, &frames))
            .collect();
        let file = tools.capture("random", options, &packets)?;
        let errors = tools.script_errors(&file)?;
        ensure!(errors.is_empty(), "the dissector fails with {options}: {errors}");
        let texts = tools.tshark(&file, arm)?;
        ensure!(
            texts.iter().any(|text| is_noise(text)),
            "no damage is reported with {options}"
        );
    }
    println!("{RANDOM_PACKETS} damaged and random packets of each kind cause no error");
    Ok(())
}

/// A direction byte and a damaged frame, or random bytes.
fn random_packet(random: &mut Rand32, frames: &[Vec<u8>]) -> Vec<u8> {
    let mut below = |end: usize| random.rand_range(0..end as u32) as usize;
    if below(4) == 0 {
        return (0..=below(40)).map(|_| below(256) as u8).collect();
    }
    let mut packet = vec![below(3) as u8];
    packet.extend(&frames[below(frames.len())]);
    for _ in 0..below(4) {
        let at = below(packet.len());
        packet[at] = below(256) as u8;
    }
    if below(2) == 0 {
        packet.truncate(1 + below(packet.len()));
    }
    packet
}
