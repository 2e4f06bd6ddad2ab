//! Reports of a HID device, 64 bytes each, and the failures of a transfer.

use std::time::Duration;

use armwire::alpha1::hid::REPORT;

use crate::error::Error;

/// A HID device of this computer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Named {
    /// The system's name, for example `/dev/hidraw3`.
    pub(super) name: String,
    /// Vendor and product id.
    pub(super) ids: (u16, u16),
}

/// A transport of HID reports.
pub(super) trait Reports: Send {
    /// Reads one report within `wait`. Returns its length, or 0 on timeout.
    fn read(&mut self, report: &mut [u8; REPORT], wait: Duration) -> Result<usize, Failure>;

    fn write(&mut self, report: &[u8; REPORT]) -> Result<(), Failure>;
}

/// A failed transfer of a report, or a failed open.
#[derive(Debug)]
pub(super) enum Failure {
    /// The device was disconnected.
    Gone,
    /// The device accepts no report within the timeout.
    Stuck,
    /// The user lacks permission to open the device.
    Denied,
    /// Any other error, with the system's message.
    Other(String),
}

impl Failure {
    /// The error on a device of this name, with these vendor and product ids.
    pub(super) fn on(self, name: &str, (vendor, product): (u16, u16)) -> Error {
        match self {
            Self::Gone => Error::lost(name, "device disconnected: was it unplugged, or switched off?"),
            Self::Stuck => Error::at(name, "write timeout: is the robot stuck?"),
            Self::Denied if cfg!(target_os = "linux") => {
                let reason = format_args!(
                    "permission denied: put 'KERNEL==\"hidraw*\", ATTRS{{idVendor}}==\"{vendor:04x}\", \
                     ATTRS{{idProduct}}==\"{product:04x}\", TAG+=\"uaccess\"' in /etc/udev/rules.d/70-alpha1.rules, run \
                     'sudo udevadm control --reload', and plug the robot in again"
                );
                Error::at(name, reason)
            }
            Self::Denied => Error::at(name, "permission denied: is it in use by another program?"),
            Self::Other(reason) => Error::lost(name, reason),
        }
    }
}
