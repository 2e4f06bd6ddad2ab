//! The message RAM of an FDCAN (RM0440, 44.3.3): the places of filters, FIFOs and buffers, and the format of a frame.

use armwire_bridge::can::MAX_FD;
use armwire_sim::can::{FdFlags, Frame, Id};

use crate::soc::peripheral::field;

/// Size of the RAM of one FDCAN, in bytes.
pub(super) const SIZE: usize = 0x350;

/// The start of each section, and numbers of elements.
const STANDARD_FILTERS: usize = 0x000;
pub(super) const STANDARD_FILTER_COUNT: u32 = 28;
const FIFOS: [usize; 2] = [0x0B0, 0x188];
const TRANSMIT_BUFFERS: usize = 0x278;
/// Number of elements of a FIFO, and of transmit buffers.
pub(super) const DEPTH: usize = 3;

/// Size of an element with a frame, in bytes: two words of header, then the data.
const ELEMENT: usize = 8 + MAX_FD;

/// First word of a frame.
mod header {
    pub(super) const ESI: u32 = 1 << 31;
    pub(super) const XTD: u32 = 1 << 30;
    pub(super) const RTR: u32 = 1 << 29;
    pub(super) const STANDARD_ID_AT: u32 = 18;
    pub(super) const STANDARD_ID: u32 = 0x7FF;
    pub(super) const EXTENDED_ID: u32 = 0x1FFF_FFFF;
}

/// Second word of a frame.
mod kind {
    pub(super) const DLC_AT: u32 = 16;
    pub(super) const DLC: u32 = 0xF;
    pub(super) const BRS: u32 = 1 << 20;
    pub(super) const FDF: u32 = 1 << 21;
    /// In a transmit buffer: store an event in the transmit event FIFO.
    pub(super) const EFC: u32 = 1 << 23;
    /// In a receive FIFO: the matching filter, or none.
    pub(super) const FIDX_AT: u32 = 24;
    pub(super) const ANMF: u32 = 1 << 31;
}

/// The action for a frame whose identifier matches a filter (SFEC).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// The filter is disabled.
    None,
    /// Store in this FIFO.
    Store(usize),
    Reject,
}

/// A filter for identifiers of 11 bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filter(u32);

impl Filter {
    /// Returns true if it matches the identifier (SFT).
    pub(super) fn matches(self, id: u32) -> bool {
        let (first, second) = (field(self.0, 16, 0x7FF), field(self.0, 0, 0x7FF));
        match field(self.0, 30, 0b11) {
            0b00 => (first..=second).contains(&id),
            0b01 => id == first || id == second,
            0b10 => id & second == first & second,
            _ => false,
        }
    }

    pub(super) fn action(self) -> Action {
        match field(self.0, 27, 0b111) {
            0b001 | 0b101 => Action::Store(0),
            0b010 | 0b110 => Action::Store(1),
            0b011 => Action::Reject,
            _ => Action::None,
        }
    }
}

/// The RAM. No reset clears it.
#[derive(Clone, Debug)]
pub(super) struct Ram([u8; SIZE]);

impl Default for Ram {
    fn default() -> Self {
        Self([0; SIZE])
    }
}

impl Ram {
    /// Reads a word. `None` beyond the end.
    pub(super) fn read(&self, offset: u32) -> Option<u32> {
        let bytes = self.0.get(offset as usize..offset as usize + 4)?;
        Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    /// Writes a word. `None` beyond the end.
    pub(super) fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        let bytes = self.0.get_mut(offset as usize..offset as usize + 4)?;
        bytes.copy_from_slice(&value.to_le_bytes());
        Some(())
    }

    fn word(&self, offset: usize) -> u32 {
        self.read(offset as u32).unwrap_or(0)
    }

    pub(super) fn standard_filter(&self, number: u32) -> Filter {
        Filter(self.word(STANDARD_FILTERS + 4 * number as usize))
    }

    /// The frame in a transmit buffer. `fd` and `switch` are true if the controller sends FD frames, and switches the
    /// bit rate in the data phase (FDOE and BRSE).
    pub(super) fn frame_to_send(&self, buffer: usize, fd: bool, switch: bool) -> Frame {
        let start = TRANSMIT_BUFFERS + buffer * ELEMENT;
        let (header, kind) = (self.word(start), self.word(start + 4));
        let id = if header & header::XTD != 0 {
            Id::Extended(header & header::EXTENDED_ID)
        } else {
            Id::Standard(field(header, header::STANDARD_ID_AT, header::STANDARD_ID) as u16)
        };
        let dlc = field(kind, kind::DLC_AT, kind::DLC) as u8;
        let data = &self.0[start + 8..start + ELEMENT];
        if fd && kind & kind::FDF != 0 {
            let flags = FdFlags {
                bit_rate_switch: switch && kind & kind::BRS != 0,
                error_passive: header & header::ESI != 0,
            };
            Frame::fd(id, flags, dlc, data)
        } else {
            Frame::classic(id, header & header::RTR != 0, dlc, data)
        }
    }

    /// Returns true if a transmit buffer requests an event in the transmit event FIFO.
    pub(super) fn wants_event(&self, buffer: usize) -> bool {
        self.word(TRANSMIT_BUFFERS + buffer * ELEMENT + 4) & kind::EFC != 0
    }

    /// Stores a received frame in an element of a FIFO, with the matching filter.
    pub(super) fn store(&mut self, fifo: usize, place: usize, frame: &Frame, filter: Option<u32>) {
        let start = FIFOS[fifo] + place * ELEMENT;
        let id = match frame.id {
            Id::Standard(id) => u32::from(id) << header::STANDARD_ID_AT,
            Id::Extended(id) => id | header::XTD,
        };
        let when = |set, bit| if set { bit } else { 0 };
        let flags = frame.fd.unwrap_or_default();
        let words = [
            id | when(frame.remote, header::RTR) | when(flags.error_passive, header::ESI),
            u32::from(frame.dlc) << kind::DLC_AT
                | when(frame.fd.is_some(), kind::FDF)
                | when(flags.bit_rate_switch, kind::BRS)
                | filter.map_or(kind::ANMF, |number| number << kind::FIDX_AT),
        ];
        for (at, byte) in (start..).zip(words.iter().flat_map(|word| word.to_le_bytes())) {
            self.0[at] = byte;
        }
        let data = frame.payload();
        self.0[start + 8..][..data.len()].copy_from_slice(data);
    }
}
