//! The choice of a HID device.

use std::fmt;

/// Vendor and product id of an Alpha1, as public programs use them. STMicroelectronics uses the same ids in its HID
/// examples: other devices may have them, too.
#[cfg(feature = "hid")]
pub(super) const ALPHA1: (u16, u16) = (0x0483, 0x5750);

/// A choice of a HID device: the text after `hid:` in a port.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Selector {
    /// No text: the only device with the ids of an Alpha1.
    Alpha1,
    /// `VID:PID`, in hexadecimal: the only device with these ids.
    Ids(u16, u16),
    /// The system's name, such as `/dev/hidraw3`.
    Name(String),
}

impl Selector {
    pub(crate) fn parse(text: &str) -> Self {
        let is_id = |text: &str| text.len() == 4 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        let id = |text: &str| is_id(text).then(|| u16::from_str_radix(text, 16).ok()).flatten();
        let ids = text
            .split_once(':')
            .and_then(|(vendor, product)| Some((id(vendor)?, id(product)?)));
        match ids {
            Some((vendor, product)) => Self::Ids(vendor, product),
            None if text.is_empty() => Self::Alpha1,
            None => Self::Name(text.to_owned()),
        }
    }

    /// Returns true for a device with this name and these ids.
    #[cfg(feature = "hid")]
    pub(super) fn selects(&self, device: &str, ids: (u16, u16)) -> bool {
        match self {
            Self::Alpha1 => ids == ALPHA1,
            Self::Ids(vendor, product) => ids == (*vendor, *product),
            Self::Name(name) => device == name,
        }
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Alpha1 => Ok(()),
            Self::Ids(vendor, product) => write!(f, "{vendor:04x}:{product:04x}"),
            Self::Name(name) => f.write_str(name),
        }
    }
}
