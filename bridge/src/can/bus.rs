//! Any frame on a CAN bus (ISO 11898-1:2015): classic or FD, with an identifier of 11 or 29 bits.
//!
//! The adapter's [`Frame`](super::Frame) covers a subset: data frames with an 11-bit identifier.

use super::{FD_LENGTHS, MAX_CLASSIC, MAX_FD};

/// An identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Id {
    /// 11 bits, 0..=0x7FF.
    Standard(u16),
    /// 29 bits, 0..=0x1FFF_FFFF.
    Extended(u32),
}

impl Id {
    /// The largest 29-bit identifier.
    pub const MAX_EXTENDED: u32 = 0x1FFF_FFFF;

    /// Returns the numeric value.
    pub const fn value(self) -> u32 {
        match self {
            Self::Standard(id) => id as u32,
            Self::Extended(id) => id,
        }
    }
}

/// The flags that only FD frames have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FdFlags {
    /// BRS: the data phase has a separate bit rate.
    pub bit_rate_switch: bool,
    /// ESI: the sender is error passive.
    pub error_passive: bool,
}

/// A frame on a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The identifier.
    pub id: Id,
    /// RTR: the frame requests a data frame. Always false in an FD frame.
    pub remote: bool,
    /// The flags of an FD frame, `None` for a classic one.
    pub fd: Option<FdFlags>,
    /// The data length code, 0..=15.
    pub dlc: u8,
    /// The data, zero after the [`payload`](Self::payload).
    pub data: [u8; MAX_FD],
}

impl Frame {
    /// Creates a classic data frame. `None` if `data` has more than eight bytes.
    pub fn data_frame(id: Id, data: &[u8]) -> Option<Self> {
        (data.len() <= MAX_CLASSIC).then(|| Self::classic(id, false, data.len() as u8, data))
    }

    /// Creates a remote frame with this `dlc`.
    pub fn remote_frame(id: Id, dlc: u8) -> Self {
        Self::classic(id, true, dlc, &[])
    }

    /// Creates a classic frame from a controller's registers: `dlc` is 0..=15. Data after the payload is not
    /// transmitted.
    pub fn classic(id: Id, remote: bool, dlc: u8, data: &[u8]) -> Self {
        let frame = Self {
            id,
            remote,
            fd: None,
            dlc: dlc & 0xF,
            data: [0; MAX_FD],
        };
        frame.filled(data)
    }

    /// Creates an FD frame. `None` if FD has no such length.
    pub fn fd_frame(id: Id, data: &[u8], bit_rate_switch: bool) -> Option<Self> {
        let dlc = FD_LENGTHS.iter().position(|&len| usize::from(len) == data.len())?;
        let flags = FdFlags {
            bit_rate_switch,
            error_passive: false,
        };
        Some(Self::fd(id, flags, dlc as u8, data))
    }

    /// Creates an FD frame from a controller's message RAM: `dlc` is 0..=15. Data after the payload is not transmitted.
    pub fn fd(id: Id, flags: FdFlags, dlc: u8, data: &[u8]) -> Self {
        let frame = Self {
            fd: Some(flags),
            ..Self::classic(id, false, dlc, &[])
        };
        frame.filled(data)
    }

    /// Returns the transmitted data: none in a remote frame, eight bytes in a classic frame with a DLC above eight.
    pub fn payload(&self) -> &[u8] {
        self.data.get(..self.len()).unwrap_or(&self.data)
    }

    /// Returns true if the data phase has a separate bit rate.
    pub fn switches_bit_rate(&self) -> bool {
        self.fd.is_some_and(|flags| flags.bit_rate_switch)
    }

    /// Converts to a frame of the adapter. `None` for a remote frame or a 29-bit identifier.
    pub fn to_adapter(&self) -> Option<super::Frame> {
        let Id::Standard(id) = self.id else {
            return None;
        };
        let id = super::Id::new(id).ok()?;
        match (self.fd, self.remote) {
            (Some(_), _) => super::Frame::new_fd(id, self.payload()).ok(),
            (None, false) => super::Frame::new(id, self.payload()).ok(),
            (None, true) => None,
        }
    }

    fn len(&self) -> usize {
        let len = fd_length(self.dlc);
        match (self.fd, self.remote) {
            (Some(_), _) => len,
            (None, false) => len.min(MAX_CLASSIC),
            (None, true) => 0,
        }
    }

    fn filled(mut self, data: &[u8]) -> Self {
        let len = self.len();
        for (byte, value) in self.data.iter_mut().take(len).zip(data) {
            *byte = *value;
        }
        self
    }
}

/// Converts a frame of the adapter. An FD frame switches the bit rate.
impl From<super::Frame> for Frame {
    fn from(frame: super::Frame) -> Self {
        let (id, data) = (Id::Standard(frame.id().get()), frame.data());
        // The DLC of a valid length of either kind is its place.
        let dlc = FD_LENGTHS
            .iter()
            .take_while(|&&len| usize::from(len) < data.len())
            .count() as u8;
        let flags = FdFlags {
            bit_rate_switch: true,
            error_passive: false,
        };
        match frame.is_fd() {
            true => Self::fd(id, flags, dlc, data),
            false => Self::classic(id, false, dlc, data),
        }
    }
}

/// Length of an FD frame with this DLC. Only the lowest four bits count.
pub(crate) fn fd_length(dlc: u8) -> usize {
    FD_LENGTHS.get(usize::from(dlc & 0xF)).map_or(0, |&len| len.into())
}
