//! A request and its reply for each protocol, and the uses of armwire that are counted and timed.
#![no_std]

use core::hint::black_box;

use armwire::decoder::{Decoder, Kind};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::{Client, Config, Event, Output};

/// A request of a protocol whose longest frame has `N` bytes, and the arm's reply to it.
pub struct Arm<M: Messages, const N: usize> {
    /// The protocol.
    pub messages: M,
    /// The request.
    pub request: M::Request<'static>,
    /// The host's expectation once it has sent the request.
    pub expect: M::Expect,
    /// The reply as it is on the line.
    pub reply: &'static [u8],
}

/// Ling: all joints, 21 bytes.
#[cfg(feature = "ling")]
pub const LING: Arm<armwire::ling::Ling, { armwire::ling::MAX_FRAME }> = Arm {
    messages: armwire::ling::Ling,
    request: armwire::ling::Request::ReadJoints,
    expect: (),
    reply: b"\xAA\x06\x00\x0F\x00\x08\x00\x08\x00\x08\x00\x08\x00\x08\x00\x08\xF4\x01\x00\xB4\xFF",
};

/// xArm: a register of 13 bytes, with which the frame has 21.
#[cfg(feature = "xarm")]
pub fn xarm() -> Arm<armwire::xarm::XArm, { armwire::xarm::MAX_FRAME }> {
    use armwire::xarm::{Direction, Raw, Request, XArm};
    Arm {
        messages: XArm::PRIVATE,
        request: Request::Raw(Raw::new(42, &[]).expect("no command of another type has this number")),
        expect: Direction::Responses,
        reply: b"\x00\x01\x00\x02\x00\x0F\x2A\x00\x07\x07\x07\x07\x07\x07\x07\x07\x07\x07\x07\x07\x07",
    }
}

/// Alpha1: the version of the firmware, 15 bytes, the longest answer of a fixed length.
#[cfg(feature = "alpha1")]
pub const ALPHA1: Arm<armwire::alpha1::Alpha1, { armwire::alpha1::MAX_FRAME }> = Arm {
    messages: armwire::alpha1::Alpha1,
    request: armwire::alpha1::Request::ReadFirmwareVersion,
    expect: armwire::alpha1::Expect::Responses(None),
    reply: b"\xF5\x5F\xAA2016010100\x95\xED",
};

impl<M: Messages + Copy, const N: usize> Arm<M, N> {
    /// A decoder without bytes.
    pub fn decoder(&self) -> Decoder<M, N> {
        Decoder::new()
    }

    /// A client that waits for nothing.
    pub fn client(&self) -> Client<M, N> {
        Client::new(self.messages, Config::DEFAULT)
    }

    /// Puts the reply into the decoder's space, as DMA or a port does.
    pub fn fill(&self, decoder: &mut Decoder<M, N>) {
        decoder.space()[..self.reply.len()].copy_from_slice(self.reply);
    }

    /// Decodes the reply in the decoder's buffer. Returns true for a frame.
    #[inline]
    pub fn reply(&self, decoder: &mut Decoder<M, N>) -> bool {
        black_box(decoder.space());
        let is_there = decoder.commit(self.reply.len()).is_ok();
        let item = decoder.next(&self.messages, self.expect);
        is_there && item.is_some_and(|item| item.kind == Kind::Frame && !black_box(item.bytes).is_empty())
    }

    /// Decodes a stream that comes in chunks. The number of frames in it.
    #[inline]
    pub fn stream(&self, decoder: &mut Decoder<M, N>, stream: &[u8], chunk: usize) -> usize {
        self.decode(decoder, stream, chunk, |_| true)
    }

    /// Decodes a stream that comes in chunks. The number of replies in it, down to typed values.
    #[inline]
    pub fn replies(&self, decoder: &mut Decoder<M, N>, stream: &[u8], chunk: usize) -> usize {
        let is_good = |frame: &[u8]| black_box(&self.messages.parse_response(frame, self.expect)).is_ok();
        self.decode(decoder, stream, chunk, is_good)
    }

    #[inline]
    fn decode(
        &self,
        decoder: &mut Decoder<M, N>,
        stream: &[u8],
        chunk: usize,
        is_good: impl Fn(&[u8]) -> bool + Copy,
    ) -> usize {
        let mut count = 0;
        for mut bytes in stream.chunks(chunk) {
            while !bytes.is_empty() {
                bytes = decoder.push(bytes);
                count += self.frames(decoder, is_good);
            }
        }
        count
    }

    /// Takes all items out of the decoder. The number of good frames among them.
    #[inline]
    fn frames(&self, decoder: &mut Decoder<M, N>, is_good: impl Fn(&[u8]) -> bool) -> usize {
        let mut count = 0;
        while let Some(item) = decoder.next(&self.messages, self.expect) {
            count += usize::from(item.kind == Kind::Frame && is_good(black_box(item.bytes)));
        }
        count
    }

    /// Encodes the request. The number of bytes, 0 if there is no room.
    #[inline]
    pub fn encode(&self, room: &mut [u8; N]) -> usize {
        self.messages
            .encode_request(black_box(&self.request), room)
            .unwrap_or(0)
    }

    /// Makes a call: encodes the request, decodes the reply and accepts it. Returns true if it was accepted.
    #[inline]
    pub fn call(&self, client: &mut Client<M, N>) -> bool {
        let call = |client: &mut Client<M, N>| {
            client.submit(black_box(&self.request)).ok()?;
            if matches!(client.poll(Instant::ZERO), Output::Receive) {
                let _none = client.receive(Instant::ZERO, &[]);
            }
            let Output::Transmit(bytes) = client.poll(Instant::ZERO) else {
                return None;
            };
            let sent = bytes.len();
            client.transmitted(Instant::ZERO, sent).ok()?;
            let now = Instant::from_micros(350);
            let rest = client.receive(now, black_box(self.reply));
            let is_answer = matches!(black_box(client.poll(now)), Output::Event(Event::Answer(_)));
            (is_answer && rest.is_empty()).then_some(())
        };
        call(client).is_some()
    }
}
