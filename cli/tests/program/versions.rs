//! The built program with adapters of other versions of the control port, and the adapter with a host of an older one.
//! Messages of other versions are literal bytes.

use std::fs::OpenOptions;
use std::io::{Read, Write};
use std::process::Output;
use std::sync::mpsc;
use std::thread;

use crate::common::board::Board;
use crate::common::{TIMEOUT, failure, retry_while, run_against};

/// The numbers of requests: the byte after the sequence number.
const IDENTIFY: u8 = 0;
const GET_CONFIG: u8 = 2;
const GET_COUNTERS: u8 = 6;
const GET_LATENCIES: u8 = 7;
const SUBSCRIBE: u8 = 8;
const END_STREAM: u8 = 11;
const GET_LINE: u8 = 12;
const RESERVE_LINE: u8 = 13;
const RELEASE_LINE: u8 = 14;
const GET_RECOVERY: u8 = 16;

/// Replies without their head: kind and sequence number.
const CONFIG: [u8; 15] = [4, 0, 0, 0, 0xC0, 0x84, 0x3D, 0, 0, 0, 100, 0, 0xF4, 0x03, 0];
const LINE: [u8; 13] = [9, 0xC0, 0x84, 0x3D, 0, 0, 0xC0, 0x84, 0x3D, 0, 0, 0, 0];

/// The identity of an adapter with this version. Version 6 has two flags, version 7 the chip 0x1001_6413 behind them.
fn identity(version: u8) -> Vec<u8> {
    let names = b"\x051.2.3\x0C1a2b3c4d5e6f\x07virtual\x0C0123456789AB";
    let end: &[u8] = match version {
        ..6 => &[0],
        6 => &[0, 0],
        _ => &[0, 0, 0x93, 0xC8, 0x85, 0x80, 0x01],
    };
    [&[2, version], &names[..], end].concat()
}

/// Counters, all of them 1.
fn counters(counts: usize) -> Vec<u8> {
    [vec![6], vec![1; counts]].concat()
}

/// The replies of an adapter with this version, this number of counters, and these bytes appended to other replies.
fn replies(version: u8, counts: usize, added: &'static [u8]) -> impl Fn(u8) -> Vec<u8> {
    move |request| {
        let reply = match request {
            IDENTIFY => identity(version),
            GET_CONFIG => CONFIG.to_vec(),
            GET_COUNTERS => return counters(counts),
            GET_LATENCIES => [vec![7], vec![0; 3 * 16]].concat(),
            GET_LINE => LINE.to_vec(),
            GET_RECOVERY if version >= 5 => vec![10, 0],
            _ => vec![1, version],
        };
        [&reply, added].concat()
    }
}

/// The COBS encoding of a message of less than 254 bytes, with its zero at the end.
fn to_stream(message: &[u8]) -> Vec<u8> {
    let blocks = message.split(|byte| *byte == 0);
    let mut stream: Vec<u8> = blocks
        .flat_map(|block| [&[block.len() as u8 + 1], block].concat())
        .collect();
    stream.push(0);
    stream
}

/// The message of a COBS encoding without its zero.
fn from_stream(stream: &[u8]) -> Vec<u8> {
    let mut message = Vec::new();
    let mut rest = stream;
    while let [len, behind @ ..] = rest {
        let (block, behind) = behind.split_at(usize::from(*len) - 1);
        message.extend(block);
        message.extend((!behind.is_empty()).then_some(0));
        rest = behind;
    }
    message
}

/// Runs the program against an adapter. `reply` has the adapter's reply to a request number.
fn run_with(args: &[&str], reply: impl Fn(u8) -> Vec<u8>) -> Output {
    retry_while("the adapter does not answer in", || {
        let mut received = Vec::new();
        run_against(args, |_, pty, bytes| {
            received.extend(bytes);
            while let Some(end) = received.iter().position(|byte| *byte == 0) {
                let request: Vec<u8> = received.drain(..=end).collect();
                if let [sequence, number, ..] = from_stream(&request[..end])[..] {
                    let message = [vec![0, sequence], reply(number)].concat();
                    pty.write(&to_stream(&message)).unwrap();
                }
            }
        })
    })
}

/// The output of a program that succeeds without a warning.
fn printed(output: Output) -> String {
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// The value in the line of this name.
fn value<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.trim())
}

#[test]
fn counters_of_version_3_lack_the_last_four() {
    let text = printed(run_with(&["counters", "control:PORT"], replies(3, 56, &[])));
    assert_eq!(value(&text, "arm_to_host_bytes "), Some("1"), "{text}");
    assert_eq!(value(&text, "late_stamps "), Some("1"), "{text}");
    assert_eq!(value(&text, "untracked_requests "), Some("0"), "{text}");
    assert_eq!(value(&text, "refused_stopped "), Some("0"), "{text}");
}

#[test]
fn counters_of_version_4_lack_the_last_three() {
    let text = printed(run_with(&["counters", "control:PORT"], replies(4, 57, &[])));
    assert_eq!(value(&text, "untracked_requests "), Some("1"), "{text}");
    assert_eq!(value(&text, "refused_stopped "), Some("0"), "{text}");
    assert_eq!(value(&text, "recovery_starts "), Some("0"), "{text}");
}

#[test]
fn unknown_counters_of_version_8_are_skipped() {
    let text = printed(run_with(&["counters", "control:PORT"], replies(8, 61, &[])));
    assert_eq!(value(&text, "recovery_starts "), Some("1"), "{text}");
    assert_eq!(
        text,
        printed(run_with(&["counters", "control:PORT"], replies(6, 60, &[])))
    );
}

#[test]
fn adapter_of_any_version_is_described() {
    for version in 3..=8 {
        // Version 8 has more at the end of each message.
        let added: &[u8] = if version == 8 { &[1, 2, 3] } else { &[] };
        let text = printed(run_with(&["info", "control:PORT"], replies(version, 60, added)));
        let chip = if version < 7 { "" } else { ", chip 0x10016413" };
        let expected = [
            &format!("adapter          virtual, serial number 0123456789AB, firmware 1.2.3 (1a2b3c4d5e6f){chip}"),
            "configured       arm ling, poll off, silence after 500 ms",
            "can              node 0, 1000000 bit/s, telemetry off, commands off",
        ];
        assert_eq!(text.lines().collect::<Vec<_>>(), expected, "version {version}");
    }
}

#[test]
fn error_names_version_8_of_an_adapter() {
    let output = run_with(&["reserve", "control:PORT"], replies(8, 61, &[]));
    let line = failure(&output);
    assert!(
        line.ends_with(
            "the adapter does not support this request: its control protocol is version 8, this program's is 7"
        ),
        "{line}"
    );
}

#[test]
fn unknown_reply_of_version_8_is_reported() {
    let output = run_with(&["counters", "control:PORT"], |request| match request {
        GET_LATENCIES => vec![12, 1],
        _ => replies(8, 61, &[])(request),
    });
    let line = failure(&output);
    assert!(
        line.contains("a message of the adapter cannot be read")
            && line.ends_with("is its firmware newer than this program?"),
        "{line}"
    );
}

#[test]
fn host_of_version_3_is_served() {
    let board = Board::start("version-3");
    let path = board.control.strip_prefix("control:").unwrap();
    let mut port = OpenOptions::new().read(true).write(true).open(path).unwrap();
    let mut reader = port.try_clone().unwrap();
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        let mut byte = [0];
        // Ends with the adapter or with the receiver.
        while reader.read_exact(&mut byte).is_ok() && sender.send(byte[0]).is_ok() {}
    });
    let mut call = |request: &[u8]| {
        port.write_all(&to_stream(request)).unwrap();
        let byte = || receiver.recv_timeout(TIMEOUT).expect("the adapter replies");
        let stream: Vec<u8> = std::iter::repeat_with(byte).take_while(|byte| *byte != 0).collect();
        from_stream(&stream)
    };
    let reply = |body: &[u8]| [&[0, 7], body].concat();
    let done = reply(&[0]);
    let reserved = [&LINE[..11], &[2, 0]].concat();

    assert_eq!(call(&[7, IDENTIFY]), reply(&identity(7)));
    assert_eq!(call(&[7, GET_CONFIG]), reply(&CONFIG));
    assert_eq!(call(&[7, SUBSCRIBE, 0, 1]), done);
    assert_eq!(call(&[7, END_STREAM]), done);
    assert_eq!(call(&[7, GET_LINE]), reply(&LINE));
    assert_eq!(call(&[7, RESERVE_LINE]), done);
    assert_eq!(call(&[7, GET_LINE]), reply(&reserved));
    assert_eq!(call(&[7, RELEASE_LINE]), done);
    // The host knows 56 counters and skips the last four. The 46th counts control requests.
    let counters = call(&[7, GET_COUNTERS]);
    assert_eq!((&counters[..3], counters.len()), (&[0, 7, 6][..], 3 + 60));
    assert_eq!(counters[3 + 45], 9);
    // A request of a later version.
    assert_eq!(call(&[7, 18, 1]), reply(&[1, 7]));
}
