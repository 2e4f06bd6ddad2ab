//! The parts of a log that are not understood, counted by kind.

use super::log::{Place, Unread};
use super::output::Output;
use crate::printable::escaped;

/// Counts of what is not understood, in the order of the first of each kind.
#[derive(Default)]
pub(super) struct Doubts(Vec<(&'static str, u64)>);

impl Doubts {
    /// Counts a part, and shows the first of its kind.
    pub(super) fn add(&mut self, place: Place<'_>, reason: &Unread, out: &dyn Output) {
        match self.0.iter_mut().find(|(kind, _)| *kind == reason.kind) {
            Some((_, count)) => *count += 1,
            None => {
                self.0.push((reason.kind, 1));
                let text = format!("not understood: {place}: {}", reason.text);
                out.remark(format_args!("{}", escaped(&text)));
            }
        }
    }

    /// The number of parts.
    pub(super) fn count(&self) -> u64 {
        self.0.iter().map(|(_, count)| count).sum()
    }

    /// Their part of the sum, empty without any: `, not understood: 3 (no time: 2, NUL bytes: 1)`.
    pub(super) fn sum(&self) -> String {
        if self.0.is_empty() {
            return String::new();
        }
        let kinds: Vec<_> = self.0.iter().map(|(kind, count)| format!("{kind}: {count}")).collect();
        format!(", not understood: {} ({})", self.count(), kinds.join(", "))
    }
}
