//! Units in are units out: each line, block, object and record of a recording has its place in the account, whatever is
//! done to the file.

use std::collections::BTreeSet;
use std::io::Read;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

use super::files::{Mutation, arm, files, mutation};
use super::{Nowhere, Pieces, line};
use crate::decode::detect::{detect, dump_order};
use crate::decode::doubts::Place;
use crate::decode::format::Format;
use crate::decode::input::Head;
use crate::decode::output::Entries;
use crate::decode::packed::Unpacked;
use crate::decode::text::dump::Order;
use crate::decode::unit::Unit;
use crate::decode::{decode_recording, read};

/// The number of mutations of each format.
const MUTATIONS: u32 = 2_000;
/// Longer files are cut, so that they can be mutated as often.
const MAX_LEN: usize = 300;

/// The code of the last record of an MCAP file.
const FOOTER: u8 = 2;

/// A test file, unpacked.
#[derive(Clone, Debug)]
struct File {
    name: String,
    format: Format,
    order: Option<Order>,
    bytes: Vec<u8>,
}

impl File {
    fn is_text(&self) -> bool {
        !matches!(self.format, Format::Raw | Format::Blf | Format::Mcap | Format::Pcap)
    }
}

/// A file with this name and content, unpacked; `None` if its format is not known.
fn file(name: &str, packed: &[u8]) -> Option<File> {
    let mut bytes = Vec::new();
    Unpacked::new(Box::new(packed)).read_to_end(&mut bytes).ok()?;
    let mut head = Head::new(name.to_owned(), Box::new(&bytes[..]), &Nowhere);
    let format = detect(&mut head).ok()?;
    let order = match format {
        Format::Dump => Some(dump_order(&mut head).ok()?),
        _ => None,
    };
    drop(head);
    Some(File {
        name: name.to_owned(),
        format,
        order,
        bytes,
    })
}

/// The test files of every format.
fn all_files() -> Vec<File> {
    let files = [files("texts"), files("logs")].concat();
    let file = |(name, packed): &(String, Vec<u8>)| file(name, packed).expect(name);
    files.iter().map(file).collect()
}

/// The beginnings of the test files of each format, in which a reader finds units.
fn beginnings_by_format() -> Vec<Vec<File>> {
    let mut formats: Vec<Vec<File>> = Vec::new();
    for mut file in all_files().into_iter().filter(|file| file.format != Format::Raw) {
        file.bytes.truncate(MAX_LEN);
        let is_same = |files: &&mut Vec<File>| (files[0].format, files[0].order) == (file.format, file.order);
        match formats.iter_mut().find(is_same) {
            Some(files) => files.push(file),
            None => formats.push(vec![file]),
        }
    }
    formats
}

/// What a reader says of a unit: its place, and the number of its bytes of a line.
#[derive(Debug)]
struct Said {
    line: Option<u64>,
    offset: Option<u64>,
    bytes: usize,
}

/// What the reader of a file says of each unit, and whether it read to the end.
fn said(file: &File) -> (Vec<Said>, bool) {
    let mut said = Vec::new();
    let head = Head::new(file.name.clone(), Box::new(Pieces(&file.bytes, 1_000)), &Nowhere);
    let mut input = match file.is_text() {
        true => head.into_text().unwrap(),
        false => head.into_input(),
    };
    let read = read(&mut input, file.format, file.order, &mut |place, unit| {
        let (line, offset) = match place {
            Place::Line(number, _) => (Some(number), None),
            Place::Byte(offset) => (None, Some(offset)),
            Place::End => (None, None),
        };
        let bytes = match unit {
            Ok(Unit::Bytes(bytes)) => bytes.bytes.len(),
            _ => 0,
        };
        said.push(Said { line, offset, bytes });
    });
    (said, read.is_ok())
}

/// The number of units of each line: one, and one for NUL bytes around a text.
fn units_of_lines(text: &[u8]) -> Vec<usize> {
    let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
    // A carriage return ends a line, with or without a line feed behind it.
    let text = String::from_utf8_lossy(text).replace("\r\n", "\n").replace('\r', "\n");
    let units = |line: &[u8]| {
        let line = line.strip_suffix(b"\n").unwrap_or(line);
        let has_nul = line.first() == Some(&0) || line.last() == Some(&0);
        1 + usize::from(has_nul && line.iter().any(|byte| *byte != 0))
    };
    text.as_bytes()
        .split_inclusive(|byte| *byte == b'\n')
        .map(units)
        .collect()
}

/// Checks that each unit of a text has one answer of its reader.
fn check_lines(file: &File) -> Result<(), TestCaseError> {
    let expected = units_of_lines(&file.bytes);
    let (said, is_whole) = said(file);
    let mut units = vec![0; expected.len()];
    for said in &said {
        if let Some(number) = said.line {
            units[number as usize - 1] += 1;
        }
    }
    // A reader that refuses the rest has answered for what is before it.
    let read = match is_whole {
        true => expected.len(),
        false => units.iter().position(|units| *units == 0).expect("a refused line"),
    };
    match file.format {
        // A long line is passed on in parts, and its reader takes NUL bytes as it takes others.
        Format::Hex => prop_assert!(units.iter().all(|units| *units > 0), "{file:?}"),
        _ => prop_assert_eq!(&units[..read], &expected[..read], "{:?}", file),
    }
    prop_assert!(units[read..].iter().all(|units| *units == 0), "{:?}", file);
    Ok(())
}

/// Checks that the sum of a text has all bytes of its reader.
fn check_sum(file: &File) -> Result<(), TestCaseError> {
    let total: usize = said(file).0.iter().map(|said| said.bytes).sum();
    let out = Entries::default();
    let head = Head::new(file.name.clone(), Box::new(&file.bytes[..]), &out);
    // The order of bytes in a mutated dump may be another.
    let format = match file.order {
        None => file.format,
        Some(Order::Big) => Format::DumpBe,
        Some(Order::Little) => Format::DumpLe,
        Some(Order::Bits) => return Ok(()),
    };
    let decoded = decode_recording(head, &out, Some(format), line(arm(&file.name), None));
    let lines = out.into_lines();
    let sum = lines.iter().rfind(|line| line.starts_with("bytes: "));
    let is_all = sum.is_some_and(|sum| sum.starts_with(&format!("bytes: {total}, ")));
    prop_assert!(is_all || decoded.is_err(), "{} {:?} {:?}", total, lines, file);
    Ok(())
}

/// Checks that the answers of a reader are in the order of their places, from the start of the file.
fn check_offsets(file: &File) -> Result<(), TestCaseError> {
    let (said, is_whole) = said(file);
    let offsets: Vec<_> = said.iter().filter_map(|said| said.offset).collect();
    prop_assert!(offsets.is_sorted(), "{:?}", file);
    let first = if file.format == Format::Mcap { 8 } else { 0 };
    // A file that ends in its first record has no place but its end.
    let begins = offsets.first() == Some(&first) || offsets.is_empty() && !said.is_empty();
    prop_assert!(begins || !is_whole || file.bytes.is_empty(), "{said:?} {file:?}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(MUTATIONS))]

    #[test]
    fn mutated_units_are_all_in_the_account(mutations in vec(mutation(), 0..6)) {
        thread_local!(static FORMATS: Vec<Vec<File>> = beginnings_by_format());
        let one_of = |files: &Vec<File>| files[mutations.len() % files.len()].clone();
        for mut file in FORMATS.with(|formats| formats.iter().map(one_of).collect::<Vec<_>>()) {
            for mutation in &mutations {
                Mutation::apply(mutation, &mut file.bytes);
            }
            match file.is_text() {
                true => check_lines(&file)?,
                false => check_offsets(&file)?,
            }
            // Of some, for the sake of time.
            if file.format.is_of_line() && mutations.len() == 5 {
                check_sum(&file)?;
            }
        }
    }
}

/// The corpus of the fuzzer is in the repository, not in the package.
#[test]
fn units_of_the_corpus_are_all_in_the_account() {
    let corpus = concat!(env!("CARGO_MANIFEST_DIR"), "/../host-tests/fuzz/corpus/armwire_decode");
    for entry in std::fs::read_dir(corpus).into_iter().flatten() {
        let input = std::fs::read(entry.unwrap().path()).unwrap();
        // The first byte is the arm.
        let Some(file) = input.get(1..).and_then(|bytes| file("corpus", bytes)) else {
            continue;
        };
        match (file.format, file.is_text()) {
            (Format::Raw, _) => {}
            (_, true) => check_lines(&file).unwrap(),
            (_, false) => check_offsets(&file).unwrap(),
        }
    }
}

/// The length of the unit that a file in a binary format begins with, in a file of little-endian numbers.
fn unit_len(file: &File, at: usize) -> usize {
    let rest = &file.bytes[at..];
    let word = |at: usize| u32::from_le_bytes(rest[at..at + 4].try_into().unwrap()) as usize;
    match file.format {
        Format::Pcap if file.bytes.starts_with(b"\x0A\x0D\x0D\x0A") => word(4),
        Format::Pcap => 16 + word(8),
        Format::Mcap => 9 + word(1),
        // Padding is between two objects.
        _ => {
            let size = word(8);
            let next = rest[size..].windows(4).position(|bytes| bytes == b"LOBJ");
            next.map_or(rest.len(), |next| size + next)
        }
    }
}

/// The head of a file, and its units.
fn split(file: &File) -> (Vec<u8>, Vec<Vec<u8>>) {
    let head = match file.format {
        Format::Pcap if file.bytes.starts_with(b"\x0A\x0D\x0D\x0A") => unit_len(file, 0),
        Format::Pcap => 24,
        Format::Mcap => 8,
        _ => u32::from_le_bytes(file.bytes[4..8].try_into().unwrap()) as usize,
    };
    // The end of an MCAP file is no record.
    let end = file.bytes.len() - if file.format == Format::Mcap { 8 } else { 0 };
    let (mut units, mut at) = (Vec::new(), head);
    while at < end {
        let len = unit_len(file, at);
        // Nothing is behind the last record of an MCAP file.
        if file.format != Format::Mcap || file.bytes[at] != FOOTER {
            units.push(file.bytes[at..at + len].to_vec());
        }
        at += len;
    }
    (file.bytes[..head].to_vec(), units)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn units_in_any_order_are_all_in_the_account(order in vec(any::<Index>(), 1..30)) {
        for file in all_files().into_iter().filter(|file| !file.is_text() && file.format != Format::Raw) {
            let (head, units) = split(&file);
            let chosen: Vec<_> = order.iter().map(|at| at.get(&units)).collect();
            let bytes = [head, chosen.iter().copied().flatten().copied().collect()].concat();
            let (said, _) = said(&File { bytes, ..file.clone() });
            let places: BTreeSet<_> = said.iter().filter_map(|said| said.offset).collect();
            // The head of an MCAP file is no record.
            let heads = usize::from(file.format != Format::Mcap);
            prop_assert_eq!(places.len(), heads + chosen.len(), "{}", file.name);
        }
    }

    #[test]
    fn bytes_as_they_are_are_all_in_the_sum(bytes in vec(any::<u8>(), 0..600), piece in 1..100_usize) {
        let out = Entries::default();
        let head = Head::new("log".to_owned(), Box::new(Pieces(&bytes, piece)), &out);
        decode_recording(head, &out, Some(Format::Raw), line(crate::ArmKind::Ling, None)).unwrap();
        let lines = out.into_lines();
        let sum = lines.iter().rfind(|line| line.starts_with("bytes: ")).unwrap();
        prop_assert!(sum.starts_with(&format!("bytes: {}, ", bytes.len())), "{}", sum);
    }
}
