//! Ling, and the values in its messages.

use core::hint::black_box;

use armwire::ling::{
    ControlMode, ForceFeedback, Frame, Info, JointMask, JointState, Kind, Ling, MAX_FRAME, ModeChange, ModeReply,
    ModeState, MotionStatus, Opening, PerServo, Position, Request, Response, SelfCheck, SerialNumber, Speed, Stroke,
    TemperatureLimit, checksum, mode_change,
};
use armwire::raw::Raw;
use armwire::time::Instant;

use crate::bytes::bytes;
use crate::protocol;

pub(crate) fn call_all() {
    protocol::call_all::<Ling, MAX_FRAME>(Ling, Some(Request::SelfCheck), Response::Stroke(Stroke::Mm50), ());
    protocol::call_correlation::<Raw, MAX_FRAME>(&Raw, ());

    let mut data = [0; 300];
    let data = bytes(&mut data);
    black_box(checksum(data));
    let frame = Frame {
        command: black_box(0),
        function: black_box(0),
        data,
    };
    black_box(frame.encode(bytes(&mut [0; 300])).is_ok());
    black_box(Frame::parse(black_box(data)));

    let float = black_box(0.0_f32);
    let stroke = black_box(Stroke::Mm50);
    let kind = black_box(Kind::Leader);

    black_box(Position::from_radians(float).is_ok_and(|position| position.radians() == float));
    black_box(Position::new(black_box(0)).is_ok_and(|position| position.ticks() == black_box(0)));
    black_box(Speed::from_radians_per_second(float).is_ok_and(|speed| speed.radians_per_second() == float));
    black_box(Speed::for_move(black_box(0)).is_ok());
    black_box(Speed::for_move_radians_per_second(float).is_ok());
    black_box(Speed::new(black_box(0)).is_ok_and(|speed| speed.ticks_per_second() == black_box(0)));
    black_box(Opening::new(black_box(0)).is_ok_and(|opening| opening.per_mille() == black_box(0)));
    black_box(Opening::from_fraction(float).is_ok_and(|opening| opening.fraction() == float));
    black_box(Opening::from_millimetres(float, stroke).is_ok_and(|opening| opening.millimetres(stroke) == float));
    black_box(TemperatureLimit::new(black_box(0)).is_ok_and(|limit| limit.celsius() == black_box(0)));
    black_box(u8::from(MotionStatus::from(black_box(0))));
    black_box(
        MotionStatus::of_answer(black_box(0), black_box(15))
            .check_motion()
            .is_ok(),
    );

    let state = black_box(JointState {
        joints: [0; 6],
        gripper: 0,
        status: MotionStatus::Idle,
    });
    black_box(state.positions().is_ok());
    black_box(state.opening().is_ok());

    let response = black_box(Response::Stroke(stroke));
    black_box((Info::try_from(response).is_ok(), Stroke::try_from(response).is_ok()));
    black_box((
        JointState::try_from(response).is_ok(),
        SelfCheck::try_from(response).is_ok(),
    ));
    black_box((
        PerServo::<u8>::try_from(response).is_ok(),
        PerServo::<u16>::try_from(response).is_ok(),
    ));

    black_box((
        ModeReply::try_from(response).is_ok(),
        ModeState::try_from(response).is_ok(),
        ForceFeedback::try_from(response).is_ok(),
    ));
    black_box(JointMask(black_box(0)).has(black_box(0)));
    let mut change = ModeChange::new(black_box(ControlMode::Current));
    if let Ok(state) = ModeState::try_from(response) {
        change.on_mode(black_box(Instant::ZERO), &state);
    }
    if let Ok(reply) = ModeReply::try_from(response) {
        change.on_reply(&reply);
    }
    black_box(change.poll(black_box(Instant::ZERO)) == mode_change::Output::Wait(Instant::ZERO));

    let serial = black_box(SerialNumber([0; 16]));
    black_box(serial.as_str());
    black_box(serial.kind());

    let readings = black_box(PerServo::Leader([0_u16; 6]));
    black_box(readings.as_slice());
    black_box(readings.kind());
    black_box(kind.servos());

    let check = black_box(SelfCheck(0));
    black_box(check.all_normal(kind));
    black_box(check.faulty(kind).map(u32::from).fold(0, u32::wrapping_add));
}
