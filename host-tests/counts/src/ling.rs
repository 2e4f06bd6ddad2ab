//! Ling: the reply to a request for the joints, 21 bytes.

use core::hint::black_box;

use armwire::ling::{
    GripperSpeed, JointState, Ling, MAX_FRAME, MotionStatus, Move, Opening, Position, Request, Response, Speed,
    checksum,
};
use armwire::{Client, Config, Decoder, Event, Input, Micros, Protocol};

use crate::{CHUNK, FRAMES, HOSTILE, decode, done, ends, repeated};

type Lings = Decoder<Ling, MAX_FRAME>;

/// Joints 2048, gripper 500, idle.
const REPLY: [u8; LEN] = [
    0xAA, 0x06, 0x00, 0x0F, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0xF4, 0x01, 0x00,
    0x00, 0xFF,
];
const LEN: usize = 21;

/// The header of that reply, nested in itself.
static NESTED: [u8; HOSTILE] = repeated(&REPLY_HEADER);
const REPLY_HEADER: [u8; 4] = [0xAA, 0x06, 0x00, 0x0F];
/// Nothing but the first byte of a header.
static HEADERS: [u8; HOSTILE] = repeated(&[0xAA]);
/// Every fourth byte begins what has the greatest length and a right end mark, and so a checksum to be calculated.
static LENGTHS: [u8; HOSTILE] = repeated(&[0xAA, 0xFF, 0x00, 64]);
/// As many such beginnings as a stream can have: each takes three bytes of its own, and the end mark can be shared.
static WORST: [u8; HOSTILE] = repeated(&[0xAA, 0xAA, 0xAA, 64, 63, 62, 0xFF]);

/// Beginnings that all end with the last byte, which makes all of them be looked at, and none be a frame.
const CASCADE: [u8; MAX_FRAME] = cascade();

const fn cascade() -> [u8; MAX_FRAME] {
    let mut bytes = [0; MAX_FRAME];
    let mut i = 0;
    while i < MAX_FRAME {
        bytes[i] = if i % 6 < 3 { 0xAA } else { 67 - i as u8 % 68 };
        i += 1;
    }
    bytes[MAX_FRAME - 1] = 0xFF;
    bytes
}

pub(crate) fn run() {
    let joints = Response::Joints(JointState {
        joints: [2048; 6],
        gripper: 500,
        status: MotionStatus::Idle,
    });
    let mut reply = REPLY;
    assert!(Ling::encode_response(&joints, &mut reply) == Ok(LEN));
    let mut clean = [0; LEN * FRAMES];
    for frame in clean.chunks_exact_mut(LEN) {
        frame.copy_from_slice(&reply);
    }
    let decoder = &mut Lings::new();
    let warm = decode(decoder, (), black_box(&reply), CHUNK);
    assert!(warm == [1, 0]);

    ends(count_ling_checksum(black_box(&reply[1..19])), &reply[19]);
    ends(count_ling_decode(black_box(decoder), black_box(&reply)), &true);
    ends(
        count_ling_decode_chunks(black_box(decoder), black_box(&clean)),
        &[FRAMES, 0],
    );
    ends(
        count_ling_decode_bytes(black_box(decoder), black_box(&clean)),
        &[FRAMES, 0],
    );

    for hostile in [
        count_ling_nested,
        count_ling_headers,
        count_ling_lengths,
        count_ling_worst,
    ] {
        // Which stream it is, the function says.
        let [frames, _] = hostile(black_box(&mut Lings::new()));
        done();
        assert!(frames == 0);
    }
    let [frames, _] = count_ling_worst_bytes(black_box(&mut Lings::new()));
    done();
    assert!(frames == 0);

    let decoder = &mut Lings::new();
    let (last, before) = CASCADE.split_last().unwrap_or((&0, &[]));
    let held = decode(decoder, (), black_box(before), CHUNK);
    assert!(held == [0, 0]);
    let [frames, _] = count_ling_worst_byte(black_box(decoder), black_box(*last));
    done();
    assert!(frames == 0 && decoder.pending() == 3);

    let target = Move {
        joints: [(Position::CENTRE, Speed::new(1000).unwrap_or(Speed::MAX)); 6],
        gripper: (Opening::CLOSED, GripperSpeed(1000)),
    };
    ends(
        count_ling_encode(black_box(&Request::Move(target)), black_box(&mut [0; MAX_FRAME])),
        &34,
    );

    let client = &mut Client::new(Config::DEFAULT);
    let answer = Some(Event::Answer(joints));
    assert!(call(black_box(client), black_box(&reply)) == answer);
    ends(count_ling_call(black_box(client), black_box(&reply)), &true);
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_checksum(body: &[u8]) -> u8 {
    checksum(body)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_decode(decoder: &mut Lings, frame: &[u8]) -> bool {
    black_box(decoder.decode(&mut &*frame, ())).is_some_and(|next| next.is_ok())
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_decode_chunks(decoder: &mut Lings, line: &[u8]) -> [usize; 2] {
    decode(decoder, (), line, CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_decode_bytes(decoder: &mut Lings, line: &[u8]) -> [usize; 2] {
    decode(decoder, (), line, 1)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_nested(decoder: &mut Lings) -> [usize; 2] {
    decode(decoder, (), black_box(&NESTED), CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_headers(decoder: &mut Lings) -> [usize; 2] {
    decode(decoder, (), black_box(&HEADERS), CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_lengths(decoder: &mut Lings) -> [usize; 2] {
    decode(decoder, (), black_box(&LENGTHS), CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_worst(decoder: &mut Lings) -> [usize; 2] {
    decode(decoder, (), black_box(&WORST), CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_worst_bytes(decoder: &mut Lings) -> [usize; 2] {
    decode(decoder, (), black_box(&WORST), 1)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_worst_byte(decoder: &mut Lings, last: u8) -> [usize; 2] {
    decode(decoder, (), &[last], CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_encode(request: &Request, out: &mut [u8]) -> usize {
    Ling::encode_request(request, out).unwrap_or(0)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_ling_call(client: &mut Client<Ling, MAX_FRAME>, line: &[u8]) -> bool {
    matches!(black_box(&call(client, line)), Some(Event::Answer(_)))
}

/// Asks for the joints, and hears the reply.
#[inline(always)]
fn call(client: &mut Client<Ling, MAX_FRAME>, line: &[u8]) -> Option<Event<Ling>> {
    client.submit(Request::ReadJoints).ok()?;
    let n = client.poll_transmit(Micros(0))?.len();
    let _ = client.transmitted(Micros(0), n);
    client.handle(Micros(350), &mut Input::Bytes(line))
}
