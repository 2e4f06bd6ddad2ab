//! xArm, and what is in its messages.

use core::hint::black_box;

use armwire::xarm::{
    Command, Direction, Frame, Header, Joint, MAX_FRAME, ProtocolId, Raw, Reply, Request, Response, RotationRadius,
    SerialsText, State, Transactions, VersionText, XArm,
};

use crate::{bytes, client, decoder, device};

pub(crate) fn call_all() {
    let mut transactions = black_box(Transactions::new());
    let header = black_box(Header {
        transaction: transactions.next_id(),
        protocol: ProtocolId::Private,
    });
    let request = Request::Call {
        header,
        command: Command::Reboot,
    };
    let response = Response::Reply {
        header,
        state: State(0),
        reply: Reply::SystemControl(0),
    };
    decoder::call_all::<XArm, MAX_FRAME>(black_box(Direction::Responses));
    client::call_all::<XArm, MAX_FRAME>(request, response);
    device::call_all::<XArm, MAX_FRAME>(response);

    let mut body = [0; 300];
    let body = bytes(&mut body);
    let frame = Frame {
        transaction: black_box(0),
        protocol: black_box(0),
        body,
    };
    black_box(
        frame
            .encode(black_box(Direction::Requests), bytes(&mut [0; 300]))
            .is_ok(),
    );
    black_box(Raw::new(black_box(0), body).is_ok_and(|raw| !black_box(raw).params().is_empty()));
    black_box(black_box(request).eq(&black_box(request)));
    black_box(black_box(Command::Reboot).register());
    black_box(black_box(Reply::empty(black_box(0))).register());
    if let Err(error) = <XArm as armwire::Protocol>::parse_request(black_box(frame)) {
        black_box(error.refusal());
    }

    let mut text = [0; 300];
    let text = str::from_utf8(bytes(&mut text)).unwrap_or_default();
    let version = black_box(VersionText::new(text).unwrap_or(VersionText([0; 40])));
    black_box(version.as_str());
    black_box(
        version
            .version()
            .is_ok_and(|version| black_box(version).firmware_numbers().is_some()),
    );
    let serials = black_box(SerialsText::new(text, text).unwrap_or(SerialsText([0; 40])));
    black_box(serials.arm());
    black_box(serials.control_box());

    let float = black_box(0.0_f32);
    black_box(Joint::new(black_box(0)).is_ok_and(|joint| joint.number() == black_box(0)));
    black_box(RotationRadius::from_metres(float).is_ok_and(|radius| radius.metres() == Ok(float)));
    black_box(black_box(State(0)).contains(black_box(State::ERROR | State::WARNING)));
}
