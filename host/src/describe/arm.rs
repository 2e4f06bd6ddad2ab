//! A protocol as a program on a PC knows it.

use armwire::Config;
use armwire::messages::Messages;

use super::fact::Fact;
use super::printable::hex;

/// The protocol of a line. It is exhaustive: a program that decodes must know each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// Ling / Alicia-D.
    Ling,
    /// The Ling arm of the older generation.
    LingLegacy,
    /// UFACTORY xArm.
    Xarm,
    /// UBTECH Alpha1.
    Alpha1,
}

/// A protocol, and its texts.
pub trait Arm: Messages + Default {
    /// The protocol as a value.
    const PROTOCOL: Protocol;

    /// The arm's name, with its article.
    const NAME: &'static str;

    /// The other arm that may be on such a line, with its article.
    const OTHER: (&'static str, Protocol);

    /// Default timing of the line.
    const CONFIG: Config;

    /// True if it may be a HID device on USB.
    const ON_HID: bool = false;

    /// Number of bytes of its request with which an answer begins.
    const HEADER: usize;

    /// The requests that identify the arm and read its state.
    fn info() -> Vec<Self::Request<'static>> {
        Vec::new()
    }

    /// The facts in a response, in the words of its text.
    fn facts(response: &Self::Response<'_>) -> Vec<Fact>;

    /// The facts in a response, after others whose facts are known.
    fn facts_after(_known: &[Fact], response: &Self::Response<'_>) -> Vec<Fact> {
        Self::facts(response)
    }

    /// The bytes of a response's frame after its documented fields, if it has any.
    fn extra_fact(frame: &[u8]) -> Option<Fact> {
        let arm = Self::default();
        let extra = arm.extra(frame);
        (!extra.is_empty()).then(|| Fact::words("extra", hex(extra)))
    }

    /// The reason of a response that reports a failed request.
    fn refusal(_response: &Self::Response<'_>) -> Option<String> {
        None
    }

    /// The request whose answer explains a response that reports a refusal, an error or a warning.
    fn follow_up(_response: &Self::Response<'_>) -> Option<Self::Request<'static>> {
        None
    }

    /// The facts in the answer to [`follow_up`](Self::follow_up). Empty if it explains nothing.
    fn explanation(_response: &Self::Response<'_>) -> Vec<Fact> {
        Vec::new()
    }

    /// The rest of a frame besides its message, in parentheses, such as its number.
    fn envelope(_frame: &[u8]) -> String {
        String::new()
    }
}
