//! A request and its reply for each protocol, and the uses of armwire that are counted and timed.
#![no_std]

use core::hint::black_box;

use armwire::{Client, Config, Decoder, Event, Input, Micros, Protocol};

/// A request of a protocol whose longest frame has `N` bytes, and the arm's reply to it.
pub struct Arm<P: Protocol, const N: usize> {
    /// The request.
    pub request: P::Request,
    /// The reply as it is on the line.
    pub reply: &'static [u8],
}

/// Ling: all joints, 21 bytes.
#[cfg(feature = "ling")]
pub const LING: Arm<armwire::ling::Ling, { armwire::ling::MAX_FRAME }> = Arm {
    request: armwire::ling::Request::ReadJoints,
    reply: b"\xAA\x06\x00\x0F\x00\x08\x00\x08\x00\x08\x00\x08\x00\x08\x00\x08\xF4\x01\x00\xB4\xFF",
};

/// xArm: a register of 13 bytes, with which the frame has 21.
#[cfg(feature = "xarm")]
pub fn xarm() -> Arm<armwire::xarm::XArm, { armwire::xarm::MAX_FRAME }> {
    use armwire::xarm::{Command, Header, ProtocolId, Raw, Request};
    let header = Header {
        transaction: 1,
        protocol: ProtocolId::Private,
    };
    let register = Raw::new(42, &[]).expect("no command of another type has this number");
    Arm {
        request: Request::Call {
            header,
            command: Command::Raw(register),
        },
        reply: b"\x00\x01\x00\x02\x00\x0F\x2A\x00\x07\x07\x07\x07\x07\x07\x07\x07\x07\x07\x07\x07\x07",
    }
}

/// Alpha1: the version of the firmware, 15 bytes, the longest answer of a fixed length.
#[cfg(feature = "alpha1")]
pub const ALPHA1: Arm<armwire::alpha1::Alpha1, { armwire::alpha1::MAX_FRAME }> = Arm {
    request: armwire::alpha1::Request::ReadFirmwareVersion,
    reply: b"\xF5\x5F\xAA2016010100\x95\xED",
};

impl<P: Protocol, const N: usize> Arm<P, N> {
    /// A decoder without bytes.
    pub fn decoder(&self) -> Decoder<P, N> {
        Decoder::new()
    }

    /// A client that waits for nothing.
    pub fn client(&self) -> Client<P, N> {
        Client::new(Config::DEFAULT)
    }

    /// Decodes a stream that comes in chunks. The number of frames in it.
    #[inline]
    pub fn frames(&self, decoder: &mut Decoder<P, N>, stream: &[u8], chunk: usize) -> usize {
        self.decode(decoder, stream, chunk, |_, _| true)
    }

    /// Decodes a stream that comes in chunks. The number of replies in it, down to typed values.
    #[inline]
    pub fn replies(&self, decoder: &mut Decoder<P, N>, stream: &[u8], chunk: usize) -> usize {
        self.decode(decoder, stream, chunk, |frame, expect| {
            black_box(&P::parse_response(frame, expect)).is_ok()
        })
    }

    #[inline]
    fn decode(
        &self,
        decoder: &mut Decoder<P, N>,
        stream: &[u8],
        chunk: usize,
        is_good: impl Fn(P::Frame<'_>, P::Expect) -> bool,
    ) -> usize {
        let expect = P::expect(Some(&self.request));
        let mut count = 0;
        for mut bytes in stream.chunks(chunk) {
            while let Some(next) = decoder.decode(&mut bytes, expect) {
                count += usize::from(black_box(next).is_ok_and(|frame| is_good(frame, expect)));
            }
        }
        count
    }

    /// Encodes the request. The number of bytes, 0 if there is no room.
    #[inline]
    pub fn encode(&self, room: &mut [u8; N]) -> usize {
        P::encode_request(black_box(&self.request), room).unwrap_or(0)
    }

    /// Makes a whole call: the request on its way, the reply decoded and accepted. Whether it was.
    #[inline]
    pub fn call(&self, client: &mut Client<P, N>) -> bool {
        let call = |client: &mut Client<P, N>| {
            client.submit(black_box(self.request)).ok()?;
            let sent = client.poll_transmit(Micros(0))?.len();
            client.transmitted(Micros(0), sent).ok()?;
            let event = client.handle(Micros(350), &mut Input::Bytes(black_box(self.reply)));
            matches!(event, Some(Event::Answer(_))).then_some(())
        };
        call(client).is_some()
    }
}
