//! Properties of every Ling message and every line of bytes.

mod common;

use armwire::framing::{Framing, Reason, Scan};
use armwire::ling::{self, *};
use armwire::messages::Messages;
use common::Subject;
use proptest::array::{uniform6, uniform10, uniform16};
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
        (0..=255_u8)
            .prop_filter("254 reads", |celsius| *celsius != 254)
            .prop_map(|celsius| Request::SetTemperatureLimit(TemperatureLimit::new(celsius).unwrap())),
        Just(Request::ReadVelocities),
        (uniform6(joint), gripper).prop_map(|(joints, gripper)| Request::Move(Move { joints, gripper })),
        Just(Request::SelfCheck),
        mode().prop_map(Request::SetMode),
        Just(Request::ReadMode),
        any::<bool>().prop_map(Request::SetForceFeedback),
        Just(Request::ReadForceFeedback),
    ]
}

fn mode() -> impl Strategy<Value = ControlMode> {
    prop_oneof![Just(ControlMode::Position), Just(ControlMode::Current)]
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
        (any::<u8>(), 0..3_usize).prop_map(|(requested, result)| {
            let results = [ModeResult::Accepted, ModeResult::Invalid, ModeResult::Unsupported];
            let result = results[result];
            Response::ModeReply(ModeReply { requested, result })
        }),
        (mode(), any::<[u8; 2]>(), uniform6(any::<[i16; 4]>())).prop_map(|(mode, [blocked, valid], values)| {
            let joints = values.map(
                |[residual_torque, requested_current, output_current, measured_current]| JointForce {
                    residual_torque,
                    requested_current,
                    output_current,
                    measured_current,
                },
            );
            let (blocked, valid) = (JointMask(blocked), JointMask(valid));
            Response::Mode(ModeState {
                mode,
                blocked,
                valid,
                joints,
            })
        }),
        (any::<[bool; 5]>(), any::<[u8; 4]>()).prop_map(|(switches, [inhibit, transition, grip, requested_mode])| {
            let [
                is_requested,
                is_effective,
                is_sync_active,
                is_torque_enabled,
                is_torque_requested,
            ] = switches;
            Response::ForceFeedback(ForceFeedback {
                is_requested,
                is_effective,
                inhibit: Inhibit(inhibit),
                is_sync_active,
                is_torque_enabled,
                is_torque_requested,
                transition,
                grip,
                requested_mode,
            })
        }),
    ]
}

/// Headers, terminators, small lengths, and arbitrary bytes.
fn noise() -> impl Strategy<Value = u8> {
    prop_oneof![4 => any::<u8>(), 2 => Just(0xAA), 1 => Just(0xFF), 1 => 0..32_u8]
}

impl Subject for Ling {
    const PADDING: Option<u8> = None;

    fn any_request() -> BoxedStrategy<Request> {
        request().boxed()
    }

    fn any_response() -> BoxedStrategy<(Vec<u8>, ())> {
        response()
            .prop_map(|response| (common::response_bytes::<Ling>(&response), ()))
            .boxed()
    }

    fn any_expect() -> BoxedStrategy<()> {
        Just(()).boxed()
    }

    fn any_frame((): ()) -> BoxedStrategy<Vec<u8>> {
        let request = request().prop_map(|request| common::request_bytes::<Ling>(&request));
        let response = response().prop_map(|response| common::response_bytes::<Ling>(&response));
        prop_oneof![request, response].boxed()
    }

    fn any_noise() -> BoxedStrategy<u8> {
        noise().boxed()
    }
}

proptest! {
    #[test]
    fn every_request_survives_the_wire(request in Ling::any_request()) {
        common::a_request_survives_the_wire::<Ling>(request)?;
    }

    #[test]
    fn every_response_survives_the_wire(response in Ling::any_response()) {
        common::a_response_survives_the_wire::<Ling>(response)?;
    }

    #[test]
    fn frame_prefix_never_gets_a_verdict(frame in Ling::any_frame(())) {
        common::a_prefix_of_a_frame_is_given_no_verdict::<Ling>(&frame, ())?;
    }

    #[test]
    fn no_intact_frame_and_no_byte_is_lost(line in common::line::<Ling>()) {
        common::nothing_is_lost_to_noise::<Ling>(line)?;
    }

    #[test]
    fn client_accepts_any_bytes_at_any_time(steps in common::steps::<Ling>(), request in Ling::any_request()) {
        common::client_accepts_any_bytes::<Ling>(steps, request)?;
    }
}

/// The number of single-bit errors in a body of `len` bytes that the checksum misses. The checksum is linear: the
/// number is the same for every body of that length.
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
fn checksum_misses_single_bits_only_in_long_frames() {
    // Eight bits of a CRC-32 detect less than a CRC-8. Values are therefore range-checked, and lengths must match the
    // function.
    for len in 3..=21 {
        assert_eq!(missed_single_bit_errors(len), 0, "{len} bytes");
    }
    for (len, frame) in [(23, "velocities"), (27, "information"), (31, "move")] {
        assert_eq!(missed_single_bit_errors(len), 2, "{frame}");
    }
}

#[test]
fn undocumented_length_is_named() {
    assert_eq!(
        Ling.scan(&[0xAA, 0x06, 0x00, 0xFF], ()),
        Scan::Noise(
            1,
            Reason::Length {
                min: 0,
                max: 64,
                got: 255
            }
        )
    );
}

/// A frame with these bytes after its data.
fn longer(frame: &[u8], extra: &[u8]) -> Vec<u8> {
    let frame = Frame::parse(frame).unwrap();
    let data = [frame.data, extra].concat();
    let mut out = [0; MAX_FRAME];
    let n = Frame { data: &data, ..frame }.encode(&mut out).unwrap();
    out[..n].to_vec()
}

proptest! {
    #[test]
    fn longer_answer_has_documented_fields_and_extra(
        response in response(),
        extra in proptest::collection::vec(any::<u8>(), 0..40),
    ) {
        let documented = common::response_bytes::<Ling>(&response);
        // More readings of servos may complete a follower's.
        let servos = match response {
            Response::Temperatures(PerServo::Leader(_)) => 4,
            Response::Velocities(PerServo::Leader(_)) => 8,
            // A frame has no more.
            Response::Mode(_) => 64 - 52 + 1,
            _ => usize::MAX,
        };
        let extra = &extra[..extra.len().min(servos - 1)];
        let frame = longer(&documented, extra);
        let documented_fields = match response {
            // An Alicia-D sends one more byte at most: the status of another robot is not documented.
            Response::Joints(state) if extra.len() > 1 => Response::Joints(JointState {
                status: MotionStatus::of_answer(state.status.into(), 15 + extra.len() as u8),
                ..state
            }),
            response => response,
        };
        prop_assert_eq!(Ling.parse_response(&frame, ()), Ok(documented_fields));
        prop_assert_eq!(Ling.extra(&frame), extra);
        prop_assert_eq!(Ling.extra(&documented), &[] as &[u8]);
    }

    #[test]
    fn request_has_no_extra_and_one_length(
        request in request(),
        extra in proptest::collection::vec(any::<u8>(), 1..5),
    ) {
        let documented = common::request_bytes::<Ling>(&request);
        prop_assert_eq!(Ling.extra(&documented), &[] as &[u8]);
        prop_assert!(Ling.parse_request(&longer(&documented, &extra)).is_err());
    }
}

#[test]
fn readings_beyond_ten_servos_are_extra() {
    let mut out = [0; MAX_FRAME];
    for (function, of_ten) in [(1, 10), (2, 20)] {
        let data: Vec<u8> = (0..64).collect();
        let frame = Frame {
            command: 6,
            function,
            data: &data,
        };
        let n = frame.encode(&mut out).unwrap();
        assert_is_followers(&Ling.parse_response(&out[..n], ()).unwrap());
        assert_eq!(Ling.extra(&out[..n]), &data[of_ten..]);
    }
}

fn assert_is_followers(response: &Response) {
    let kind = match response {
        Response::Temperatures(celsius) => celsius.kind(),
        Response::Velocities(ticks) => ticks.kind(),
        other => panic!("{other:?}"),
    };
    assert_eq!(kind, Kind::Follower);
}

/// The data of a joint answer with this status.
fn joint_data(status: u8) -> [u8; 15] {
    [1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 1, 0xF4, 0x01, status]
}

#[test]
fn joints_of_another_robot_are_no_pose() {
    for len in 15..=64_u8 {
        let data: Vec<u8> = (0..len).collect();
        let mut out = [0; MAX_FRAME];
        let frame = Frame {
            command: 6,
            function: 0,
            data: &data,
        };
        let n = frame.encode(&mut out).unwrap();
        let Ok(Response::Joints(state)) = Ling.parse_response(&out[..n], ()) else {
            panic!("they are read");
        };
        assert_eq!(state.joints, [0x0100, 0x0302, 0x0504, 0x0706, 0x0908, 0x0B0A]);
        let is_own = len <= 16;
        assert_eq!(state.positions().is_ok(), is_own);
        assert_eq!(state.status == MotionStatus::Other(14), is_own);
        let is_foreign = matches!(state.status.check_motion(), Err(Immovable::Foreign(_)));
        assert_eq!(is_foreign, !is_own);
    }
}

#[test]
fn two_armed_robot_is_named() {
    let frame = include_bytes!("bessica.bin");
    assert_eq!(Ling.scan(frame, ()), Scan::Frame(frame.len()));
    let Ok(Response::Joints(state)) = Ling.parse_response(frame, ()) else {
        panic!("it is read");
    };
    assert_eq!(state.joints[0], 0x0065);
    let name = "not an Alicia-D but a Bessica-D";
    assert_eq!(state.status.to_string(), format!("{name} (33 data bytes)"));
    let reason = state.status.check_motion().unwrap_err();
    assert_eq!(reason.to_string(), format!("the arm is {name} (33 data bytes)"));
    let error = state.positions().unwrap_err();
    assert_eq!(
        error.to_string(),
        format!("{name}: its answer is 33 data bytes, must be 15..=16")
    );
    assert_eq!(state.opening(), Err(error));
}

#[test]
fn motion_needs_torque_and_a_documented_status() {
    for code in 0..=u8::MAX {
        let status = MotionStatus::from(code);
        let expected = match code {
            0x00 | 0xE2 => Err(Immovable::TorqueOff(status)),
            0x01 | 0x10 | 0x11 | 0xE1 => Ok(()),
            other => Err(Immovable::UnknownStatus(other)),
        };
        assert_eq!(status.check_motion(), expected, "{status}");
        assert_eq!(status.is_torque_off(), matches!(expected, Err(Immovable::TorqueOff(_))));
    }
}

#[test]
fn every_motion_status_matches_the_document() {
    for code in 0..=u8::MAX {
        let expected = match code {
            0x00 => MotionStatus::Idle,
            0x01 => MotionStatus::Locked,
            0x10 => MotionStatus::Syncing,
            0x11 => MotionStatus::SyncLocked,
            0xE1 => MotionStatus::Overheating,
            0xE2 => MotionStatus::OverheatProtection,
            other => MotionStatus::Other(other),
        };
        let data = &joint_data(code);
        let mut out = [0; MAX_FRAME];
        let frame = Frame {
            command: 0x06,
            function: 0x00,
            data,
        };
        let n = frame.encode(&mut out).unwrap();
        let response = Ling.parse_response(&out[..n], ());
        let expected = Response::Joints(JointState {
            joints: [1, 2, 3, 4, 5, 0x0106],
            gripper: 500,
            status: expected,
        });
        assert_eq!(response, Ok(expected), "status {code:02X}");
        let mut out = [0; MAX_FRAME];
        Ling.encode_response(&expected, None, &mut out).unwrap();
        assert_eq!(&out[4..19], data, "status {code:02X}");
    }
}
