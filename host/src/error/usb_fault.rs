//! The reason why a control port on USB cannot be used.

use std::fmt::{self, Display, Formatter};

use crate::error::outside::Outside;

/// USB vendor and product id of the adapter. They are the test ids of pid.codes: other devices may have them, too.
pub const VENDOR_AND_PRODUCT: (u16, u16) = (0x1209, 0x0001);

/// The reason why a control port on USB cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum UsbFault {
    /// The system does not allow it to this user.
    PermissionDenied,
    /// Another program has the port, or another object of this one.
    Busy,
    /// The adapter was disconnected.
    Disconnected,
    /// The system has this reason.
    Other(Outside),
}

impl Display for UsbFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::PermissionDenied if cfg!(target_os = "linux") => {
                let (vendor, product) = VENDOR_AND_PRODUCT;
                write!(
                    f,
                    "permission denied for the control port: put 'SUBSYSTEM==\"usb\", ATTR{{idVendor}}==\"{vendor:04x}\", \
                     ATTR{{idProduct}}==\"{product:04x}\", TAG+=\"uaccess\"' in /etc/udev/rules.d/70-armwire.rules, run \
                     'sudo udevadm control --reload', and plug the adapter in again"
                )
            }
            Self::PermissionDenied => f.write_str("permission denied for the control port"),
            Self::Busy => {
                f.write_str("the control port is in use, by another program or by this one: close that use first")
            }
            Self::Disconnected => f.write_str("the adapter was disconnected: was it unplugged?"),
            Self::Other(reason) => write!(f, "the control port cannot be opened: {reason}"),
        }
    }
}
