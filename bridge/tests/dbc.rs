//! Consistency of `docs/armwire.dbc` and the tables of `docs/can.md` with the code.

use std::collections::BTreeMap;

use armwire::ling::{JOINTS, JointState, MotionStatus, Opening, Position, Speed};
use armwire_bridge::can::command::Command;
use armwire_bridge::can::telemetry::{Errors, Sample, event_to_frame};
use armwire_bridge::can::{Frame, Function, Node};
use armwire_bridge::config::{CAN_BIT_RATES, Can};
use armwire_bridge::control::{Event, Initiator, Refusal, Stamp};
use proptest::prelude::*;

const DBC: &str = include_str!("../../docs/armwire.dbc");
const CAN_MD: &str = include_str!("../../docs/can.md");

/// The file's messages, by identifier.
fn messages() -> BTreeMap<u16, Message> {
    let mut messages = BTreeMap::new();
    let mut last = None;
    for line in DBC.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["BO_", id, name, length, _] => {
                let message = Message {
                    name: name.trim_end_matches(':'),
                    length: length.parse().unwrap(),
                    signals: Vec::new(),
                };
                last = Some(id.parse().unwrap());
                assert!(messages.insert(last.unwrap(), message).is_none(), "{id} twice");
            }
            ["SG_", name, ":", layout, scale, _, unit, _] => {
                let message: &mut Message = messages.get_mut(&last.unwrap()).unwrap();
                message.signals.push(Signal::parse(name, layout, scale, unit));
            }
            _ => {}
        }
    }
    messages
}

struct Message {
    name: &'static str,
    length: usize,
    signals: Vec<Signal>,
}

impl Message {
    /// Decodes a frame, by signal.
    fn decode(&self, data: &[u8]) -> BTreeMap<&'static str, f64> {
        let raw = u64::from_le_bytes(data.try_into().unwrap());
        let values = self.signals.iter().map(|signal| (signal.name, signal.value(raw)));
        values.collect()
    }
}

struct Signal {
    name: &'static str,
    start: u32,
    length: u32,
    factor: f64,
    offset: f64,
    unit: &'static str,
}

impl Signal {
    /// Parses for example `Joint1`, `0|16@1+`, `(0.5,-3)` and `"rad"`.
    fn parse(name: &'static str, layout: &'static str, scale: &'static str, unit: &'static str) -> Self {
        let layout = layout.strip_suffix("@1+").expect("little-endian and unsigned");
        let (start, length) = layout.split_once('|').unwrap();
        let (factor, offset) = scale[1..scale.len() - 1].split_once(',').unwrap();
        Self {
            name,
            start: start.parse().unwrap(),
            length: length.parse().unwrap(),
            factor: factor.parse().unwrap(),
            offset: offset.parse().unwrap(),
            unit: unit.trim_matches('"'),
        }
    }

    fn mask(&self) -> u64 {
        ((1 << self.length) - 1) << self.start
    }

    fn value(&self, raw: u64) -> f64 {
        ((raw & self.mask()) >> self.start) as f64 * self.factor + self.offset
    }
}

/// The file's value names of a signal.
fn names(message: u16, signal: &str) -> BTreeMap<u8, String> {
    let prefix = format!("VAL_ {message} {signal} ");
    let table = DBC.lines().find_map(|line| line.strip_prefix(&prefix)).unwrap();
    let parts: Vec<&str> = table.split('"').map(str::trim).collect();
    let pairs = parts
        .chunks_exact(2)
        .map(|pair| (pair[0].parse().unwrap(), pair[1].to_owned()));
    pairs.collect()
}

/// Asserts that the frames contain the expected signals and no others.
fn check(frames: &[Frame], expected: &[(&str, f64)]) {
    let mut decoded = BTreeMap::new();
    for frame in frames {
        let (function, _) = Function::of(frame.id()).unwrap();
        for (name, value) in messages()[&function.base()].decode(frame.data()) {
            if let Some(before) = decoded.insert(name, value) {
                // The sequence number and the stamp are in several frames; those of the joints have only its low half.
                assert!(
                    value == before || value as u64 & 0xFFFF == before as u64,
                    "{name}: {before}, then {value}"
                );
            }
        }
    }
    for &(name, expected) in expected {
        let decoded = decoded.remove(name).unwrap();
        assert!(
            (decoded - expected).abs() < 1e-6,
            "{name} is {decoded}, must be {expected}"
        );
    }
    assert!(decoded.is_empty(), "left: {decoded:?}");
}

const JOINT_NAMES: [&str; JOINTS] = ["Joint1", "Joint2", "Joint3", "Joint4", "Joint5", "Joint6"];

/// The angles of the joints, by the file's signal names.
fn angles(joints: [u16; JOINTS]) -> impl Iterator<Item = (&'static str, f64)> {
    let angles = joints.map(|ticks| f64::from(Position::new(ticks).unwrap().radians()));
    JOINT_NAMES.into_iter().zip(angles)
}

fn joints() -> impl Strategy<Value = [u16; JOINTS]> {
    prop::array::uniform6(0..=Position::MAX.ticks())
}

proptest! {
    #[test]
    fn telemetry_matches_the_file(
        joints in joints(), gripper in 0..=1000_u16, status in any::<u8>(), stamp in any::<u32>(), count in any::<u8>(),
    ) {
        let sample = Sample {
            state: JointState { joints, gripper, status: MotionStatus::from(status) },
            stamp,
            count,
        };
        let mut expected: Vec<_> = angles(joints).collect();
        expected.extend([
            ("Gripper", Opening::new(gripper).unwrap().fraction().into()),
            ("MotionStatus", status.into()),
            ("Count", count.into()),
            ("Stamp", stamp.into()),
        ]);
        check(&sample.to_frames(Node::default()), &expected);
    }

    #[test]
    fn commands_match_the_file(
        joints in joints(), sequence in any::<u8>(), speed in 3..=250_u8, gripper in 0..=250_u8,
    ) {
        let command = Command { sequence, joints, speed, gripper };
        let target = command.target().unwrap();
        let speed: Speed = target.joints[0].1;
        let mut expected: Vec<_> = angles(target.joints.map(|(position, _)| position.ticks())).collect();
        expected.extend([
            ("Sequence", sequence.into()),
            ("Speed", speed.radians_per_second().into()),
            ("Gripper", target.gripper.0.fraction().into()),
        ]);
        check(&command.to_frames(Node::default()), &expected);
    }

    #[test]
    fn error_counts_match_the_file(words in any::<([u16; 3], [u8; 2])>()) {
        let ([noise_bytes, uart, can], [unanswered, refused]) = words;
        let errors = Errors { noise_bytes, uart, can, unanswered, refused };
        let expected = [
            ("NoiseBytes", noise_bytes.into()),
            ("UartErrors", uart.into()),
            ("CanErrors", can.into()),
            ("Unanswered", unanswered.into()),
            ("Refused", refused.into()),
        ];
        check(&[errors.to_frame(Node::default())], &expected);
    }
}

#[test]
fn events_and_initiators_have_their_names() {
    let initiators = [
        Initiator::Usb,
        Initiator::Can,
        Initiator::Poll,
        Initiator::Command,
        Initiator::Adapter,
    ];
    let reasons = [
        Refusal::QueueFull,
        Refusal::NotAFrame,
        Refusal::Incomplete,
        Refusal::Stale,
        Refusal::OutOfRange,
        Refusal::LineReserved,
        Refusal::OtherRate,
        Refusal::Stopped,
    ];
    let mut cases = Vec::new();
    for initiator in initiators {
        for reason in reasons {
            cases.push((
                Event::Refused { initiator, reason },
                format!("refused: {reason}"),
                initiator.to_string(),
                0,
            ));
        }
        for (torque_off, name) in [(false, "host silent"), (true, "host silent, torque switched off")] {
            let event = Event::HostSilent {
                initiator,
                dropped: 515,
                torque_off,
            };
            cases.push((event, name.to_owned(), initiator.to_string(), 515));
        }
    }
    for (off, name) in [(true, "bus off"), (false, "back on the bus")] {
        cases.push((Event::BusOff { off }, name.to_owned(), "none".to_owned(), 0));
    }

    let (kinds, initiators) = (
        names(Function::Event.base(), "Kind"),
        names(Function::Event.base(), "Initiator"),
    );
    let (mut kinds_left, mut initiators_left) = (kinds.clone(), initiators.clone());
    for (event, kind, initiator, dropped) in cases {
        let frame = event_to_frame(&event, Stamp(0xABCD_1234_5678), Node::default()).unwrap();
        let &[kind_code, initiator_code, ..] = frame.data() else {
            panic!("{frame:?}");
        };
        assert_eq!((&kinds[&kind_code], &initiators[&initiator_code]), (&kind, &initiator));
        let expected = [
            ("Kind", kind_code.into()),
            ("Initiator", initiator_code.into()),
            ("Dropped", dropped.into()),
            ("Stamp", f64::from(0x1234_5678)),
        ];
        check(&[frame], &expected);
        kinds_left.remove(&kind_code);
        initiators_left.remove(&initiator_code);
    }
    assert!(
        kinds_left.is_empty() && initiators_left.is_empty(),
        "unused names: {kinds_left:?} {initiators_left:?}"
    );
}

#[test]
fn motion_statuses_have_their_names() {
    let names = names(Function::State.base(), "MotionStatus");
    for code in 0..=u8::MAX {
        let status = MotionStatus::from(code);
        let known = !matches!(status, MotionStatus::Other(_));
        assert_eq!(names.get(&code), known.then(|| status.to_string()).as_ref());
    }
}

#[test]
fn dbc_file_covers_every_bit_exactly_once() {
    let messages = messages();
    let cyclic = Function::ALL
        .into_iter()
        .filter(|function| function.base() < Function::ArmRequest.base());
    assert!(messages.keys().copied().eq(cyclic.clone().map(Function::base)));
    for function in cyclic {
        let message = &messages[&function.base()];
        assert_eq!((message.name, message.length), (format!("{function:?}").as_str(), 8));
        let bits: u32 = message.signals.iter().map(|signal| signal.length).sum();
        let covered = message.signals.iter().fold(0, |bits, signal| bits | signal.mask());
        assert_eq!((bits, covered), (64, u64::MAX), "{}", message.name);
    }
}

#[test]
fn units_match_the_values() {
    for signal in messages().values().flat_map(|message| &message.signals) {
        let unit = match signal.name {
            name if JOINT_NAMES.contains(&name) => "rad",
            "Speed" => "rad/s",
            "Stamp" => "us",
            "NoiseBytes" | "Dropped" => "bytes",
            _ => "",
        };
        assert_eq!(signal.unit, unit, "{}", signal.name);
    }
}

#[test]
fn document_tables_match_identifiers_and_fastest_telemetry() {
    let rows = CAN_MD.lines().filter_map(|line| line.strip_prefix("| 0x"));
    let bases = rows.map(|row| u16::from_str_radix(&row[..3], 16).unwrap());
    assert!(bases.eq(Function::ALL.map(Function::base)));

    let table = CAN_MD
        .split("| Bit rate | `can.telemetry-hz` at most |")
        .nth(1)
        .unwrap();
    let rows = table
        .lines()
        .skip(2)
        .map_while(|line| line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | "));
    let fastest = rows.map(|(bit_rate, fastest)| (bit_rate.parse().unwrap(), fastest.parse().unwrap()));
    let expected = CAN_BIT_RATES.map(|bit_rate| {
        let can = Can {
            bit_rate,
            ..Can::default()
        };
        (bit_rate, can.max_telemetry_hz())
    });
    assert_eq!(fastest.collect::<Vec<(u32, u16)>>(), expected);
}
