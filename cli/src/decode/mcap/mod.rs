//! The frames in an MCAP recording.

mod chunk;
mod fields;
pub(crate) mod records;

use std::collections::{BTreeMap, BTreeSet};

use super::doubts::{Doubt, Doubts, Place};
use super::input::Input;
use super::meaning::frame_meaning;
use super::output::{Item, OnLine, Output};
use crate::args::Speaker;
use crate::error::Error;
use crate::recording::Frame;
use crate::recording::messages::{FRAME, MESSAGE_ENCODING, parse_frame};
use records::{Record, Visitor, damaged_record};

/// Prints the frames of a recording that `armwire monitor --mcap` wrote, and the sum. Returns the number of its parts that
/// were not understood.
pub(super) fn decode(input: &mut Input<'_>, out: &dyn Output) -> Result<u64, Error> {
    let mut frames = Frames {
        out,
        schemas: BTreeSet::new(),
        channels: BTreeMap::new(),
        frames: 0,
        noise_bytes: 0,
        doubts: Doubts::default(),
    };
    let read = records::read(input, &mut frames);
    let finished = frames.finish(&read);
    let (place, reason) = match read {
        Err(error) => error,
        Ok(_) => match finished {
            Ok(()) => return Ok(frames.doubts.count()),
            Err(reason) => (input.offset(), reason),
        },
    };
    Err(input.refused_at(place, &reason))
}

/// The frames of a recording so far.
struct Frames<'a> {
    out: &'a dyn Output,
    /// The schemas of frames.
    schemas: BTreeSet<u16>,
    /// The channels, and whether they are for frames.
    channels: BTreeMap<u16, bool>,
    frames: u64,
    noise_bytes: u64,
    doubts: Doubts,
}

impl Visitor for Frames<'_> {
    fn record(&mut self, record: Record<'_>) -> Result<(), Doubt> {
        match record {
            Record::Schema { id, name } if name == FRAME.0 => {
                self.schemas.insert(id);
            }
            Record::Channel {
                id, schema, encoding, ..
            } => {
                let has_frames = self.schemas.contains(&schema) && encoding == MESSAGE_ENCODING;
                self.channels.insert(id, has_frames);
            }
            Record::Message {
                channel,
                sequence,
                log_time,
                data,
            } => match self.channels.get(&channel) {
                Some(true) => {
                    let frame = parse_frame(log_time.cast_signed(), data)
                        .map_err(|reason| damaged_record(format!("message {sequence}: {reason}")))?;
                    self.show(&frame);
                }
                Some(false) => {}
                None => {
                    let text = format!("message {sequence}: channel {channel} is not before it");
                    return Err(Doubt::new("messages without their channel", text));
                }
            },
            Record::Schema { .. } => {}
        }
        Ok(())
    }

    fn doubt(&mut self, place: u64, reason: &Doubt) {
        self.doubts.add(Place::Byte(place), reason, self.out);
    }
}

impl Frames<'_> {
    fn show(&mut self, frame: &Frame) {
        let Frame {
            stamp,
            protocol,
            from,
            bytes,
            ..
        } = frame;
        let meaning = frame_meaning(*protocol, bytes, *from);
        match meaning {
            Ok(_) => self.frames += 1,
            Err(_) => self.noise_bytes += bytes.len() as u64,
        }
        let direction = match from {
            Speaker::Host => "to arm",
            Speaker::Arm => "from arm",
        };
        let (seconds, nanos) = (stamp.div_euclid(1_000_000_000), stamp.rem_euclid(1_000_000_000));
        self.out.item(&Item {
            place: format_args!("{seconds}.{nanos:09}  {direction:8}"),
            bytes,
            text: meaning.as_ref().unwrap_or_else(|reason| reason),
            on_line: Some(OnLine {
                protocol: *protocol,
                from: Some(*from),
                nanos: stamp.cast_unsigned(),
            }),
        });
    }

    /// The sum.
    fn finish(&self, read: &Result<bool, (u64, String)>) -> Result<(), String> {
        let has_channel = self.channels.values().any(|has_frames| *has_frames);
        if !has_channel && self.doubts.count() == 0 && *read == Ok(false) {
            return Err(format!(
                "no channel of {}: 'armwire monitor --mcap' records one",
                FRAME.0
            ));
        }
        let mut sum = format!("frames: {}, noise bytes: {}", self.frames, self.noise_bytes);
        sum += &self.doubts.sum();
        if *read == Ok(true) {
            sum += ", the file has no end";
        }
        self.out.remark(format_args!("{sum}"));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;
    use crate::args::ArmKind;
    use crate::decode::format::Format;
    use crate::decode::input::Head;
    use crate::decode::tests::printed;
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
        assert_eq!(zstd.0[84], "frames: 84, noise bytes: 0");
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
                let out = crate::decode::tests::Nowhere;
                let measured = allocation_counter::measure(|| {
                    let head = Head::new("log".to_owned(), Box::new(&damaged[..]), &out);
                    let _ = decode(&mut head.into_input(), &out);
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
            prop_assert!(sum.ends_with(", the file has no end"), "{}", sum);
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
                prop_assert!(has_sum || error.is_some_and(|error| error.contains("no channel of")), "{:?}", lines);
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
                let out = crate::decode::tests::Nowhere;
                let head = Head::new("log".to_owned(), source, &out);
                decode(&mut head.into_input(), &out).unwrap();
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
