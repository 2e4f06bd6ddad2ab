//! The forms in which people have bytes: what a program writes, read back, whole and in pieces.

use std::fmt::Write as _;
use std::io::Write as _;

use proptest::collection::vec;
use proptest::prelude::*;

use crate::decode::format::Format;
use crate::decode::tests::printed;
use crate::{ArmKind, Speaker};

/// The bytes that are decoded from a text, in order, and the error if there is one. Remarks are errors, too.
fn decoded(text: &str) -> Result<Vec<u8>, String> {
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
    if let Some(error) = error {
        return Err(error);
    }
    let mut bytes = vec![];
    for line in &lines {
        let Some((place, _)) = line.split_once("\n          ") else {
            if ["This is a Ling arm", "These are frames of", "bytes: ", "The marks of"]
                .iter()
                .any(|start| line.starts_with(start))
            {
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

/// Bytes that each form must decode to: at least a frame's header, with a byte that no text has.
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
    let (lines, error) = printed(huge.as_bytes(), None, ArmKind::LingLegacy, None);
    assert_eq!(error, None);
    assert!(
        lines.iter().any(|line| line.ends_with("at most 16777216 are repeated")),
        "{lines:?}"
    );
}

#[test]
fn offset_that_does_not_fit_is_remarked() {
    let text = "00000000: aa06 0001 fe9a ff\n00000010: aa06 0001 fe9a ff\n";
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
    assert_eq!(error, None);
    let remark = "not understood: line 2: '00000010: aa06 0001 fe9a ff': the offset 00000010 does not fit to the bytes \
                  before it: 7 is expected";
    assert!(lines.iter().any(|line| line == remark), "{lines:?}");
    assert_eq!(
        lines.last().unwrap(),
        "bytes: 14, frames: 2, noise bytes: 0, not understood: 1 (offsets that do not fit: 1)"
    );
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
            "12:34:56 AA:06:00:01:FE:9A:FF\n",
            "may be a time or a date (--format log) or bytes (--format hex)",
        ),
        (
            "RX: 07 AA 06 00 01 FE 9A FF\n",
            "'07' may be a number before the bytes, or the first of them",
        ),
        ("RX: [10 20 30]\n", "may be decimal or hexadecimal"),
        (
            "I (1) uart: 00000010 aa 06 00\n",
            "'00000010' may be an offset before the bytes, or the first of them",
        ),
        (
            "0 8 0 8 0 8\n1 2 3\n",
            "the numbers may be decimal (--format dec) or bytes in hexadecimal (--format hex)",
        ),
        (
            "00000000: 010006aa aaff9afe  ........\n",
            "(--format dump-be), as of 'xxd -g 4', or little-endian (--format dump-le)",
        ),
        (":07000000AA060001FE9AFFB1\n", "Intel HEX"),
        ("a: AA 06 00 (b: 01 02 03)\n", "two runs of bytes"),
        ("RX: AA 06 00 0G FF\nRX: AA 06\n", "'0G' is not a byte"),
    ] {
        let (_, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
        let error = error.unwrap_or_default();
        assert!(error.contains(reason), "{text}: {error}");
    }
}

#[test]
fn repetition_without_an_end_is_not_understood() {
    let row = "00000000  aa 06 00 01 fe 9a ff aa  06 00 01 fe 9a ff aa 06 |................|\n";
    for text in [format!("{row}*\n"), format!("{row}*\n{row}00000010\n")] {
        let sum = sum(&text, None).0;
        let doubt = "not understood: 1 (repetitions without an end: 1)";
        assert!(sum.ends_with(doubt), "{text}: {sum}");
    }
}

#[test]
fn lines_before_a_dump_are_counted() {
    let row = "00000000: aa06 0001 fe9a ff  .......\n";
    for (lines, end) in [
        ("         0 1 2 3 4 5 6 7 8 9 A B C D E F\n", ""),
        ("the arm\n", ", lines without bytes: 1"),
        (
            "TX AA 06 00 01 FE 9A FF\n",
            ", not understood: 1 (no offset and bytes of a hex dump: 1)",
        ),
    ] {
        let (lines, error) = printed(
            format!("{lines}{row}").as_bytes(),
            Some(Format::Dump),
            ArmKind::Ling,
            None,
        );
        assert_eq!(error, None);
        let sum = format!("bytes: 7, frames: 1, noise bytes: 0{end}");
        assert_eq!(*lines.last().unwrap(), sum);
    }
}

#[test]
fn half_a_character_of_utf_16_is_an_error() {
    let text = "RX: AA 06 00 01 FE 9A FF\n".encode_utf16().flat_map(u16::to_le_bytes);
    let text: Vec<_> = [0xFF, 0xFE].into_iter().chain(text).chain([0x41]).collect();
    let (lines, error) = printed(&text, None, ArmKind::Ling, None);
    assert_eq!(lines.last().unwrap(), "bytes: 7, frames: 1, noise bytes: 0");
    let error = error.unwrap();
    assert!(error.ends_with("the text in UTF-16 ends within a character"), "{error}");
}

#[test]
fn zero_behind_the_first_line_leaves_a_text() {
    let sum = sum(
        "RX: AA 06 00 01 FE 9A FF\nRX: AA \0 06\nRX: AA 06 00 01 FE 9A FF\n",
        None,
    )
    .0;
    assert!(sum.starts_with("bytes: 14, frames: 2, "), "{sum}");
}

#[test]
fn carriage_return_ends_a_line() {
    let frame = "AA 06 00 01 FE 9A FF";
    for (text, frames) in [
        (format!("RX: {frame}\rTX: {frame}\r\nRX: {frame}\n"), 3),
        (format!("RX: {frame}\rRX: {frame}\r"), 2),
        (format!("{frame}\r{frame}\r{frame}"), 3),
        (frame.replace(' ', "\r").replace("06", "6"), 1),
        (format!("0000: {frame}\r0007: {frame}\r"), 2),
    ] {
        let sum = sum(&text, None).0;
        assert_eq!(
            sum,
            format!("bytes: {}, frames: {frames}, noise bytes: 0", 7 * frames),
            "{text:?}"
        );
    }
}

#[test]
fn two_frames_in_a_line_are_ambiguous() {
    for line in [
        "1 TX: AA 06 00 01 FE 9A FF RX: AA 04 0E 01 01 96 FF",
        "12:00:00 AA 06 00 01 FE 9A FF -> AA 04 0E 01 01 96 FF",
        "12:00:00 AA060001FE9AFF -> AA040E010196FF",
        "TX: AA060001FE9AFF RX: AA040E010196FF",
        "TX: AA-06-00-01-FE-9A-FF / RX: AA-04-0E-01-01-96-FF",
        "RX: AA 04 0E 01 01 96 FF | AA 04 0E 01 01 96 FF",
        "TX: 170 6 0 1 254 154 255 RX: 170 4 14 1 1 150 255",
    ] {
        let (sum, _) = sum(&format!("RX: AA 04 0E 01 01 96 FF\n{line}\n"), None);
        assert!(sum.ends_with("not understood: 1 (ambiguous bytes: 1)"), "{line}: {sum}");
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
        ("UTF-16, big-endian", big.clone()),
        ("UTF-16, little-endian", little.clone()),
        ("UTF-16 without a mark, big-endian", big[2..].to_vec()),
        ("UTF-16 without a mark, little-endian", little[2..].to_vec()),
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
    let (lines, error) = printed(&gzip[..gzip.len() - 9], None, ArmKind::Ling, None);
    assert!(
        error.is_some() && lines.last().unwrap().starts_with("bytes: 2"),
        "{lines:?}"
    );
    let long = text.repeat(110);
    let zstd = ruzstd::encoding::compress_to_vec(long.as_bytes(), level);
    let (lines, error) = printed(&zstd[..zstd.len() - 9], None, ArmKind::Ling, None);
    assert!(error.is_some_and(|error| error.contains("the zstd data is damaged: ")));
    let frames = lines
        .iter()
        .filter(|line| line.ends_with("to the arm: read joints"))
        .count();
    assert!(frames > 2_500, "{frames} of 3,300");
    assert!(lines.last().unwrap().starts_with("bytes: "), "{lines:?}");
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
fn sum_follows_what_was_shown_before_a_refusal() {
    // The last offset may have two bases, and the second line has no offset.
    let dump = "0000000 0000 0000 0000 0000 0000 0000 0000 00aa\nQ0000010 0000 0000 0000 0000\n*\n0000040 00aa\n";
    let (lines, error) = printed(dump.as_bytes(), None, ArmKind::LingLegacy, None);
    assert!(lines[0].starts_with("not understood: line 2: "), "{lines:?}");
    assert!(
        lines
            .last()
            .unwrap()
            .starts_with("bytes: 16, frames: 0, noise bytes: 16, not understood: 1"),
        "{lines:?}"
    );
    assert!(error.is_some_and(|error| error.contains("may have base 16 or 8")));
}

#[test]
fn octal_dump_is_refused() {
    let dump = "0000000 003252 000000 177376 177632\n0000010\n";
    let (lines, error) = printed(dump.as_bytes(), None, ArmKind::Ling, None);
    assert_eq!(lines, [""; 0]);
    assert!(
        error
            .unwrap()
            .ends_with("'003252' is no word in hexadecimal: od needs -t x1")
    );
}

/// Two frames of a Ling arm, a request and its answer, as in `forms`.
fn two_frames() -> Vec<u8> {
    let request = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
    let answer = [0xAA, 0x04, 0x0E, 0x01, 0x01, 0x96, 0xFF];
    [request, answer].concat()
}

#[test]
fn forms_of_programs_are_read() {
    for (text, name) in [
        (
            "0000  aa 06 00 01 fe 9a ff aa  04 0e 01 01 96 ff        ........ ......\n",
            "tshark -x",
        ),
        (
            "00000000 aa 06 00 01 fe 9a ff aa 04 0e 01 01 96 ff       ..............\n",
            "one space before the characters",
        ),
        (
            "Offset(h) 00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F\n\n\
             00000000  AA 06 00 01 FE 9A FF AA 04 0E 01 01 96 FF        ª...þšÿª....–ÿ\n",
            "HxD",
        ),
        (
            "0000 - aa 06 00 01 fe 9a ff aa-04 0e 01 01 96 ff         ..............\n",
            "openssl",
        ),
        (
            "[  123.456789] uart: 00000000: aa 06 00 01 fe 9a ff aa 04 0e 01 01 96 ff  ..............\n",
            "print_hex_dump of the kernel",
        ),
        (
            "I (1234) uart: 0x3ffb0000   aa 06 00 01 fe 9a ff aa  04 0e 01 01 96 ff        |..............|\n",
            "ESP_LOG_BUFFER_HEXDUMP",
        ),
        (
            "   Label: a.bin\r\n\r\n  Offset Bytes Ascii\r\n         00 01 02 03 04 05 06 07\r\n  ------ ----- -----\r\n\
             0000000000000000 AA 06 00 01 FE 9A FF AA \u{FFFD}   \u{FFFD}\u{FFFD}\u{FFFD}\u{FFFD}\r\n\
             0000000000000008 04 0E 01 01 96 FF           \u{FFFD}\u{FFFD}\r\n",
            "Format-Hex",
        ),
        ("AA 6 0 1 FE 9A FF \nAA 4 E 1 1 96 FF \n", "Serial.print(b, HEX)"),
        ("170 6 0 1 254 154 255\n170 4 14 1 1 150 255\n", "Serial.print(b)"),
        (
            "170\n6\n0\n1\n254\n154\n255\n170\n4\n14\n1\n1\n150\n255\n",
            "a number in a line",
        ),
        ("AA\n6\n0\n1\nFE\n9A\nFF\nAA\n4\nE\n1\n1\n96\nFF\n", "a byte in a line"),
        (
            "[\n  170,\n  6,\n  0,\n  1,\n  254,\n  154,\n  255,\n  170,\n  4,\n  14,\n  1,\n  1,\n  150,\n  255\n]\n",
            "JSON over lines",
        ),
        (
            "// frames\nconst uint8_t frames[14] = {\n  170, 6, 0, 1, 254, 154, 255, // joints\n  170, 4, 14, 1, 1, \
             150, 255, /* 75 mm */\n};\nint n = 14;\n",
            "a decimal array of C",
        ),
        (
            "uint8_t f[] = { // two\n  0xAA, 0x6, 0x0, 0x1, 0xFE, 0x9A, 0xFF,  // read 0x06\n  0xAA, 0x04, 0x0E, 1, 1, \
             0x96, 0xFF };\n",
            "an array of C with comments",
        ),
        (
            "uint8_t f[2][7] = {{170, 6, 0, 1, 254, 154, 255}, {170, 4, 14, 1, 1, 150, 255}};\n",
            "an array of arrays",
        ),
        (
            "[-86, 6, 0, 1, -2, -102, -1]\n[-86, 4, 14, 1, 1, -106, -1]\n",
            "signed bytes of Java",
        ),
        (
            "layout:\n  dim: []\n  data_offset: 0\ndata:\n- 170\n- 6\n- 0\n- 1\n- 254\n- 154\n- 255\n---\ndata:\n- 170\n\
             - 4\n- 14\n- 1\n- 1\n- 150\n- 255\n---\n",
            "ros2 topic echo",
        ),
        (
            "['0xaa', '0x6', '0x0', '0x1', '0xfe', '0x9a', '0xff']\n['aa', '04', '0e', '01', '01', '96', 'ff']\n",
            "a list of Python",
        ),
        (
            "[b'\\xaa\\x06\\x00\\x01\\xfe\\x9a\\xff', b'\\xaa\\x04\\x0e\\x01\\x01\\x96\\xff']\n",
            "byte strings of Python",
        ),
        (
            "\"\\xAA\\x06\\x00\\x01\" \"\\xFE\\x9A\\xFF\"\n\\xAA\\x04\\x0E\\x01\\x01\\x96\\xFF\n",
            "strings of C",
        ),
        (
            "write(3, \"\\252\\6\\0\\1\\376\\232\\377\", 7) = 7\nread(3, \"\\xaa\\x04\\x0e\\x01\\x01\\x96\\xff\", 64) = 7\n",
            "strace",
        ),
        ("[aa][06][00][01][fe][9a][ff][aa][04][0e][01][01][96][ff]", "picocom"),
        (
            "<AA><06><00><01><FE><9A><FF>\n<0xAA><0x04><0x0E><0x01><0x01><0x96><0xFF>\n",
            "angle brackets",
        ),
        (
            "AAh 06h 00h 01h FEh 9Ah FFh\ndb 0AAh, 04h, 0Eh, 01h, 01h, 96h, 0FFh\n",
            "an assembler",
        ),
        (
            "$AA $06 $00 $01 $FE $9A $FF\n#AA #04 #0E #01 #01 #96 #FF\n",
            "signs before each byte",
        ),
        (
            "[14:22:00:123] 0xaa 0x06 0x00 0x01 0xfe 0x9a 0xff ␊\n[14:22:00:124] 0xaa 0x04 0x0e 0x01 0x01 0x96 0xff ␊\n",
            "CuteCom",
        ),
        (
            "Time [s],Value,Parity Error,Framing Error\n0.1,0xAA,,\n0.2,0x06,,\n0.3,0x00,,\n0.4,0x01,,\n0.5,0xFE,,\n0.6,0x9A,,\n\
             0.7,0xFF,,\n0.8,0xAA,,\n0.9,0x04,,\n1.0,0x0E,,\n1.1,0x01,,\n1.2,0x01,,\n1.3,0x96,,\n1.4,'255' (0xFF),,\n",
            "Saleae",
        ),
        (
            "0-90 UART: RX data: AA\nuart-1: 06\nuart-1: 00\nuart-1: 01\nuart-1: FE\nuart-1: 9A\nuart-1: FF\n\
             AA 04 0E 01 01 96 FF\n",
            "PulseView",
        ),
        (
            "\u{1b}[32mI (1) RX AA 06 00 01 FE 9A FF\u{1b}[0m\n\u{1b}[1;31mRX\u{1b}[0m AA 04 0E 01 01 96 FF\n",
            "colours",
        ),
        (
            "I (9) uart: aa 06 00 01 fe 9a ff\nI (9) uart: aa 04 0e\nI (9) uart: 03 00 22 ff\n",
            "ESP_LOG_BUFFER_HEX",
        ),
        (
            "0x20000000:\t0xaa\t0x06\t0x00\t0x01\t0xfe\t0x9a\t0xff\n0x20000007:\t0xaa\t0x04\t0x0e\t0x01\t0x01\t0x96\t0xff\n",
            "x/7xb of gdb",
        ),
        (
            "00: AA 06 00 01 FE 9A FF AA\n08: 04 0E 01 01 96 FF\n",
            "offsets of two digits",
        ),
        (
            "Jun 12 14:22:00 host arm[123]: TX AA 06 00 01 FE 9A FF\nJun  2 14:22:01 AA 04 0E 01 01 96 FF\n",
            "syslog",
        ),
        (
            "Wed Jun 12 14:22:00 2024 AA 06 00 01 FE 9A FF\nWed Jun 12 14:22:01 2024 RX: AA 04 0E 01 01 96 FF\n",
            "asctime",
        ),
        (
            "12/06/2024 14:22:00.123 [TX] - 170 006 000 001 254 154 255 \n\
             12/06/2024 14:22:00.130 [RX] - <170><004><014><001><001><150><255>\n",
            "Docklight in decimal",
        ),
        (
            "12.06.2024 14:22:00 AA 06 00 01 FE 9A FF\n12.06.2024 14:22:01 AA 04 0E 01 01 96 FF\n",
            "date and time",
        ),
        (
            "t,d0,d1,d2,d3,d4,d5,d6\n0.5,AA,06,00,01,FE,9A,FF\n1.5,AA,04,0E,01,01,96,FF\n",
            "columns of bytes",
        ),
        (
            "Received: 170 6 0 1 254 154 255\nReceived: 170, 4, 14, 1, 1, 150, 255\n",
            "decimal numbers behind a direction",
        ),
        (
            "new byte[] { (byte) 0xAA, (byte) 0x06, (byte) 0x00, (byte) 0x01, (byte) 0xFE, (byte) 0x9A, (byte) 0xFF };\n\
             new byte[] { (byte) 0xAA, 0x04, 0x0E, 0x01, 0x01, (byte) 0x96, (byte) 0xFF };\n",
            "arrays of Java",
        ),
        (
            "I send AA 06 00 01 FE 9A FF and the arm is silent.\n“AA–04–0E–01–01–96–FF”\n",
            "a letter",
        ),
        (
            "[14:22:01.123]发→◇AA 06 00 01 FE 9A FF \n□\n[14:22:01.130]收：AA 04 0E 01 01 96 FF \n",
            "SSCOM",
        ),
        (
            "0B1F:0000  AA 06 00 01 FE 9A FF AA   ........\n0B1F:0008  04 0E 01 01 96 FF         ......\n",
            "DEBUG",
        ),
        (
            "0000000 aa06 0001 fe9a ffaa 040e 0101 96ff       >..............<\n000000e 0022 >.\"<\n",
            "od --endian=big",
        ),
        (
            "\u{1b}[1;32m00000000\u{1b}[0m: aa06 0001 fe9a ff\u{1b}[0maa 040e 0101 96ff\u{a0}\u{a0}..............\n",
            "xxd in colours, with other spaces",
        ),
        ("b'aa060001fe9aff'\nb'aa 04 0e 01 01 96 ff'\n", "binascii.hexlify"),
        (
            "frame=['0xaa', '0x6', '0x0', '0x1', '0xfe', '0x9a', '0xff'], checksum=0x9a\nAA 04 0E 01 01 96 FF\n",
            "a checksum behind the bytes",
        ),
        (
            "000001: Write Request (DOWN), 12:00:00.123\n\n AA 06 00 01 FE 9A FF   ª...þšÿ\n\n000002: Read (UP)\n\n \
             AA 04 0E 01 01 96 FF   ª....–ÿ\n",
            "Device Monitoring Studio",
        ),
    ] {
        let (mut lines, error) = printed(text.as_bytes(), None, ArmKind::LingLegacy, None);
        assert_eq!(error, None, "{name}");
        lines.retain(|line| line != "These are frames of a Ling arm: --arm ling");
        let sum = lines.last().unwrap();
        let len = if name == "od --endian=big" { 16 } else { 14 };
        assert!(
            sum.starts_with(&format!("bytes: {len}, ")) && !sum.contains("not understood"),
            "{name}: {lines:?}"
        );
        let shown: Vec<u8> = decoded(text).unwrap_or_else(|reason| panic!("{name}: {reason}"));
        match name {
            "ESP_LOG_BUFFER_HEX" => assert_eq!(shown[7..], [0xAA, 4, 0x0E, 3, 0, 0x22, 0xFF]),
            "PulseView"
            | "strace"
            | "decimal numbers behind a direction"
            | "Docklight in decimal"
            | "syslog"
            | "asctime"
            | "a letter"
            | "SSCOM"
            | "Device Monitoring Studio" => {}
            _ => assert_eq!(shown[..14], two_frames(), "{name}"),
        }
    }
}

#[test]
fn text_in_an_encoding_of_one_byte_is_text() {
    let text = b"# Gr\xF6\xDFe der Antwort: 7 Bytes\nTX: AA 06 00 01 FE 9A FF\n";
    let (lines, error) = printed(text, None, ArmKind::Ling, None);
    assert_eq!(error, None);
    assert_eq!(
        lines.last().unwrap(),
        "bytes: 7, frames: 1, noise bytes: 0, lines without bytes: 1"
    );
}

#[test]
fn line_that_is_not_understood_costs_only_itself() {
    for (text, sum) in [
        (
            "RX: AA 06 00 01\nRX: AA 06 00 0G FF\nRX: FE 9A FF\n",
            "bytes: 7, frames: 1, noise bytes: 0, not understood: 1 (no bytes in hexadecimal: 1)",
        ),
        (
            "AA 06 00 01\n2024 was long ago\nFE 9A FF\n",
            "bytes: 7, frames: 1, noise bytes: 0, not understood: 1 (no bytes in hexadecimal: 1)",
        ),
        (
            "170 6 0 1\n254 154 256\n254 154 255",
            "bytes: 7, frames: 1, noise bytes: 0, not understood: 1 (no numbers from 0 to 255: 1)",
        ),
        (
            "00000000  aa 06 00 01  |....|\nRX: AA 06 00 01 FE 9A FF\n00000004  fe 9a ff\n",
            "bytes: 7, frames: 1, noise bytes: 0, not understood: 1 (no offset and bytes of a hex dump: 1)",
        ),
    ] {
        let (lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
        assert_eq!(error, None, "{text}");
        assert_eq!(lines.last().unwrap(), sum, "{text}");
        assert!(
            lines.iter().any(|line| line.starts_with("not understood: line 2: '")),
            "{lines:?}"
        );
    }
}

#[test]
fn little_endian_dump_is_told_by_its_characters() {
    let text = "00000000: 010006aa aaff9afe 010e04aa  ............\n0000000c: 22ff9601  ...\"\n";
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
    assert_eq!(error, None);
    assert_eq!(
        lines.last().unwrap(),
        "bytes: 16, frames: 2, noise bytes: 2",
        "{lines:?}"
    );
    let text = text.replace("22ff9601  ...\"", "00ff9601  ....");
    let read = |format| printed(text.as_bytes(), Some(format), ArmKind::Ling, None).0;
    use crate::decode::format::Format;
    assert!(read(Format::DumpLe)[0].ends_with("to the arm: read joints"));
    assert!(read(Format::DumpBe)[0].starts_with("       0  01 00 06"));
}

#[test]
fn log_of_the_arms_side_sends_what_the_arm_sends() {
    use crate::decode::output::Entries;
    use crate::decode::{Head, Line, Verdict, decode_recording};

    let out = Entries::default();
    let text = "RX: F2 2F 00 00 00 00 00 00 00 ED\nTX: F2 2F AA ED\n";
    let line = Line {
        arm: ArmKind::Alpha1,
        from: None,
        tx: Speaker::Arm,
    };
    let head = Head::new("log".to_owned(), Box::new(text.as_bytes()), &out);
    assert_eq!(decode_recording(head, &out, None, line).unwrap(), Verdict::default());
    let lines = out.into_lines();
    assert!(
        lines[0].ends_with("to the arm: stop") && lines[1].ends_with("from the arm: stop: done"),
        "{lines:?}"
    );
}

#[test]
fn files_of_other_programs_are_refused_by_name() {
    for (beginning, what) in [
        (&b"SQLite format 3\0\x10\0"[..], "an SQLite database: "),
        (b"MDF     4.10    ", "an ASAM MDF file: "),
        (b"#ROSBAG V2.0\nE\0", "a bag of ROS 1: "),
        (b"\xFD7zXZ\0\0\x04", "compressed by xz: "),
        (b"BZh91AY&SY", "compressed by bzip2: "),
        (b"\x04\x22\x4D\x18\x64", "compressed by lz4: "),
        (b"PK\x03\x04\x14\0", "a ZIP archive: "),
        (b"UnFinMF 4.10    ", "an ASAM MDF file: "),
        (
            b"PAR1\x15\x04\x15",
            "a Parquet file, as of a LeRobot data set: tools/lerobot_to_mcap.py ",
        ),
        (b"btsnoop\0\0\0\0\x01", "a Bluetooth HCI log (btsnoop): 'tshark "),
        (b"<SALEAE>\0\0\0\0", "a binary export of Saleae Logic: "),
        (b"\x93NUMPY\x01\0", "an array of NumPy: "),
    ] {
        let (lines, error) = printed(beginning, None, ArmKind::Ling, None);
        assert!(lines.is_empty());
        assert!(
            error
                .as_ref()
                .is_some_and(|error| error.starts_with(&format!("log: {what}"))),
            "{error:?}"
        );
    }
}

/// The sum of a text of a Ling arm, and whether all of its frames are messages.
fn sum(text: &str, from: Option<Speaker>) -> (String, Vec<String>) {
    let (mut lines, error) = printed(text.as_bytes(), None, ArmKind::Ling, from);
    assert_eq!(error, None, "{text}");
    (lines.pop().unwrap(), lines)
}

#[test]
fn dates_and_times_before_bytes_are_no_bytes() {
    for time in [
        "2026-01-02 10:23:45",
        "2026-01-02 10:23:45,12",
        "2026-01-02 10:23:45.123456",
        "2026-01-02 10:23:45:123",
        "2026-01-02T10:23:45",
        "2026-01-02T10:23:45Z",
        "2026/01/02 10:23:45",
        "26-01-02 10:23:45",
        "02-01-2026 10:23:45",
        "02.01.2026 10:23:45",
        "20260102 10:23:45",
        "2026-01-02",
        "10:23:45",
        "10:23:45,12",
        "10:23:45:12",
        "10:23",
        "[2026-01-02 10:23:45]",
    ] {
        for first in ["AA 06", "aa06", "0xAA 0x06"] {
            let text = format!("{time} {first} 00 01 FE 9A FF\n").repeat(2);
            assert_eq!(sum(&text, None).0, "bytes: 14, frames: 2, noise bytes: 0", "{text}");
        }
        let text = format!("{time} RX 06 00 AA 06 00 01 FE 9A FF\n{time} TX AA:06:00:01:FE:9A:FF\n");
        assert_eq!(sum(&text, None).0, "bytes: 16, frames: 2, noise bytes: 2", "{text}");
    }
}

#[test]
fn offset_behind_a_direction_is_no_byte() {
    let text = include_str!("../../../tests/texts/pyserial-spy.log");
    let (sum, lines) = sum(text, None);
    assert_eq!(
        sum, "bytes: 79, frames: 6, noise bytes: 0, lines without bytes: 2",
        "{lines:?}"
    );
}

#[test]
fn bytes_that_go_on_in_the_next_line_are_joined() {
    let esphome = include_str!("../../../tests/texts/esphome-wrapped.log");
    assert_eq!(sum(esphome, None).0, "bytes: 79, frames: 6, noise bytes: 0");
    let prefixed = "[1] RX: AA 06 00 0F 00 08 34 08 6C 07\n[2]     00 08 00 08 00 0A F4 01 10 90 FF\n";
    assert_eq!(sum(prefixed, None).0, "bytes: 21, frames: 1, noise bytes: 0");
    // A terminal wraps a line without an indentation. The bytes of an idle line stand for themselves.
    let wrapped = "RX: AA 06 00 0F 00 08 34 08 6C 07\n00 08 00 08 00 0A F4 01 10 90 FF\nAA 06 00 01 FE 9A FF\n";
    let (sum, lines) = sum(wrapped, None);
    assert_eq!(sum, "bytes: 28, frames: 2, noise bytes: 0");
    assert!(lines[0].contains("from the arm: joints: "), "{lines:?}");
    assert!(lines[1].ends_with("to the arm: read joints"), "{lines:?}");
}

/// What is said once of marks that are wrong.
const CONTRADICTED: &str = "The marks of direction contradict the frames";

#[test]
fn marks_of_direction_are_hints() {
    let arduino = include_str!("../../../tests/texts/arduino.log");
    let (total, lines) = sum(arduino, None);
    assert_eq!(total, "bytes: 58, frames: 3, noise bytes: 0");
    let meanings = lines.iter().filter(|line| line.contains("from the arm: ")).count();
    let remarks = lines.iter().filter(|line| line.starts_with(CONTRADICTED)).count();
    assert_eq!((meanings, remarks), (3, 1), "{lines:?}");
    // The option overrides the mark.
    let (_, lines) = sum("RX: AA 06 00 01 FE 9A FF\n", Some(Speaker::Host));
    assert!(
        lines[0].ends_with("to the arm: read joints") && lines.len() == 1,
        "{lines:?}"
    );
    let (sum, lines) = sum(arduino, Some(Speaker::Host));
    assert_eq!(
        sum, "bytes: 58, frames: 3, noise bytes: 0, frames without a message: 3",
        "{lines:?}"
    );
}

#[test]
fn both_sides_turn_if_one_is_contradicted() {
    let text = "RX: 00 01 00 02 00 01 0D\nTX: 00 01 00 02 00 05 0D 00 00 00 00\n".repeat(3);
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::Xarm, None);
    assert_eq!(error, None);
    let (sum, lines) = lines.split_last().unwrap();
    assert_eq!(sum, "bytes: 54, frames: 6, noise bytes: 0");
    for (direction, bytes) in [("to the arm", "0D"), ("from the arm", "00")] {
        let of_direction = |line: &&String| line.contains(&format!("\n          {direction}: "));
        let items: Vec<_> = lines.iter().filter(of_direction).collect();
        let is_right = |line: &&String| line.split('\n').next().unwrap().ends_with(bytes);
        assert!(items.len() == 3 && items.iter().all(is_right), "{lines:?}");
    }
}

/// The directions of an xArm's frames in a text, and the sum.
fn directions(text: &str, from: Option<Speaker>) -> (String, String) {
    let (lines, error) = printed(text.as_bytes(), None, ArmKind::Xarm, from);
    assert_eq!(error, None);
    let direction = |line: &String| match line.split_once("\n          ")?.1 {
        text if text.starts_with("to the arm") => Some('>'),
        text if text.starts_with("from the arm") => Some('<'),
        _ => Some('?'),
    };
    (
        lines.iter().filter_map(direction).collect(),
        lines.last().unwrap().clone(),
    )
}

/// Reading and setting a state, motion, and a version, with their answers.
const BOTH_WAYS: [&str; 8] = [
    "00 01 00 02 00 01 01",
    "00 01 00 02 00 08 01 00 36 2C 36 2C 58 00",
    "00 02 00 02 00 03 0B 08 01",
    "00 02 00 02 00 02 0B 10",
    "00 03 00 02 00 02 0C 00",
    "00 03 00 02 00 02 0C 00",
    "00 04 00 02 00 01 0D",
    "00 04 00 02 00 03 0D 00 02",
];

#[test]
fn answers_of_an_xarm_are_told_by_their_numbers() {
    for mark in ["TX: ", "RX: ", ""] {
        let text: String = BOTH_WAYS.iter().map(|frame| format!("{mark}{frame}\n")).collect();
        let (directions, sum) = directions(&text, None);
        assert_eq!(directions, "><><><><", "{mark}");
        assert_eq!(sum, "bytes: 70, frames: 8, noise bytes: 0", "{mark}");
    }
    let text: String = BOTH_WAYS.iter().map(|frame| format!("TX: {frame}\n")).collect();
    assert_eq!(directions(&text, Some(Speaker::Host)).0, ">?>>>>>>");
}

#[test]
fn frame_that_may_be_either_senders_is_counted() {
    let text: String = BOTH_WAYS[4..].iter().map(|frame| format!("TX: {frame}\n")).collect();
    let (shown, sum) = directions(&text, None);
    assert_eq!(shown, ">>><");
    assert_eq!(
        sum,
        "bytes: 32, frames: 4, noise bytes: 0, frames of uncertain direction: 1"
    );
    // An answer whose request is missing.
    let frames = [&BOTH_WAYS[3..4], &BOTH_WAYS[6..]].concat();
    let text: String = frames.iter().map(|frame| format!("TX: {frame}\n")).collect();
    let (shown, sum) = directions(&text, None);
    assert_eq!(shown, ">><");
    assert!(sum.ends_with(", frames of uncertain direction: 1"), "{sum}");
}

#[test]
fn number_of_a_lost_answer_is_used_again() {
    // The answer to the third frame is lost, and another connection has its number again.
    let frames = [&BOTH_WAYS[..2], &BOTH_WAYS[4..5], &BOTH_WAYS[6..], &BOTH_WAYS[4..6]].concat();
    let text: String = frames.iter().map(|frame| format!("TX: {frame}\n")).collect();
    let (shown, sum) = directions(&text, None);
    assert_eq!(shown, "><>><><");
    assert!(sum.ends_with(", frames of uncertain direction: 1"), "{sum}");
}

#[test]
fn requests_between_answers_are_counted() {
    // The first request may be an answer.
    for mark in ["RX: ", ""] {
        let text: String = BOTH_WAYS[2..6].iter().map(|frame| format!("{mark}{frame}\n")).collect();
        let (shown, sum) = directions(&text, None);
        assert_eq!(shown, "<<<<");
        assert_eq!(
            sum,
            "bytes: 33, frames: 4, noise bytes: 0, frames of uncertain direction: 2"
        );
    }
    let text: String = BOTH_WAYS[2..6].iter().map(|frame| format!("{frame}\n")).collect();
    assert_eq!(
        directions(&text, Some(Speaker::Arm)).1,
        "bytes: 33, frames: 4, noise bytes: 0"
    );
}

#[test]
fn requests_with_one_number_are_no_answers() {
    let requests = "TX: 00 01 00 02 00 03 0B 08 01\nTX: 00 01 00 02 00 03 0B 08 00\n";
    // The other direction has its own mark.
    let answers = "RX: 00 01 00 02 00 02 0B 00\n";
    let (shown, sum) = directions(&format!("{answers}{}", requests.repeat(3)), None);
    assert_eq!(shown, "<>>>>>>");
    assert_eq!(sum, "bytes: 62, frames: 7, noise bytes: 0");
    // Without one nothing tells.
    let (_, sum) = directions(&requests.repeat(3), None);
    assert!(sum.contains(", frames of uncertain direction: "), "{sum}");
}

#[test]
fn marks_that_the_frames_confirm_are_believed() {
    for (arm, text) in [
        (ArmKind::Ling, "-> AA 06 00 01 FE 9A FF\n<- AA 04 0E 01 01 96 FF\n"),
        (ArmKind::Alpha1, "-> F2 2F 00 00 00 00 00 00 00 ED\n<- F2 2F AA ED\n"),
        // An answer may be a request of as many bytes.
        (
            ArmKind::Xarm,
            "-> 00 01 00 02 00 01 0D\n<- 00 01 00 02 00 05 0D 00 00 00 02\n",
        ),
    ] {
        let (lines, error) = printed(text.as_bytes(), None, arm, None);
        assert_eq!(error, None);
        assert!(
            lines[0].contains("to the arm: ") && lines[1].contains("from the arm: "),
            "{lines:?}"
        );
        let (mut swapped, error) = printed(
            text.replace("->", "→")
                .replace("<-", "->")
                .replace('→', "<-")
                .as_bytes(),
            None,
            arm,
            None,
        );
        assert_eq!(error, None);
        let remark = swapped
            .iter()
            .position(|line| line.starts_with(CONTRADICTED))
            .expect("a remark");
        swapped.remove(remark);
        let is_same = if arm == ArmKind::Xarm { 1 } else { lines.len() };
        assert_eq!(swapped[..is_same], lines[..is_same]);
    }
}

#[test]
fn wrong_arm_is_named_behind_the_sum() {
    for (arm, text, line) in [
        (
            ArmKind::Alpha1,
            "TX: AA 06 00 01 FE 9A FF\n",
            "These are frames of a Ling arm: --arm ling",
        ),
        (
            ArmKind::Xarm,
            "AA 06 00 01 FE 9A FF\n",
            "These are frames of a Ling arm: --arm ling",
        ),
        (
            ArmKind::Ling,
            "F2 2F AA ED\nF2 2F AA ED\n",
            "These are frames of an Alpha1: --arm alpha1",
        ),
        (
            ArmKind::Ling,
            "F2 2F 00 00 00 00 00 00 00 ED\n",
            "These are frames of an Alpha1: --arm alpha1 --from host",
        ),
        (
            ArmKind::Ling,
            "00 01 00 02 00 05 0D 00 00 00 02\n",
            "These are frames of an xArm: --arm xarm",
        ),
    ] {
        let (lines, _) = printed(text.as_bytes(), None, arm, None);
        assert_eq!(lines.last().unwrap(), line, "{lines:?}");
    }
    // Noise is of no arm.
    let (lines, _) = printed(&[0x81; 3000], None, ArmKind::Ling, None);
    assert_eq!(lines.last().unwrap(), "bytes: 3000, frames: 0, noise bytes: 3000");
}

#[test]
fn tables_of_analysers_are_read() {
    type Cell = fn(u8) -> String;
    let hex: Cell = |byte| format!("0x{byte:02X}");
    for (names, front, cell, back) in [
        ("Time [s],Value,Parity Error,Framing Error", "0.1,", hex, ",,"),
        (
            "Time [s],Value,Parity Error,Framing Error",
            "0.1,",
            |byte| byte.to_string(),
            ",,",
        ),
        (
            "Time [s],Value,Parity Error,Framing Error",
            "0.1,",
            |byte| format!("0b{:04b} {:04b}", byte >> 4, byte & 15),
            ",,",
        ),
        ("Time [s];Value;Parity Error;Framing Error", "0.1;", hex, ";;"),
        (
            "Time [s],Analyzer Name,Decoded Protocol Result",
            "0.1,Async Serial,",
            hex,
            "",
        ),
        (
            "name,type,start_time,duration,data,error",
            "\"Async Serial\",\"data\",0.1,8.6e-05,",
            hex,
            ",",
        ),
        (
            "Id;Time[ns];0:UART: RX/TX;",
            "3;100.00;",
            |byte| format!("{byte:02X}"),
            ";",
        ),
    ] {
        let row = |byte: &u8| format!("{front}{}{back}\n", cell(*byte));
        let rows: String = two_frames().iter().map(row).collect();
        let (sum, lines) = sum(&format!("{names}\n{rows}"), None);
        assert_eq!(
            sum, "bytes: 14, frames: 2, noise bytes: 0, lines without bytes: 1",
            "{names}: {lines:?}"
        );
    }
    let rows: String = two_frames()
        .iter()
        .map(|byte| format!("0-90 uart-1: rx-data: {byte:02X}\n"))
        .collect();
    assert_eq!(sum(&rows, None).0, "bytes: 14, frames: 2, noise bytes: 0");
}

#[test]
fn bytes_in_a_form_that_is_not_read_are_counted() {
    let frame = "TX: AA 06 00 01 FE 9A FF\n";
    for (line, is_counted) in [
        ("AA", true),
        ("RX: AA/04/0E/01/01/96/FF", true),
        ("RX | AA | 04 | 0E | 01 | 01 | 96 | FF", true),
        ("RX: %AA%04%0E%01%01%96%FF", true),
        ("RX: &HAA &H04 &H0E &H01 &H01 &H96 &HFF", true),
        ("RX: 0xAAu, 0x04u, 0x0Eu", true),
        ("RX: 252 004 016 001 001 226 377", true),
        ("04", false),
        ("nothing", false),
        ("RX: joints 12.50 13.75 -10.25 20.00", false),
        ("read 07 values, 12 of 35 are 0", false),
        ("TX: timeout after 20 ms", false),
        ("sent #123", false),
        ("got -100", false),
    ] {
        let (sum, _) = sum(&format!("{frame}{line}\n"), None);
        let more = match is_counted {
            true => "not understood: 1 (unknown form of bytes: 1)",
            false => "lines without bytes: 1",
        };
        assert_eq!(sum, format!("bytes: 7, frames: 1, noise bytes: 0, {more}"), "{line}");
    }
}

#[test]
fn row_of_a_table_with_other_columns_is_counted() {
    let text = "Time [s],Value,Parity Error,Framing Error\n0.1,0xAA,,\n0.2,06\n";
    let (sum, lines) = sum(text, None);
    assert!(
        sum.ends_with("not understood: 1 (no byte in the column of bytes: 1)"),
        "{sum} {lines:?}"
    );
}

#[test]
fn row_of_a_table_without_its_byte_is_counted() {
    let text = "Time [s],Value,Parity Error,Framing Error\n0.1,0xAA,,\n0.2,A,,\n0.3,\\r,,\n0.4,0x06,,\n";
    let (sum, lines) = sum(text, None);
    assert!(
        sum.ends_with("lines without bytes: 1, not understood: 2 (no byte in the column of bytes: 2)"),
        "{sum} {lines:?}"
    );
}
