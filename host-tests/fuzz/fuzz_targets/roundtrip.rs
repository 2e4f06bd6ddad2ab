//! Whatever can be said is read as it was meant: every message of every protocol, those of the control port, and the
//! cyclic frames on CAN; and a buffer a byte too short for it is refused.
#![no_main]

use armwire::ling::{JointState, Opening, Position, Speed, Stroke};
use armwire::{Framing, Scan};
use armwire_bridge::can::command::Command;
use armwire_bridge::can::telemetry::{Errors, Sample, event_from_frame, event_to_frame};
use armwire_bridge::can::{Frame, Id, Node};
use armwire_bridge::control::{
    FromAdapter, FromHost, MAX_COBS, MAX_MESSAGE, Message, Reader, Reply, Stamp, decode, encode, encode_cobs,
};
use armwire_bridge::isotp::SeparationTime;
use armwire_bridge::{LineCoding, Refused};
use armwire_fuzz::config::{any_config, any_event, any_reply, any_request};
use armwire_fuzz::{Check, Result, Subject, Unstructured, check, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some((kind, rest)) = input.split_first() else {
        return;
    };
    let mut u = Unstructured::new(rest);
    // Too short an input is none.
    let _ = match kind % 4 {
        0 => control_messages(&mut u),
        1 => cyclic_frames(&mut u),
        2 => values(&mut u),
        _ => {
            check::<Messages>(rest);
            Ok(())
        }
    };
});

struct Messages;

impl Check for Messages {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        if u.arbitrary()? {
            let request = P::any_request(u)?;
            let bytes = request_bytes::<P>(&request);
            assert_eq!(P::scan(&bytes, P::REQUESTS), Scan::Frame(bytes.len()));
            let frame = P::view(&bytes).expect("it is a frame");
            assert_eq!(
                (P::wire_len(frame), P::parse_request(frame)),
                (bytes.len(), Ok(request))
            );
            let mut short = vec![0; bytes.len() - 1];
            let error = P::encode_request(&request, &mut short).expect_err("it is too short");
            assert_eq!((error.needed, error.got), (bytes.len(), bytes.len() - 1));
            assert!(!error.to_string().is_empty());
        } else {
            let (response, expect) = P::any_response(u)?;
            let bytes = response_bytes::<P>(&response);
            assert_eq!(on_idle_line::<P>(&bytes, expect), Scan::Frame(bytes.len()));
            let frame = P::view(&bytes).expect("it is a frame");
            assert_eq!(
                (P::wire_len(frame), P::parse_response(frame, expect)),
                (bytes.len(), Ok(response))
            );
            let mut short = vec![0; bytes.len() - 1];
            let error = P::encode_response(&response, &mut short).expect_err("it is too short");
            assert_eq!((error.needed, error.got), (bytes.len(), bytes.len() - 1));
        }
        Ok(())
    }
}

fn on_idle_line<P: Framing>(bytes: &[u8], expect: P::Expect) -> Scan {
    match P::scan(bytes, expect) {
        Scan::Need(missing) => P::scan_idle(bytes, expect, missing),
        verdict => verdict,
    }
}

fn control_messages(u: &mut Unstructured<'_>) -> Result<()> {
    let sequence = u.arbitrary()?;
    match u.int_in_range(0..=2)? {
        0 => control_message(&FromHost {
            sequence,
            request: any_request(u)?,
        }),
        1 => control_message(&FromAdapter::Reply {
            sequence,
            reply: any_reply(u)?,
        }),
        _ => control_message(&FromAdapter::Event {
            at: Stamp(u.arbitrary()?),
            event: any_event(u)?,
        }),
    }
    let config = any_config(u)?;
    match config.check() {
        Ok(()) => assert!(config.can.telemetry_hz <= config.can.max_telemetry_hz()),
        Err(error) => {
            assert!(!error.to_string().is_empty());
            control_message(&FromAdapter::Reply {
                sequence,
                reply: Reply::BadConfig(error),
            });
        }
    }
    Ok(())
}

fn control_message<T: Message + PartialEq + std::fmt::Debug>(message: &T) {
    let mut bytes = [0; MAX_MESSAGE];
    let len = encode(message, &mut bytes).expect("it is not too long");
    assert_eq!(decode::<T>(&bytes[..len]).as_ref(), Ok(message));
    assert!(encode(message, &mut vec![0; len - 1]).is_err());
    assert!(decode::<T>(&bytes[..len - 1]).is_err(), "the end of it is not needed");

    let mut bytes = [0; MAX_COBS];
    let len = encode_cobs(message, &mut bytes).expect("it is not too long");
    assert_eq!(bytes[..len].iter().position(|byte| *byte == 0), Some(len - 1));
    assert!(encode_cobs(message, &mut vec![0; len - 1]).is_err());
    let mut reader = Reader::<MAX_MESSAGE>::new();
    assert!(reader.push(&bytes[..len]).is_empty());
    assert_eq!(reader.next::<T>(), Some(Ok(serde_free_clone(message))));
}

/// The same message, by way of its bytes: not all messages can be copied.
fn serde_free_clone<T: Message>(message: &T) -> T {
    let mut bytes = [0; MAX_MESSAGE];
    let len = encode(message, &mut bytes).expect("it is not too long");
    decode(&bytes[..len]).expect("it was written")
}

fn cyclic_frames(u: &mut Unstructured<'_>) -> Result<()> {
    let node = Node::new(u.int_in_range(0..=15)?).expect("in range");
    let sample = Sample {
        state: JointState {
            joints: u.arbitrary()?,
            gripper: u.arbitrary()?,
            status: u.arbitrary::<u8>()?.into(),
        },
        stamp: u.arbitrary()?,
        count: u.arbitrary()?,
    };
    assert_eq!(Sample::from_frames(&sample.to_frames(node)), Some(sample));
    let errors = Errors {
        noise_bytes: u.arbitrary()?,
        uart: u.arbitrary()?,
        can: u.arbitrary()?,
        unanswered: u.arbitrary()?,
        refused: u.arbitrary()?,
    };
    assert_eq!(Errors::from_frame(&errors.to_frame(node)), Some(errors));
    let (event, at) = (any_event(u)?, Stamp(u.arbitrary()?));
    if let Some(frame) = event_to_frame(&event, at, node) {
        assert_eq!(event_from_frame(&frame), Some((at.0 as u32, event)));
    }
    let command = Command {
        sequence: u.arbitrary()?,
        joints: u.arbitrary()?,
        speed: u.arbitrary()?,
        gripper: u.arbitrary()?,
    };
    let in_range = (1..=250).contains(&command.speed)
        && command.gripper <= 250
        && command.joints.iter().all(|&ticks| ticks <= Position::MAX.ticks());
    assert_eq!(command.target().is_ok(), in_range);

    // Frames that are none of these are read as none, or written anew as they are.
    let Ok(id) = Id::new(u.arbitrary::<u16>()? & 0xFFF) else {
        return Ok(());
    };
    let Ok(frame) = Frame::new(id, u.arbitrary()?) else {
        return Ok(());
    };
    let node = Node::new(id.get() as u8 & 15).expect("in range");
    if let Some(errors) = Errors::from_frame(&frame) {
        assert_eq!(errors.to_frame(node), frame);
    }
    if let Some((stamp, event)) = event_from_frame(&frame) {
        assert_eq!(event_to_frame(&event, Stamp(stamp.into()), node), Some(frame));
    }
    assert!(Sample::from_frames(&[frame; 3]).is_none());
    Ok(())
}

fn values(u: &mut Unstructured<'_>) -> Result<()> {
    let number = f32::from_bits(u.arbitrary()?);
    if let Ok(position) = Position::from_radians(number) {
        assert!(
            (position.radians() - number).abs() < 0.0008,
            "{number} rad is {position:?}"
        );
    }
    if let Ok(speed) = Speed::from_radians_per_second(number) {
        assert!(
            (speed.radians_per_second() - number).abs() < 0.0008,
            "{number} rad/s is {speed:?}"
        );
    }
    if let Ok(opening) = Opening::from_fraction(number) {
        assert!((opening.fraction() - number).abs() < 0.0006);
    }
    for stroke in [Stroke::Mm50, Stroke::Mm75, Stroke::Mm100] {
        if let Ok(opening) = Opening::from_millimetres(number, stroke) {
            assert!((opening.millimetres(stroke) - number).abs() < 0.06);
        }
    }
    if let Ok(position) = Position::new(u.arbitrary()?) {
        assert_eq!(Position::from_radians(position.radians()), Ok(position));
    }
    if let Ok(speed) = Speed::new(u.arbitrary()?) {
        assert_eq!(Speed::from_radians_per_second(speed.radians_per_second()), Ok(speed));
    }
    let byte = u.arbitrary()?;
    let gap = SeparationTime::from_byte(byte);
    assert!(gap.to_byte() == byte || gap.micros().0 == 127_000);
    let cdc: [u8; 7] = u.arbitrary()?;
    match LineCoding::from_cdc(cdc) {
        Ok(coding) => assert_eq!(coding.to_cdc(), cdc),
        Err(refused) => {
            let what = match refused {
                Refused::Baud(_) => "baud",
                Refused::DataBits(_) => "data bits",
                Refused::Parity(_) => "parity",
                Refused::StopBits(_) => "stop bits",
            };
            assert!(refused.to_string().contains(what));
        }
    }
    Ok(())
}
