//! The frames in an MCAP recording.

mod records;

use std::collections::BTreeSet;

use super::input::Input;
use super::meaning::frame_meaning;
use super::output::{Item, OnLine, Output};
use crate::args::Speaker;
use crate::error::Error;
use crate::recording::Frame;
use crate::recording::messages::{FRAME, MESSAGE_ENCODING, parse_frame};
use records::Record;

/// Prints the frames of a recording that `armwire monitor --mcap` wrote, and the sum.
pub(super) fn decode(input: &mut Input<'_>, out: &dyn Output) -> Result<(), Error> {
    let mut frames = Frames::default();
    let read = records::read(input, &mut |record| frames.take(record, out));
    let finished = read.and_then(|is_cut| frames.finish(is_cut, out));
    finished.map_err(|reason| input.refused_at(input.offset(), &reason))
}

/// The frames of a recording so far.
#[derive(Default)]
struct Frames {
    /// The schemas and channels for frames.
    schemas: BTreeSet<u16>,
    channels: BTreeSet<u16>,
    frames: u64,
    noise_bytes: u64,
}

impl Frames {
    fn take(&mut self, record: Record<'_>, out: &dyn Output) -> Result<(), String> {
        match record {
            Record::Schema { id, name } if name == FRAME.0 => {
                self.schemas.insert(id);
            }
            Record::Channel { id, schema, encoding }
                if self.schemas.contains(&schema) && encoding == MESSAGE_ENCODING =>
            {
                self.channels.insert(id);
            }
            Record::Message {
                channel,
                sequence,
                log_time,
                data,
            } if self.channels.contains(&channel) => {
                let frame = parse_frame(log_time.cast_signed(), data)
                    .map_err(|reason| format!("message {sequence}: {reason}"))?;
                self.show(&frame, out);
            }
            _ => {}
        }
        Ok(())
    }

    fn show(&mut self, frame: &Frame, out: &dyn Output) {
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
        out.item(&Item {
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
    fn finish(&self, is_cut: bool, out: &dyn Output) -> Result<(), String> {
        if self.channels.is_empty() && !is_cut {
            return Err(format!(
                "no channel of {}: 'armwire monitor --mcap' records one",
                FRAME.0
            ));
        }
        let end = if is_cut { ", the file has no end" } else { "" };
        let Self {
            frames, noise_bytes, ..
        } = self;
        out.remark(format_args!("frames: {frames}, noise bytes: {noise_bytes}{end}"));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
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

    #[test]
    fn every_damaged_byte_is_an_error_or_harmless() {
        let file = file(&[frame(
            Protocol::Ling,
            Speaker::Arm,
            &[0xAA, 0x04, 0x0E, 0x01, 0x01, 0x96, 0xFF],
        )]);
        for at in 8..file.len() {
            for value in [0, 1, 0x7F, 0x80, 0xFF, file[at] ^ 1] {
                let mut damaged = file.clone();
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
            printed(&damaged, Some(Format::Mcap), ArmKind::Ling, None);
            printed(&[&file[..8], &bytes].concat(), Some(Format::Mcap), ArmKind::Ling, None);
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
        let measured = allocation_counter::measure(|| {
            let source = Box::new(&recording[..]);
            let out = crate::decode::tests::Nowhere;
            let head = Head::new("log".to_owned(), source, &out);
            decode(&mut head.into_input(), &out).unwrap();
        });
        assert!(measured.bytes_max < MAX_MEMORY, "{} bytes", measured.bytes_max);
    }
}
