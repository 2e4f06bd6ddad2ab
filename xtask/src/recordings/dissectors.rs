//! The dissector for Wireshark and the decoder for sigrok name what `armwire decode` names, and in its words.
//!
//! Both get the same recordings: every frame of the documents, which the fuzz corpus has, and every short frame that the
//! command takes for a message. So a new message fails the check until both have its name.

use std::fmt::{self, Display, Write};
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use crc::{CRC_32_ISO_HDLC, Crc};

use crate::apt;
use crate::cargo::{cargo, target_dir};
use crate::process::{output, run};
use crate::workspace::root;

/// The tools, each of which is a Debian package.
const TOOLS: [&str; 2] = ["tshark", "sigrok-cli"];
const DISSECTOR: &str = "tools/wireshark/armwire.lua";
const DECODERS: &str = "tools/sigrok";
const CORPUS: &str = "host-tests/fuzz/corpus/decode";

/// Whole frames at the end of a recording, behind which no frame is pending.
const LAST_FRAMES: usize = 60;
/// Packets of damaged frames and of random bytes for each link type.
const RANDOM_PACKETS: usize = 20_000;
/// A report as port 30003 has it: its length in bytes, and its numbers.
const REPORT: u8 = 135;
const REPORT_NUMBERS: usize = 32;
/// A heartbeat with a wrong last byte, and a frame without a register.
const XARM_ERRORS: [&[u8]; 2] = [&[0, 0, 0, 1, 0, 2, 0, 5], &[0, 1, 0, 2, 0, 0]];
/// Bytes that have a meaning somewhere: codes, answers, end marks, limits.
const VALUES: [u8; 16] = [
    0x00, 0x01, 0x02, 0x03, 0x04, 0x10, 0x11, 0x5A, 0x80, 0xAA, 0xE1, 0xE2, 0xED, 0xEE, 0xFE, 0xFF,
];
/// Samples of a bit on a line, at 1 Mbaud and 8 MHz.
const BIT: usize = 8;

/// One direction of a line.
struct Line {
    arm: &'static str,
    /// The sender, as `armwire decode --from` has it.
    from: &'static str,
    /// The frames of the documents: files of the fuzz corpus, and how many bytes come before a frame in them.
    documents: &'static [(&'static str, usize)],
}

const LINES: [Line; 7] = [
    Line::new("ling", "host", &[("ling-request", 1)]),
    Line::new("ling", "arm", &[("ling-response", 1)]),
    // A recording is of one generation.
    Line::new("ling", "arm", OLDER),
    Line::new("xarm", "host", &[("xarm-request", 2)]),
    Line::new("xarm", "arm", &[("xarm-response", 2)]),
    Line::new("alpha1", "host", &[("alpha1-request", 2)]),
    Line::new("alpha1", "arm", &[("alpha1-response", 2), ("servo-angles", 3)]),
];

/// The frames of the older generation.
const OLDER: &[(&str, usize)] = &[("legacy", 1)];

/// A frame of a recording, or bytes between frames, and its text.
type Item = (Vec<u8>, String);

/// Compares both with `armwire decode`.
///
/// # Errors
///
/// If a tool is missing, names something else, or a script fails on damaged or random bytes.
pub(crate) fn check() -> Result<()> {
    find_tools()?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    let dir = target_dir()?.join("recordings/dissectors");
    if dir.exists() {
        fs::remove_dir_all(&dir)?;
    }
    fs::create_dir_all(&dir)?;
    let tools = Tools {
        armwire: target_dir()?.join("debug/armwire"),
        dir,
    };
    for line in &LINES {
        compare(&tools, line)?;
    }
    check_servo_answers(&tools)?;
    check_tcp(&tools)?;
    check_random_packets(&tools)
}

/// Installs the tools if they are missing.
fn find_tools() -> Result<()> {
    let is_missing = |tool: &&str| output(Command::new(tool).arg("--version")).is_err();
    let missing: Vec<_> = TOOLS.into_iter().filter(is_missing).collect();
    ensure!(
        missing.is_empty() || apt::install(&missing)?,
        "tools are missing; run `sudo apt-get install --no-install-recommends {}`",
        missing.join(" ")
    );
    Ok(())
}

/// What the command says of a recording of a line is what the tools say of it.
fn compare(tools: &Tools, line: &Line) -> Result<()> {
    let mut frames = line.document_frames()?;
    let Some(first) = frames.first().cloned() else {
        bail!("{CORPUS} has no frames of {:?}", line.documents);
    };
    let variants: Vec<_> = frames.iter().flat_map(|frame| line.variants(frame)).collect();
    let messages = tools.decode(line, &line.short_frames().concat())?;
    frames.extend(
        messages
            .into_iter()
            .filter(|(_, text)| is_message(text))
            .map(|(bytes, _)| bytes),
    );
    let recording = [line.damage(&frames), variants.concat(), first.repeat(LAST_FRAMES)].concat();
    let expected = tools.decode(line, &recording)?;
    check_equal(line, "tshark", &expected, &tools.dissect(line, &recording)?)?;
    // An xArm has no UART.
    if line.arm != "xarm" {
        let mut named = tools.annotate(line.arm, &[(line.from, recording)])?;
        let mut expected = expected.clone();
        if line.is_older() {
            // sigrok's decoder tells the generation frame by frame, and damage has another reason in each.
            named.retain(|text| !is_noise(text));
            expected.retain(|(_, text)| !is_noise(text));
        }
        check_equal(line, "sigrok-cli", &expected, &named)?;
    }
    let messages = expected.iter().filter(|(_, text)| is_message(text)).count();
    let others = expected.len() - messages;
    println!("{line}: {messages} messages and {others} damaged or unknown are named");
    Ok(())
}

fn check_equal(line: &Line, tool: &str, expected: &[Item], got: &[String]) -> Result<()> {
    for (nth, (bytes, text)) in expected.iter().enumerate() {
        let got = got.get(nth).map_or("nothing", |got| plain(got));
        // A packet has one byte of a false header: the bytes that contradict it are in others.
        let is_cut = is_noise(text) && got.starts_with("noise: no whole frame");
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

/// A text without the sender, and without the reason why a frame is no message.
fn plain(text: &str) -> &str {
    let text = ["to the arm: ", "from the arm: "]
        .iter()
        .find_map(|sender| text.strip_prefix(sender))
        .unwrap_or(text);
    if text.starts_with(NO_MESSAGE) { NO_MESSAGE } else { text }
}

/// The answers of servos have a meaning after their requests, which both tools remember.
fn check_servo_answers(tools: &Tools) -> Result<()> {
    let mut events = Vec::new();
    for request in document_frames("alpha1-request", 2)? {
        for answer in document_frames("servo-angles", 3)? {
            if is_servo_answer(&answer, &request) {
                events.extend([("host", request.clone()), ("arm", answer)]);
            }
        }
    }
    let packets = events
        .iter()
        .map(|(from, bytes)| packet(from, bytes))
        .collect::<Vec<_>>();
    let file = tools.capture("servos", "-l 149", &packets)?;
    for (tool, texts) in [
        ("tshark", tools.tshark(&file, "alpha1")?),
        ("sigrok-cli", tools.annotate("alpha1", &events)?),
    ] {
        ensure!(texts.len() == events.len(), "{tool} names {texts:?} of {events:02X?}");
        for (text, (_, answer)) in texts.iter().zip(&events).skip(1).step_by(2) {
            ensure!(text.starts_with("servo "), "{tool} names {answer:02X?} '{text}'");
        }
    }
    println!("{} answers of servos are named after their requests", events.len() / 2);
    Ok(())
}

/// Whether a frame may answer this request. Moves and lights, commands 01 and 04 in row FA, are answered by one byte.
fn is_servo_answer(answer: &[u8], request: &[u8]) -> bool {
    match *request {
        [0xFA, _, 0, ..] => false,
        [0xFA, _, _, 0x01 | 0x04, ..] => answer.len() == 1,
        [row @ (0xFA | 0xFC), ..] => answer.len() > 1 && answer[0] == row,
        _ => false,
    }
}

/// On TCP, frames and reports are found in segments of any size.
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
    println!("xArm frames and reports are named in TCP segments");
    Ok(())
}

/// Damaged frames and random bytes are no error of the script.
fn check_random_packets(tools: &Tools) -> Result<()> {
    let mut random = Random(1);
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
        let packets: Vec<_> = (0..RANDOM_PACKETS).map(|_| random.packet(&frames)).collect();
        let file = tools.capture("random", options, &packets)?;
        let errors = output(tools.tshark_command(&file).args(["-Y", "_ws.lua.error"]))?;
        ensure!(errors.is_empty(), "{DISSECTOR} fails with {options}: {errors}");
        let shown = output(
            tools
                .tshark_command(&file)
                .args(["-T", "fields", "-e", &format!("{arm}.damage")]),
        )?;
        ensure!(shown.contains("noise: "), "no damage is seen with {options}");
    }
    println!("{RANDOM_PACKETS} damaged and random packets of each kind are no error");
    Ok(())
}

impl Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let generation = if self.is_older() {
            " of the older generation"
        } else {
            ""
        };
        write!(f, "{}{generation}, from the {}", self.arm, self.from)
    }
}

impl Line {
    const fn new(arm: &'static str, from: &'static str, documents: &'static [(&'static str, usize)]) -> Self {
        Self { arm, from, documents }
    }

    fn is_older(&self) -> bool {
        self.documents == OLDER
    }

    fn document_frames(&self) -> Result<Vec<Vec<u8>>> {
        let mut frames = Vec::new();
        for (name, start) in self.documents {
            frames.extend(document_frames(name, *start)?);
        }
        Ok(frames)
    }

    /// A frame for each header, with one value or none. The older generation has no short ones.
    fn short_frames(&self) -> Vec<Vec<u8>> {
        let all = 0..=u8::MAX;
        match self.arm {
            "ling" if self.is_older() => Vec::new(),
            "ling" => all
                .clone()
                .flat_map(|command| (0..=u8::MAX).map(move |f| ling_frame(command, f)))
                .collect(),
            "xarm" => all.flat_map(xarm_frames).collect(),
            _ => all.flat_map(alpha1_frames).collect(),
        }
    }

    /// The frame with other values: the first and the last byte of the data are each of [`VALUES`], the others one of them.
    fn variants(&self, frame: &[u8]) -> Vec<Vec<u8>> {
        let (data, check) = self.data(frame);
        let mut variants = Vec::new();
        for at in data.clone() {
            let is_end = at == data.start || at + 1 == data.end;
            for (nth, value) in VALUES.iter().enumerate() {
                if is_end || nth == at % VALUES.len() {
                    let mut variant = frame.to_vec();
                    variant[at] = *value;
                    if let Some((from, check)) = check {
                        variant[data.end] = check(&variant[from..data.end]);
                    }
                    variants.push(variant);
                }
            }
        }
        variants
    }

    /// The place of the data in a frame, and of the bytes in its checksum, which comes behind them.
    fn data(&self, frame: &[u8]) -> (Range<usize>, Option<(usize, Check)>) {
        let end = frame.len().saturating_sub(2);
        match (self.arm, self.from) {
            ("ling", _) if self.is_older() => (3..end, Some((3, parity))),
            ("ling", _) => (4..end, Some((1, crc))),
            // The state: others are floating-point numbers, whose text has another precision.
            ("xarm", "arm") => (7..8, None),
            ("xarm", _) => (7..frame.len(), None),
            // A status has no checksum.
            _ if frame.len() <= 4 => (0..0, None),
            _ => (2..end, Some((2, sum))),
        }
    }

    /// Every frame, and damaged in several ways between whole ones. TCP damages nothing, but an arm may be wrong.
    fn damage(&self, frames: &[Vec<u8>]) -> Vec<u8> {
        let mut recording = Vec::new();
        // The first frames are damaged behind their headers, by which frames of the older generation are told.
        for (nth, frame) in (4..).zip(frames) {
            recording.extend(frame);
            if self.arm == "xarm" {
                recording.extend(XARM_ERRORS[nth % XARM_ERRORS.len()]);
                continue;
            }
            let mut flipped = frame.clone();
            flipped[nth % frame.len()] ^= 1 << (nth % 8);
            let mut lost = frame.clone();
            lost.remove(nth % frame.len());
            let end = [&frame[..frame.len() - 1], &[0x55]].concat();
            for damaged in [
                &flipped,
                &lost,
                &end,
                &frame[..nth % frame.len()].to_vec(),
                &vec![0x55, 0xAA],
            ] {
                recording.extend(damaged);
                recording.extend(frame);
            }
        }
        recording
    }
}

/// Frames of the fuzz corpus, in order.
fn document_frames(name: &str, start: usize) -> Result<Vec<Vec<u8>>> {
    let mut frames = Vec::new();
    for nth in 0.. {
        let path = root().join(CORPUS).join(format!("document-{name}-{nth}"));
        if !path.exists() {
            break;
        }
        frames.push(fs::read(path)?.split_off(start));
    }
    ensure!(!frames.is_empty(), "{CORPUS} has no document-{name}-0");
    Ok(frames)
}

/// A checksum of bytes.
type Check = fn(&[u8]) -> u8;

fn crc(bytes: &[u8]) -> u8 {
    Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(bytes) as u8
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

fn parity(bytes: &[u8]) -> u8 {
    sum(bytes) & 1
}

/// A frame with the data byte of most requests.
fn ling_frame(command: u8, function: u8) -> Vec<u8> {
    let body = [command, function, 1, 0xFE];
    [&[0xAA][..], &body, &[crc(&body), 0xFF]].concat()
}

/// Frames with no parameter, and with one.
fn xarm_frames(register: u8) -> [Vec<u8>; 2] {
    [
        vec![0, 1, 0, 2, 0, 2, register, 0],
        vec![0, 1, 0, 2, 0, 3, register, 0, 1],
    ]
}

/// The frames of a row, and of a command to a servo, with no value and with one.
fn alpha1_frames(byte: u8) -> Vec<Vec<u8>> {
    let frame = |row: u8, data: [u8; 6]| [&[row, row.rotate_left(4)][..], &data, &[sum(&data), 0xED]].concat();
    vec![
        frame(byte, [0; 6]),
        frame(byte, [1, 0, 0, 0, 0, 0]),
        frame(0xFA, [1, byte, 0, 0, 0, 0]),
        frame(0xFC, [1, byte, 0, 0, 0, 0]),
    ]
}

/// A packet of a recording.
fn packet(from: &str, bytes: &[u8]) -> Vec<u8> {
    [&[u8::from(from == "arm")], bytes].concat()
}

/// Levels of two lines: bit 0 from the host, bit 1 from the arm, as a logic analyser has them.
fn samples(events: &[(&str, Vec<u8>)]) -> Vec<u8> {
    const IDLE: u8 = 0b11;
    let mut samples = vec![IDLE; 100 * BIT];
    for (from, bytes) in events {
        let line = if *from == "host" { 0b01 } else { 0b10 };
        for byte in bytes {
            // A start bit, the data, lowest bit first, and a stop bit.
            let bits = u16::from(*byte) << 1 | 1 << 9;
            for bit in 0..10 {
                let level = if bits >> bit & 1 == 1 { IDLE } else { IDLE & !line };
                samples.extend([level; BIT]);
            }
        }
        samples.extend([IDLE; 20 * BIT]);
    }
    samples
}

/// The tools, and the folder of their files.
struct Tools {
    armwire: PathBuf,
    dir: PathBuf,
}

impl Tools {
    /// The items of a recording, as the command has them.
    fn decode(&self, line: &Line, recording: &[u8]) -> Result<Vec<Item>> {
        let text = output(&mut self.decode_command(line, recording)?)?;
        let lines: Vec<_> = text
            .lines()
            .filter(|line| line.starts_with(' '))
            .map(str::trim)
            .collect();
        let mut items = Vec::new();
        for pair in lines.chunks_exact(2) {
            let (_, hex) = pair[0].split_once("  ").context("an item has an offset and bytes")?;
            let bytes = hex.split(' ').map(|byte| u8::from_str_radix(byte, 16));
            items.push((bytes.collect::<Result<_, _>>()?, pair[1].to_owned()));
        }
        Ok(items)
    }

    fn decode_command(&self, line: &Line, recording: &[u8]) -> Result<Command> {
        let file = self.dir.join("recording");
        fs::write(&file, recording)?;
        let mut decode = Command::new(&self.armwire);
        decode.args(["decode", "--format", "raw", "--arm", line.arm]).arg(file);
        // Frames of Ling tell their sender.
        if line.arm != "ling" {
            decode.args(["--from", line.from]);
        }
        Ok(decode)
    }

    /// The items of a recording, as Wireshark has them from the command's packets.
    fn dissect(&self, line: &Line, recording: &[u8]) -> Result<Vec<String>> {
        let file = self.dir.join("recording.pcapng");
        let _ = fs::remove_file(&file);
        output(self.decode_command(line, recording)?.arg("--pcapng").arg(&file))?;
        self.tshark(&file, line.arm)
    }

    /// A capture file of these packets.
    fn capture(&self, name: &str, options: &str, packets: &[Vec<u8>]) -> Result<PathBuf> {
        let (dump, file) = (self.dir.join(name), self.dir.join(format!("{name}.pcapng")));
        let mut text = String::new();
        for packet in packets {
            text += "000000";
            for byte in packet {
                write!(text, " {byte:02x}")?;
            }
            text += "\n";
        }
        fs::write(&dump, text)?;
        let mut make = Command::new("text2pcap");
        output(make.arg("-q").args(options.split(' ')).args([dump, file.clone()]))?;
        Ok(file)
    }

    /// Messages and damage in a capture file.
    fn tshark(&self, file: &Path, arm: &str) -> Result<Vec<String>> {
        let mut tshark = self.tshark_command(file);
        tshark.args(["-T", "fields", "-E", "aggregator=|", "-E", "separator=|"]);
        for field in ["message", "damage"] {
            tshark.args(["-e", &format!("{arm}.{field}")]);
        }
        let text = output(&mut tshark)?;
        let texts = text
            .lines()
            .flat_map(|line| line.split('|'))
            .filter(|text| !text.is_empty());
        Ok(texts.map(str::to_owned).collect())
    }

    fn tshark_command(&self, file: &Path) -> Command {
        let mut tshark = Command::new("tshark");
        let script = root().join(DISSECTOR);
        tshark
            .args(["-X", &format!("lua_script:{}", script.display()), "-r"])
            .arg(file);
        // The user may have the dissector, too.
        tshark.env("WIRESHARK_CONFIG_DIR", &self.dir);
        tshark
    }

    /// Frames and damage on two lines, as sigrok has them.
    fn annotate(&self, arm: &str, events: &[(&str, Vec<u8>)]) -> Result<Vec<String>> {
        let file = self.dir.join("samples");
        fs::write(&file, samples(events))?;
        let mut sigrok = Command::new("sigrok-cli");
        sigrok
            .args(["-I", "binary:numchannels=2:samplerate=8000000", "-i"])
            .arg(file);
        sigrok.args(["-P", &format!("uart:tx=0:rx=1:baudrate=1000000,armwire:arm={arm}")]);
        sigrok.args(["-A", "armwire=rx-frame:tx-frame:rx-warning:tx-warning"]);
        sigrok
            .env("SIGROKDECODE_DIR", root().join(DECODERS))
            .env("PYTHONDONTWRITEBYTECODE", "1");
        let text = output(&mut sigrok)?;
        let texts = text
            .lines()
            .map(|line| line.split_once(": ").map_or(line, |(_, text)| text));
        Ok(texts.map(str::to_owned).collect())
    }
}

/// Numbers that look random, the same in each run: xorshift.
struct Random(u32);

impl Random {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    fn below(&mut self, end: usize) -> usize {
        self.next() as usize % end
    }

    /// A damaged frame after a byte of direction, or random bytes.
    fn packet(&mut self, frames: &[Vec<u8>]) -> Vec<u8> {
        if self.below(4) == 0 {
            return (0..1 + self.below(40)).map(|_| self.next() as u8).collect();
        }
        let mut packet = vec![self.below(3) as u8];
        packet.extend(&frames[self.below(frames.len())]);
        for _ in 0..self.below(4) {
            let at = self.below(packet.len());
            packet[at] = self.next() as u8;
        }
        let end = if self.below(2) == 0 {
            1 + self.below(packet.len())
        } else {
            packet.len()
        };
        packet.truncate(end);
        packet
    }
}
