//! The parts of a recording's sum.

use std::fmt::{self, Display};

/// A count of a sum.
pub(super) struct Part {
    what: &'static str,
    pub(super) count: u64,
    /// It is printed even if it is 0.
    is_always: bool,
    /// A count above 0 says that something is wrong.
    pub(super) is_flaw: bool,
}

impl Part {
    /// A count that is printed in any case.
    pub(super) fn always(what: &'static str, count: u64) -> Self {
        Self {
            what,
            count,
            is_always: true,
            is_flaw: false,
        }
    }

    /// A count that is printed above 0.
    pub(super) fn some(what: &'static str, count: u64) -> Self {
        let is_always = false;
        Self {
            is_always,
            ..Self::always(what, count)
        }
    }

    /// The count of a flaw.
    pub(super) fn flaw(self) -> Self {
        let is_flaw = true;
        Self { is_flaw, ..self }
    }

    pub(super) fn is_shown(&self) -> bool {
        self.is_always || self.count > 0
    }
}

impl Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.what, self.count)
    }
}
