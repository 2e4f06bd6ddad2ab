//! What becomes of a damaged frame.

use armwire::{Decoder, Noise, Protocol, Reason, alpha1, ling, xarm};
use armwire_host_tests::reference::vectors::Vector;

/// What became of a frame. The later one counts if there are two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Outcome {
    /// Not delivered: no header begins it.
    Header,
    /// Not delivered: the line is silent before the end of the frame.
    Silence,
    /// Not delivered: a length that no message has.
    Length,
    /// Not delivered: the end mark is missing.
    EndMark,
    /// Not delivered: the checksum does not match.
    Checksum,
    /// Refused: a good frame, but no message of the protocol.
    Unknown,
    /// Refused: a byte or a value is none that it may be.
    Range,
    /// A good message, but no answer to the request.
    NoAnswer,
    /// Delivered as it was sent.
    Unharmed,
    /// Delivered as another message.
    Undetected,
}

impl Outcome {
    /// All of them, in the order of the columns.
    pub(crate) const ALL: [Self; 10] = [
        Self::Header,
        Self::Silence,
        Self::Length,
        Self::EndMark,
        Self::Checksum,
        Self::Unknown,
        Self::Range,
        Self::NoAnswer,
        Self::Unharmed,
        Self::Undetected,
    ];

    /// What it is called in the table.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Header => "header",
            Self::Silence => "silence",
            Self::Length => "length",
            Self::EndMark => "end mark",
            Self::Checksum => "checksum",
            Self::Unknown => "unknown",
            Self::Range => "range",
            Self::NoAnswer => "no answer",
            Self::Unharmed => "unharmed",
            Self::Undetected => "**undetected**",
        }
    }

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

/// A protocol whose errors can be sorted.
pub(crate) trait Sorted: Protocol {
    /// What it means that a frame is not a message for this reason.
    fn refused(error: &Self::Error) -> Outcome;
}

fn ling_cause(cause: ling::Cause) -> Outcome {
    match cause {
        ling::Cause::Unknown => Outcome::Unknown,
        ling::Cause::Length { .. } => Outcome::Length,
        ling::Cause::Byte { .. } | ling::Cause::Value { .. } => Outcome::Range,
        other => panic!("a cause without a column: {other:?}"),
    }
}

impl Sorted for ling::Ling {
    fn refused(error: &ling::ParseError) -> Outcome {
        ling_cause(error.cause)
    }
}

impl Sorted for ling::legacy::Legacy {
    fn refused(error: &ling::legacy::ParseError) -> Outcome {
        ling_cause(error.cause)
    }
}

impl Sorted for xarm::XArm {
    fn refused(error: &xarm::ParseError) -> Outcome {
        match error {
            xarm::ParseError::Call {
                cause: xarm::Cause::Value { .. },
                ..
            } => Outcome::Range,
            xarm::ParseError::Call { .. } => Outcome::Length,
            _ => Outcome::Unknown,
        }
    }
}

impl Sorted for alpha1::Alpha1 {
    fn refused(error: &alpha1::ParseError) -> Outcome {
        match error.cause {
            alpha1::Cause::Length { .. } => Outcome::Length,
            alpha1::Cause::Byte { .. } | alpha1::Cause::Value { .. } | alpha1::Cause::Offset(_) => Outcome::Range,
            _ => Outcome::Unknown,
        }
    }
}

/// What a frame means.
enum Message<P: Protocol> {
    Request(P::Request),
    /// And what it answers.
    Response(P::Response, Option<P::Request>),
}

/// A frame whose damage is tried.
pub(crate) struct Subject<P: Protocol> {
    /// The frame.
    pub(crate) bytes: Vec<u8>,
    expect: P::Expect,
    message: Message<P>,
}

impl<P: Sorted> Subject<P> {
    /// A frame from the host.
    pub(crate) fn request(vector: &Vector) -> Self {
        let request = request_of::<P>(&vector.bytes);
        Self {
            bytes: vector.bytes.clone(),
            expect: P::REQUESTS,
            message: Message::Request(request),
        }
    }

    /// A frame from the arm.
    pub(crate) fn response(vector: &Vector) -> Self {
        let request = vector.request.as_deref().map(request_of::<P>);
        let expect = P::expect(request.as_ref());
        let frame = P::view(&vector.bytes).expect(vector.name);
        let response = P::parse_response(frame, expect).expect(vector.name);
        if let Some(request) = &request {
            assert!(
                P::answers(request, &P::response_ref(&response)),
                "{} answers something else",
                vector.name
            );
        }
        Self {
            bytes: vector.bytes.clone(),
            expect,
            message: Message::Response(response, request),
        }
    }

    /// What becomes of the frame if these bytes come in its place, and then silence.
    pub(crate) fn outcome<const N: usize>(&self, damaged: &[u8]) -> Outcome {
        let (mut first, mut delivered) = (None, None);
        self.hear::<N>(damaged, |heard| match heard {
            Ok((_, outcome)) => delivered = delivered.max(Some(outcome)),
            Err(noise) => first = first.or(Some(Outcome::of_noise(noise.reason))),
        });
        delivered.or(first).unwrap_or(Outcome::Silence)
    }

    /// Whether the same frame, whole, is delivered if it follows these bytes without a pause.
    pub(crate) fn spares_the_next<const N: usize>(&self, damaged: &[u8]) -> bool {
        let line = [damaged, &self.bytes].concat();
        let mut spared = false;
        self.hear::<N>(&line, |heard| spared |= heard == Ok((line.len(), Outcome::Unharmed)));
        spared
    }

    /// All that comes of a line: where a frame ends and what it is, or noise.
    fn hear<const N: usize>(&self, line: &[u8], mut tell: impl FnMut(Result<(usize, Outcome), Noise>)) {
        let mut decoder = Decoder::<P, N>::new();
        let mut rest = line;
        let mut told = true;
        while told || !rest.is_empty() {
            rest = decoder.push(rest);
            told = false;
            if rest.is_empty()
                && let Some(noise) = decoder.idle(self.expect)
            {
                tell(Err(noise));
                told = true;
            }
            while let Some(next) = decoder
                .next(self.expect)
                .map(|next| next.map(|frame| self.judge(frame)))
            {
                let end = line.len() - rest.len() - decoder.pending();
                tell(next.map(|outcome| (end, outcome)));
                told = true;
            }
        }
    }

    fn judge(&self, frame: P::Frame<'_>) -> Outcome {
        match &self.message {
            Message::Request(sent) => match P::parse_request(frame) {
                Err(error) => P::refused(&error),
                Ok(request) if request == *sent => Outcome::Unharmed,
                Ok(_) => Outcome::Undetected,
            },
            Message::Response(sent, request) => match P::parse_response(frame, self.expect) {
                Err(error) => P::refused(&error),
                Ok(response) if response == *sent => Outcome::Unharmed,
                Ok(response) if request.is_some_and(|request| !P::answers(&request, &P::response_ref(&response))) => {
                    Outcome::NoAnswer
                }
                Ok(_) => Outcome::Undetected,
            },
        }
    }
}

fn request_of<P: Protocol>(bytes: &[u8]) -> P::Request {
    let frame = P::view(bytes).expect("a frame");
    P::parse_request(frame).expect("a request")
}
