//! The frames in an MCAP recording.

mod chunk;
mod fields;
pub(crate) mod records;

use std::collections::BTreeMap;

use super::doubts::{Doubt, Place};
use super::framed::Recorded;
use super::input::Input;
use super::unit::{Read, Take, Unit};
use crate::error::Error;
use crate::recording::messages::{FRAME, JOINT_STATE, MESSAGE_ENCODING, parse_frame};
use records::{Record, STRUCTURE, Visitor, damaged_record};

/// Passes each record of a file to `take`. A whole file without the frames of `armwire monitor --mcap` is an error.
pub(super) fn read(input: &mut Input<'_>, take: &mut Take<'_>) -> Result<(), Error> {
    let mut frames = Frames {
        take,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        has_doubts: false,
    };
    let is_cut = records::read(input, &mut frames).map_err(|(place, reason)| input.refused_at(place, &reason))?;
    if is_cut {
        frames.take(
            Place::End,
            Err(Doubt::new("the file has no end", "the file has no end")),
        );
    }
    let has_channel = frames.channels.values().any(|kind| *kind == FRAMES);
    match has_channel || frames.has_doubts {
        true => Ok(()),
        false => {
            let reason = format!("no channel of {}: 'armwire monitor --mcap' records one", FRAME.0);
            Err(input.refused_at(input.offset(), &reason))
        }
    }
}

/// The kinds of messages.
const FRAMES: &str = "frames";
const JOINT_STATES: &str = "joint states";
const OTHERS: &str = "messages of other types";

/// The schemas and channels of a file so far.
struct Frames<'t, 'a> {
    take: &'t mut Take<'a>,
    /// The kinds of messages by schema, and by channel.
    schemas: BTreeMap<u16, &'static str>,
    channels: BTreeMap<u16, &'static str>,
    has_doubts: bool,
}

impl Visitor for Frames<'_, '_> {
    fn unit(&mut self, place: u64, record: Result<Record<'_>, Doubt>) {
        let read = record.and_then(|record| self.read(record));
        self.take(Place::Byte(place), read);
    }
}

impl Frames<'_, '_> {
    fn take(&mut self, place: Place<'_>, read: Read<'_>) {
        self.has_doubts |= read.is_err();
        (self.take)(place, read);
    }

    fn read(&mut self, record: Record<'_>) -> Read<'static> {
        match record {
            Record::Schema { id, name } => {
                let kinds = [(FRAME.0, FRAMES), (JOINT_STATE.0, JOINT_STATES)];
                let kind = kinds.into_iter().find(|(known, _)| *known == name);
                self.schemas.extend(kind.map(|(_, kind)| (id, kind)));
                Ok(Unit::Comment)
            }
            Record::Channel {
                id, schema, encoding, ..
            } => {
                let kind = self.schemas.get(&schema).filter(|_| encoding == MESSAGE_ENCODING);
                self.channels.insert(id, kind.unwrap_or(&OTHERS));
                Ok(Unit::Comment)
            }
            Record::Other(STRUCTURE) => Ok(Unit::Comment),
            Record::Other(kind) => Ok(Unit::Other(kind)),
            Record::Message {
                channel,
                sequence,
                log_time,
                data,
            } => match self.channels.get(&channel) {
                Some(&FRAMES) => {
                    let frame = parse_frame(log_time.cast_signed(), data)
                        .map_err(|reason| damaged_record(format!("message {sequence}: {reason}")))?;
                    Ok(Unit::Frame(Recorded {
                        stamp: frame.stamp,
                        protocol: frame.protocol,
                        from: Some(frame.from),
                        bytes: frame.bytes.into(),
                    }))
                }
                Some(kind) => Ok(Unit::Other(kind)),
                None => {
                    let text = format!("message {sequence}: channel {channel} is not before it");
                    Err(Doubt::new("messages without their channel", text))
                }
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use proptest::collection::vec;
    use proptest::prelude::*;

    use crate::args::{ArmKind, Speaker};
    use crate::decode::decode_recording;
    use crate::decode::format::Format;
    use crate::decode::input::Head;
    use crate::decode::tests::{Nowhere, line, printed};
    use crate::recording::Frame;
    use crate::recording::tests::{any_frame, file};
    use armwire_host::describe::Protocol;

    /// In bytes: the buffer of the input is an eighth of it.
    const MAX_MEMORY: u64 = 512 * 1024;

    /// A frame with these bytes, at 1.5 s.
    fn frame(protocol: Protocol, from: Speaker, bytes: &[u8]) -> Frame {
        Frame {
            log_time: 0,
            stamp: 1_500_000_000,
            protocol,
            from,
            bytes: bytes.to_vec(),
        }
    }

    /// The lines and the error of a recording of any arm.
    fn output(recording: &[u8]) -> (Vec<String>, Option<String>) {
        printed(recording, None, ArmKind::Ling, None)
    }

    #[test]
    fn frames_have_their_time_direction_and_meaning() {
        let (lines, error) = output(&file(&[
            frame(
                Protocol::Ling,
                Speaker::Host,
                &[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF],
            ),
            frame(Protocol::Alpha1, Speaker::Arm, &[0xF2, 0x2F, 0xAA, 0xED]),
            frame(Protocol::Xarm, Speaker::Host, &[0, 0, 0, 1, 0, 2, 0, 0]),
            frame(
                Protocol::Ling,
                Speaker::Arm,
                &[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9B, 0xFF],
            ),
        ]));
        assert_eq!(error, None);
        assert_eq!(
            lines,
            [
                "1.500000000  to arm    AA 06 00 01 FE 9A FF\n          to the arm: read joints",
                "1.500000000  from arm  F2 2F AA ED\n          from the arm: stop: done",
                "1.500000000  to arm    00 00 00 01 00 02 00 00\n          to the arm: heartbeat",
                "1.500000000  from arm  AA 06 00 01 FE 9B FF\n          no frame of a Ling arm: checksum 0x9b, expected 0x9a",
                "frames: 3, noise bytes: 7",
            ]
        );
    }

    #[test]
    fn file_without_frames_is_refused() {
        let mut other = Vec::new();
        let mut writer = mcap::Writer::new(std::io::Cursor::new(&mut other)).unwrap();
        let schema = writer.add_schema("sensor_msgs/msg/JointState", "ros2msg", b"").unwrap();
        writer
            .add_channel(schema, "/joint_states", "cdr", &Default::default())
            .unwrap();
        writer.finish().unwrap();
        drop(writer);
        let (lines, error) = output(&other);
        assert!(lines.is_empty(), "{lines:?}");
        assert_eq!(
            error.unwrap(),
            format!(
                "log: byte {}: no channel of armwire_msgs/msg/Frame: 'armwire monitor --mcap' records one",
                other.len()
            )
        );
    }

    /// The compressions of chunks.
    const COMPRESSIONS: [&str; 3] = ["", "lz4", "zstd"];

    /// Compressed bytes.
    fn compressed(compression: &str, bytes: &[u8]) -> Vec<u8> {
        match compression {
            "lz4" => {
                let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                encoder.write_all(bytes).unwrap();
                encoder.finish().unwrap()
            }
            "zstd" => ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest),
            _ => bytes.to_vec(),
        }
    }

    /// The file with each chunk compressed, so many times, and without its index. With the places of the chunks.
    fn rewritten(file: &[u8], compression: &str, times: usize) -> (Vec<u8>, Vec<usize>) {
        let mut out = file[..8].to_vec();
        let mut chunks = Vec::new();
        let mut rest = &file[8..];
        while let Some((head, behind)) = rest.split_first_chunk::<9>() {
            let len = u64::from_le_bytes(head[1..].try_into().unwrap()) as usize;
            let (body, next) = behind.split_at(len);
            match head[0] {
                0x06 => {
                    // Times, length, CRC, an empty name, and the length of the records.
                    let (head, records) = (&body[..28], compressed(compression, &body[40..]));
                    for _ in 0..times {
                        chunks.push(out.len());
                        out.push(0x06);
                        out.extend((40 + compression.len() as u64 + records.len() as u64).to_le_bytes());
                        out.extend(head);
                        out.extend((compression.len() as u32).to_le_bytes());
                        out.extend(compression.as_bytes());
                        out.extend((records.len() as u64).to_le_bytes());
                        out.extend(&records);
                    }
                }
                0x0F => {
                    // The end of the data: its own record, and the end of the file.
                    out.extend(head);
                    out.extend(body);
                    out.extend([0x02, 20, 0, 0, 0, 0, 0, 0, 0]);
                    out.extend([0; 20]);
                    out.extend(mcap::MAGIC);
                    break;
                }
                _ => out.extend(rest[..9 + len].iter()),
            }
            rest = next;
        }
        (out, chunks)
    }

    /// A reading of joints.
    fn reading() -> Frame {
        frame(
            Protocol::Ling,
            Speaker::Arm,
            &[0xAA, 0x04, 0x0E, 0x01, 0x01, 0x96, 0xFF],
        )
    }

    #[test]
    fn chunks_compressed_by_other_programs_are_read() {
        let [zstd, lz4] = [
            &include_bytes!("../../../tests/logs/zstd.mcap")[..],
            include_bytes!("../../../tests/logs/lz4.mcap"),
        ]
        .map(output);
        assert_eq!(zstd.1, None);
        assert_eq!(zstd, lz4);
        // The count of the library for Python.
        assert_eq!(zstd.0.len(), 84 + 1);
        assert_eq!(zstd.0[84], "frames: 84, noise bytes: 0, joint states: 40");
    }

    #[test]
    fn damaged_chunk_is_left_out_with_its_place() {
        let file = file(&vec![reading(); 3]);
        let (lines, error) = output(&file);
        assert_eq!((lines.len(), error), (4, None));
        for compression in COMPRESSIONS {
            let (mut rewritten, chunks) = rewritten(&file, compression, 3);
            let (whole, error) = output(&rewritten);
            assert_eq!((whole.len(), error), (9 + 1, None), "{compression}");
            let inside = (chunks[1] + chunks[2]) / 2;
            rewritten[inside] ^= 0x10;
            let (lines, error) = output(&rewritten);
            assert_eq!(error, None);
            assert_eq!((&lines[..3], &lines[4..7]), (&whole[..3], &whole[..3]), "{compression}");
            let damage = format!("not understood: byte {}: damaged chunk: ", chunks[1]);
            assert!(lines[3].starts_with(&damage), "{}", lines[3]);
            assert_eq!(
                lines[7],
                "frames: 6, noise bytes: 0, not understood: 1 (damaged chunks: 1)"
            );
        }
    }

    /// A record without fields.
    fn empty_record(code: u8) -> Vec<u8> {
        [&[code][..], &0_u64.to_le_bytes()].concat()
    }

    #[test]
    fn unknown_records_are_not_understood() {
        let (file, _) = rewritten(&file(&[reading()]), "", 1);
        let front = file.len() - 29 - 8;
        for code in [0, 0x10, 0x55, 0x85] {
            let file = [&file[..front], &empty_record(code), &file[front..]].concat();
            let sum = "frames: 1, noise bytes: 0, not understood: 1 (unknown records: 1)";
            assert_eq!(output(&file).0.last().unwrap(), sum, "{code}");
        }
    }

    #[test]
    fn records_that_a_chunk_cannot_have_are_not_understood() {
        let chunk = |records: &[u8]| {
            let len = records.len() as u64;
            let fields = [&[0; 16][..], &len.to_le_bytes(), &[0; 8], &len.to_le_bytes(), records].concat();
            [&[0x06][..], &(fields.len() as u64).to_le_bytes(), &fields].concat()
        };
        let (file, _) = rewritten(&file(&[reading()]), "", 1);
        let front = file.len() - 29 - 8;
        let footer = [&[0x02, 20, 0, 0, 0, 0, 0, 0, 0][..], &[0; 20]].concat();
        for (records, doubts) in [
            (chunk(&[]), "1 (unknown records: 1)"),
            (empty_record(0x01), "1 (unknown records: 1)"),
            (
                [&footer[..], &[0x55; 9]].concat(),
                "2 (unknown records: 1, damaged chunks: 1)",
            ),
        ] {
            let file = [&file[..front], &chunk(&records), &file[front..]].concat();
            let sum = format!("frames: 1, noise bytes: 0, not understood: {doubts}");
            assert_eq!(*output(&file).0.last().unwrap(), sum, "{records:02X?}");
        }
    }

    #[test]
    fn bytes_behind_the_end_are_not_understood() {
        let whole = file(&[reading()]);
        for behind in [&whole[..], &[0x05]] {
            let (lines, error) = output(&[&whole[..], behind].concat());
            assert_eq!(error, None);
            let place = format!("not understood: byte {}: the file goes on behind its end", whole.len());
            assert!(lines[1].starts_with(&place), "{lines:?}");
            let sum = "frames: 1, noise bytes: 0, not understood: 1 (bytes behind the end: 1)";
            assert_eq!(lines[2], sum);
        }
    }

    #[test]
    fn messages_of_a_lost_channel_are_counted() {
        // The first chunk has the channels.
        let mut file = include_bytes!("../../../tests/logs/lz4.mcap").to_vec();
        let chunk = file.windows(3).position(|bytes| bytes == b"lz4").unwrap();
        file[chunk + 100] ^= 1;
        let (lines, error) = output(&file);
        assert_eq!(error, None);
        let sum = lines.last().unwrap();
        assert!(
            sum.starts_with("frames: 0, noise bytes: 0, not understood: ")
                && sum.contains("(damaged chunks: 1, messages without their channel: "),
            "{sum}"
        );
    }

    #[test]
    fn every_damaged_byte_is_an_error_or_harmless() {
        for compression in COMPRESSIONS {
            is_refused_or_harmless(&rewritten(&file(&[reading()]), compression, 1).0);
        }
    }

    /// Damages each byte in turn.
    fn is_refused_or_harmless(file: &[u8]) {
        for at in 8..file.len() {
            for value in [0, 0x80, 0xFF, file[at] ^ 1] {
                let mut damaged = file.to_vec();
                damaged[at] = value;
                let measured = allocation_counter::measure(|| {
                    let head = Head::new("log".to_owned(), Box::new(&damaged[..]), &Nowhere);
                    let _ = decode_recording(head, &Nowhere, Some(Format::Mcap), line(ArmKind::Ling, None));
                });
                assert!(
                    measured.bytes_max < MAX_MEMORY,
                    "byte {at}: {} bytes",
                    measured.bytes_max
                );
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn cut_file_has_the_frames_before_the_cut(frames in vec(any_frame(), 0..5), cut in any::<prop::sample::Index>()) {
            let file = file(&frames);
            let (whole, _) = output(&file);
            let cut = 8 + cut.index(file.len() - 8);
            let (lines, error) = output(&file[..cut]);
            prop_assert_eq!(error, None);
            let (sum, lines) = lines.split_last().unwrap();
            prop_assert!(sum.ends_with(", not understood: 1 (the file has no end: 1)"), "{}", sum);
            let (remark, lines) = lines.split_last().unwrap();
            prop_assert_eq!(remark, "not understood: the end: the file has no end");
            prop_assert_eq!(lines, &whole[..lines.len()]);
        }

        #[test]
        fn any_bytes_are_decoded_or_refused(bytes in vec(any::<u8>(), 0..300), at in any::<prop::sample::Index>()) {
            let file = file(&[frame(Protocol::Ling, Speaker::Arm, &bytes)]);
            let mut damaged = file.clone();
            damaged[at.index(file.len())] ^= 0x55;
            for recording in [damaged, [&file[..8], &bytes].concat()] {
                let (lines, error) = printed(&recording, Some(Format::Mcap), ArmKind::Ling, None);
                let has_sum = lines.last().is_some_and(|sum| sum.starts_with("frames: "));
                prop_assert!(has_sum || lines.is_empty() && error.is_some(), "{:?}", lines);
            }
        }
    }

    #[test]
    fn memory_does_not_grow_with_a_recording() {
        let recording = file(&vec![
            frame(
                Protocol::Ling,
                Speaker::Arm,
                &[0xAA, 0x04, 0x0E, 0x01, 0x01, 0x96, 0xFF]
            );
            40_000
        ]);
        assert!(recording.len() > 3_000_000);
        for compression in COMPRESSIONS {
            // In memory are a compressed chunk, and its window.
            let (recording, chunks) = rewritten(&recording, compression, 1);
            assert!(chunks.len() > 2);
            let measured = allocation_counter::measure(|| {
                let source = Box::new(&recording[..]);
                let head = Head::new("log".to_owned(), source, &Nowhere);
                decode_recording(head, &Nowhere, Some(Format::Mcap), line(ArmKind::Ling, None)).unwrap();
            });
            let max = if compression.is_empty() {
                MAX_MEMORY
            } else {
                8 * MAX_MEMORY
            };
            assert!(measured.bytes_max < max, "{compression}: {} bytes", measured.bytes_max);
        }
    }
}
