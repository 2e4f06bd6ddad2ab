//! The outcome of a damaged frame.

use armwire::decoder::{Decoder, Kind};
use armwire::framing::Reason;
use armwire::messages::Messages;
use armwire::{Cause, ParseError};
use armwire_host_tests::reference::vectors::Vector;
use strum::{Display, VariantArray};

/// The outcome of a frame, displayed as in the tables. The later variant counts if there are two.
#[derive(Clone, Copy, Debug, Display, PartialEq, Eq, PartialOrd, Ord, VariantArray)]
pub(crate) enum Outcome {
    /// Not delivered: no header begins it.
    #[strum(to_string = "header")]
    Header,
    /// Not delivered: the line is silent before the end of the frame.
    #[strum(to_string = "silence")]
    Silence,
    /// Not delivered: a length that no message has.
    #[strum(to_string = "length")]
    Length,
    /// Not delivered: the end mark is missing.
    #[strum(to_string = "end mark")]
    EndMark,
    /// Not delivered: the checksum does not match.
    #[strum(to_string = "checksum")]
    Checksum,
    /// Refused: a good frame, but no message of the protocol.
    #[strum(to_string = "unknown")]
    Unknown,
    /// Refused: a byte or a value is none that it may be.
    #[strum(to_string = "range")]
    Range,
    /// A good message, but no answer to the request.
    #[strum(to_string = "no answer")]
    NoAnswer,
    /// Delivered as it was sent.
    #[strum(to_string = "unharmed")]
    Unharmed,
    /// Delivered as another message.
    #[strum(to_string = "**undetected**")]
    Undetected,
}

impl Outcome {
    fn of_noise(reason: Reason) -> Self {
        match reason {
            Reason::Stray => Self::Header,
            Reason::Truncated { .. } => Self::Silence,
            Reason::Length { .. } => Self::Length,
            Reason::Tail { .. } => Self::EndMark,
            Reason::Checksum { .. } => Self::Checksum,
            Reason::Byte { .. } => Self::Range,
            other => panic!("a reason without a column: {other:?}"),
        }
    }
}

/// The outcome of a frame that is no message for this reason.
fn refused(error: &ParseError) -> Outcome {
    match error.cause {
        Cause::Length { .. } => Outcome::Length,
        Cause::Byte { .. } | Cause::Value { .. } => Outcome::Range,
        _ => Outcome::Unknown,
    }
}

/// A frame to be damaged.
pub(crate) struct Subject<M: Messages> {
    /// The frame.
    pub(crate) bytes: Vec<u8>,
    messages: M,
    expect: M::Expect,
    /// The sender: the host, or the arm with the request that it answers.
    from: Sender<M::Key>,
}

/// The sender of a frame.
enum Sender<K> {
    Host,
    Arm(Option<K>),
}

impl<M: Messages + Default> Subject<M> {
    /// A frame from the host.
    pub(crate) fn request(vector: &Vector) -> Self {
        let messages = M::default();
        assert!(messages.parse_request(&vector.bytes).is_ok(), "{}", vector.name);
        Self {
            bytes: vector.bytes.clone(),
            expect: messages.requests(),
            messages,
            from: Sender::Host,
        }
    }

    /// A frame from the arm.
    pub(crate) fn response(vector: &Vector) -> Self {
        let messages = M::default();
        let request = vector
            .request
            .as_deref()
            .map(|bytes| messages.request(bytes).expect("a request"));
        let expect = request.map_or(messages.unsolicited(), |info| info.expect);
        let key = request.map(|info| info.key);
        assert!(
            messages.parse_response(&vector.bytes, expect).is_ok(),
            "{}",
            vector.name
        );
        assert!(
            key.is_none_or(|key| messages.is_response_to(key, &vector.bytes)),
            "{} answers something else",
            vector.name
        );
        Self {
            bytes: vector.bytes.clone(),
            messages,
            expect,
            from: Sender::Arm(key),
        }
    }

    /// The outcome if these bytes arrive in place of the frame, followed by silence.
    pub(crate) fn outcome<const N: usize>(&self, damaged: &[u8]) -> Outcome {
        let (mut first, mut delivered) = (None, None);
        self.decode::<N>(damaged, |found| match found {
            Ok((_, outcome)) => delivered = delivered.max(Some(outcome)),
            Err(reason) => first = first.or(Some(Outcome::of_noise(reason))),
        });
        delivered.or(first).unwrap_or(Outcome::Silence)
    }

    /// True if the same frame, intact, is delivered right after these bytes.
    pub(crate) fn spares_the_next<const N: usize>(&self, damaged: &[u8]) -> bool {
        let line = [damaged, &self.bytes].concat();
        let mut spared = false;
        self.decode::<N>(&line, |found| spared |= found == Ok((line.len(), Outcome::Unharmed)));
        spared
    }

    /// Decodes a line: the end and outcome of each frame, and noise.
    fn decode<const N: usize>(&self, line: &[u8], mut found: impl FnMut(Result<(usize, Outcome), Reason>)) {
        let mut decoder = Decoder::<_, N>::new();
        let mut rest = line;
        loop {
            rest = decoder.push(rest);
            if rest.is_empty() {
                decoder.idle();
            }
            while let Some(item) = decoder.next(&self.messages, self.expect) {
                match item.kind {
                    Kind::Frame => {
                        let end = item.offset as usize + item.bytes.len();
                        found(Ok((end, self.judge(item.bytes))));
                    }
                    Kind::Noise(reason) | Kind::Broken(reason) => found(Err(reason)),
                    Kind::Padding => {}
                }
            }
            if rest.is_empty() {
                return;
            }
        }
    }

    fn judge(&self, frame: &[u8]) -> Outcome {
        match self.from {
            Sender::Host => match (
                self.messages.parse_request(frame),
                self.messages.parse_request(&self.bytes),
            ) {
                (Err(error), _) => refused(&error),
                // xArm's numbers are in the frame, not in the request.
                (Ok(request), Ok(sent)) if request == sent && self.key(frame) == self.key(&self.bytes) => {
                    Outcome::Unharmed
                }
                _ => Outcome::Undetected,
            },
            Sender::Arm(key) => {
                let sent = self.messages.parse_response(&self.bytes, self.expect);
                match (self.messages.parse_response(frame, self.expect), sent) {
                    (Err(error), _) => refused(&error),
                    _ if key.is_some_and(|key| !self.messages.is_response_to(key, frame)) => Outcome::NoAnswer,
                    (Ok(response), Ok(sent)) if response == sent && (key.is_some() || frame == self.bytes) => {
                        Outcome::Unharmed
                    }
                    _ => Outcome::Undetected,
                }
            }
        }
    }

    fn key(&self, request: &[u8]) -> Option<M::Key> {
        self.messages.request(request).map(|info| info.key)
    }
}
