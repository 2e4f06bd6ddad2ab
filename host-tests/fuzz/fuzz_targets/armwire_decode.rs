//! `armwire decode` of any input: its totals match its lines, every byte is in a line, and an unreadable input is an
//! error of one line.
#![no_main]

use armwire_cli::{ArmKind, Speaker, decode};
use libfuzzer_sys::fuzz_target;

const ARMS: [ArmKind; 5] = [
    ArmKind::Ling,
    ArmKind::Xarm,
    ArmKind::Alpha1,
    ArmKind::LingLegacy,
    ArmKind::Alpha1Servo,
];

fuzz_target!(|input: &[u8]| {
    let Some((kind, recording)) = input.split_first() else {
        return;
    };
    let arm = ARMS[usize::from(*kind) % ARMS.len()];
    let from = [None, Some(Speaker::Host), Some(Speaker::Arm)][usize::from(*kind) / ARMS.len() % 3];
    match decode(recording, arm, from) {
        Ok(lines) => check(&lines),
        // The error may quote the input.
        Err(error) => assert_eq!(error.lines().count(), 1),
    }
});

/// The sum is that of the lines. Lines behind it may name other arms.
fn check(lines: &[String]) {
    let is_sum = |line: &&String| !line.starts_with("These are frames of ") && !line.starts_with("USB device ");
    let sum = lines.iter().rev().find(is_sum).expect("there is always a sum");
    // A capture may have nothing that is read, streams of several endpoints, or several kinds of links.
    let kinds = [
        sum.starts_with("bytes: "),
        sum.contains("CAN frames: "),
        has_framed(sum),
    ];
    // The entries of USB have times and no offsets.
    let has_times = |line: &String| line.contains("\n          ") && entry(line).is_none();
    let is_of_usb = sum.contains("USB ") || sum.contains("bytes of other devices: ");
    let is_usb = is_of_usb || sum.starts_with("bytes: ") && lines.iter().any(has_times);
    if sum.starts_with("packets read: 0") || is_usb || kinds.iter().filter(|is_there| **is_there).count() > 1 {
        return;
    }
    if sum.starts_with("CAN frames: ") {
        let [frames, pdus, lost, cyclic, others] = [
            "CAN frames: ",
            "PDUs: ",
            "lost: ",
            "cyclic frames: ",
            "frames of others: ",
        ]
        .map(|what| count(sum, what));
        let shown = lines.iter().filter(|line| line.contains("\n          ")).count();
        // A PDU is lost without an entry if nothing showed an adapter yet.
        assert!(pdus <= shown && shown <= pdus + lost);
        // A frame may end one PDU and begin another.
        assert!(pdus + lost <= 3 * frames && cyclic + others <= frames);
        return;
    }
    // The sum of an MCAP recording, which has no offsets.
    if sum.starts_with("frames: ") {
        let entries: Vec<_> = lines.iter().filter_map(|line| logged(line)).collect();
        // Other lines name damage.
        let shown = lines.iter().filter(|line| line.contains("\n          ")).count();
        assert_eq!(entries.len(), shown);
        let noise: usize = entries
            .iter()
            .filter_map(|&(len, is_noise)| is_noise.then_some(len))
            .sum();
        let frames = entries.iter().filter(|(_, is_noise)| !is_noise).count();
        assert_eq!(
            [frames, noise],
            ["frames: ", "noise bytes: "].map(|what| count(sum, what))
        );
        return;
    }
    let [bytes, frames, noise] = ["bytes: ", "frames: ", "noise bytes: "].map(|what| count(sum, what));
    let [padding, unread] = ["padding bytes: ", "not read: "].map(|what| count(sum, what));
    let entries = lines.iter().filter_map(|line| entry(line));
    // Every byte is in a frame, in noise or in padding. A damaged frame is shown whole, and its bytes may be shown
    // again.
    let (mut shown, mut good) = (0, 0);
    for (offset, len, is_noise) in entries {
        assert!(offset + len <= bytes);
        good += usize::from(!is_noise);
        shown += usize::from(!is_noise) * len;
    }
    assert_eq!(good, frames);
    assert_eq!(shown + noise + padding + unread, bytes);
}

/// Returns true if a sum has that of a recording of frames, perhaps behind others.
fn has_framed(sum: &str) -> bool {
    let sums_of_noise = sum.matches("noise bytes: ").count();
    sums_of_noise > usize::from(sum.starts_with("bytes: "))
}

/// The number behind `what`, 0 if absent.
fn count(sum: &str, what: &str) -> usize {
    let Some((_, rest)) = sum.split_once(what) else {
        return 0;
    };
    let number = rest.split(',').next().unwrap_or_default();
    number.parse().expect("a number")
}

/// Position and length of the bytes of a line, and true for noise. `None` for a line without bytes.
fn entry(line: &str) -> Option<(usize, usize, bool)> {
    let (bytes, meaning) = line.split_once("\n          ")?;
    let mut words = bytes.split_whitespace();
    let offset = words.next()?.parse().ok()?;
    let is_noise = meaning.starts_with("noise: ") || meaning == "the recording ends within a frame";
    Some((offset, words.count(), is_noise))
}

/// Length of the bytes of an entry of an MCAP recording, and true for noise. Time and direction precede the bytes.
fn logged(line: &str) -> Option<(usize, bool)> {
    let (bytes, meaning) = line.split_once("\n          ")?;
    let is_noise = meaning.starts_with("no frame of ") || meaning.starts_with("not one whole frame of ");
    // An unknown direction is one word.
    let before = if bytes.split_whitespace().nth(1) == Some("unknown") {
        2
    } else {
        3
    };
    Some((bytes.split_whitespace().count() - before, is_noise))
}
