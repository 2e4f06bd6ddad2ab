//! Alpha1: the reply of a servo to a request for its offset, 10 bytes.

use core::hint::black_box;

use armwire::alpha1::{
    Alpha1, Expect, MAX_FRAME, Outcome, Request, Response, ServoId, ServoRequest, ServoResponse, checksum,
};
use armwire::{Client, Config, Decoder, Event, Input, Micros, Protocol};

use crate::{CHUNK, FRAMES, HOSTILE, decode, done, ends, repeated};

type Alphas = Decoder<Alpha1, MAX_FRAME>;

const LEN: usize = 10;
const EXPECT: Expect = Expect::Responses(None);

/// A header of a frame whose length is known, nested in itself.
static NESTED: [u8; HOSTILE] = repeated(&[0xFA, 0xAF]);
/// Nothing but a byte that begins a header.
static HEADERS: [u8; HOSTILE] = repeated(&[0xFA]);
/// Every fourth byte begins what has the greatest length and a right end mark.
static LENGTHS: [u8; HOSTILE] = repeated(&[0xF1, 0x1F, 60, 0xED]);

pub(crate) fn run() {
    let servo = ServoId::MAX;
    let request = Request::Servo(ServoRequest::ReadOffset(servo));
    let offset = Response::Servo(ServoResponse::Offset {
        servo,
        outcome: Outcome::Success,
        thirds: 3,
    });
    let mut reply = [0; LEN];
    assert!(Alpha1::encode_response(&offset, &mut reply) == Ok(LEN));
    let mut clean = [0; LEN * FRAMES];
    for frame in clean.chunks_exact_mut(LEN) {
        frame.copy_from_slice(&reply);
    }
    let decoder = &mut Alphas::new();
    let warm = decode(decoder, EXPECT, black_box(&reply), CHUNK);
    assert!(warm == [1, 0]);
    ends(count_alpha1_checksum(black_box(&reply[2..8])), &reply[8]);
    ends(count_alpha1_decode(black_box(decoder), black_box(&reply)), &true);
    ends(
        count_alpha1_decode_chunks(black_box(decoder), black_box(&clean)),
        &[FRAMES, 0],
    );
    ends(
        count_alpha1_decode_bytes(black_box(decoder), black_box(&clean)),
        &[FRAMES, 0],
    );

    for hostile in [count_alpha1_nested, count_alpha1_headers, count_alpha1_lengths] {
        let [frames, _] = hostile(black_box(&mut Alphas::new()));
        done();
        assert!(frames == 0);
    }

    ends(
        count_alpha1_encode(black_box(&request), black_box(&mut [0; MAX_FRAME])),
        &LEN,
    );
    let client = &mut Client::new(Config::DEFAULT);
    let answer = Some(Event::Answer(offset));
    assert!(call(black_box(client), request, black_box(&reply)) == answer);
    ends(
        count_alpha1_call(black_box(client), black_box(&request), black_box(&reply)),
        &true,
    );
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_checksum(body: &[u8]) -> u8 {
    checksum(body)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_decode(decoder: &mut Alphas, frame: &[u8]) -> bool {
    black_box(decoder.decode(&mut &*frame, EXPECT)).is_some_and(|next| next.is_ok())
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_decode_chunks(decoder: &mut Alphas, line: &[u8]) -> [usize; 2] {
    decode(decoder, EXPECT, line, CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_decode_bytes(decoder: &mut Alphas, line: &[u8]) -> [usize; 2] {
    decode(decoder, EXPECT, line, 1)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_nested(decoder: &mut Alphas) -> [usize; 2] {
    decode(decoder, EXPECT, black_box(&NESTED), CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_headers(decoder: &mut Alphas) -> [usize; 2] {
    decode(decoder, EXPECT, black_box(&HEADERS), CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_lengths(decoder: &mut Alphas) -> [usize; 2] {
    decode(decoder, EXPECT, black_box(&LENGTHS), CHUNK)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_encode(request: &Request, out: &mut [u8]) -> usize {
    Alpha1::encode_request(request, out).unwrap_or(0)
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_alpha1_call(client: &mut Client<Alpha1, MAX_FRAME>, request: &Request, line: &[u8]) -> bool {
    matches!(black_box(&call(client, *request, line)), Some(Event::Answer(_)))
}

/// Asks, and hears the reply.
#[inline(always)]
fn call(client: &mut Client<Alpha1, MAX_FRAME>, request: Request, line: &[u8]) -> Option<Event<Alpha1>> {
    client.submit(request).ok()?;
    let n = client.poll_transmit(Micros(0))?.len();
    let _ = client.transmitted(Micros(0), n);
    client.handle(Micros(350), &mut Input::Bytes(line))
}
