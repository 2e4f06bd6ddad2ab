//! The forms in which people have bytes: what a program writes, read back, whole and in pieces.

use std::fmt::Write as _;
use std::io::Write as _;

use proptest::collection::vec;
use proptest::prelude::*;

use crate::decode::tests::printed;
use crate::{ArmKind, Speaker};

/// The bytes that are decoded from a text, in order, and the error if there is one. Remarks are errors, too.
fn decoded(text: &str) -> Result<Vec<u8>, String> {
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
    if let Some(error) = error {
        return Err(error);
    }
    let mut bytes = vec![];
    for line in &lines[..lines.len() - 1] {
        let Some((place, _)) = line.split_once("\n          ") else {
            if line.starts_with("This is a Ling arm") {
                continue;
            }
            return Err(line.clone());
        };
        let mut words = place.split_whitespace();
        let offset: usize = words.next().unwrap().parse().unwrap();
        let shown: Vec<u8> = words.map(|word| u8::from_str_radix(word, 16).unwrap()).collect();
        // A damaged frame is shown whole, and its bytes may be shown again.
        bytes.resize(bytes.len().max(offset + shown.len()), 0);
        bytes[offset..offset + shown.len()].copy_from_slice(&shown);
    }
    Ok(bytes)
}

fn character(byte: u8) -> char {
    match byte {
        b' '..=b'~' => byte.into(),
        _ => '.',
    }
}

/// `xxd -g group`, with a line per 16 bytes.
fn xxd(bytes: &[u8], group: usize) -> String {
    let mut text = String::new();
    for (nth, line) in bytes.chunks(16).enumerate() {
        let groups: Vec<_> = line.chunks(group).map(|group| hex(group, "")).collect();
        let ascii: String = line.iter().copied().map(character).collect();
        let width = 32 + 16usize.div_ceil(group) - 1;
        writeln!(text, "{:08x}: {:width$}  {ascii}", 16 * nth, groups.join(" ")).unwrap();
    }
    text
}

/// `hexdump -C`, or without the column of characters `od -A x -t x1` with longer offsets.
fn hexdump_c(bytes: &[u8], has_ascii: bool) -> String {
    let mut text = String::new();
    for (nth, line) in bytes.chunks(16).enumerate() {
        let ascii: String = line.iter().copied().map(character).collect();
        let ascii = if has_ascii {
            format!("  |{ascii}|")
        } else {
            String::new()
        };
        writeln!(text, "{:08x}  {:48}{ascii}", 16 * nth, hex(line, " ")).unwrap();
    }
    writeln!(text, "{:08x}", bytes.len()).unwrap();
    text
}

/// `hexdump` and `od -x`: little-endian words, the offset in base 16 or 8.
fn words(bytes: &[u8], is_octal: bool) -> String {
    let offset = |offset: usize| match is_octal {
        true => format!("{offset:07o}"),
        false => format!("{offset:07x}"),
    };
    let mut text = String::new();
    for (nth, line) in bytes.chunks(16).enumerate() {
        let word = |word: &[u8]| format!("{:04x}", u16::from_le_bytes([word[0], *word.get(1).unwrap_or(&0)]));
        let words: Vec<_> = line.chunks(2).map(word).collect();
        writeln!(text, "{} {}", offset(16 * nth), words.join(" ")).unwrap();
    }
    text + &offset(bytes.len()) + "\n"
}

/// `od -A n`, `-A x` and `-A o`.
fn od(bytes: &[u8], offset: fn(usize) -> String) -> String {
    let mut text = String::new();
    for (nth, line) in bytes.chunks(16).enumerate() {
        writeln!(text, "{} {}", offset(16 * nth), hex(line, " ")).unwrap();
    }
    text + &offset(bytes.len()) + "\n"
}

fn hex(bytes: &[u8], between: &str) -> String {
    bytes
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect::<Vec<_>>()
        .join(between)
}

fn prefixed(bytes: &[u8]) -> String {
    bytes
        .iter()
        .map(|byte| format!("0x{byte:02x}"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// `repr` of bytes in Python.
fn python(bytes: &[u8]) -> String {
    let is_quoted = bytes.contains(&b'\'') && !bytes.contains(&b'"');
    let quote = if is_quoted { '"' } else { '\'' };
    let mut text = format!("b{quote}");
    for &byte in bytes {
        match byte {
            b'\n' => text += "\\n",
            b'\r' => text += "\\r",
            b'\t' => text += "\\t",
            b'\\' => text += "\\\\",
            b'\'' if !is_quoted => text += "\\'",
            b' '..=b'~' => text.push(byte.into()),
            _ => write!(text, "\\x{byte:02x}").unwrap(),
        }
    }
    text.push(quote);
    text
}

/// A C array, 12 bytes a line, as of `xxd -i`.
fn array(bytes: &[u8]) -> String {
    let lines: Vec<_> = bytes.chunks(12).map(prefixed).collect();
    format!(
        "unsigned char dump_bin[] = {{\n  {}\n}};\nunsigned int dump_bin_len = {};\n",
        lines.join(",\n  "),
        bytes.len()
    )
}

/// What the forms must decode to. Bytes are at least a frame's header, with a byte that no text has.
fn payload() -> impl Strategy<Value = Vec<u8>> {
    vec(any::<u8>(), 3..50).prop_map(|bytes| [&[0xAA, 0x06][..], &bytes].concat())
}

fn prefix() -> impl Strategy<Value = String> {
    let time =
        (0..24u8, 0..60u8, 0..60u8, 0..1000u16).prop_map(|(h, m, s, ms)| format!("{h:02}:{m:02}:{s:02}.{ms:03}"));
    let date = (1..13u8, 1..29u8).prop_map(|(month, day)| format!("2026-{month:02}-{day:02}"));
    (time, date, 0..100_000u32, 0..8usize).prop_map(|(time, date, number, form)| match form {
        0 => String::new(),
        1 => format!("[{time}] "),
        2 => format!("{date} {time} INFO arm.serial: "),
        3 => format!("{date}T{time}Z DEBUG [pid {number}] "),
        4 => format!("[INFO] [{number}.{number}] [driver]: "),
        5 => format!("({number}) "),
        6 => format!("{} ttyUSB0 ", time.replace('.', ",")),
        _ => format!("I ({number}) UART: "),
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn dumps_are_read_back(bytes in payload()) {
        for (name, text) in [
            ("xxd", xxd(&bytes, 2)),
            ("xxd -g 1", xxd(&bytes, 1)),
            ("hexdump -C", hexdump_c(&bytes, true)),
            ("hexdump -C without characters", hexdump_c(&bytes, false)),
            ("hexdump", words(&bytes, false)),
            ("od -x", words(&bytes, true)),
            ("od -A x -t x1", od(&bytes, |offset| format!("{offset:06x}"))),
            ("od -t x1", od(&bytes, |offset| format!("{offset:07o}"))),
            ("od -A d -t x1", od(&bytes, |offset| format!("{offset:07}"))),
            ("xxd -p", hex(&bytes, "") + "\n"),
        ] {
            prop_assert_eq!(decoded(&text), Ok(bytes.clone()), "{}\n{}", name, text);
        }
    }

    #[test]
    fn literals_are_read_back(bytes in payload()) {
        for text in [
            python(&bytes),
            format!("{bytes:?}"),
            format!("{{ {} }}", prefixed(&bytes)),
            format!("[{}]", prefixed(&bytes)),
            array(&bytes),
            hex(&bytes, "-"),
            hex(&bytes, ":"),
            hex(&bytes, ", ").to_uppercase(),
        ] {
            prop_assert_eq!(decoded(&text), Ok(bytes.clone()), "{}", text);
        }
    }

    #[test]
    fn no_digit_of_a_prefix_becomes_data(
        reads in vec((prefix(), 0..6usize, payload()), 1..6),
        form in 0..3usize,
    ) {
        let mut text = String::new();
        let mut sent = [Vec::<u8>::new(), Vec::new()];
        for (prefix, direction, bytes) in &reads {
            let (direction, side) = [
                ("RX: ", 0), ("TX: ", 1), ("<- ", 0), ("-> ", 1), ("recv ", 0), ("send: ", 1),
            ][*direction];
            let bytes_text = match form {
                0 => hex(bytes, " "),
                1 => python(bytes),
                _ => format!("{bytes:?}"),
            };
            writeln!(text, "{prefix}{direction}{bytes_text}").unwrap();
            sent[side].extend(bytes.iter().copied());
        }
        let (lines, error) = printed(text.as_bytes(), None, ArmKind::Xarm, None);
        // A stream of an xArm breaks at the first wrong byte.
        prop_assert!(error.is_none_or(|error| error.contains("the stream is broken")), "{}", text);
        prop_assert!(!lines.is_empty());
        let (lines, error) = printed(text.as_bytes(), None, ArmKind::LingLegacy, None);
        prop_assert_eq!(error, None, "{}", text);
        let total = sent[0].len() + sent[1].len();
        let sum = lines.last().unwrap();
        prop_assert!(sum.starts_with(&format!("bytes: {total}, ")), "{}\n{}", text, sum);
    }
}

#[test]
fn directions_are_those_of_the_decoder() {
    let text = "12:00:00.001 TX: AA 06 00 01 FE 9A FF\n12:00:00.003 RX: AA 04 0E 01\n12:00:00.004 TX: AA 06\n\
                12:00:00.005 RX: 01 96 FF\n";
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
    assert_eq!(error, None);
    assert!(
        lines[0].ends_with("AA 06 00 01 FE 9A FF\n          to the arm: read joints"),
        "{lines:?}"
    );
    assert!(lines[1].ends_with("from the arm: stroke: 75 mm"), "{lines:?}");
    assert_eq!(lines.last().unwrap(), "bytes: 16, frames: 2, noise bytes: 2");
    let stop = "<- F2 2F AA ED\n-> F2 2F 00 00 00 00 00 00 00 ED\n";
    let (lines, _) = printed(stop.as_bytes(), None, ArmKind::Alpha1, None);
    assert!(
        lines[0].ends_with("from the arm: stop: done") && lines[1].ends_with("to the arm: stop"),
        "{lines:?}"
    );
}

#[test]
fn dump_of_two_frames_has_no_offsets_in_it() {
    let text = include_bytes!("../../../tests/texts/two-frames.xxd");
    let (lines, error) = printed(text, None, ArmKind::Ling, None);
    assert_eq!(error, None);
    assert_eq!(
        lines.last().unwrap(),
        "bytes: 42, frames: 2, noise bytes: 0",
        "{lines:?}"
    );
}

#[test]
fn repeated_lines_are_repeated() {
    let zeros = "0000000 0000 0000 0000 0000 0000 0000 0000 0000\n*\n";
    for (rest, len) in [
        ("0000040 00aa\n0000041\n", None),
        ("0000040 0000 0000 0000 0000 0000 0000 0000 00aa\n0000060\n", None),
        ("00000a0 1111\n00000a2\n", Some(162)),
    ] {
        let (lines, error) = printed(format!("{zeros}{rest}").as_bytes(), None, ArmKind::LingLegacy, None);
        match len {
            None => assert!(
                error
                    .as_ref()
                    .is_some_and(|error| error.contains("may have base 16 or 8")),
                "{rest} {lines:?} {error:?}"
            ),
            Some(len) => assert!(
                lines.last().unwrap().starts_with(&format!("bytes: {len}, ")),
                "{lines:?}"
            ),
        }
    }
    let text = "00000000  00 00 00 00 00 00 00 00  00 00 00 00 00 00 00 00  |................|\n*\n00000030  11  |.|\n00000031\n";
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::LingLegacy, None);
    assert_eq!(
        (lines.last().unwrap().as_str(), error),
        ("bytes: 49, frames: 0, noise bytes: 49", None)
    );
    let huge = text.replace("00000030", "ffffff00");
    let (_, error) = printed(huge.as_bytes(), None, ArmKind::LingLegacy, None);
    assert!(error.unwrap().contains("at most 16777216 are repeated"));
}

#[test]
fn offset_that_does_not_fit_is_remarked() {
    let text = "00000000: aa06 0001 fe9a ff\n00000010: aa06 0001 fe9a ff\n";
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
    assert_eq!(error, None);
    let remark = "line 2: the offset 00000010 does not fit to the bytes before it: 7 is expected";
    assert!(lines.iter().any(|line| line == remark), "{lines:?}");
    assert_eq!(lines.last().unwrap(), "bytes: 14, frames: 2, noise bytes: 0");
}

#[test]
fn ambiguous_text_is_refused_with_both_readings() {
    for (text, reason) in [
        (
            "000000 aa 06 00 01 fe 9a ff\n",
            "may be an offset (--format dump) or bytes (--format hex)",
        ),
        (
            "1609459200 aa 06 00\n1609459201 aa 06\n",
            "may be an offset (--format dump) or bytes (--format hex)",
        ),
        (
            "12:34:56 AA 06 00 01 FE 9A FF\n",
            "may be a time or a date (--format log) or bytes (--format hex)",
        ),
        (
            "RX: 07 AA 06 00 01 FE 9A FF\n",
            "'07' may be a number before the bytes, or the first of them",
        ),
        ("RX: 11 22 33\nRX: [10 20 30]\n", "may be decimal or hexadecimal"),
        ("a: AA 06 00 (b: 01 02 03)\n", "two runs of bytes"),
        ("RX: AA 06 00 0G FF\nRX: AA 06\n", "'0G' is not a byte"),
        ("RX: AA 06\nRX: AA 06 00 0G FF\n", "'0G' is not a byte"),
    ] {
        let (_, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
        let error = error.unwrap_or_default();
        assert!(error.contains(reason), "{text}: {error}");
    }
}

#[test]
fn lines_without_bytes_are_skipped() {
    for text in [
        "opening port\nconnected at 1000000 baud\nRX: AA 06 00 01 FE 9A FF (7 bytes)\n12 items be added\n",
        "Here is a frame:\n\nAA 06 00 01 FE 9A FF\n",
        "# len = 7;\nuint8_t frame[7] = {0xAA, 0x06, 0x0, 0x1, 0xFE, 0x9A, 0xFF}; // read\n",
        "12:00:01 INFO [1234] arm: AA-06-00-01-FE-9A-FF\n",
        "RX ← aa060001fe9aff | ..12 34 |\n",
        "recv bytearray(b'\\xaa\\x06\\x00\\x01\\xfe\\x9a\\xff')\n",
    ] {
        let (lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
        assert_eq!(error, None, "{text}");
        assert!(
            lines.last().unwrap().starts_with("bytes: 7, frames: 1"),
            "{text}: {lines:?}"
        );
    }
}

/// The text in UTF-16, in either order, and compressed.
#[test]
fn packed_text_is_unpacked() {
    let text = "12:00:00.001 µC → TX: AA 06 00 01 FE 9A FF\n".repeat(30);
    let marked = ["\u{FEFF}", &text].concat();
    // It begins with the byte order mark and an ASCII character.
    let units = || marked.encode_utf16();
    let big: Vec<u8> = units().flat_map(u16::to_be_bytes).collect();
    let little: Vec<u8> = units().flat_map(u16::to_le_bytes).collect();
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    gzip.write_all(text.as_bytes()).unwrap();
    let gzip = gzip.finish().unwrap();
    let level = ruzstd::encoding::CompressionLevel::Fastest;
    let zstd = ruzstd::encoding::compress_to_vec(text.as_bytes(), level);
    let sum = "bytes: 210, frames: 30, noise bytes: 0";
    for (name, packed) in [
        ("UTF-8", marked.clone().into_bytes()),
        ("UTF-16, big-endian", big),
        ("UTF-16, little-endian", little),
        ("gzip", gzip.clone()),
        ("two members of gzip", gzip.repeat(2)),
        ("zstd", zstd.clone()),
        ("two frames of zstd", zstd.repeat(2)),
    ] {
        let (lines, error) = printed(&packed, None, ArmKind::Ling, None);
        assert_eq!(error, None, "{name}");
        let sum = if name.starts_with("two") {
            "bytes: 420, frames: 60, noise bytes: 0"
        } else {
            sum
        };
        assert_eq!(lines.last().unwrap(), sum, "{name}");
    }
    for packed in [&gzip[..gzip.len() - 9], &zstd[..zstd.len() - 9]] {
        let (_, error) = printed(packed, None, ArmKind::Ling, None);
        assert!(error.is_some_and(|error| error.starts_with("log: ")));
    }
    let (lines, _) = printed(&gzip, Some(crate::decode::format::Format::Raw), ArmKind::Ling, None);
    assert_eq!(
        lines.last().unwrap(),
        &format!("bytes: {0}, frames: 0, noise bytes: {0}", gzip.len())
    );
}

#[test]
fn format_option_decides_the_ambiguous() {
    use crate::decode::format::Format;
    let lines = |text: &str, format| printed(text.as_bytes(), Some(format), ArmKind::Ling, Some(Speaker::Host)).0;
    let text = "000000 aa 06 00 01 fe 9a ff\n";
    assert_eq!(
        lines(text, Format::Dump).last().unwrap(),
        "bytes: 7, frames: 1, noise bytes: 0"
    );
    assert_eq!(
        lines(text, Format::Hex).last().unwrap(),
        "bytes: 10, frames: 1, noise bytes: 3"
    );
    let text = "12:34:56 AA 06 00 01 FE 9A FF\n";
    assert_eq!(
        lines(text, Format::Log).last().unwrap(),
        "bytes: 7, frames: 1, noise bytes: 0"
    );
}

#[test]
fn octal_dump_is_refused() {
    let dump = "0000000 003252 000000 177376 177632\n0000010\n";
    let (lines, error) = printed(dump.as_bytes(), None, ArmKind::Ling, None);
    assert!(lines.iter().all(|line| !line.contains("frame")), "{lines:?}");
    assert!(
        error
            .unwrap()
            .ends_with("'003252' is no word in hexadecimal: od needs -t x1")
    );
}
