//! Alpha1, and the values in its messages.

use core::hint::black_box;
use core::time::Duration;

use armwire::alpha1::{
    Action, Address, Alpha1, Angle, Expect, FirmwareVersion, Frame, Interval, MAX_FRAME, MoveTime, Offset, Outcome,
    Request, Response, ServoId, ServoResponse, ServoStates, Text, checksum, hid,
};

use crate::bytes::bytes;
use crate::protocol;

pub(crate) fn call_all() {
    let mut text = [0; 300];
    let text = bytes(&mut text);
    let action = Action {
        angles: [None; 20],
        time: MoveTime::new(0),
        interval: Interval::new(0),
    };
    let response = black_box(Response::Playing(Outcome::Success));
    black_box((
        Text::try_from(response).is_ok(),
        ServoStates::try_from(response).is_ok(),
    ));
    black_box((
        FirmwareVersion::try_from(response).is_ok(),
        Outcome::try_from(response).is_ok(),
    ));
    black_box(ServoResponse::try_from(response).is_ok_and(|response| response.outcome().1.is_success()));
    protocol::call_all::<Alpha1, MAX_FRAME>(Alpha1, Some(Request::Act(action)), response, Expect::Requests);
    black_box(hid::reports(text).map(black_box).count());
    black_box(Frame::parse(text));
    black_box(checksum(text));

    let duration = black_box(Duration::ZERO);
    black_box(MoveTime::from_duration(duration).is_ok_and(|time| time.duration() == duration));
    black_box(black_box(MoveTime::new(black_box(0))).units());
    black_box(Interval::from_duration(duration).is_ok_and(|interval| interval.duration() == duration));
    black_box(black_box(Interval::new(black_box(0))).units());
    black_box(Angle::new(black_box(0)).is_ok_and(|angle| angle.degrees() == black_box(None)));
    black_box(ServoId::new(black_box(0)).is_ok_and(|servo| Address::One(servo).id() == black_box(0)));
    black_box(Offset::new(black_box(0)).is_ok_and(|offset| offset.degrees() == offset.thirds().into()));
    black_box(Text::new(text).is_ok_and(|text| black_box(text).as_str().is_some() || text.as_bytes().is_empty()));
    black_box(black_box(Outcome::Success).is_success());

    let states = black_box(ServoStates::from_bits(black_box(0)));
    black_box(states.bits());
    black_box(states.running().map(u32::from).fold(0, u32::wrapping_add));
}
