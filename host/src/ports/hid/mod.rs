//! HID devices on USB: the choice of one, and its line.

#[cfg(feature = "hid")]
mod device;
#[cfg(feature = "hid")]
mod line;
#[cfg(feature = "hid")]
mod reports;
mod selector;

use crate::error::Error;
use crate::ports::line::Line;
pub use selector::Selector;

/// The names of all devices with the ids of an Alpha1. Empty if the system cannot list HID devices, or without the feature
/// `hid`.
pub(crate) fn alpha1_names() -> Vec<String> {
    #[cfg(feature = "hid")]
    return line::alpha1_names();
    #[cfg(not(feature = "hid"))]
    Vec::new()
}

/// Opens the device that matches the selector.
pub(crate) fn open(selector: &Selector) -> Result<Box<dyn Line>, Error> {
    #[cfg(feature = "hid")]
    return line::open(selector);
    #[cfg(not(feature = "hid"))]
    Err(Error::Disabled {
        name: format!("hid:{selector}").into(),
        feature: "hid",
    })
}
