//! A text of an arm, with its name.

use core::fmt;

/// `name: text`, with unprintable characters of the text escaped. An empty text is the name alone.
///
/// ```
/// use armwire::text::Named;
///
/// assert_eq!(Named("version", b"1.3\n").to_string(), r"version: 1.3\n");
/// assert_eq!(Named("version", b"").to_string(), "version");
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Named<'a>(pub &'static str, pub &'a [u8]);

impl fmt::Display for Named<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self(name, []) => f.write_str(name),
            Self(name, text) => write!(f, "{name}: {}", text.escape_ascii()),
        }
    }
}
