//! An answer with more bytes than documented, to every request of every protocol: the documented fields stay.

use std::fmt::Display;

use armwire::alpha1::{
    self, Alpha1, FirmwareVersion, Outcome, ServoId, ServoRequest, ServoResponse, ServoStates, Text,
};
use armwire::ling::{
    self, ControlMode, ForceFeedback, Info, JointForce, JointMask, JointState, Ling, ModeReply, ModeResult, ModeState,
    MotionStatus, PerServo, SelfCheck, SerialNumber, Stroke, Version,
};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::xarm::{self, Joint, Register, Reply, RotationRadius, SerialsText, State, TorqueSource, VersionText};
use armwire::{Client, Config, Event, Output};
use proptest::collection::vec;
use proptest::prelude::*;

/// Fits every frame.
const ROOM: usize = 260;

/// The answer that a client takes for its request, as text without what is not documented, and its extra bytes.
fn taken<P: Messages + Default>(
    request: &P::Request<'_>,
    response: &P::Response<'_>,
    longer: impl Fn(Vec<u8>) -> Vec<u8>,
) -> Option<(String, Vec<u8>)>
where
    for<'a> P::Response<'a>: Display,
{
    let mut client = Client::<P, ROOM>::new(P::default(), Config::DEFAULT);
    client.submit(request).unwrap();
    let sent = loop {
        match client.poll(Instant::ZERO) {
            Output::Receive => client.received(Instant::ZERO, 0).unwrap(),
            Output::Transmit(bytes) => {
                let bytes = bytes.to_vec();
                client.transmitted(Instant::ZERO, bytes.len()).unwrap();
                break bytes;
            }
            output => panic!("{output:?}"),
        }
    };
    let mut out = [0; ROOM];
    let to = P::default().request(&sent).map(|info| info.key);
    let n = P::default().encode_response(response, to, &mut out).unwrap();
    let answer = longer(out[..n].to_vec());
    assert!(client.receive(Instant::ZERO, &answer).is_empty());
    match client.poll(Instant::ZERO) {
        Output::Event(Event::Answer(response)) => {
            let text = response.to_string();
            Some((text, P::default().extra(client.frame()).to_vec()))
        }
        _ => None,
    }
}

fn ling_exchanges() -> Vec<(ling::Request, ling::Response)> {
    use ling::{Request, Response};
    vec![
        (
            Request::ReadInfo,
            Response::Info(Info {
                serial: SerialNumber(*b"ADFS251205123456"),
                hardware: Version(610),
                firmware: Version(603),
            }),
        ),
        (Request::ReadStroke, Response::Stroke(Stroke::Mm100)),
        (
            Request::ReadJoints,
            Response::Joints(JointState {
                joints: [2048, 1, 2, 3, 4, 4095],
                gripper: 500,
                status: MotionStatus::Locked,
            }),
        ),
        (
            Request::ReadTemperatures,
            Response::Temperatures(PerServo::Leader([35; 6])),
        ),
        (
            Request::ReadTemperatures,
            Response::Temperatures(PerServo::Follower([35; 10])),
        ),
        (Request::ReadVelocities, Response::Velocities(PerServo::Leader([7; 6]))),
        (
            Request::ReadVelocities,
            Response::Velocities(PerServo::Follower([7; 10])),
        ),
        (Request::SelfCheck, Response::SelfCheck(SelfCheck(0x03FF))),
        (
            Request::SetMode(ControlMode::Current),
            Response::ModeReply(ModeReply {
                requested: 1,
                result: ModeResult::Accepted,
            }),
        ),
        (
            Request::ReadMode,
            Response::Mode(ModeState {
                mode: ControlMode::Current,
                blocked: JointMask(0b00_0110),
                valid: JointMask(0b11_1111),
                joints: [JointForce::default(); 6],
            }),
        ),
        (
            Request::SetForceFeedback(true),
            Response::ForceFeedback(ForceFeedback::default()),
        ),
        (
            Request::ReadForceFeedback,
            Response::ForceFeedback(ForceFeedback::default()),
        ),
        // The other requests have no documented answer.
    ]
}

/// More bytes that are not documented. A leader's answer that is long enough is a follower's, and one with joints that is
/// not an Alicia-D's, without a status: they have fewer.
fn ling_longer(response: &ling::Response, frame: &[u8], extra: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let max = match response {
        ling::Response::Joints(_) => 1,
        ling::Response::Temperatures(PerServo::Leader(_)) => 3,
        ling::Response::Velocities(PerServo::Leader(_)) => 7,
        ling::Response::Mode(_) => ling::MAX_DATA - 52,
        _ => extra.len(),
    };
    let extra = &extra[..extra.len().min(max)];
    let frame = ling::Frame::parse(frame).unwrap();
    let data = [frame.data, extra].concat();
    let mut out = [0; ROOM];
    let n = ling::Frame { data: &data, ..frame }.encode(&mut out).unwrap();
    (out[..n].to_vec(), extra.to_vec())
}

fn xarm_exchanges() -> Vec<(xarm::Request<'static>, Reply<'static>)> {
    use xarm::Request;
    // Texts end with a NUL; what follows is not part of them.
    let version = VersionText(b"6,6,XI1202,AC1302,v1.12.10\0");
    let serials = SerialsText(b"XI120204201B02\0AC130202B02L02\n\0");
    let radius = RotationRadius { millimetres: 76.0 };
    vec![
        (Request::ReadVersion, Reply::Version(version)),
        (Request::ReadSerials, Reply::Serials(serials)),
        (Request::ReloadDynamics, Reply::Empty(Register::ReloadDynamics)),
        (Request::ReadTorqueSource, Reply::TorqueSource(TorqueSource::Current)),
        (
            Request::ReadRotationRadius(Joint::new(6).unwrap()),
            Reply::RotationRadius(radius),
        ),
        (Request::Shutdown, Reply::SystemControl(1)),
        (Request::Reboot, Reply::SystemControl(1)),
        // A raw register has no documented fields, and a heartbeat no answer. The shorter answer of register 10 is
        // in a test of its own.
    ]
}

fn xarm_longer(mut frame: Vec<u8>, extra: &[u8]) -> Vec<u8> {
    frame.extend(extra);
    let len = (frame.len() - xarm::HEADER) as u16;
    frame[4..xarm::HEADER].copy_from_slice(&len.to_be_bytes());
    frame
}

fn alpha1_exchanges() -> Vec<(alpha1::Request<'static>, alpha1::Response<'static>)> {
    use alpha1::{Action, Address, Angle, Interval, Led, MoveTime, Offset, OffsetTool, Request, Response, UsbType};
    let outcome = Outcome::Success;
    let servo = ServoId::new(3).unwrap();
    let (to, time, interval) = (Address::One(servo), MoveTime::new(50), Interval::new(60));
    let action = Action {
        angles: [None; 20],
        time,
        interval,
    };
    let text = *b"2015121519";
    let angle = Angle::new(90).unwrap();
    let robot = [
        (
            Request::ReadHardwareVersion,
            Response::HardwareVersion(Text::new(b"Alpha1_V2.0").unwrap()),
        ),
        (
            Request::ReadServoStates,
            Response::ServoStates(ServoStates::from_bits(0x8005)),
        ),
        (Request::Stop, Response::Stopped(outcome)),
        (
            Request::ReadFirmwareVersion,
            Response::FirmwareVersion(FirmwareVersion { outcome, text }),
        ),
        (Request::Act(action), Response::Acted(outcome)),
        (
            Request::SetOffsetTool(OffsetTool::Connect),
            Response::OffsetTool(outcome),
        ),
        (Request::SetUsbType(UsbType::Hid), Response::UsbType(outcome)),
        (Request::Play(Text::new(b"dance").unwrap()), Response::Playing(outcome)),
    ];
    let acknowledged = ServoResponse::Acknowledged(servo);
    let (lock, version) = (interval, [0, 1, 2, 3]);
    let servos = [
        (ServoRequest::Move { to, angle, time, lock }, acknowledged),
        (ServoRequest::Release(to), acknowledged),
        (ServoRequest::SetLed { to, led: Led(1) }, acknowledged),
        (
            ServoRequest::ReadAngles(servo),
            ServoResponse::Angles {
                servo,
                outcome,
                target: 91,
                actual: 90,
            },
        ),
        (
            ServoRequest::ChangeId { from: servo, to: servo },
            ServoResponse::IdChanged { servo, outcome, was: 3 },
        ),
        (
            ServoRequest::SetOffset(servo, Offset::new(-10).unwrap()),
            ServoResponse::OffsetSet { servo, outcome },
        ),
        (
            ServoRequest::ReadOffset(servo),
            ServoResponse::Offset {
                servo,
                outcome,
                thirds: -10,
            },
        ),
        (
            ServoRequest::ReadVersion(servo),
            ServoResponse::Version {
                servo,
                outcome,
                version,
            },
        ),
    ];
    let servos = servos.map(|(request, response)| (Request::Servo(request), Response::Servo(response)));
    robot.into_iter().chain(servos).collect()
}

proptest! {
    #[test]
    fn longer_answer_keeps_its_documented_fields(extra in vec(any::<u8>(), 0..40)) {
        for (request, response) in ling_exchanges() {
            let documented = response.to_string();
            let mut out = [0; ROOM];
            let n = Ling.encode_response(&response, None, &mut out).unwrap();
            let (frame, extra) = ling_longer(&response, &out[..n], &extra);
            let taken = taken::<Ling>(&request, &response, |_| frame.clone());
            prop_assert_eq!(taken, Some((documented, extra)));
        }
        for (request, reply) in xarm_exchanges() {
            let response = xarm::Response::Reply { state: State::OK, reply };
            let kept = match reply {
                Reply::Version(_) | Reply::Serials(_) => vec![],
                _ => extra.clone(),
            };
            let taken = taken::<xarm::XArm>(&request, &response, |frame| xarm_longer(frame, &extra));
            prop_assert_eq!(taken, Some((response.to_string(), kept)));
        }
        // An Alpha1's frame has no length: the bytes that follow are outside of it.
        for (request, response) in alpha1_exchanges() {
            let taken = taken::<Alpha1>(&request, &response, |frame| [&frame, &extra[..]].concat());
            prop_assert_eq!(taken, Some((response.to_string(), vec![])));
        }
    }
}

/// Its number is not documented, and means nothing to a caller.
#[test]
fn shutdown_with_any_parameters_is_accepted() {
    for params in 0..=8 {
        let frame = xarm_longer(vec![0, 1, 0, 2, 0, 2, 10, 0], &vec![1; params]);
        let response = xarm::XArm::PRIVATE.parse_response(&frame, xarm::Direction::Responses);
        let answer = xarm::Answer::<()>::try_from(response.unwrap()).unwrap();
        assert_eq!(answer.state, State::OK);
    }
}
