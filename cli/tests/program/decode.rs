//! The built program on recordings: live ones, of any length, in any format, and invalid ones.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc;
use std::thread;

use crate::common::{PROGRAM, TIMEOUT, failure, finish, free_path, run, success, usage};

/// Logs written by python-can.
const LOGS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/logs/");

/// The text formats: name, header, and a record of a request to a Ling arm.
const RECORDS: [(&str, &str, &str); 8] = [
    ("hex", "", "AA 06 00 01 FE 9A FF\n"),
    ("candump", "", "(1.000000) can0 60F#07AA060001FE9AFF\n"),
    ("candump", "", "  can0  60F   [8]  07 AA 06 00 01 FE 9A FF\n"),
    (
        "asc",
        "date Mon Jan 1 00:00:00.000 am 2024\nbase hex  timestamps absolute\n",
        "   1.000000 1  60F             Rx   d 8 07 AA 06 00 01 FE 9A FF\n",
    ),
    (
        "trc",
        ";$FILEVERSION=1.1\r\n",
        "     1)      1000.0  Rx         060F  8  07 AA 06 00 01 FE 9A FF\r\n",
    ),
    (
        "csv",
        "timestamp,arbitration_id,extended,remote,error,dlc,data\n",
        "1.0,0x60f,0,0,0,8,B6oGAAH+mv8=\n",
    ),
    (
        "gvret",
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n",
        "1000000,0000060F,false,Rx,0,8,07,AA,06,00,01,FE,9A,FF,\n",
    ),
    (
        "printer",
        "",
        "Timestamp:        1.000000    ID:     060f    S Rx                DL:  8    07 aa 06 00 01 fe 9a ff     Channel: can0\n",
    ),
];
/// The same request in bytes.
const RAW: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];

/// The shortest header of a BLF file.
const BLF_HEADER: &[u8] = b"LOGG\x08\0\0\0";
/// An object of a BLF file with the same request.
const BLF_RECORD: &[u8] = b"LOBJ\x20\0\x01\0\x30\0\0\0\x56\0\0\0\x02\0\0\0\0\0\0\0\0\x10\0\0\0\0\0\0\
    \x01\0\0\x08\x0F\x06\0\0\x07\xAA\x06\0\x01\xFE\x9A\xFF";

/// The header of a pcap file with frames of SocketCAN, and a packet with the same request.
const PCAP_HEADER: &[u8] = b"\xD4\xC3\xB2\xA1\x02\0\x04\0\0\0\0\0\0\0\0\0\0\0\x04\0\xE3\0\0\0";
const PCAP_RECORD: &[u8] = b"\x01\0\0\0\0\0\0\0\x10\0\0\0\x10\0\0\0\
    \0\0\x06\x0F\x08\0\0\0\x07\xAA\x06\0\x01\xFE\x9A\xFF";

/// All formats: name, header, and a record.
fn formats() -> Vec<(&'static str, Vec<u8>, Vec<u8>)> {
    let text = RECORDS.map(|(format, header, record)| (format, header.into(), record.into()));
    let bytes = [
        ("raw", Vec::new(), RAW.to_vec()),
        ("blf", BLF_HEADER.to_vec(), BLF_RECORD.to_vec()),
        ("pcap", PCAP_HEADER.to_vec(), PCAP_RECORD.to_vec()),
    ];
    text.into_iter().chain(bytes).collect()
}

/// An `armwire decode` that reads its standard input.
fn start(args: &[&str]) -> (Child, ChildStdin) {
    let mut child = Command::new(PROGRAM)
        .arg("decode")
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let stdin = child.stdin.take().unwrap();
    (child, stdin)
}

#[test]
fn frames_appear_while_the_recording_continues() {
    for (format, header, record) in formats() {
        let (mut child, mut stdin) = start(&[]);
        stdin.write_all(&header).unwrap();
        stdin.write_all(&record).unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let (sender, receiver) = mpsc::channel();
        let reader = thread::spawn(move || {
            let mut lines = [String::new(), String::new()];
            for line in &mut lines {
                out.read_line(line).unwrap();
            }
            sender.send(lines).unwrap();
            out
        });
        let lines = receiver.recv_timeout(TIMEOUT);
        drop(stdin);
        // Later output is not read.
        drop(reader.join());
        assert!(finish(child).status.success(), "{format}");
        let [bytes, meaning] = lines.expect("nothing is shown");
        assert!(bytes.ends_with("  AA 06 00 01 FE 9A FF\n"), "{format}: {bytes}");
        assert_eq!(meaning, "          to the arm: read joints\n", "{format}");
    }
}

/// Peak memory of a program so far, in kB.
#[cfg(target_os = "linux")]
fn peak_memory(child: &Child) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

/// Decodes a recording piece by piece. Returns the program's peak memory in kB.
#[cfg(target_os = "linux")]
fn memory(format: &str, header: &[u8], record: &[u8], records: usize) -> u64 {
    let (mut child, mut stdin) = start(&["--format", format]);
    let mut out = child.stdout.take().unwrap();
    let reader = thread::spawn(move || std::io::copy(&mut out, &mut std::io::sink()));
    stdin.write_all(header).unwrap();
    let piece = record.repeat(1000);
    for _ in 0..records / 1000 {
        stdin.write_all(&piece).unwrap();
    }
    let memory = peak_memory(&child);
    drop(stdin);
    assert!(finish(child).status.success(), "{format}");
    reader.join().unwrap().unwrap();
    memory
}

/// The length of a short recording in bytes: more than the pipe's buffer, the program must have begun to read it.
#[cfg(target_os = "linux")]
const SHORT: usize = 300_000;
/// Maximum additional memory for a long recording, in kB: much less than the recording.
#[cfg(target_os = "linux")]
const MORE: u64 = 1_500;

#[cfg(target_os = "linux")]
#[test]
fn long_recording_needs_no_more_memory() {
    for (format, header, record) in formats() {
        let memory = |bytes| memory(format, &header, &record, bytes / record.len());
        let (short, long) = (memory(SHORT), memory(4_000_000));
        assert!(long < short + MORE, "{format}: {long} kB, not {short} kB");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn endless_line_needs_no_more_memory() {
    let digits = "AA060001FE9AFF".repeat(10);
    let memory = |bytes| memory("hex", b"", digits.as_bytes(), bytes / digits.len());
    let (short, long) = (memory(SHORT), memory(4_000_000));
    assert!(long < short + MORE, "{long} kB, not {short} kB");
}

#[test]
fn format_of_python_can_logs_is_recognised() {
    for (log, pdus) in [
        ("python-can.log", 4),
        ("python-can.asc", 4),
        ("python-can.blf", 4),
        ("python-can-uncompressed.blf", 4),
        ("python-can-1.0.trc", 2),
        ("python-can-2.1.trc", 2),
        ("python-can.csv", 3),
    ] {
        let out = success(&["decode", &format!("{LOGS}{log}")]);
        assert!(out.contains("to the arm: read joints\n"), "{log}: {out}");
        assert!(out.contains("from the arm: joints: +0.00° "), "{log}: {out}");
        assert!(out.contains(&format!("PDUs: {pdus}, lost: 0, ")), "{log}: {out}");
    }
}

/// A log goes on behind what is not understood. The exit status is 0, and 3 with `--strict`.
#[test]
fn foreign_record_ends_no_log() {
    let path = free_path("foreign.log");
    for (format, header, record) in formats() {
        let foreign = match format {
            // A damaged packet has no length.
            "raw" | "hex" | "pcap" => continue,
            "blf" => &b"LOBS0123456789ab"[..],
            _ => b"\x1B[2J\xFFgarbage\n",
        };
        fs::write(&path, [&header[..], &record, foreign, &record, foreign].concat()).unwrap();
        let args = ["decode", "--format", format, path.to_str().unwrap()];
        let output = run(&args);
        assert_eq!(output.status.code(), Some(0));
        let place = match format {
            "blf" => "byte 56: no object starts here".to_owned(),
            _ => format!(
                "line {}: '\\u{{1b}}",
                1 + header.iter().chain(&record).filter(|&&byte| byte == b'\n').count()
            ),
        };
        let out = String::from_utf8(output.stdout).unwrap();
        assert_eq!(
            out.matches("          to the arm: read joints\n").count(),
            2,
            "{format}: {out}"
        );
        assert_eq!(out.matches("not understood: ").count(), 2, "{format}: {out}");
        assert!(out.contains(&format!("\nnot understood: {place}")), "{format}: {out}");
        let sum = out.lines().last().unwrap();
        assert!(sum.starts_with("CAN frames: 2, PDUs: 2, lost: 0, "), "{format}: {sum}");
        assert!(sum.contains(", not understood: 2 ("), "{format}: {sum}");
        let warning = String::from_utf8(output.stderr).unwrap();
        assert!(
            warning.ends_with(": not understood: 2, see the output\n"),
            "{format}: {warning}"
        );

        let output = run(&[&args[..], &["--strict"]].concat());
        assert_eq!(output.status.code(), Some(3), "{format}");
        assert_eq!(String::from_utf8(output.stdout).unwrap(), out);
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn frames_that_candump_lost_show_in_the_exit_status() {
    let path = free_path("dropped.log");
    let record = "(1.0) can0 60F#07AA060001FE9AFF\n";
    let dropped = "DROPCOUNT: dropped 500 CAN frames on 'can0' socket (total drops 500)\n";
    fs::write(&path, [record, dropped, record].concat()).unwrap();
    let path = path.to_str().unwrap();
    assert_eq!(run(&["decode", path]).status.code(), Some(0));
    let output = run(&["decode", path, "--strict"]);
    assert_eq!(output.status.code(), Some(3));
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(warning.contains("not logged: 500"), "{warning}");
    fs::remove_file(path).unwrap();
}

#[cfg(feature = "recordings")]
#[test]
fn damaged_mcap_chunk_shows_in_the_exit_status() {
    let path = free_path("damaged.mcap");
    let mut recording = fs::read(format!("{LOGS}zstd.mcap")).unwrap();
    let path = path.to_str().unwrap();
    fs::write(path, &recording).unwrap();
    success(&["decode", path, "--strict"]);
    // In the middle of a chunk's data.
    let middle = recording.len() / 3;
    recording[middle] ^= 0x55;
    fs::write(path, &recording).unwrap();
    let output = run(&["decode", path]);
    assert_eq!(output.status.code(), Some(0));
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(out.contains(": damaged chunk: ") && out.contains("\nframes: "), "{out}");
    assert_eq!(run(&["decode", path, "--strict"]).status.code(), Some(3));
    fs::remove_file(path).unwrap();
}

#[test]
fn log_cut_in_a_record_ends_with_its_sum() {
    let path = free_path("cut.log");
    for (format, header, record) in formats() {
        if matches!(format, "raw" | "hex") {
            continue;
        }
        let cut = &record[..record.len() / 2];
        fs::write(&path, [&header[..], &record, cut].concat()).unwrap();
        let output = run(&["decode", "--format", format, path.to_str().unwrap(), "--strict"]);
        assert_eq!(output.status.code(), Some(3), "{format}");
        let out = String::from_utf8(output.stdout).unwrap();
        let sum = out.lines().last().unwrap();
        assert!(sum.starts_with("CAN frames: 1, PDUs: 1, lost: 0, "), "{format}: {out}");
        assert!(
            sum.ends_with(", not understood: 1 (ends inside a record: 1)"),
            "{format}: {out}"
        );
    }
    fs::remove_file(path).unwrap();
}

/// A raw recording in which this is wrong has status 3 with `--strict`, and 0 without it.
#[test]
fn strict_refuses_whatever_is_no_frame() {
    let path = free_path("strict");
    let name = path.to_str().unwrap();
    let wrong_sum = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9B, 0xFF];
    let no_message = [0xAA, 0x06, 0x23, 0x01, 0xFE, 0x23, 0xFF];
    for (recording, reason) in [
        (RAW.to_vec(), None),
        (vec![0x81; 300], Some("no frame of a Ling arm")),
        (Vec::new(), Some("no frame of a Ling arm: the input is empty")),
        ([RAW, wrong_sum].concat(), Some("noise bytes: 7")),
        ([&RAW[..], &[0x11]].concat(), Some("noise bytes: 1")),
        ([&RAW[..], &RAW[..4]].concat(), Some("noise bytes: 4")),
        ([RAW, no_message].concat(), Some("frames without a message: 1")),
        (
            b"RX: AA 06 00 01 FE 9A FF\nRX: AA 06 0G 01 FE\n".to_vec(),
            Some("not understood: 1"),
        ),
        (
            b"(1.0) can0 123#00\n".to_vec(),
            Some("no frame of a Ling arm: the input looks like the format 'candump'"),
        ),
        (
            b"(1.0) can0 60F#07AA060001FE9AFF\n(2.0) can0 60F#07AA060001FE9BFF\n".to_vec(),
            Some("PDUs without a frame: 1"),
        ),
    ] {
        fs::write(&path, &recording).unwrap();
        let strict = run(&["decode", "--strict", name]);
        let text = String::from_utf8(strict.stderr).unwrap();
        match reason {
            None => assert!(strict.status.success() && text.is_empty(), "{text}"),
            Some(reason) => assert!(
                strict.status.code() == Some(3) && text.contains(reason),
                "{reason}: {text}"
            ),
        }
        let lenient = run(&["decode", name]);
        assert!(lenient.status.success());
        assert_eq!(lenient.stdout, strict.stdout);
        let is_warned =
            reason.is_some_and(|reason| reason.starts_with("no frame ") || reason.starts_with("not understood"));
        assert_eq!(!lenient.stderr.is_empty(), is_warned, "{reason:?}");
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn error_of_a_4_megabyte_line_is_short() {
    let path = free_path("long.log");
    for line in ["what", "AA G"] {
        fs::write(&path, [line, &"A".repeat(4 << 20)].concat()).unwrap();
        let line = failure(&run(&["decode", path.to_str().unwrap()]));
        assert!(line.len() < 400 && line.contains("line 1: '"), "{line}");
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn format_option_overrides_detection() {
    let path = free_path("digits");
    fs::write(&path, "AA060001FE9AFF").unwrap();
    let path = path.to_str().unwrap();
    assert!(success(&["decode", path]).ends_with("bytes: 7, frames: 1, noise bytes: 0\n"));
    let raw = run(&["decode", path, "--format", "raw"]);
    assert!(raw.stdout.ends_with(b"bytes: 14, frames: 0, noise bytes: 14\n"));
    let output = run(&["decode", path, "--format", "blf", "--strict"]);
    assert_eq!(output.status.code(), Some(3));
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(
        out.starts_with("not understood: byte 0: no header of a BLF file\n"),
        "{out}"
    );
    let text = usage(&["decode", path, "--format", "mf4"]);
    assert!(
        text.contains("raw, hex, dec, candump, asc, trc, blf, csv, gvret, printer, pcap"),
        "{text}"
    );
    fs::remove_file(path).unwrap();
}

#[test]
fn closed_output_ends_the_program() {
    let (mut child, mut stdin) = start(&[]);
    let mut out = child.stdout.take().unwrap();
    stdin.write_all(&RAW).unwrap();
    out.read_exact(&mut [0; 10]).unwrap();
    drop(out);
    // Fails when the program has ended.
    while stdin.write_all(&RAW).is_ok() {}
    assert!(finish(child).status.success());
}

/// A packet of a pcapng file: interface number, time in ns, flags and data.
type Packet = (u32, u64, u32, Vec<u8>);

/// The link types of the interfaces in a pcapng file, and its packets.
fn packets(file: &[u8]) -> (Vec<u16>, Vec<Packet>) {
    let word = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let (mut link_types, mut packets) = (Vec::new(), Vec::new());
    let mut rest = file;
    while !rest.is_empty() {
        let (block, others) = rest.split_at(word(rest, 4) as usize);
        match word(block, 0) {
            1 => link_types.push(word(block, 8) as u16),
            6 => {
                let len = word(block, 20) as usize;
                let time = u64::from(word(block, 12)) << 32 | u64::from(word(block, 16));
                let flags = word(block, 28 + len.next_multiple_of(4) + 4);
                packets.push((word(block, 8), time, flags, block[28..28 + len].to_vec()));
            }
            other => assert_eq!(other, 0x0A0D_0D0A),
        }
        rest = others;
    }
    (link_types, packets)
}

/// Decodes a recording to pcapng. Returns the printed text and the file.
fn to_pcapng(recording: &[u8], args: &[&str]) -> (String, Vec<u8>) {
    let [from, to] = ["recording", "pcapng"].map(free_path);
    fs::write(&from, recording).unwrap();
    let paths = [from.to_str().unwrap(), "--pcapng", to.to_str().unwrap()];
    let printed = success(&[&["decode"], &paths[..], args].concat());
    let file = fs::read(&to).unwrap();
    fs::remove_file(from).unwrap();
    fs::remove_file(to).unwrap();
    (printed, file)
}

#[test]
fn pcapng_has_frames_noise_and_directions() {
    let stroke = [0xAA, 0x04, 0x0E, 0x01, 0x01, 0x96, 0xFF];
    let (printed, file) = to_pcapng(&[&RAW[..], &[0x11], &stroke].concat(), &[]);
    assert_eq!(printed, "bytes: 15, frames: 2, noise bytes: 1\n");
    let (link_types, packets) = packets(&file);
    assert_eq!(link_types, [147]);
    assert_eq!(packets[0], (0, 0, 0b10, [&[0][..], &RAW].concat()));
    assert_eq!(packets[1], (0, 0, 0, vec![2, 0x11]));
    assert_eq!(packets[2], (0, 0, 0b01, [&[1][..], &stroke].concat()));
    assert_eq!(packets.len(), 3);
}

#[test]
fn pcapng_has_the_times_of_a_can_log() {
    let log = b"(1609459200.000001) can0 60F#07AA060001FE9AFF\n(1609459200.5) can0 123#00\n";
    let (printed, file) = to_pcapng(log, &[]);
    assert_eq!(
        printed,
        "CAN frames: 2, PDUs: 1, lost: 0, cyclic frames: 0, frames of others: 1\n"
    );
    let (_, packets) = packets(&file);
    assert_eq!(
        packets,
        [(0, 1_609_459_200_000_001_000, 0b10, [&[0][..], &RAW].concat())]
    );
}

#[test]
fn pcapng_link_type_depends_on_the_arm() {
    let stop = [0xF2, 0x2F, 0xAA, 0xED];
    let (_, file) = to_pcapng(&stop, &["--arm", "alpha1"]);
    let (link_types, alpha1) = packets(&file);
    assert_eq!((link_types, &alpha1[0].3), (vec![149], &[&[1][..], &stop].concat()));
    let heartbeat = [0, 0, 0, 1, 0, 2, 0, 0];
    let (_, file) = to_pcapng(&heartbeat, &["--arm", "xarm", "--from", "host"]);
    let (link_types, xarm) = packets(&file);
    assert_eq!((link_types, &xarm[0].3), (vec![148], &[&[0][..], &heartbeat].concat()));
}

#[test]
fn existing_file_is_not_replaced() {
    let path = free_path("kept");
    fs::write(&path, RAW).unwrap();
    let name = path.to_str().unwrap();
    for to in [name, "/no-such-folder/x"] {
        let line = failure(&run(&["decode", name, "--pcapng", to]));
        assert!(line.starts_with(&format!("{to}: ")), "{line}");
    }
    assert_eq!(fs::read(&path).unwrap(), RAW);
    fs::remove_file(path).unwrap();
}

#[test]
fn pcapng_on_standard_output_is_alone_there() {
    let path = free_path("piped");
    fs::write(&path, RAW).unwrap();
    let output = run(&["decode", path.to_str().unwrap(), "--pcapng", "-"]);
    assert!(output.status.success());
    assert_eq!(packets(&output.stdout).1.len(), 1);
    assert_eq!(output.stderr, b"armwire: bytes: 7, frames: 1, noise bytes: 0\n");
    fs::remove_file(path).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_is_reported_with_the_path() {
    let path = free_path("full");
    fs::write(&path, RAW).unwrap();
    let line = failure(&run(&["decode", path.to_str().unwrap(), "--pcapng", "/dev/full"]));
    assert!(line.contains("/dev/full: No space left"), "{line}");
    fs::remove_file(path).unwrap();
}
