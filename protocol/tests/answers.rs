//! Responses as the values of answers.

use armwire::alpha1::{self, FirmwareVersion, Outcome, ServoId, ServoResponse, ServoStates, Text};
use armwire::ling::{
    self, ControlMode, ForceFeedback, Info, JointForce, JointMask, JointState, ModeReply, ModeResult, ModeState,
    MotionStatus, PerServo, SelfCheck, SerialNumber, Stroke, Version,
};
use armwire::xarm::{
    self, Answer, Raw, Register, Reply, RotationRadius, SerialsText, State, TorqueSource, VersionText,
};

/// The numbers of the responses, from 0, that have this value.
fn taken<R: Copy, T: TryFrom<R>>(responses: &[R]) -> Vec<usize> {
    let numbered = responses.iter().enumerate();
    numbered
        .filter(|(_, response)| T::try_from(**response).is_ok())
        .map(|(nth, _)| nth)
        .collect()
}

#[test]
fn ling_value_is_taken_from_its_answer_only() {
    let responses = [
        ling::Response::Info(Info {
            serial: SerialNumber([b'0'; 16]),
            hardware: Version(610),
            firmware: Version(610),
        }),
        ling::Response::Stroke(Stroke::Mm50),
        ling::Response::Joints(JointState {
            joints: [2048; 6],
            gripper: 0,
            status: MotionStatus::Idle,
        }),
        ling::Response::Temperatures(PerServo::Leader([35; 6])),
        ling::Response::Velocities(PerServo::Leader([0; 6])),
        ling::Response::SelfCheck(SelfCheck(0)),
        ling::Response::ModeReply(ModeReply {
            requested: 1,
            result: ModeResult::Accepted,
        }),
        ling::Response::Mode(ModeState {
            mode: ControlMode::Current,
            blocked: JointMask(0),
            valid: JointMask(0),
            joints: [JointForce::default(); 6],
        }),
        ling::Response::ForceFeedback(ForceFeedback::default()),
    ];
    assert_eq!(taken::<_, Info>(&responses), [0]);
    assert_eq!(taken::<_, Stroke>(&responses), [1]);
    assert_eq!(taken::<_, JointState>(&responses), [2]);
    assert_eq!(taken::<_, PerServo<u8>>(&responses), [3]);
    assert_eq!(taken::<_, PerServo<u16>>(&responses), [4]);
    assert_eq!(taken::<_, SelfCheck>(&responses), [5]);
    assert_eq!(taken::<_, ModeReply>(&responses), [6]);
    assert_eq!(taken::<_, ModeState>(&responses), [7]);
    assert_eq!(taken::<_, ForceFeedback>(&responses), [8]);
    let other = Stroke::try_from(responses[5]).unwrap_err();
    assert_eq!(other.got, responses[5]);
}

#[test]
fn alpha1_value_is_taken_from_its_answer_only() {
    let (servo, outcome) = (ServoId::MAX, Outcome::Failure);
    let responses = [
        alpha1::Response::HardwareVersion(Text::new(b"Alpha1").unwrap()),
        alpha1::Response::ServoStates(ServoStates::from_bits(1)),
        alpha1::Response::FirmwareVersion(FirmwareVersion {
            outcome,
            text: [b'0'; 10],
        }),
        alpha1::Response::Stopped(outcome),
        alpha1::Response::Acted(outcome),
        alpha1::Response::OffsetTool(outcome),
        alpha1::Response::UsbType(outcome),
        alpha1::Response::Playing(outcome),
        alpha1::Response::Servo(ServoResponse::IdChanged { servo, outcome, was: 1 }),
        alpha1::Response::Servo(ServoResponse::OffsetSet { servo, outcome }),
        alpha1::Response::Servo(ServoResponse::Acknowledged(servo)),
    ];
    assert_eq!(taken::<_, Text<'_>>(&responses), [0]);
    assert_eq!(taken::<_, ServoStates>(&responses), [1]);
    assert_eq!(taken::<_, FirmwareVersion>(&responses), [2]);
    assert_eq!(taken::<_, Outcome>(&responses), [3, 4, 5, 6, 7, 8, 9]);
    assert_eq!(taken::<_, ServoResponse>(&responses), [8, 9, 10]);
}

#[test]
fn xarm_value_is_taken_from_its_reply_only() {
    let replies = [
        Reply::Version(VersionText(b"v1")),
        Reply::Serials(SerialsText(b"1")),
        Reply::TorqueSource(TorqueSource::Current),
        Reply::RotationRadius(RotationRadius { millimetres: 76.0 }),
        Reply::Raw(Raw::new(19, &[1]).unwrap()),
        Reply::Empty(Register::SystemControl),
        Reply::SystemControl(1),
    ];
    assert_eq!(taken::<_, VersionText<'_>>(&replies), [0]);
    assert_eq!(taken::<_, SerialsText<'_>>(&replies), [1]);
    assert_eq!(taken::<_, TorqueSource>(&replies), [2]);
    assert_eq!(taken::<_, RotationRadius>(&replies), [3]);
    assert_eq!(taken::<_, Raw<'_>>(&replies), [4]);
    assert_eq!(taken::<_, ()>(&replies), [5, 6]);
    let answer = |state| xarm::Response::Reply {
        state,
        reply: replies[5],
    };
    let responses = [
        answer(State::OK),
        answer(State::ERROR),
        answer(State::INVALID),
        xarm::Response::Heartbeat,
    ];
    assert_eq!(taken::<_, Answer<()>>(&responses), [0, 1]);
    assert_eq!(taken::<_, Answer<TorqueSource>>(&responses), [] as [usize; 0]);
}
