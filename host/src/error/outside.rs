//! Text from outside the program.

use std::fmt::{self, Display, Formatter};

use crate::describe::escaped;

/// Text from outside the program: of a user, an arm, an adapter, a file or the system. It is displayed as a terminal may
/// show it, in one line and [escaped](crate::describe::escaped).
///
/// ```
/// use armwire_host::Outside;
///
/// let name = Outside::from("arm\x1B[2J");
/// assert_eq!(name.to_string(), r"arm\u{1b}[2J");
/// assert_eq!(name.as_str(), "arm\x1B[2J");
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Outside(String);

impl Outside {
    /// The text itself. A terminal may act on it.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl From<String> for Outside {
    fn from(text: String) -> Self {
        Self(text)
    }
}

impl From<&str> for Outside {
    fn from(text: &str) -> Self {
        Self(text.to_owned())
    }
}

impl Display for Outside {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.pad(&escaped(&self.0))
    }
}
