//! What holds of every message and every stream of bytes.

use armwire::ling::{self, *};
use armwire::{Client, Config, Decoder, Event, Framing, Input, Micros, Noise, Protocol, Reason, Scan};
use proptest::array::{uniform6, uniform10, uniform16};
use proptest::collection::vec;
use proptest::prelude::*;

fn request() -> impl Strategy<Value = Request> {
    let stroke = prop_oneof![Just(Stroke::Mm50), Just(Stroke::Mm75), Just(Stroke::Mm100)];
    let joint = (0..=4095_u16, 0..=5000_u16)
        .prop_map(|(position, speed)| (Position::new(position).unwrap(), Speed::new(speed).unwrap()));
    let gripper =
        (0..=1000_u16, any::<u16>()).prop_map(|(opening, speed)| (Opening::new(opening).unwrap(), GripperSpeed(speed)));
    prop_oneof![
        Just(Request::ReadInfo),
        Just(Request::SetZero),
        stroke.prop_map(Request::SetStroke),
        Just(Request::ReadStroke),
        Just(Request::SetTorque(Torque::Off)),
        Just(Request::SetTorque(Torque::On)),
        Just(Request::ReadJoints),
        Just(Request::ReadTemperatures),
        (0..=253_u8).prop_map(|celsius| Request::SetTemperatureLimit(TemperatureLimit::new(celsius).unwrap())),
        Just(Request::ReadVelocities),
        (uniform6(joint), gripper).prop_map(|(joints, gripper)| Request::Move(Move { joints, gripper })),
        Just(Request::SelfCheck),
    ]
}

fn response() -> impl Strategy<Value = Response> {
    prop_oneof![
        (uniform16(any::<u8>()), any::<u32>(), any::<u32>()).prop_map(|(serial, hardware, firmware)| {
            Response::Info(Info {
                serial: SerialNumber(serial),
                hardware: Version(hardware),
                firmware: Version(firmware),
            })
        }),
        prop_oneof![Just(Stroke::Mm50), Just(Stroke::Mm75), Just(Stroke::Mm100)].prop_map(Response::Stroke),
        (uniform6(any::<u16>()), any::<u16>(), any::<u8>()).prop_map(|(joints, gripper, status)| {
            Response::Joints(JointState {
                joints,
                gripper,
                status: status.into(),
            })
        }),
        uniform6(any::<u8>()).prop_map(|celsius| Response::Temperatures(PerServo::Leader(celsius))),
        uniform10(any::<u8>()).prop_map(|celsius| Response::Temperatures(PerServo::Follower(celsius))),
        uniform6(any::<u16>()).prop_map(|ticks| Response::Velocities(PerServo::Leader(ticks))),
        uniform10(any::<u16>()).prop_map(|ticks| Response::Velocities(PerServo::Follower(ticks))),
        any::<u16>().prop_map(|mask| Response::SelfCheck(SelfCheck(mask))),
    ]
}

/// Noise that looks like frames more often than chance would have it.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![4 => any::<u8>(), 2 => Just(0xAA), 1 => Just(0xFF), 1 => 0..32_u8];
    vec(byte, 0..24)
}

fn bytes_of(response: &Response) -> Vec<u8> {
    let mut out = [0; ling::MAX_FRAME];
    let n = Ling::encode_response(response, &mut out).unwrap();
    out[..n].to_vec()
}

/// A frame that came out of the decoder (its place in the stream), or noise.
#[derive(Clone, Debug, PartialEq)]
enum Out {
    Frame(core::ops::Range<u64>),
    Noise(Noise),
}

type Lings = Decoder<Ling, { ling::MAX_FRAME }>;

/// Appends what the decoder has to say, `at` being where in the stream it is.
fn drain(decoder: &mut Lings, at: &mut u64, out: &mut Vec<Out>) {
    while let Some(next) = decoder.next(()) {
        let start = *at;
        match next {
            // The self-check as printed is a byte longer than its length field says; nothing here makes one.
            Ok(frame) => {
                *at += (frame.data.len() + ling::OVERHEAD) as u64;
                out.push(Out::Frame(start..*at));
            }
            Err(noise) => {
                assert_eq!(noise.offset, start);
                *at += noise.len as u64;
                out.push(Out::Noise(noise));
            }
        }
    }
}

/// All that comes out of a stream that arrives in chunks and then goes idle.
fn decode<'c>(chunks: impl IntoIterator<Item = &'c [u8]>) -> Vec<Out> {
    let (mut decoder, mut at, mut out) = (Lings::new(), 0, Vec::new());
    for mut rest in chunks {
        while !rest.is_empty() {
            rest = decoder.push(rest);
            drain(&mut decoder, &mut at, &mut out);
        }
    }
    while let Some(noise) = decoder.idle(()) {
        at += noise.len as u64;
        out.push(Out::Noise(noise));
        drain(&mut decoder, &mut at, &mut out);
    }
    out
}

proptest! {
    #[test]
    fn every_request_survives_the_wire(request in request()) {
        let mut out = [0; ling::MAX_FRAME];
        let n = Ling::encode_request(&request, &mut out).unwrap();
        prop_assert_eq!(Ling::scan(&out[..n], ()), Scan::Frame(n));
        prop_assert_eq!(Ling::parse_request(Ling::view(&out[..n]).unwrap()), Ok(request));
        let error = Ling::encode_request(&request, &mut out[..n - 1]).unwrap_err();
        prop_assert_eq!((error.needed, error.got), (n, n - 1));
    }

    #[test]
    fn every_response_survives_the_wire(response in response()) {
        let bytes = bytes_of(&response);
        prop_assert_eq!(Ling::parse_response(Ling::view(&bytes).unwrap(), ()), Ok(response));
        let mut out = vec![0; bytes.len() - 1];
        prop_assert_eq!(Ling::encode_response(&response, &mut out).unwrap_err().needed, bytes.len());
    }

    #[test]
    fn a_prefix_of_a_frame_is_never_given_a_verdict(response in response()) {
        let bytes = bytes_of(&response);
        for n in 1..bytes.len() {
            let Scan::Need(more) = Ling::scan(&bytes[..n], ()) else {
                panic!("a verdict on {n} of {} bytes", bytes.len());
            };
            prop_assert!((1..=bytes.len() - n).contains(&more));
        }
    }

    #[test]
    fn what_comes_out_does_not_depend_on_the_chunks(
        parts in vec((noise(), response()), 1..6),
        cuts in vec(1..40_usize, 1..60),
    ) {
        let stream: Vec<u8> = parts.iter().flat_map(|(noise, response)| [noise.clone(), bytes_of(response)].concat()).collect();
        let mut chunks = Vec::new();
        let mut rest = &stream[..];
        for cut in cuts {
            let (chunk, later) = rest.split_at(cut.min(rest.len()));
            chunks.push(chunk);
            rest = later;
        }
        chunks.push(rest);
        prop_assert_eq!(decode(chunks), decode([&stream[..]]));
        prop_assert_eq!(decode(stream.chunks(1)), decode([&stream[..]]));
    }

    #[test]
    fn no_intact_frame_is_lost_to_noise(parts in vec((noise(), response()), 1..12)) {
        let mut stream = Vec::new();
        let mut intact = Vec::new();
        for (noise, response) in &parts {
            stream.extend(noise);
            let start = stream.len() as u64;
            stream.extend(bytes_of(response));
            intact.push(start..stream.len() as u64);
        }
        let out = decode([&stream[..]]);
        let frames: Vec<_> = out.iter().filter_map(|out| match out {
            Out::Frame(range) => Some(range.clone()),
            Out::Noise(_) => None,
        }).collect();
        for frame in intact {
            // Noise that is a good frame by chance may overlap: that one is a frame too, and came first.
            let overlapped = frames.iter().any(|f| *f != frame && f.start < frame.start && f.end > frame.start);
            prop_assert!(frames.contains(&frame) || overlapped, "lost {frame:?} of {out:?}");
        }
    }

    #[test]
    fn every_byte_is_in_a_frame_or_in_noise(stream in vec(noise(), 0..20)) {
        let stream = stream.concat();
        let bytes: u64 = decode([&stream[..]]).iter().map(|out| match out {
            Out::Frame(range) => range.end - range.start,
            Out::Noise(noise) => noise.len as u64,
        }).sum();
        prop_assert_eq!(bytes, stream.len() as u64);
    }

    #[test]
    fn the_client_takes_any_bytes_at_any_time(
        steps in vec((noise(), 0..50_000_u64, any::<bool>()), 0..40),
        request in request(),
    ) {
        let mut client = Client::<Ling, { ling::MAX_FRAME }>::new(Config::DEFAULT);
        let mut now = Micros(0);
        let (mut given, mut noise, mut frames) = (0, 0, 0);
        for (bytes, wait, idle) in steps {
            let _ = client.submit(request);
            if let Some(n) = client.poll_transmit(now).map(<[u8]>::len) {
                client.transmitted(now, n);
            }
            now = now + Micros(wait);
            given += bytes.len();
            for mut input in [Input::Bytes(&bytes), if idle { Input::Idle } else { Input::Tick }] {
                while let Some(event) = client.handle(now, &mut input) {
                    match event {
                        Event::Noise(dropped) => noise += dropped.len,
                        Event::Sent | Event::TimedOut { .. } => {}
                        _ => frames += 1,
                    }
                }
            }
        }
        // What is left is in the decoder: less than a frame, and a run of stray bytes not yet ended.
        let mut input = Input::Idle;
        while let Some(event) = client.handle(now, &mut input) {
            match event {
                Event::Noise(dropped) => noise += dropped.len,
                Event::Sent | Event::TimedOut { .. } => {}
                _ => frames += 1,
            }
        }
        prop_assert!(noise <= given && noise + frames * ling::OVERHEAD <= given);
        prop_assert!(noise + frames * ling::MAX_FRAME >= given, "{noise} bytes of noise, {frames} frames, {given} given");
    }
}

/// How many of the single-bit errors in a body of `len` bytes its checksum misses. The checksum is linear, so this is
/// the same for every body of that length.
fn missed_single_bit_errors(len: usize) -> usize {
    let mut body = vec![0; len];
    let good = ling::checksum(&body);
    (0..len * 8)
        .filter(|bit| {
            body[bit / 8] ^= 1 << (bit % 8);
            let missed = ling::checksum(&body) == good;
            body[bit / 8] ^= 1 << (bit % 8);
            missed
        })
        .count()
}

#[test]
fn the_checksum_misses_single_bit_errors_only_in_long_frames() {
    // Eight bits of CRC-32 are no CRC-8. Hence values are range-checked too, and lengths must fit the function.
    for len in 3..=21 {
        assert_eq!(missed_single_bit_errors(len), 0, "{len} bytes");
    }
    for (len, frame) in [(23, "velocities"), (27, "information"), (31, "move")] {
        assert_eq!(missed_single_bit_errors(len), 2, "{frame}");
    }
}

#[test]
fn a_length_no_message_has_is_named() {
    assert_eq!(
        Ling::scan(&[0xAA, 0x06, 0x00, 0xFF], ()),
        Scan::Skip(
            1,
            Reason::Length {
                min: 0,
                max: 64,
                got: 255
            }
        )
    );
}
