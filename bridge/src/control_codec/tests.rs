//! Encoding and decoding of the control port's messages.

extern crate std;

use std::string::String;
use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::can::Node;
use crate::config::{ArmKind, Can, Config, ConfigError, HostTimeout, Poll};
use crate::control::{
    ArmIdentity, Event, Failure, FrameBytes, FromAdapter, FromHost, Histogram, Identity, Initiator, Latencies,
    LineReservation, LineState, MAX_COBS, MAX_EVENT, MAX_FRAME, Refusal, Reply, Request, Stamp, StopInForce,
    Subscription, VERSION,
};
use crate::store::Saved;
use crate::{Counters, LineCoding, Parity, StopBits};

fn arm() -> impl Strategy<Value = ArmKind> {
    prop::sample::select(&ArmKind::ALL[..])
}

fn config() -> impl Strategy<Value = Config> {
    let poll = prop_oneof![Just(Poll::Off), any::<u16>().prop_map(Poll::Hertz), Just(Poll::Fastest)];
    let can = (
        0..=Node::MAX.get(),
        any::<u32>(),
        any::<Option<u32>>(),
        any::<u16>(),
        any::<bool>(),
        any::<u16>(),
        any::<bool>(),
    );
    let can = can.prop_map(
        |(node, bit_rate, data_bit_rate, telemetry_hz, commands, command_timeout_ms, unsolicited)| Can {
            node: Node::new(node).unwrap(),
            bit_rate,
            data_bit_rate,
            telemetry_hz,
            commands,
            command_timeout_ms,
            unsolicited,
        },
    );
    let host_timeout = any::<(u16, bool)>().prop_map(|(after_ms, torque_off)| HostTimeout { after_ms, torque_off });
    (arm(), poll, can, host_timeout).prop_map(|(arm, poll, can, host_timeout)| Config {
        arm,
        poll,
        can,
        host_timeout,
    })
}

fn config_error() -> impl Strategy<Value = ConfigError> {
    let pair = any::<(u16, u16)>;
    prop_oneof![
        pair().prop_map(|(max, got)| ConfigError::PollRate { max, got }),
        arm().prop_map(ConfigError::NotPolled),
        any::<u32>().prop_map(ConfigError::BitRate),
        any::<u32>().prop_map(ConfigError::DataBitRate),
        pair().prop_map(|(max, got)| ConfigError::Telemetry { max, got }),
        arm().prop_map(ConfigError::NotCommanded),
        pair().prop_map(|(max, got)| ConfigError::CommandTimeout { max, got }),
        Just(ConfigError::NoCanFd),
        Just(ConfigError::NoCan),
    ]
}

fn from_host() -> impl Strategy<Value = FromHost> {
    let request = prop_oneof![
        Just(Request::Identify),
        Just(Request::IdentifyArm),
        Just(Request::GetConfig),
        config().prop_map(Request::SetConfig),
        Just(Request::SaveConfig),
        Just(Request::ResetConfig),
        Just(Request::GetCounters),
        Just(Request::GetLatencies),
        any::<(bool, bool)>().prop_map(|(frames, events)| Request::Subscribe(Subscription { frames, events })),
        Just(Request::Restart),
        Just(Request::RestartIntoBootLoader),
        Just(Request::EndStream),
        Just(Request::GetLine),
        Just(Request::ReserveLine),
        Just(Request::ReleaseLine),
        Just(Request::Stop),
        Just(Request::GetRecovery),
        Just(Request::GetSaved),
        Just(Request::GetStop),
    ];
    (any::<u8>(), request).prop_map(|(sequence, request)| FromHost { sequence, request })
}

fn text<const N: usize>() -> impl Strategy<Value = heapless::String<N, u8>> {
    any::<String>().prop_map(|text| {
        let mut kept = heapless::String::new();
        for char in text.chars() {
            let _ = kept.push(char); // as much as fits
        }
        kept
    })
}

fn identity() -> impl Strategy<Value = Identity> {
    let numbers = (any::<u16>(), any::<u32>());
    (numbers, text(), text(), text(), text(), any::<[bool; 2]>()).prop_map(
        |((version, chip), firmware, commit, board, serial, [can_fd, no_can])| Identity {
            version,
            firmware,
            commit,
            board,
            serial,
            can_fd,
            no_can,
            chip,
        },
    )
}

fn frame_bytes() -> impl Strategy<Value = FrameBytes> {
    prop::collection::vec(any::<u8>(), 0..=MAX_FRAME).prop_map(|bytes| FrameBytes::from_slice(&bytes).unwrap())
}

fn counters() -> impl Strategy<Value = Counters> {
    prop::collection::vec(any::<u32>(), Counters::COUNT).prop_map(|counts| {
        let mut bytes = Vec::new();
        for count in counts {
            bytes.extend_from_slice(postcard::to_slice(&count, &mut [0; 5]).unwrap());
        }
        Counters::from_bytes(&bytes).unwrap()
    })
}

fn histogram() -> impl Strategy<Value = Histogram> {
    any::<[u32; Histogram::BUCKETS]>().prop_map(|counts| Histogram { counts })
}

fn reply() -> impl Strategy<Value = Reply> {
    let arm = (arm(), prop::option::of(frame_bytes())).prop_map(|(kind, answer)| ArmIdentity { kind, answer });
    let latencies =
        (histogram(), histogram(), histogram()).prop_map(|(answer, turn, poll)| Latencies { answer, turn, poll });
    prop_oneof![
        Just(Reply::Done),
        any::<u16>().prop_map(|version| Reply::Unsupported { version }),
        identity().prop_map(Reply::Identity),
        arm.prop_map(Reply::Arm),
        config().prop_map(Reply::Config),
        config_error().prop_map(Reply::BadConfig),
        counters().prop_map(Reply::Counters),
        latencies.prop_map(Reply::Latencies),
        failure().prop_map(Reply::Failed),
        line_state().prop_map(Reply::Line),
        any::<bool>().prop_map(|active| Reply::Recovery { active }),
        saved().prop_map(Reply::Saved),
        stop().prop_map(Reply::Stop),
    ]
}

fn stop() -> impl Strategy<Value = Option<StopInForce>> {
    let by = prop::sample::select(vec![Initiator::Usb, Initiator::Can]);
    prop::option::of((by, any::<u16>()).prop_map(|(by, left_ms)| StopInForce { by, left_ms }))
}

fn saved() -> impl Strategy<Value = Saved> {
    prop_oneof![
        config().prop_map(Saved::Config),
        Just(Saved::Nothing),
        Just(Saved::Unreadable)
    ]
}

fn coding() -> impl Strategy<Value = LineCoding> {
    let parity = prop::sample::select(vec![Parity::None, Parity::Odd, Parity::Even]);
    let stop_bits = prop::sample::select(vec![StopBits::One, StopBits::Two]);
    (any::<u32>(), parity, stop_bits).prop_map(|(baud, parity, stop_bits)| LineCoding {
        baud,
        parity,
        stop_bits,
    })
}

fn line_state() -> impl Strategy<Value = LineState> {
    let reservation = prop::sample::select(vec![
        LineReservation::None,
        LineReservation::OtherRate,
        LineReservation::Requested,
    ]);
    (coding(), coding(), reservation, prop::option::of(coding())).prop_map(|(coding, arm, reservation, waiting)| {
        LineState {
            coding,
            arm,
            reservation,
            waiting,
        }
    })
}

fn failure() -> impl Strategy<Value = Failure> {
    prop_oneof![
        Just(Failure::Flash),
        Just(Failure::Busy),
        Just(Failure::StreamArmed),
        Just(Failure::LineReserved),
        Just(Failure::SupplyLow),
        Just(Failure::NoRoom),
        Just(Failure::ArmSilent),
        Just(Failure::PoseOutOfRange),
        arm().prop_map(Failure::NotStoppable),
        any::<u16>().prop_map(|wait_s| Failure::TooManySaves { wait_s }),
    ]
}

fn initiator() -> impl Strategy<Value = Initiator> {
    prop::sample::select(&Initiator::ALL[..])
}

fn event() -> impl Strategy<Value = Event> {
    let refusal = prop::sample::select(&Refusal::ALL[..]);
    prop_oneof![
        (prop::option::of(initiator()), frame_bytes()).prop_map(|(initiator, bytes)| Event::Frame { initiator, bytes }),
        (initiator(), any::<u16>(), any::<bool>()).prop_map(|(initiator, dropped, torque_off)| Event::HostSilent {
            initiator,
            dropped,
            torque_off
        }),
        (initiator(), refusal).prop_map(|(initiator, reason)| Event::Refused { initiator, reason }),
        any::<bool>().prop_map(|off| Event::BusOff { off }),
        any::<bool>().prop_map(|active| Event::Recovery { active }),
    ]
}

fn from_adapter() -> impl Strategy<Value = FromAdapter> {
    prop_oneof![
        (any::<u8>(), reply()).prop_map(|(sequence, reply)| FromAdapter::Reply { sequence, reply }),
        (any::<u64>(), event()).prop_map(|(at, event)| FromAdapter::Event { at: Stamp(at), event }),
    ]
}

fn encoded<T: Message>(message: &T) -> Vec<u8> {
    let mut out = [0; MAX_MESSAGE];
    let len = encode(message, &mut out).unwrap();
    out[..len].to_vec()
}

fn encoded_cobs<T: Message>(message: &T) -> Vec<u8> {
    let mut out = [0; MAX_COBS];
    let len = encode_cobs(message, &mut out).unwrap();
    out[..len].to_vec()
}

#[test]
fn longest_frame_fits_in_an_event() {
    let event = FromAdapter::Event {
        at: Stamp(u64::MAX),
        event: Event::Frame {
            initiator: Some(Initiator::Adapter),
            bytes: FrameBytes::from_slice(&[0xFF; MAX_FRAME]).unwrap(),
        },
    };
    assert!(encode(&event, &mut [0; MAX_EVENT]).is_ok());
}

/// All messages and errors that a reader finds in these pieces of a stream.
fn read<T: Message, const N: usize>(reader: &mut Reader<N>, pieces: &[&[u8]]) -> Vec<Result<T, Malformed>> {
    let mut received = Vec::new();
    for piece in pieces {
        let mut rest = *piece;
        while !rest.is_empty() {
            rest = reader.push(rest);
            received.extend(reader.next());
        }
    }
    received
}

/// `bytes`, split at these places.
fn pieces<'a>(bytes: &'a [u8], cuts: &[prop::sample::Index]) -> Vec<&'a [u8]> {
    let mut ends: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
    ends.push(bytes.len());
    ends.sort();
    let mut start = 0;
    ends.into_iter()
        .map(|end| &bytes[std::mem::replace(&mut start, end)..end])
        .collect()
}

fn cuts() -> impl Strategy<Value = Vec<prop::sample::Index>> {
    prop::collection::vec(any::<prop::sample::Index>(), 0..8)
}

proptest! {
    #[test]
    fn host_messages_round_trip(messages in prop::collection::vec(from_host(), 0..8), cuts in cuts()) {
        for message in &messages {
            prop_assert_eq!(decode(&encoded(message)), Ok(*message));
        }
        let stream: Vec<u8> = messages.iter().flat_map(encoded_cobs).collect();
        let received = read(&mut Reader::<MAX_MESSAGE>::new(), &pieces(&stream, &cuts));
        prop_assert_eq!(received, messages.into_iter().map(Ok).collect::<Vec<_>>());
    }

    #[test]
    fn adapter_messages_round_trip(messages in prop::collection::vec(from_adapter(), 0..8), cuts in cuts()) {
        for message in &messages {
            prop_assert_eq!(decode(&encoded(message)), Ok(message.clone()));
        }
        let stream: Vec<u8> = messages.iter().flat_map(encoded_cobs).collect();
        let received = read(&mut Reader::<MAX_MESSAGE>::new(), &pieces(&stream, &cuts));
        prop_assert_eq!(received, messages.into_iter().map(Ok).collect::<Vec<_>>());
    }

    #[test]
    fn usb_message_has_one_zero_at_its_end(message in from_adapter()) {
        let bytes = encoded_cobs(&message);
        prop_assert_eq!(bytes.iter().position(|&byte| byte == 0), Some(bytes.len() - 1));
    }

    #[test]
    fn garbage_costs_no_message_behind_its_zero(
        garbage in prop::collection::vec(any::<u8>(), 0..700),
        message in from_adapter(),
        cuts in cuts(),
    ) {
        let stream = [&garbage, &[0][..], &encoded_cobs(&message)].concat();
        let mut reader = Reader::<MAX_MESSAGE>::new();
        let received = read(&mut reader, &pieces(&stream, &cuts));
        prop_assert_eq!(received.last(), Some(&Ok(message)));
        prop_assert!(reader.next::<FromAdapter>().is_none());
    }

    #[test]
    fn each_part_of_garbage_is_reported_once(garbage in prop::collection::vec(any::<u8>(), 0..700), cuts in cuts()) {
        let parts = garbage.split_inclusive(|&byte| byte == 0).filter(|part| part.len() > 1 && part.ends_with(&[0]));
        let received = read::<FromHost, 64>(&mut Reader::new(), &pieces(&garbage, &cuts));
        prop_assert_eq!(received.len(), parts.count());
    }

    #[test]
    fn decoded_message_encodes_to_the_same_bytes(bytes in prop::collection::vec(0..4_u8, 0..40)) {
        if let Ok(message) = decode::<FromHost>(&bytes) {
            prop_assert_eq!(encoded(&message), bytes);
        }
    }

    #[test]
    fn sequence_number_is_read_whatever_follows(sequence: u8, rest in prop::collection::vec(any::<u8>(), 0..80)) {
        let bytes = [&[sequence], &rest[..]].concat();
        match decode::<FromHost>(&bytes) {
            Ok(message) => prop_assert_eq!(message.sequence, sequence),
            Err(malformed) => prop_assert_eq!(malformed.sequence, Some(sequence)),
        }
        let mut cobs = [0; 90];
        let len = cobs::try_encode(&bytes, &mut cobs).unwrap();
        match read::<FromHost, 16>(&mut Reader::new(), &[&cobs[..=len]])[..] {
            [Ok(message)] => prop_assert_eq!(message.sequence, sequence),
            [Err(malformed)] => prop_assert_eq!(malformed.sequence, Some(sequence)),
            ref other => prop_assert!(false, "{other:?}"),
        }
    }

    #[test]
    fn message_cut_short_ends_early(message in from_host(), cut in any::<prop::sample::Index>()) {
        let bytes = encoded(&message);
        let cut = &bytes[..cut.index(bytes.len())];
        let malformed = Malformed { sequence: cut.first().copied(), reason: Reason::EndsEarly };
        prop_assert_eq!(decode::<FromHost>(cut), Err(malformed));
    }

    #[test]
    fn host_ignores_trailing_data_of_newer_adapter(
        message in from_adapter(),
        more in prop::collection::vec(any::<u8>(), 1..20),
    ) {
        prop_assert_eq!(decode(&[encoded(&message), more].concat()), Ok(message));
    }

    #[test]
    fn host_message_with_trailing_data_is_refused(message in from_host(), more in prop::collection::vec(any::<u8>(), 1..20)) {
        let bytes = [encoded(&message), more.clone()].concat();
        let malformed = Malformed { sequence: Some(message.sequence), reason: Reason::Surplus { bytes: more.len() } };
        prop_assert_eq!(decode::<FromHost>(&bytes), Err(malformed));
    }

    #[test]
    fn nothing_is_written_beyond_the_buffer(message in from_adapter(), room in 0..MAX_COBS) {
        let whole = encoded_cobs(&message);
        let mut out = [0xEE; MAX_COBS];
        let result = encode_cobs(&message, &mut out[..room]);
        match room < whole.len() {
            true => prop_assert_eq!(result, Err(NoRoom { room })),
            false => prop_assert_eq!(result, Ok(whole.len())),
        }
        prop_assert!(out[room..].iter().all(|&byte| byte == 0xEE));
    }
}

#[test]
fn oversized_message_is_refused_and_next_is_read() {
    let long = FromHost {
        sequence: 9,
        request: Request::SetConfig(Config::default()),
    };
    let short = FromHost {
        sequence: 10,
        request: Request::GetConfig,
    };
    let max = encoded(&long).len() - 1;
    let stream = [encoded_cobs(&long), encoded_cobs(&short)].concat();
    let malformed = Malformed {
        sequence: Some(9),
        reason: Reason::TooLong { max: 8 },
    };
    assert!(max >= 8);
    assert_eq!(read(&mut Reader::<8>::new(), &[&stream]), [Err(malformed), Ok(short)]);
}

#[test]
fn reader_accepts_nothing_until_message_is_taken() {
    let message = FromHost {
        sequence: 1,
        request: Request::Identify,
    };
    let bytes = encoded_cobs(&message);
    let two = [&bytes[..], &bytes].concat();
    let mut reader = Reader::<MAX_MESSAGE>::new();
    assert_eq!(reader.push(&two), bytes);
    assert_eq!(reader.push(&bytes), bytes);
    assert_eq!(reader.next(), Some(Ok(message)));
    assert_eq!(reader.next::<FromHost>(), None);
    assert_eq!(reader.push(&bytes), []);
    assert_eq!(reader.next(), Some(Ok(message)));
}

#[test]
fn cleared_reader_has_forgotten_half_a_message() {
    let message = FromHost {
        sequence: 1,
        request: Request::Identify,
    };
    let bytes = encoded_cobs(&message);
    let mut reader = Reader::<MAX_MESSAGE>::new();
    reader.push(&bytes[..2]);
    reader.clear();
    assert_eq!(read(&mut reader, &[&bytes]), [Ok(message)]);
}

#[test]
fn older_host_learns_version_of_newer_adapter() {
    let identity = Identity {
        version: VERSION + 1,
        firmware: "9.0.0".try_into().unwrap(),
        can_fd: true,
        ..Identity::default()
    };
    let known = FromAdapter::Reply {
        sequence: 7,
        reply: Reply::Identity(identity),
    };
    // The newer message has one more field.
    let newer = [&encoded(&known)[..], &[1]].concat();
    assert_eq!(decode(&newer), Ok(known.clone()));

    let mut stream = [0; MAX_COBS];
    let len = cobs::try_encode(&newer, &mut stream).unwrap();
    let next = FromAdapter::Reply {
        sequence: 8,
        reply: Reply::Done,
    };
    let stream = [&stream[..=len], &encoded_cobs(&next)].concat();
    let received = read(&mut Reader::<MAX_MESSAGE>::new(), &[&stream]);
    assert_eq!(received, [Ok(known), Ok(next)]);
}

/// The number of counters in version 2.
const OLDER_COUNTS: [u8; 51] = [1; 51];

#[test]
fn counters_of_version_2_lack_only_newer_ones() {
    let older = [&[0, 7, 6][..], &OLDER_COUNTS].concat();
    let Ok(FromAdapter::Reply {
        reply: Reply::Counters(counters),
        ..
    }) = decode(&older)
    else {
        panic!("{:?}", decode::<FromAdapter>(&older))
    };
    assert_eq!((counters.arm_to_host_bytes, counters.dropped_can_frames), (1, 1));
    assert_eq!(
        (
            counters.refused_line_reserved,
            counters.refused_other_rate,
            counters.refused_rate_bytes
        ),
        (0, 0, 0)
    );
    assert_eq!(
        decode::<FromAdapter>(&older[..53]).unwrap_err().reason,
        Reason::EndsEarly
    );
}

#[test]
fn counters_that_are_cut_are_malformed() {
    let message = FromAdapter::Reply {
        sequence: 7,
        reply: Reply::Counters(Counters {
            refused_line_reserved: 300,
            hard_faults: 300,
            untracked_requests: 300,
            ..Counters::default()
        }),
    };
    let mut bytes = [0; MAX_MESSAGE];
    let len = encode(&message, &mut bytes).unwrap();
    // Version 4 lacks the last three counters; the one before them has two bytes here, and version 3 lacks it, too.
    let older = [3 + OLDER_COUNTS.len(), len - 3, len - 5];
    for cut in (3..len).filter(|cut| !older.contains(cut)) {
        let error = decode::<FromAdapter>(&bytes[..cut]).expect_err("a cut message");
        assert_eq!(error.reason, Reason::EndsEarly, "{cut} of {len} bytes");
        assert!(Counters::from_bytes(&bytes[3..cut]).is_err(), "{cut} of {len} bytes");
    }
}

#[test]
fn requests_keep_their_numbers() {
    let end_stream = FromHost {
        sequence: 7,
        request: Request::EndStream,
    };
    assert_eq!(decode(&[7, 11]), Ok(end_stream));
    // The numbers of these requests follow.
    for (number, request) in [
        (12, Request::GetLine),
        (13, Request::ReserveLine),
        (14, Request::ReleaseLine),
        (15, Request::Stop),
    ] {
        assert_eq!(decode(&[7, number]), Ok(FromHost { sequence: 7, request }));
    }
}

#[test]
fn version_5_messages_follow_those_of_version_4() {
    for (number, request) in [(15, Request::Stop), (16, Request::GetRecovery), (17, Request::GetSaved)] {
        assert_eq!(decode(&[7, number]), Ok(FromHost { sequence: 7, request }));
    }
    for (bytes, reply) in [
        (&[0, 7, 10, 1][..], Reply::Recovery { active: true }),
        (&[0, 7, 11, 1], Reply::Saved(Saved::Nothing)),
        (&[0, 7, 11, 2], Reply::Saved(Saved::Unreadable)),
    ] {
        assert_eq!(decode(bytes), Ok(FromAdapter::Reply { sequence: 7, reply }));
    }
    let event = Event::Recovery { active: true };
    assert_eq!(decode(&[1, 9, 4, 1]), Ok(FromAdapter::Event { at: Stamp(9), event }));
}

#[test]
fn version_7_messages_follow_those_of_version_6() {
    let request = Request::GetStop;
    assert_eq!(decode(&[7, 18]), Ok(FromHost { sequence: 7, request }));
    let stop = StopInForce {
        by: Initiator::Can,
        left_ms: 1_200,
    };
    for (bytes, stop) in [(&[0, 7, 12, 0][..], None), (&[0, 7, 12, 1, 1, 0xB0, 0x09], Some(stop))] {
        let reply = Reply::Stop(stop);
        assert_eq!(decode(bytes), Ok(FromAdapter::Reply { sequence: 7, reply }));
    }
}

/// An identity of this version, up to its serial number.
fn identity_bytes(version: u8) -> Vec<u8> {
    [&[0, 7, 2, version][..], b"\x051.2.3\x00\x04pico\x0212"].concat()
}

#[test]
fn identity_of_version_5_does_not_lack_can() {
    for can_fd in [false, true] {
        let older = [&identity_bytes(5)[..], &[can_fd.into()]].concat();
        let identity = Identity {
            version: 5,
            firmware: "1.2.3".try_into().unwrap(),
            board: "pico".try_into().unwrap(),
            serial: "12".try_into().unwrap(),
            can_fd,
            no_can: false,
            ..Identity::default()
        };
        let reply = Reply::Identity(identity);
        assert_eq!(decode(&older), Ok(FromAdapter::Reply { sequence: 7, reply }));
    }
}

#[test]
fn identity_of_version_6_does_not_name_its_chip() {
    let older = [&identity_bytes(6)[..], &[0, 1]].concat();
    let Ok(FromAdapter::Reply {
        reply: Reply::Identity(identity),
        ..
    }) = decode(&older)
    else {
        panic!("{:?}", decode::<FromAdapter>(&older))
    };
    assert_eq!((identity.no_can, identity.chip), (true, 0));
}

#[test]
fn identity_of_version_7_ends_with_its_chip() {
    let whole = [&identity_bytes(7)[..], &[0, 1, 0xAC, 0x02]].concat();
    let Ok(FromAdapter::Reply {
        reply: Reply::Identity(identity),
        ..
    }) = decode(&whole)
    else {
        panic!("{:?}", decode::<FromAdapter>(&whole))
    };
    assert!(identity.no_can && !identity.can_fd);
    assert_eq!(identity.chip, 300);
    assert_eq!(
        encoded(&FromAdapter::Reply {
            sequence: 7,
            reply: Reply::Identity(identity)
        }),
        whole
    );
}

#[test]
fn identity_that_is_cut_is_malformed() {
    for (version, ends) in [(5, &[0][..]), (6, &[0, 1]), (7, &[0, 1, 0])] {
        let whole = [&identity_bytes(version)[..], ends].concat();
        for cut in 3..whole.len() {
            let error = decode::<FromAdapter>(&whole[..cut]).expect_err("a cut message");
            assert_eq!(error.reason, Reason::EndsEarly, "{cut} bytes of version {version}");
        }
    }
}

#[test]
fn unknown_request_keeps_its_sequence_number() {
    let malformed = Malformed {
        sequence: Some(200),
        reason: Reason::Unknown,
    };
    assert_eq!(decode::<FromHost>(&[200, 19]), Err(malformed));
    assert_eq!(decode::<FromHost>(&[200, 19, 1, 2, 3]), Err(malformed));
}

#[test]
fn longest_messages_fit() {
    let full = "\u{7F}".repeat(24);
    let most = |n: usize| full[..n].try_into().unwrap();
    let most_identity = Identity {
        version: u16::MAX,
        firmware: most(16),
        commit: most(16),
        board: most(16),
        serial: full.as_str().try_into().unwrap(),
        can_fd: true,
        no_can: true,
        chip: u32::MAX,
    };
    let counts = [[0xFF, 0xFF, 0xFF, 0xFF, 0x0F]; Counters::COUNT];
    let most_counters = Counters::from_bytes(counts.as_flattened()).unwrap();
    let most_counts = Histogram {
        counts: [u32::MAX; Histogram::BUCKETS],
    };
    let most_latencies = Latencies {
        answer: most_counts,
        turn: most_counts,
        poll: most_counts,
    };
    let replies = [
        Reply::Identity(most_identity),
        Reply::Counters(most_counters),
        Reply::Latencies(most_latencies),
    ];
    for reply in replies {
        encoded_cobs(&FromAdapter::Reply {
            sequence: u8::MAX,
            reply,
        });
    }
    encoded_cobs(&FromAdapter::Event {
        at: Stamp(u64::MAX),
        event: Event::Frame {
            initiator: Some(Initiator::Adapter),
            bytes: FrameBytes::from_slice(&[0xFF; MAX_FRAME]).unwrap(),
        },
    });
}
