//! The files in `tests/texts` and `tests/logs`: of every format and packing, whole and mutated.

use std::io::{self, Read};
use std::path::Path;
use std::{env, fs};

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

use super::{Nowhere, line, printed};
use crate::ArmKind;
use crate::decode::decode_recording;
use crate::decode::input::Head;
use crate::decode::output::Entries;

/// The files of a folder, with their names.
pub(super) fn files(folder: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(folder);
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| {
            let entry = entry.unwrap();
            (
                entry.file_name().into_string().unwrap(),
                fs::read(entry.path()).unwrap(),
            )
        })
        .collect();
    files.sort();
    files
}

/// The arm of a file.
pub(super) fn arm(name: &str) -> ArmKind {
    match name.starts_with("servo-bus") {
        true => ArmKind::Alpha1Servo,
        false => ArmKind::Ling,
    }
}

#[test]
fn texts_of_all_programs_have_the_same_frames() {
    for (name, file) in files("texts") {
        let (lines, error) = printed(&file, None, arm(&name), None);
        assert_eq!(error, None, "{name}");
        let bytes = match name.as_str() {
            "servo-bus.bin" => "bytes: 51, frames: 6, noise bytes: 0",
            "two-frames.xxd" => "bytes: 42, frames: 2, noise bytes: 0",
            "arduino.log" => "bytes: 58, frames: 3, noise bytes: 0",
            "esphome-wrapped.log" | "pyserial-spy.log" => "bytes: 79, frames: 6, noise bytes: 0",
            _ => "bytes: 84, frames: 6, noise bytes: 0",
        };
        // Declarations and brackets, settings of a port, the heading of a dump, keys, and the names of columns.
        let others = match name.as_str() {
            "array.c" | "list.json" | "pyserial-spy.log" => ", lines without bytes: 2",
            "format-hex.txt" => ", lines without bytes: 3",
            "ros.yaml" => ", lines without bytes: 30",
            "saleae.csv" | "saleae-decimal.csv" => ", lines without bytes: 1",
            _ => "",
        };
        assert_eq!(lines.last().unwrap(), &format!("{bytes}{others}"), "{name}");
    }
}

/// A file again and again, in pieces.
struct Repeated<'a> {
    file: &'a [u8],
    at: usize,
    left: usize,
}

impl Read for Repeated<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.at == self.file.len() && self.left > 0 {
            (self.at, self.left) = (0, self.left - 1);
        }
        let n = bytes.len().min(self.file.len() - self.at);
        bytes[..n].copy_from_slice(&self.file[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}

#[test]
fn memory_does_not_grow_with_a_text() {
    /// Maximum memory, in bytes: buffers, a decompressor, and the window of a decoder.
    const MAX_MEMORY: u64 = 256 * 1024;
    const TOTAL: usize = 320 * 1024;
    for (name, file) in files("texts") {
        let measured = allocation_counter::measure(|| {
            let left = TOTAL / file.len();
            let source = Repeated {
                file: &file,
                at: 0,
                left,
            };
            let head = Head::new("log".to_owned(), Box::new(source), &Nowhere);
            decode_recording(head, &Nowhere, None, line(arm(&name), None)).unwrap();
        });
        let memory = measured.bytes_max;
        assert!(memory < MAX_MEMORY, "{name}: {memory} bytes");
    }
}

/// A change of a file.
#[derive(Clone, Debug)]
pub(super) enum Mutation {
    Set(Index, u8),
    Insert(Index, Vec<u8>),
    Remove(Index, usize),
    Repeat(Index, usize, usize),
    Cut(Index),
}

impl Mutation {
    pub(super) fn apply(&self, file: &mut Vec<u8>) {
        if file.is_empty() {
            return;
        }
        let len = file.len();
        let range = |at: &Index, n: usize| at.index(len)..(at.index(len) + n).min(len);
        match self {
            Self::Set(at, byte) => file[at.index(len)] = *byte,
            Self::Insert(at, bytes) => drop(file.splice(range(at, 0), bytes.iter().copied())),
            Self::Remove(at, n) => drop(file.drain(range(at, *n))),
            Self::Repeat(at, n, times) => {
                let part = file[range(at, *n)].repeat(*times);
                drop(file.splice(range(at, 0), part));
            }
            Self::Cut(at) => file.truncate(at.index(len)),
        }
    }
}

pub(super) fn mutation() -> impl Strategy<Value = Mutation> {
    let at = any::<Index>;
    prop_oneof![
        4 => (at(), any::<u8>()).prop_map(|(at, byte)| Mutation::Set(at, byte)),
        2 => (at(), vec(any::<u8>(), 1..9)).prop_map(|(at, bytes)| Mutation::Insert(at, bytes)),
        2 => (at(), 1..40_usize).prop_map(|(at, n)| Mutation::Remove(at, n)),
        1 => (at(), 1..40_usize, 1..60_usize).prop_map(|(at, n, times)| Mutation::Repeat(at, n, times)),
        1 => at().prop_map(Mutation::Cut),
    ]
}

/// Few cases, unless `PROPTEST_CASES` asks for more: each has every file.
fn config() -> ProptestConfig {
    let config = ProptestConfig::default();
    match env::var_os("PROPTEST_CASES") {
        Some(_) => config,
        None => ProptestConfig { cases: 8, ..config },
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn mutated_files_end_with_a_sum(mutations in vec(mutation(), 1..6)) {
        for (name, mut file) in [files("texts"), files("logs")].concat() {
            for mutation in &mutations {
                mutation.apply(&mut file);
            }
            let out = Entries::default();
            let head = Head::new("log".to_owned(), Box::new(&file[..]), &out);
            let decoded = decode_recording(head, &out, None, line(arm(&name), None));
            let lines = out.into_lines();
            let has_sum = lines.last().is_some_and(|sum| {
                ["bytes: ", "CAN frames: ", "frames: ", "packets read: "].iter().any(|beginning| sum.starts_with(beginning))
            });
            match decoded {
                Ok(_) => prop_assert!(has_sum, "{name}: {lines:?}"),
                // Frames before an error have a sum, too.
                Err(error) => {
                    prop_assert_eq!(error.to_string().lines().count(), 1, "{}: {}", name, error);
                    prop_assert!(has_sum || lines.is_empty(), "{name}: {lines:?}");
                }
            }
        }
    }
}
