//! What Windows reads to take its own driver, WinUSB, for the control interface without being told by the user: Microsoft
//! OS 2.0 Descriptors Specification.

use super::CONTROL_INTERFACE;

/// The vendor request by which Windows reads [`DESCRIPTORS`], and the index it asks with (table 8).
pub(super) const REQUEST: (u8, u16) = (0x20, 7);

/// The type of [`CAPABILITY`] in the binary object store (USB 3.2, table 9-14).
pub(super) const PLATFORM: u8 = 5;

/// The oldest version of Windows that can read all this: 8.1.
const VERSION: [u16; 2] = [0, 0x0603];

/// What programs look for to find the control interface.
const INTERFACE: &str = "{4C757248-7066-47AD-9A38-E3D4ADFA1B0A}\0\0";

/// The name of that in the registry, and its type, `REG_MULTI_SZ`.
const PROPERTY: &str = "DeviceInterfaceGUIDs\0";
const STRINGS: u16 = 7;

/// The types of descriptors (table 9).
const SET: u16 = 0;
const CONFIGURATION: u16 = 1;
const FUNCTION: u16 = 2;
const COMPATIBLE_ID: u16 = 3;
const REGISTRY_PROPERTY: u16 = 4;

/// The lengths of descriptors and of what they begin with, in bytes (tables 10 to 15).
const SET_LEN: usize = 10;
const SUBSET_LEN: usize = 8;
const COMPATIBLE_ID_LEN: usize = 20;
const REGISTRY_PROPERTY_LEN: usize = 10 + 2 * (PROPERTY.len() + INTERFACE.len());
const FUNCTION_LEN: usize = SUBSET_LEN + COMPATIBLE_ID_LEN + REGISTRY_PROPERTY_LEN;
const LEN: usize = SET_LEN + SUBSET_LEN + FUNCTION_LEN;

/// The descriptor set.
pub(super) static DESCRIPTORS: [u8; LEN] = {
    let mut set = Set::new();
    set.words(&[SET_LEN as u16, SET, VERSION[0], VERSION[1], LEN as u16]);
    // The first configuration has number 0 here.
    set.words(&[SUBSET_LEN as u16, CONFIGURATION, 0, (SUBSET_LEN + FUNCTION_LEN) as u16]);
    set.words(&[
        SUBSET_LEN as u16,
        FUNCTION,
        CONTROL_INTERFACE as u16,
        FUNCTION_LEN as u16,
    ]);
    set.words(&[COMPATIBLE_ID_LEN as u16, COMPATIBLE_ID]);
    set.bytes(b"WINUSB\0\0");
    set.bytes(&[0; 8]);
    set.words(&[REGISTRY_PROPERTY_LEN as u16, REGISTRY_PROPERTY, STRINGS]);
    set.words(&[2 * PROPERTY.len() as u16]);
    set.text(PROPERTY);
    set.words(&[2 * INTERFACE.len() as u16]);
    set.text(INTERFACE);
    assert!(set.len == LEN);
    set.bytes
};

/// Says that there is a descriptor set, behind the header of a device capability (tables 4 and 5).
pub(super) static CAPABILITY: [u8; 25] = [
    0, // reserved
    // MS_OS_20_Platform_Capability_ID
    0xDF,
    0x60,
    0xDD,
    0xD8,
    0x89,
    0x45,
    0xC7,
    0x4C,
    0x9C,
    0xD2,
    0x65,
    0x9D,
    0x9E,
    0x64,
    0x8A,
    0x9F,
    VERSION[0].to_le_bytes()[0],
    VERSION[0].to_le_bytes()[1],
    VERSION[1].to_le_bytes()[0],
    VERSION[1].to_le_bytes()[1],
    (LEN as u16).to_le_bytes()[0],
    (LEN as u16).to_le_bytes()[1],
    REQUEST.0,
    0, // there are no other descriptors to switch to
];

/// A descriptor set that is being written, when this is compiled.
struct Set {
    bytes: [u8; LEN],
    len: usize,
}

impl Set {
    const fn new() -> Self {
        Self {
            bytes: [0; LEN],
            len: 0,
        }
    }

    const fn bytes(&mut self, bytes: &[u8]) {
        let (_, rest) = self.bytes.split_at_mut(self.len);
        let (to, _) = rest.split_at_mut(bytes.len());
        to.copy_from_slice(bytes);
        self.len += bytes.len();
    }

    const fn words(&mut self, mut words: &[u16]) {
        while let [word, rest @ ..] = words {
            self.bytes(&word.to_le_bytes());
            words = rest;
        }
    }

    /// ASCII as UTF-16.
    const fn text(&mut self, text: &str) {
        let mut text = text.as_bytes();
        while let [byte, rest @ ..] = text {
            self.words(&[*byte as u16]);
            text = rest;
        }
    }
}
