//! The meaning of a frame.

use std::fmt::Display;

use armwire::Cause;
use armwire::alpha1::Alpha1;
use armwire::framing::Scan;
use armwire::ling::Ling;
use armwire::ling::legacy::Legacy;
use armwire::xarm::XArm;
use armwire_host::describe::{Arm, Protocol};

use crate::args::Speaker;
use crate::hex;

/// What is known of the sender of bytes.
#[derive(Clone, Copy)]
pub(super) enum Sender {
    Known(Speaker),
    /// A mark names it. Frames may say otherwise.
    Marked(Speaker),
    Unknown,
}

impl Sender {
    pub(super) fn speaker(self) -> Option<Speaker> {
        match self {
            Self::Known(speaker) | Self::Marked(speaker) => Some(speaker),
            Self::Unknown => None,
        }
    }
}

/// The expectation of a decoder for this sender.
pub(super) fn expected<P: Arm>(arm: &P, from: Option<Speaker>) -> P::Expect {
    match from {
        Some(Speaker::Host) => arm.requests(),
        Some(Speaker::Arm) | None => arm.unsolicited(),
    }
}

/// The meaning of a frame.
pub(super) struct Meaning {
    /// The sender, as given or as determined by the frame.
    pub(super) from: Option<Speaker>,
    pub(super) text: String,
    /// False for a frame without a known message.
    pub(super) is_message: bool,
}

impl Meaning {
    fn message(from: Speaker, text: String) -> Self {
        Self {
            from: Some(from),
            text,
            is_message: true,
        }
    }

    /// A frame without a known message, for this reason.
    pub(super) fn unknown(from: Option<Speaker>, reason: impl Display) -> Self {
        Self {
            from,
            text: format!("no message: {reason}"),
            is_message: false,
        }
    }
}

/// The meaning of a frame. With a mark of its sender it is that sender's unless it is a message of the other one only.
pub(super) fn meaning<P: Arm>(arm: &P, frame: &[u8], expect: P::Expect, sender: Sender) -> Meaning {
    let envelope = P::envelope(frame);
    let request = arm.parse_request(frame);
    let request = request.map(|request| Meaning::message(Speaker::Host, format!("to the arm: {request}{envelope}")));
    let response = arm.parse_response(frame, expect);
    let is_error = request.is_err() && matches!(&response, Err(error) if matches!(error.cause, Cause::ErrorFrame));
    if is_error && !matches!(sender, Sender::Known(Speaker::Host)) {
        return Meaning::message(Speaker::Arm, format!("from the arm: error frame {}", hex::show(frame)));
    }
    let response = response.map(|response| {
        let extra = P::extra_fact(frame).map_or(String::new(), |extra| format!(", {extra}"));
        Meaning::message(Speaker::Arm, format!("from the arm: {response}{extra}{envelope}"))
    });
    let found = match sender {
        Sender::Known(Speaker::Host) => request.map_err(|error| error.to_string()),
        Sender::Known(Speaker::Arm) => response.map_err(|error| error.to_string()),
        Sender::Marked(Speaker::Host) => request.or_else(|error| response.map_err(|_| error.to_string())),
        Sender::Marked(Speaker::Arm) => response.or_else(|error| request.map_err(|_| error.to_string())),
        Sender::Unknown => request.or_else(|request| {
            response.map_err(|response| format!("as a request, {request}; as an answer, {response}"))
        }),
    };
    found.unwrap_or_else(|reason| Meaning::unknown(sender.speaker(), reason))
}

/// Describes `bytes`, which must be exactly one frame sent by `from`, if it is known.
///
/// # Errors
///
/// The reason why they are not.
pub(super) fn frame_meaning(protocol: Protocol, bytes: &[u8], from: Option<Speaker>) -> Result<Meaning, String> {
    match protocol {
        Protocol::Ling => meaning_of::<Ling>(bytes, from),
        Protocol::LingLegacy => meaning_of::<Legacy>(bytes, from),
        Protocol::Xarm => meaning_of::<XArm>(bytes, from),
        Protocol::Alpha1 => meaning_of::<Alpha1>(bytes, from),
    }
}

fn meaning_of<P: Arm>(bytes: &[u8], from: Option<Speaker>) -> Result<Meaning, String> {
    let arm = P::default();
    let expect = expected(&arm, from);
    match arm.scan(bytes, expect) {
        Scan::Frame(len) if len == bytes.len() => {
            let sender = from.map_or(Sender::Unknown, Sender::Known);
            Ok(meaning(&arm, bytes, expect, sender))
        }
        Scan::Noise(_, reason) | Scan::Broken(reason) => Err(format!("no frame of {}: {reason}", P::NAME)),
        _ => Err(format!("not one whole frame of {}", P::NAME)),
    }
}
