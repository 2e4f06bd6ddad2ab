//! xArm: the reply to a request for a radius of rotation, 12 bytes.

use core::hint::black_box;

use armwire::xarm::{
    Command, Direction, Header, Joint, MAX_FRAME, ProtocolId, Reply, Request, Response, RotationRadius, State, XArm,
};
use armwire::{Client, Config, Decoder, Event, Input, Micros, Protocol};

use crate::{CHUNK, FRAMES, decode, ends};

type XArms = Decoder<XArm, MAX_FRAME>;

const LEN: usize = 12;
const HEADER: Header = Header {
    transaction: 1,
    protocol: ProtocolId::Private,
};

pub(crate) fn run() {
    let Ok(joint) = Joint::new(6) else {
        return;
    };
    let radius = Response::Reply {
        header: HEADER,
        state: State::OK,
        reply: Reply::RotationRadius(RotationRadius { millimetres: 76.0 }),
    };
    let mut reply = [0; LEN];
    assert!(XArm::encode_response(&radius, &mut reply) == Ok(LEN));
    let mut clean = [0; LEN * FRAMES];
    for frame in clean.chunks_exact_mut(LEN) {
        frame.copy_from_slice(&reply);
    }
    let decoder = &mut XArms::new();
    let warm = decode(decoder, Direction::Responses, black_box(&reply), CHUNK);
    assert!(warm == [1, 0]);
    ends(count_xarm_decode(black_box(decoder), black_box(&reply)), &true);
    ends(
        count_xarm_decode_chunks(black_box(decoder), black_box(&clean)),
        &[FRAMES, 0],
    );
    ends(
        count_xarm_decode_bytes(black_box(decoder), black_box(&clean)),
        &[FRAMES, 0],
    );

    let request = Request::Call {
        header: HEADER,
        command: Command::ReadRotationRadius(joint),
    };
    ends(
        count_xarm_encode(black_box(&request), black_box(&mut [0; MAX_FRAME])),
        &8,
    );
    let client = &mut Client::new(Config::DEFAULT);
    let answer = Some(Event::Answer(radius));
    assert!(call(black_box(client), request, black_box(&reply)) == answer);
    ends(
        count_xarm_call(black_box(client), black_box(&request), black_box(&reply)),
        &true,
    );
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_xarm_decode(decoder: &mut XArms, frame: &[u8]) -> bool {
    black_box(decoder.decode(&mut &*frame, Direction::Responses)).is_some_and(|next| next.is_ok())
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_xarm_decode_chunks(decoder: &mut XArms, line: &[u8]) -> [usize; 2] {
    decode(decoder, Direction::Responses, line, CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_xarm_decode_bytes(decoder: &mut XArms, line: &[u8]) -> [usize; 2] {
    decode(decoder, Direction::Responses, line, 1)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_xarm_encode(request: &Request, out: &mut [u8]) -> usize {
    XArm::encode_request(request, out).unwrap_or(0)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_xarm_call(client: &mut Client<XArm, MAX_FRAME>, request: &Request, line: &[u8]) -> bool {
    matches!(black_box(&call(client, *request, line)), Some(Event::Answer(_)))
}

/// Asks, and hears the reply.
#[inline(always)]
fn call(client: &mut Client<XArm, MAX_FRAME>, request: Request, line: &[u8]) -> Option<Event<XArm>> {
    client.submit(request).ok()?;
    let n = client.poll_transmit(Micros(0))?.len();
    let _ = client.transmitted(Micros(0), n);
    client.handle(Micros(350), &mut Input::Bytes(line))
}
