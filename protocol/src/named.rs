//! A text of an arm, with its name.

use core::fmt;

/// `name: text`, with unprintable characters escaped. An empty text is the name alone.
pub(crate) struct Named<'a>(pub(crate) &'static str, pub(crate) &'a [u8]);

impl fmt::Display for Named<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self(name, []) => f.write_str(name),
            Self(name, text) => write!(f, "{name}: {}", text.escape_ascii()),
        }
    }
}
