//! Every example frame of the document, and the corrected frames.

extern crate std;

use std::vec::Vec;

use super::*;
use crate::decoder::{self, Decoder};
use crate::framing::{Framing, Reason, Scan};
use crate::hex::hex;
use crate::messages::Messages;
use crate::time::Instant;
use crate::vectors;
use crate::{Cause, Client, Config, Device, DeviceEvent, Event, Output};

fn moving(gripper: u16) -> Request {
    Request::Move(Move {
        joints: [(Position::CENTRE, Speed::new(1000).unwrap()); 6],
        gripper: (Opening::new(gripper).unwrap(), GripperSpeed(1000)),
    })
}

/// Name, frame, meaning, in the order of the document. A row ends with its section, or with *candidate* for the vendor's
/// candidate document. Frames marked *corrected* are printed with the checksum of another frame, those marked *computed*
/// are not printed.
fn requests() -> Vec<(&'static str, Vec<u8>, Request)> {
    let limit = TemperatureLimit::new(100).unwrap();
    let meanings = [
        ("read information", Request::ReadInfo),                        // 2.1
        ("set zero", Request::SetZero),                                 // 2.2
        ("set stroke 100 mm", Request::SetStroke(Stroke::Mm100)),       // 2.3
        ("set stroke 50 mm", Request::SetStroke(Stroke::Mm50)),         // 2.3, computed
        ("set stroke 75 mm", Request::SetStroke(Stroke::Mm75)),         // 2.3, computed
        ("read stroke", Request::ReadStroke),                           // 2.3, corrected
        ("torque off", Request::SetTorque(Torque::Off)),                // 2.4
        ("torque on", Request::SetTorque(Torque::On)),                  // 2.4, computed
        ("read joints", Request::ReadJoints),                           // 2.5
        ("read temperatures", Request::ReadTemperatures),               // 2.5
        ("set temperature limit", Request::SetTemperatureLimit(limit)), // 2.5
        ("read velocities", Request::ReadVelocities),                   // 2.5
        ("move, gripper half open", moving(500)),                       // 2.5
        ("move, gripper open", moving(1000)),                           // 2.5, computed
        ("self-check", Request::SelfCheck),                             // 2.6
        ("set position mode", Request::SetMode(ControlMode::Position)), // candidate
        ("set current mode", Request::SetMode(ControlMode::Current)),   // candidate
        ("read mode", Request::ReadMode),                               // candidate
        ("force feedback off", Request::SetForceFeedback(false)),       // candidate
        ("force feedback on", Request::SetForceFeedback(true)),         // candidate
        ("read force feedback", Request::ReadForceFeedback),            // candidate
    ];
    vectors::with_meanings(vectors::ling_requests(), meanings)
}

fn reply(result: ModeResult) -> ModeReply {
    ModeReply { requested: 1, result }
}

fn mode_state() -> ModeState {
    let values = [
        [0, 0, 0, 0],
        [12, -350, -340, -1250],
        [-12, 350, 340, 333],
        [1, 2, 3, 4],
        [i16::MIN, i16::MAX, -1, 0],
        [0, 0, 0, 250],
    ];
    ModeState {
        mode: ControlMode::Current,
        blocked: JointMask(0b00_0110),
        valid: JointMask(0b11_1111),
        joints: values.map(
            |[residual_torque, requested_current, output_current, measured_current]| JointForce {
                residual_torque,
                requested_current,
                output_current,
                measured_current,
            },
        ),
    }
}

fn inhibited() -> ForceFeedback {
    ForceFeedback {
        is_requested: true,
        is_effective: false,
        inhibit: Inhibit(Inhibit::NO_TELEOPERATION | Inhibit::STALE),
        is_sync_active: false,
        is_torque_enabled: true,
        is_torque_requested: true,
        transition: 3,
        grip: 127,
        requested_mode: 1,
    }
}

fn responses() -> Vec<(&'static str, Vec<u8>, Response)> {
    let meanings = [
        (
            "information",
            Response::Info(Info {
                serial: SerialNumber(*b"ADLS251205123456"),
                hardware: Version(110),
                firmware: Version(610),
            }),
        ), // 2.1
        ("stroke 75 mm", Response::Stroke(Stroke::Mm75)), // 2.3, corrected
        ("stroke 50 mm", Response::Stroke(Stroke::Mm50)), // 2.3, computed
        ("stroke 100 mm", Response::Stroke(Stroke::Mm100)), // 2.3, computed
        (
            "joints",
            Response::Joints(JointState {
                joints: [2050, 2043, 2043, 2050, 2042, 2049],
                gripper: 2051,
                status: MotionStatus::Idle,
            }),
        ), // 2.5
        (
            "temperatures",
            Response::Temperatures(PerServo::Follower([35, 36, 35, 38, 35, 38, 35, 37, 36, 36])),
        ), // 2.5
        ("velocities", Response::Velocities(PerServo::Follower([0; 10]))), // 2.5
        ("self-check, follower", Response::SelfCheck(SelfCheck(0x3FF))), // 2.6
        ("self-check, leader", Response::SelfCheck(SelfCheck(0x3F))), // 2.6, computed
        (
            "current mode accepted",
            Response::ModeReply(reply(ModeResult::Accepted)),
        ), // candidate, computed
        (
            "current mode unsupported",
            Response::ModeReply(reply(ModeResult::Unsupported)),
        ), // candidate, computed
        ("mode and currents", Response::Mode(mode_state())), // candidate, computed
        ("force feedback inhibited", Response::ForceFeedback(inhibited())), // candidate, computed
        ("force feedback idle", Response::ForceFeedback(ForceFeedback::default())), // candidate, computed
    ];
    vectors::with_meanings(vectors::ling_answers(), meanings)
}

/// These bytes, which must be one frame.
fn frame_of(bytes: &[u8]) -> &[u8] {
    assert_eq!(Ling.scan(bytes, ()), Scan::Frame(bytes.len()));
    bytes
}

/// The bytes of a frame.
fn bytes_of(frame: Frame<'_>) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let n = frame.encode(&mut out).unwrap();
    out[..n].to_vec()
}

#[test]
fn documented_requests_round_trip() {
    for (name, bytes, request) in requests() {
        let mut out = [0; MAX_FRAME];
        let n = Ling.encode_request(&request, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "{name}");
        assert_eq!(Ling.parse_request(frame_of(&bytes)), Ok(request), "{name}");
    }
}

#[test]
fn documented_responses_round_trip() {
    for (name, bytes, response) in responses() {
        let mut out = [0; MAX_FRAME];
        let n = Ling.encode_response(&response, None, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "{name}");
        assert_eq!(Ling.parse_response(frame_of(&bytes), ()), Ok(response), "{name}");
    }
}

#[test]
fn two_prints_with_wrong_checksum_are_rejected() {
    // Section 2.3 prints the checksum of "set 100 mm" in the query and in its answer.
    for (printed, expected) in [("AA 04 0E 01 FE 7F FF", 0x1B), ("AA 04 0E 01 01 7F FF", 0x96)] {
        let mut decoder = Decoder::<_, MAX_FRAME>::new();
        assert!(decoder.push(&hex(printed)).is_empty());
        let noise = decoder.next(&Ling, ()).unwrap();
        assert_eq!(
            noise.kind,
            decoder::Kind::Noise(Reason::Checksum { expected, got: 0x7F })
        );
    }
}

#[test]
fn device_accepts_all_encodings_of_the_self_check() {
    for encoding in ["AA FE 00 00 FE 93 FF", "AA FE 00 00 C8 FF", "AA FE 00 01 FE D2 FF"] {
        for chunk in 1..=7 {
            let mut device = Device::<Ling, MAX_FRAME>::new(Ling);
            let mut requests = Vec::new();
            for bytes in hex(encoding).chunks(chunk) {
                assert!(device.receive(bytes).is_empty());
                while let Some(event) = device.poll() {
                    let DeviceEvent::Request { request, .. } = event else {
                        panic!("{event:?}")
                    };
                    requests.push(request);
                }
            }
            assert_eq!(requests, [Request::SelfCheck], "{encoding} in chunks of {chunk}");
        }
    }
}

#[test]
fn only_the_self_check_has_length_tolerance() {
    let check = checksum(&[0x06, 0x00, 0x00, 0xFE]);
    let verdict = Ling.scan(&[0xAA, 0x06, 0x00, 0x00, 0xFE, check, 0xFF], ());
    assert!(matches!(verdict, Scan::Noise(1, _)), "{verdict:?}");
}

#[test]
fn leader_arms_send_six_readings() {
    for response in [
        Response::Temperatures(PerServo::Leader([30; 6])),
        Response::Velocities(PerServo::Leader([1, 2, 3, 4, 5, 5000])),
    ] {
        let mut out = [0; MAX_FRAME];
        let n = Ling.encode_response(&response, None, &mut out).unwrap();
        assert_eq!(Ling.parse_response(frame_of(&out[..n]), ()), Ok(response));
    }
}

#[test]
fn reply_with_wrong_length_names_valid_lengths() {
    let frame = Frame {
        command: 0x06,
        function: 0x01,
        data: &[35; 5],
    };
    let error = Ling.parse_response(&bytes_of(frame), ()).unwrap_err();
    assert_eq!(
        std::format!("{error}"),
        "command 06 function 01: 5 data bytes, expected 6 or 10"
    );
}

#[test]
fn value_out_of_range_names_its_position() {
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_request(&moving(0), &mut out).unwrap();
    out[4 + 9] = 0x10; // joint 3: 0x1000 ticks
    let frame = Frame {
        command: 0x06,
        function: 0x03,
        data: &out[4..n - 2],
    };
    let error = Ling.parse_request(&bytes_of(frame)).unwrap_err();
    assert_eq!(
        std::format!("{error}"),
        "command 06 function 03: joint position is 4096 ticks, must be 0..=4095 (data byte 8)"
    );
}

#[test]
fn gripper_accepts_speeds_beyond_those_of_joints() {
    let request = Request::Move(Move {
        joints: [(Position::MAX, Speed::MAX); 6],
        gripper: (Opening::OPEN, GripperSpeed(5500)),
    });
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_request(&request, &mut out).unwrap();
    assert_eq!(Ling.parse_request(frame_of(&out[..n])), Ok(request));
}

#[test]
fn no_request_can_be_mistaken_for_a_response() {
    for (name, bytes, _) in requests() {
        assert!(Ling.parse_response(frame_of(&bytes), ()).is_err(), "{name}");
        let mut client = Client::<Ling, MAX_FRAME>::new(Ling, Config::DEFAULT);
        assert!(client.receive(Instant::ZERO, &bytes).is_empty());
        assert_eq!(client.poll(Instant::ZERO), Output::Event(Event::Echo), "{name}");
    }
}

#[test]
fn longest_frame_has_64_bytes_of_data() {
    assert_eq!(MAX_FRAME, 70);
    let frame = Frame {
        command: 6,
        function: 0,
        data: &[7; 64],
    };
    let mut out = [0; MAX_FRAME];
    assert_eq!(frame.encode(&mut out), Ok(70));
    assert_eq!(Frame::parse(&out), Some(frame));
    assert_eq!(Frame { data: &[], ..frame }.encode(&mut out), Ok(6));
    assert!(
        Frame {
            data: &[7; 65],
            ..frame
        }
        .encode(&mut out)
        .is_err()
    );
}

#[test]
fn self_check_with_excess_data_is_refused() {
    let frame = |data| Frame {
        command: SELF_CHECK[1],
        function: 0,
        data,
    };
    for data in [&[][..], &[0xFE]] {
        assert_eq!(Ling.parse_request(&bytes_of(frame(data))), Ok(Request::SelfCheck));
    }
    for data in [&[0xFE, 0xFE][..], &[0]] {
        assert!(Ling.parse_request(&bytes_of(frame(data))).is_err(), "{data:x?}");
    }
}

#[test]
fn move_out_of_range_names_the_byte() {
    let home = [0x00, 0x08, 0xE8, 0x03].repeat(7);
    for offset in (0..26).step_by(2) {
        let mut data = home.clone();
        data[offset..offset + 2].copy_from_slice(&[0xFF, 0xFF]);
        let error = Ling.parse_request(&bytes_of(Frame {
            command: 6,
            function: 3,
            data: &data,
        }));
        let error = error.unwrap_err();
        assert!(
            matches!(error.cause, Cause::Value { offset: at, .. } if at == offset),
            "{offset}: {error:?}"
        );
    }
}

#[test]
fn serial_number_identifies_the_kind_of_arm() {
    let kind = |text: &[u8; 16]| SerialNumber(*text).kind();
    assert_eq!(kind(b"ADLS251205123456"), Some(Kind::Leader));
    assert_eq!(kind(b"ADFS251205123456"), Some(Kind::Follower));
    assert_eq!(kind(b"ADXS251205123456"), None);
}

/// The error of an answer of the force-feedback leader, with this byte of its data replaced.
fn refused(name: &str, offset: usize, byte: u8) -> std::string::String {
    let vector = vectors::ling_answers().into_iter().find(|vector| vector.name == name);
    let mut bytes = vector.unwrap().bytes;
    bytes[4 + offset] = byte;
    let n = bytes.len();
    bytes[n - 2] = checksum(&bytes[1..n - 2]);
    std::format!("{}", Ling.parse_response(frame_of(&bytes), ()).unwrap_err())
}

#[test]
fn wrong_value_of_the_leader_is_named() {
    let rows = [
        (
            "current mode accepted",
            0,
            2,
            "command 05 function 01: data byte 0 is 02, must be 01",
        ),
        (
            "current mode accepted",
            2,
            3,
            "command 05 function 01: data byte 2 is 03, must be 00 or 01 or 02",
        ),
        (
            "mode and currents",
            0,
            0,
            "command 06 function 24: data byte 0 is 00, must be 01",
        ),
        (
            "mode and currents",
            1,
            2,
            "command 06 function 24: control mode is 2, must be 0..=1 (data byte 1)",
        ),
        (
            "force feedback idle",
            0,
            1,
            "command 06 function 20: data byte 0 is 01, must be 02",
        ),
        (
            "force feedback idle",
            1,
            2,
            "command 06 function 20: data byte 1 is 02, must be 00 or 01",
        ),
        (
            "force feedback idle",
            2,
            254,
            "command 06 function 20: data byte 2 is FE, must be 00 or 01",
        ),
        (
            "force feedback idle",
            4,
            2,
            "command 06 function 20: data byte 4 is 02, must be 00 or 01",
        ),
        (
            "force feedback idle",
            5,
            2,
            "command 06 function 20: data byte 5 is 02, must be 00 or 01",
        ),
        (
            "force feedback idle",
            6,
            2,
            "command 06 function 20: data byte 6 is 02, must be 00 or 01",
        ),
    ];
    for (name, offset, byte, text) in rows {
        assert_eq!(refused(name, offset, byte), text);
    }
    let request = |function, command, data: &[u8]| {
        let frame = bytes_of(Frame {
            command,
            function,
            data,
        });
        std::format!("{}", Ling.parse_request(&frame).unwrap_err())
    };
    let text = "command 05 function 01: control mode is 2, must be 0..=1 (data byte 0)";
    assert_eq!(request(0x01, 0x05, &[2]), text);
    let text = "command 06 function 20: data byte 0 is 02, must be 00 or 01 or FE";
    assert_eq!(request(0x20, 0x06, &[2]), text);
    let text = "command 06 function 24: 2 data bytes, expected 1";
    assert_eq!(request(0x24, 0x06, &[0xFE, 0xFE]), text);
}

/// The refused mode is none, and is kept as it is.
#[test]
fn invalid_mode_has_its_verdict() {
    let frame = hex("AA 05 01 03 01 07 01 28 FF");
    let reply = ModeReply {
        requested: 7,
        result: ModeResult::Invalid,
    };
    assert_eq!(
        Ling.parse_response(frame_of(&frame), ()),
        Ok(Response::ModeReply(reply))
    );
}

/// Functions that the candidate document reserves for the vendor's bench, and the header of its internal frames.
#[test]
fn functions_of_the_vendors_bench_are_undocumented() {
    for (command, function) in [(0x03, 0x01), (0x06, 0x23), (0x06, 0x25), (0x06, 0x26), (0x06, 0x27)] {
        for data in [&[0xFE][..], &[1], &[0; 16]] {
            let frame = bytes_of(Frame {
                command,
                function,
                data,
            });
            for error in [
                Ling.parse_request(&frame).unwrap_err(),
                Ling.parse_response(&frame, ()).unwrap_err(),
            ] {
                assert_eq!(error.cause, Cause::Unknown, "{error}");
            }
        }
    }
    assert_eq!(Ling.scan(&hex("AB 54 01 00"), ()), Scan::Noise(4, Reason::Stray));
}
