//! The direction that a line of a log names.

use super::token::Token;
use crate::args::Speaker;

/// Words before bytes that name their direction, as the program that controls the arm sees it. Those that are usual in
/// other places count with a colon only.
const DIRECTIONS: [(&str, Speaker, bool); 36] = [
    ("tx", Speaker::Host, false),
    ("txd", Speaker::Host, false),
    ("send", Speaker::Host, false),
    ("sent", Speaker::Host, false),
    ("sending", Speaker::Host, false),
    ("write", Speaker::Host, false),
    ("writing", Speaker::Host, false),
    ("wrote", Speaker::Host, false),
    ("written", Speaker::Host, false),
    ("transmit", Speaker::Host, false),
    ("transmitted", Speaker::Host, false),
    ("request", Speaker::Host, false),
    ("req", Speaker::Host, false),
    ("out", Speaker::Host, true),
    ("cmd", Speaker::Host, true),
    ("command", Speaker::Host, true),
    ("host", Speaker::Host, true),
    ("w", Speaker::Host, true),
    ("t", Speaker::Host, true),
    ("rx", Speaker::Arm, false),
    ("rxd", Speaker::Arm, false),
    ("recv", Speaker::Arm, false),
    ("received", Speaker::Arm, false),
    ("receive", Speaker::Arm, false),
    ("receiving", Speaker::Arm, false),
    ("read", Speaker::Arm, false),
    ("reading", Speaker::Arm, false),
    ("response", Speaker::Arm, false),
    ("resp", Speaker::Arm, false),
    ("reply", Speaker::Arm, false),
    ("answer", Speaker::Arm, false),
    ("in", Speaker::Arm, true),
    ("ack", Speaker::Arm, true),
    ("got", Speaker::Arm, false),
    ("r", Speaker::Arm, true),
    ("rcvd", Speaker::Arm, false),
];

/// Words that may be between the direction and the bytes.
const FILLERS: [&str; 7] = ["data", "byte", "bytes", "hex", "frame", "packet", "message"];
/// Names of a port without a direction, with a colon behind them.
const PORTS: [&str; 2] = ["uart", "serial"];

/// The last direction before the token `end`, and its place.
pub(super) fn direction(tokens: &[Token<'_>], end: usize) -> Option<(usize, Speaker)> {
    let before = || tokens.iter().enumerate().take(end).rev();
    let word = before().find_map(|(at, token)| match token {
        Token::Word(word) => Some((at, named(word.text, tokens.get(at + 1) == Some(&Token::Mark(':')))?)),
        _ => None,
    });
    // `PC -> arm RX` has two: a word says more than an arrow.
    word.or_else(|| {
        before().find_map(|(at, token)| match token {
            Token::Arrow(from) => Some((at, *from)),
            _ => None,
        })
    })
}

/// The direction of a word, or of its last part: `arm.tx`, and `rx-data` of sigrok.
fn named(word: &str, has_colon: bool) -> Option<Speaker> {
    let last = word.rsplit(['.', '/', '_']).next()?;
    let last = last.strip_suffix("-data").unwrap_or(last);
    let mut directions = DIRECTIONS.iter();
    let is_name =
        |(name, _, needs_colon): &&(&str, _, _)| last.eq_ignore_ascii_case(name) && (has_colon || !needs_colon);
    directions.find(is_name).map(|(_, from, _)| *from)
}

/// Returns true if these tokens are between a direction and its bytes.
pub(super) fn is_between(tokens: &[Token<'_>]) -> bool {
    tokens.iter().all(|token| match token {
        Token::Mark(mark) => *mark == ':',
        Token::Word(word) => FILLERS.iter().any(|filler| word.text.eq_ignore_ascii_case(filler)),
        _ => false,
    })
}

/// Returns true if the tokens end in the name of a port and a colon, such as `uart-1:`.
pub(super) fn names_port(tokens: &[Token<'_>]) -> bool {
    let [.., Token::Word(word), Token::Mark(':')] = tokens else {
        return false;
    };
    let name = word
        .text
        .trim_end_matches(|character: char| character.is_ascii_digit() || "-_".contains(character));
    PORTS.iter().any(|port| name.eq_ignore_ascii_case(port))
}
