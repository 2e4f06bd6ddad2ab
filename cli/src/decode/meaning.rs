//! The meaning of a frame.

use armwire::Cause;
use armwire::alpha1::Alpha1;
use armwire::framing::Scan;
use armwire::ling::Ling;
use armwire::ling::legacy::Legacy;
use armwire::xarm::XArm;
use armwire_host::describe::{Arm, Protocol};

use crate::args::Speaker;
use crate::hex;

/// The expectation of a decoder for this sender.
pub(super) fn expected<P: Arm>(arm: &P, from: Option<Speaker>) -> P::Expect {
    match from {
        Some(Speaker::Host) => arm.requests(),
        Some(Speaker::Arm) | None => arm.unsolicited(),
    }
}

/// The sender of a frame, as given or as determined by the frame, and its meaning.
pub(super) fn meaning<P: Arm>(
    arm: &P,
    frame: &[u8],
    expect: P::Expect,
    from: Option<Speaker>,
) -> (Option<Speaker>, String) {
    let envelope = P::envelope(frame);
    let request = arm.parse_request(frame);
    let request = request.map(|request| format!("to the arm: {request}{envelope}"));
    let response = arm.parse_response(frame, expect);
    let response = response.map(|response| {
        let extra = P::extra_fact(frame).map_or(String::new(), |extra| format!(", {extra}"));
        format!("from the arm: {response}{extra}{envelope}")
    });
    match (from, request, response) {
        (None | Some(Speaker::Arm), Err(_), Err(error)) if matches!(error.cause, Cause::ErrorFrame) => (
            Some(Speaker::Arm),
            format!("from the arm: error frame {}", hex::show(frame)),
        ),
        (None | Some(Speaker::Host), Ok(text), _) => (Some(Speaker::Host), text),
        (None | Some(Speaker::Arm), _, Ok(text)) => (Some(Speaker::Arm), text),
        (Some(Speaker::Host), Err(error), _) | (Some(Speaker::Arm), _, Err(error)) => {
            (from, format!("no message: {error}"))
        }
        (None, Err(request), Err(response)) => {
            let text = format!("no message: as a request, {request}; as an answer, {response}");
            (None, text)
        }
    }
}

/// Describes `bytes`, which must be exactly one frame sent by `from`.
///
/// # Errors
///
/// The reason why they are not.
pub(super) fn frame_meaning(protocol: Protocol, bytes: &[u8], from: Speaker) -> Result<String, String> {
    match protocol {
        Protocol::Ling => meaning_of::<Ling>(bytes, from),
        Protocol::LingLegacy => meaning_of::<Legacy>(bytes, from),
        Protocol::Xarm => meaning_of::<XArm>(bytes, from),
        Protocol::Alpha1 => meaning_of::<Alpha1>(bytes, from),
    }
}

fn meaning_of<P: Arm>(bytes: &[u8], from: Speaker) -> Result<String, String> {
    let arm = P::default();
    let expect = expected(&arm, Some(from));
    match arm.scan(bytes, expect) {
        Scan::Frame(len) if len == bytes.len() => Ok(meaning(&arm, bytes, expect, Some(from)).1),
        Scan::Noise(_, reason) | Scan::Broken(reason) => Err(format!("no frame of {}: {reason}", P::NAME)),
        _ => Err(format!("not one whole frame of {}", P::NAME)),
    }
}
