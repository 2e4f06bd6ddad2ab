//! A data frame as a CAN controller sends and receives it (ISO 11898-1).

use core::fmt;

use armwire::OutOfRange;

/// Maximum number of bytes in a classic frame.
pub const MAX_CLASSIC: usize = 8;

/// Maximum number of bytes in an FD frame.
pub const MAX_FD: usize = 64;

/// Valid lengths of an FD frame, in bytes. The index is the frame's DLC (ISO 11898-1, table 5).
pub const FD_LENGTHS: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// Padding byte: a pattern with few stuff bits, as ISO 15765-2 recommends.
const PADDING: u8 = 0xCC;

/// An 11-bit identifier. Lower identifiers win arbitration.
///
/// ```
/// use armwire_bridge::can::Id;
///
/// assert_eq!(Id::new(0x7FF).unwrap().get(), 0x7FF);
/// assert_eq!(Id::new(0x123).unwrap().to_string(), "0x123");
/// assert_eq!(Id::new(0x800).unwrap_err().to_string(), "CAN identifier is 2048, must be 0..=2047");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Id(pub(super) u16);

impl Id {
    /// The highest identifier.
    pub const MAX: Self = Self(0x7FF);

    /// The identifier `id`, 0..=0x7FF.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] when it has more than 11 bits.
    pub const fn new(id: u16) -> Result<Self, OutOfRange> {
        if id > Self::MAX.0 {
            return Err(OutOfRange {
                what: "CAN identifier",
                unit: "",
                got: id,
                min: 0,
                max: Self::MAX.0,
            });
        }
        Ok(Self(id))
    }

    /// The identifier's 11 bits.
    pub const fn get(self) -> u16 {
        self.0
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:03X}", self.0)
    }
}

/// A data frame with an 11-bit identifier: classic, 0 to 8 bytes, or FD, one of [`FD_LENGTHS`].
///
/// ```
/// use armwire_bridge::can::{Frame, FrameError, Id};
///
/// let id = Id::new(0x123).unwrap();
/// let frame = Frame::new(id, b"joints").unwrap();
/// assert_eq!((frame.id(), frame.data(), frame.is_fd()), (id, &b"joints"[..], false));
///
/// assert!(Frame::new_fd(id, &[0; 12]).is_ok());
/// let error = Frame::new_fd(id, &[0; 13]).unwrap_err();
/// assert_eq!(error, FrameError { is_fd: true, got: 13 });
/// assert_eq!(error.to_string(), "13 bytes, an FD frame has 0..=8, 12, 16, 20, 24, 32, 48 or 64");
/// ```
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    id: Id,
    is_fd: bool,
    len: u8,
    /// Bytes after the first `len` are zero.
    bytes: [u8; MAX_FD],
}

impl Frame {
    /// A classic frame.
    ///
    /// # Errors
    ///
    /// [`FrameError`] for more than 8 bytes.
    pub fn new(id: Id, data: &[u8]) -> Result<Self, FrameError> {
        match Self::filled(id, data) {
            Some(frame) if data.len() <= MAX_CLASSIC => Ok(frame),
            _ => Err(FrameError {
                is_fd: false,
                got: data.len(),
            }),
        }
    }

    /// An FD frame.
    ///
    /// # Errors
    ///
    /// [`FrameError`] for a length that is not in [`FD_LENGTHS`].
    pub fn new_fd(id: Id, data: &[u8]) -> Result<Self, FrameError> {
        match Self::filled(id, data) {
            Some(frame) if FD_LENGTHS.contains(&frame.len) => Ok(Self { is_fd: true, ..frame }),
            _ => Err(FrameError {
                is_fd: true,
                got: data.len(),
            }),
        }
    }

    /// The identifier.
    pub const fn id(&self) -> Id {
        self.id
    }

    /// The data bytes.
    pub fn data(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or_default()
    }

    /// Returns true for an FD frame of any length.
    pub const fn is_fd(&self) -> bool {
        self.is_fd
    }

    /// A frame of `head` and as much of `body` as fits, padded to 8 bytes or the next valid length.
    pub(crate) fn padded(id: Id, is_fd: bool, head: &[u8], body: &[u8]) -> Self {
        let used = head.len().saturating_add(body.len());
        let fits = |&len: &u8| usize::from(len) >= used.max(MAX_CLASSIC);
        let len = match is_fd {
            true => FD_LENGTHS.into_iter().find(fits).unwrap_or(MAX_FD as u8),
            false => MAX_CLASSIC as u8,
        };
        let mut content = head.iter().chain(body);
        let mut bytes = [0; MAX_FD];
        for byte in bytes.iter_mut().take(usize::from(len)) {
            *byte = content.next().copied().unwrap_or(PADDING);
        }
        Self { id, is_fd, len, bytes }
    }

    /// A frame of any length up to the maximum.
    fn filled(id: Id, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; MAX_FD];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self {
            id,
            is_fd: false,
            len: data.len() as u8,
            bytes,
        })
    }
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.is_fd { " FD" } else { "" };
        write!(f, "{}{kind} {:02X?}", self.id, self.data())
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Frame {
    fn format(&self, f: defmt::Formatter<'_>) {
        let kind = if self.is_fd { " FD" } else { "" };
        defmt::write!(f, "{=u16:#05X}{=str} {=[u8]:02X}", self.id.0, kind, self.data());
    }
}

/// A number of bytes that no frame can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameError {
    /// True for an FD frame.
    pub is_fd: bool,
    /// Number of bytes given.
    pub got: usize,
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let expected = match self.is_fd {
            false => "a classic frame has 0..=8",
            true => "an FD frame has 0..=8, 12, 16, 20, 24, 32, 48 or 64",
        };
        write!(f, "{} bytes, {expected}", self.got)
    }
}

impl core::error::Error for FrameError {}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;
    use std::{format, vec};

    use super::*;

    const ID: Id = Id(0x123);

    #[test]
    fn frame_keeps_its_bytes() {
        for len in 0..=70 {
            let data = vec![0xA5; len];
            let (classic, fd) = (Frame::new(ID, &data), Frame::new_fd(ID, &data));
            assert_eq!(classic.is_ok(), len <= 8);
            assert_eq!(fd.is_ok(), FD_LENGTHS.contains(&(len as u8)));
            for (frame, is_fd) in [(classic, false), (fd, true)] {
                match frame {
                    Ok(frame) => assert_eq!((frame.data(), frame.is_fd()), (&data[..], is_fd)),
                    Err(error) => assert_eq!(error, FrameError { is_fd, got: len }),
                }
            }
        }
        assert_ne!(Frame::new(ID, &[0]), Frame::new(ID, &[0, 0]));
        assert_ne!(Frame::new(ID, &[0]), Frame::new_fd(ID, &[0]));
    }

    #[test]
    fn padded_frame_takes_as_much_as_fits() {
        for used in 1..=70 {
            let (head, body) = ([7], vec![1; used - 1]);
            for (is_fd, max) in [(false, MAX_CLASSIC), (true, MAX_FD)] {
                let frame = Frame::padded(ID, is_fd, &head, &body);
                let len = frame.data().len();
                assert_eq!(frame.is_fd(), is_fd);
                assert!(FD_LENGTHS.contains(&(len as u8)) && (8..=max).contains(&len));
                let content = used.min(max);
                let expected = [&head[..], &body[..content - 1], &vec![PADDING; len - content]].concat();
                assert_eq!(frame.data(), expected);
                // A shorter frame would not hold the data.
                let shorter = FD_LENGTHS.into_iter().rfind(|&shorter| usize::from(shorter) < len);
                assert!(len == 8 || usize::from(shorter.unwrap()) < content);
            }
        }
    }

    #[test]
    fn frame_prints_as_identifier_kind_and_bytes() {
        assert_eq!(format!("{:?}", Frame::new(ID, &[1, 0xAB]).unwrap()), "0x123 [01, AB]");
        assert_eq!(format!("{:?}", Frame::new_fd(ID, &[]).unwrap()), "0x123 FD []");
        let error = Frame::new(ID, &[0; 9]).unwrap_err();
        assert_eq!(error.to_string(), "9 bytes, a classic frame has 0..=8");
    }
}
