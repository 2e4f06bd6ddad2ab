//! The arm's side: requests in, responses out, no I/O.

use core::fmt;

use crate::{BufferTooShort, Decoder, Input, Noise, Protocol};

/// What a [`Device`] hears.
pub enum Heard<P: Protocol> {
    /// A request.
    Request(P::Request),
    /// A good frame that is no request of the protocol.
    Unknown(P::Error),
    /// Bytes that are not part of a frame.
    Noise(Noise),
    /// Bytes that break a [`RELIABLE`](crate::Framing::RELIABLE) line: nothing after them can be read. Close the connection.
    Broken(Noise),
}

impl<P: Protocol> fmt::Debug for Heard<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Request(request) => f.debug_tuple("Request").field(request).finish(),
            Self::Unknown(error) => f.debug_tuple("Unknown").field(error).finish(),
            Self::Noise(noise) => f.debug_tuple("Noise").field(noise).finish(),
            Self::Broken(noise) => f.debug_tuple("Broken").field(noise).finish(),
        }
    }
}

#[cfg(feature = "defmt")]
impl<P: Protocol> defmt::Format for Heard<P>
where
    P::Request: defmt::Format,
    P::Error: defmt::Format,
{
    fn format(&self, f: defmt::Formatter<'_>) {
        match self {
            Self::Request(request) => defmt::write!(f, "Request({})", request),
            Self::Unknown(error) => defmt::write!(f, "Unknown({})", error),
            Self::Noise(noise) => defmt::write!(f, "Noise({})", noise),
            Self::Broken(noise) => defmt::write!(f, "Broken({})", noise),
        }
    }
}

impl<P: Protocol> Clone for Heard<P> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<P: Protocol> Copy for Heard<P> {}

impl<P: Protocol> PartialEq for Heard<P> {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Request(a), Self::Request(b)) => a == b,
            (Self::Unknown(a), Self::Unknown(b)) => a == b,
            (Self::Noise(a), Self::Noise(b)) | (Self::Broken(a), Self::Broken(b)) => a == b,
            _ => false,
        }
    }
}

/// An arm-side state machine with a buffer of `N` bytes, at least [`Framing::MAX_FRAME`](crate::Framing::MAX_FRAME).
///
/// It knows the protocol, not the arm: what a request does, and when its response goes out, is the caller's.
///
/// ```
/// use armwire::ling::{self, Ling, Request, Response, Stroke};
/// use armwire::{Device, Heard, Input};
///
/// let mut device = Device::<Ling, { ling::MAX_FRAME }>::new();
/// let mut input = Input::Bytes(&[0xAA, 0x04, 0x0E, 0x01, 0xFE, 0x1B, 0xFF]);
/// assert_eq!(device.handle(&mut input), Some(Heard::Request(Request::ReadStroke)));
/// assert_eq!(device.handle(&mut input), None);
///
/// let mut out = [0; ling::MAX_FRAME];
/// let n = device.respond(&Response::Stroke(Stroke::Mm100), &mut out)?;
/// assert_eq!(out[..n], [0xAA, 0x04, 0x0E, 0x01, 0x02, 0x2C, 0xFF]);
/// # Ok::<(), armwire::BufferTooShort>(())
/// ```
pub struct Device<P: Protocol, const N: usize> {
    decoder: Decoder<P, N>,
}

impl<P: Protocol, const N: usize> Device<P, N> {
    /// A device that has heard nothing. Does not compile when `N` is less than
    /// [`Framing::MAX_FRAME`](crate::Framing::MAX_FRAME).
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
        }
    }

    /// Takes the input and says what comes of it. Call again with the same input until it returns `None`.
    pub fn handle(&mut self, input: &mut Input<'_>) -> Option<Heard<P>> {
        loop {
            match self.decoder.next(P::REQUESTS) {
                Some(Ok(frame)) => {
                    return Some(match P::parse_request(frame) {
                        Ok(request) => Heard::Request(request),
                        Err(error) => Heard::Unknown(error),
                    });
                }
                Some(Err(noise)) => {
                    let broken = self.decoder.is_broken();
                    return Some(if broken {
                        Heard::Broken(noise)
                    } else {
                        Heard::Noise(noise)
                    });
                }
                None => {}
            }
            match input {
                Input::Bytes(bytes) if !bytes.is_empty() => *bytes = self.decoder.push(bytes),
                Input::Idle => match self.decoder.idle(P::REQUESTS) {
                    Some(noise) => return Some(Heard::Noise(noise)),
                    None if self.decoder.need(P::REQUESTS) == 0 => {}
                    None => return None,
                },
                Input::Bytes(_) | Input::Tick => return None,
            }
        }
    }

    /// Writes a response at the front of `out` and returns its length in bytes.
    ///
    /// # Errors
    ///
    /// [`BufferTooShort`]; never when `out` has [`Framing::MAX_FRAME`](crate::Framing::MAX_FRAME) bytes.
    pub fn respond(&self, response: &P::Response, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        P::encode_response(response, out)
    }
}

impl<P: Protocol, const N: usize> Default for Device<P, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<P: Protocol, const N: usize> fmt::Debug for Device<P, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Device").field("decoder", &self.decoder).finish()
    }
}

#[cfg(all(test, feature = "xarm"))]
mod tests {
    use super::*;
    use crate::Reason;
    use crate::xarm::{self, HEARTBEAT, Request, XArm};

    #[test]
    fn a_broken_connection_is_told_once_and_nothing_is_heard_after_it() {
        let mut device = Device::<XArm, { xarm::MAX_FRAME }>::new();
        let broken = Heard::Broken(Noise {
            offset: 8,
            len: 3,
            reason: Reason::Byte {
                offset: 2,
                expected: &[0],
                got: 1,
            },
        });
        for (bytes, expected) in [
            (&HEARTBEAT[..], Some(Heard::Request(Request::Heartbeat))),
            (&[0, 1, 1], Some(broken)),
            (&HEARTBEAT, None),
        ] {
            let mut input = Input::Bytes(bytes);
            assert_eq!(device.handle(&mut input), expected);
            assert_eq!(device.handle(&mut input), None);
            assert!(matches!(input, Input::Bytes([])), "all of it is taken");
            assert_eq!(device.handle(&mut Input::Idle), None);
        }
    }
}

#[cfg(test)]
mod idle_tests {
    use core::convert::Infallible;

    use super::*;
    use crate::{Framing, Reason, Reply, Scan};

    /// A frame is 7E and one byte, or 7E and silence.
    enum Terse {}

    impl Framing for Terse {
        const MAX_FRAME: usize = 2;
        const RELIABLE: bool = false;
        type Expect = ();
        type Frame<'a> = Option<u8>;

        fn scan(window: &[u8], (): ()) -> Scan {
            match window {
                [] | [0x7E] => Scan::Need(1),
                [0x7E, ..] => Scan::Frame(2),
                _ => Scan::Skip(1, Reason::Stray),
            }
        }

        fn scan_idle(_window: &[u8], (): (), _missing: usize) -> Scan {
            Scan::Frame(1)
        }

        fn view(bytes: &[u8]) -> Option<Option<u8>> {
            Some(bytes.get(1).copied())
        }
    }

    impl Protocol for Terse {
        const REQUESTS: () = ();
        const IDENTIFIED: bool = false;
        type Request = Option<u8>;
        type Response = ();
        type ResponseRef<'a> = ();
        type Error = Infallible;

        fn encode_request(_request: &Option<u8>, _out: &mut [u8]) -> Result<usize, BufferTooShort> {
            Ok(0)
        }

        fn encode_response((): &(), _out: &mut [u8]) -> Result<usize, BufferTooShort> {
            Ok(0)
        }

        fn parse_request(frame: Option<u8>) -> Result<Option<u8>, Infallible> {
            Ok(frame)
        }

        fn parse_response_ref<'a>(_frame: Self::Frame<'a>, (): ()) -> Result<Self::ResponseRef<'a>, Infallible> {
            Ok(())
        }

        fn to_response((): &()) {}

        fn response_ref((): &()) {}

        fn expect(_request: Option<&Option<u8>>) {}

        fn reply(_request: &Option<u8>) -> Option<Reply> {
            None
        }

        fn answers(_request: &Option<u8>, (): &()) -> bool {
            false
        }

        fn is_response_to(_request: &Option<u8>, _frame: Option<u8>) -> bool {
            false
        }

        fn repeatable(_request: &Option<u8>) -> bool {
            false
        }
    }

    #[test]
    fn what_is_heard_is_the_same_only_if_all_of_it_is() {
        let noise = |len| Noise {
            offset: 0,
            len,
            reason: Reason::Stray,
        };
        let all: [Heard<Terse>; 6] = [
            Heard::Request(None),
            Heard::Request(Some(1)),
            Heard::Noise(noise(1)),
            Heard::Noise(noise(2)),
            Heard::Broken(noise(1)),
            Heard::Broken(noise(2)),
        ];
        for (i, one) in all.iter().enumerate() {
            for (j, other) in all.iter().enumerate() {
                assert_eq!(one == other, i == j, "{one:?} and {other:?}");
            }
        }
    }

    #[test]
    fn noise_breaks_no_line_that_is_not_reliable() {
        let mut device = Device::<Terse, 2>::new();
        let mut input = Input::Bytes(&[1, 0x7E, 5]);
        let noise = Noise {
            offset: 0,
            len: 1,
            reason: Reason::Stray,
        };
        assert_eq!(device.handle(&mut input), Some(Heard::Noise(noise)));
        assert_eq!(device.handle(&mut input), Some(Heard::Request(Some(5))));
    }

    #[test]
    fn a_request_that_silence_ends_is_heard_when_the_line_goes_idle() {
        let mut device = Device::<Terse, 2>::new();
        assert_eq!(device.handle(&mut Input::Bytes(&[0x7E])), None);
        assert_eq!(device.handle(&mut Input::Idle), Some(Heard::Request(None)));
        assert_eq!(device.handle(&mut Input::Idle), None);
        let mut input = Input::Bytes(&[0x7E, 5]);
        assert_eq!(device.handle(&mut input), Some(Heard::Request(Some(5))));
    }
}
