//! xArm, and the values in its messages.

use core::hint::black_box;

use armwire::messages::Messages;
use armwire::xarm::{
    Answer, Direction, Frame, Joint, MAX_FRAME, Raw, Reply, Request, Response, RotationRadius, SerialsText, State,
    TorqueSource, VersionText, XArm,
};

use crate::bytes::bytes;
use crate::protocol;

pub(crate) fn call_all() {
    let arm = black_box(XArm::PRIVATE);
    let response = Response::Reply {
        state: State(0),
        reply: Reply::SystemControl(0),
    };
    protocol::call_all::<XArm, MAX_FRAME>(arm, Some(Request::Reboot), response, Direction::Responses);

    let mut body = [0; 300];
    let body = bytes(&mut body);
    black_box(Frame::parse(body));
    black_box(Raw::new(black_box(0), body).is_ok_and(|raw| !black_box(raw).params().is_empty()));
    black_box(black_box(Request::Reboot).eq(&black_box(Request::Reboot)));
    black_box(black_box(Request::Reboot).register());
    black_box(black_box(Reply::empty(black_box(0))).register());
    let response = black_box(response);
    black_box((
        Answer::<VersionText<'_>>::try_from(response).is_ok(),
        Answer::<SerialsText<'_>>::try_from(response).is_ok(),
    ));
    black_box((
        Answer::<RotationRadius>::try_from(response).is_ok(),
        Answer::<TorqueSource>::try_from(response).is_ok(),
    ));
    black_box((
        Answer::<Raw<'_>>::try_from(response).is_ok(),
        Answer::<()>::try_from(response).is_ok(),
    ));
    if let Err(error) = arm.parse_request(body) {
        black_box(Response::refusal(&error));
    }

    let mut text = [0; 300];
    let text = bytes(&mut text);
    let version = black_box(VersionText(text));
    black_box(version.as_str());
    black_box(
        version
            .version()
            .is_ok_and(|version| black_box(version).firmware_numbers().is_some()),
    );
    let serials = black_box(SerialsText(text));
    black_box(serials.arm());
    black_box(serials.control_box());
    let text = str::from_utf8(text).unwrap_or_default();
    black_box(VersionText::encode(text).is_ok());
    black_box(SerialsText::encode(text, text).is_ok());

    let float = black_box(0.0_f32);
    black_box(Joint::new(black_box(0)).is_ok_and(|joint| joint.number() == black_box(0)));
    black_box(RotationRadius::from_metres(float).is_ok_and(|radius| radius.metres() == Ok(float)));
    black_box(black_box(State(0)).contains(black_box(State::ERROR | State::WARNING)));
}
