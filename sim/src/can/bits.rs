//! The bits of a frame including stuff bits, and their duration (ISO 11898-1:2015, 10.4 and 10.5).
//!
//! | Part | Stuff bits | Rate |
//! |---|---|---|
//! | Start of frame to data, classic; and the CRC sequence of 15 bits | after five equal bits | nominal |
//! | Start of frame to BRS, FD | after five equal bits | nominal |
//! | ESI to data, FD | after five equal bits | data, if BRS is recessive |
//! | Stuff count of 4 bits, CRC sequence of 17 bits (up to 16 bytes) or 21, FD | one before, one after each four bits | the same |
//! | CRC delimiter | none | the same |
//! | Acknowledge slot and delimiter, end of frame | none | nominal |
//!
//! The rate switches at the sample points of BRS and of the CRC delimiter. BRS is therefore shorter than a nominal bit,
//! and the CRC delimiter is longer than a data bit by the same time. This model counts BRS as a whole nominal bit and
//! the delimiter as a whole data bit. Times outside the data phase are exact; times within it are late by less than a
//! nominal bit.
//!
//! An FD frame's stuff count and CRC sequence have fixed stuff bits, so their values do not change its length.

use std::cmp::Ordering;

use super::{Frame, Id};

/// Bits of the end of frame.
pub const END_OF_FRAME_BITS: u32 = 7;
/// Bits of the intermission, before the next frame.
pub const INTERMISSION_BITS: u32 = 3;
/// Bits of an error flag.
pub const ERROR_FLAG_BITS: u32 = 6;
/// Bits of the delimiter after error flags.
pub const ERROR_DELIMITER_BITS: u32 = 8;
/// Bits that an error passive sender waits after the intermission.
pub const SUSPEND_BITS: u32 = 8;
/// Recessive bits after which the bus is idle to a node that joins it.
pub const BUS_IDLE_BITS: u32 = 11;

/// Number of equal bits that are followed by a stuff bit.
const STUFF_RUN: u32 = 5;
/// The generator polynomial of the CRC sequence of classic frames, without its highest bit.
const CRC_15: u16 = 0x4599;
const CRC_15_BITS: u32 = 15;
const STUFF_COUNT_BITS: u32 = 4;
/// Longest data of an FD frame with a CRC sequence of 17 bits.
const MAX_CRC_17: usize = 16;
/// The CRC delimiter, the acknowledge slot and the acknowledge delimiter.
const DELIMITERS_AND_SLOT: u32 = 3;

/// Bit times of a node, in picoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitTimes {
    /// Arbitration phase.
    pub nominal: u64,
    /// Data phase of a frame with bit rate switching.
    pub data: u64,
}

impl BitTimes {
    /// Computes the bit times of rates in bits per second. A rate of 0 counts as 1.
    pub fn new(rate: u32, data_rate: u32) -> Self {
        let bit = |rate: u32| 1_000_000_000_000 / u64::from(rate.max(1));
        Self {
            nominal: bit(rate),
            data: bit(data_rate),
        }
    }
}

/// The bits of a frame on the wire, and their duration.
pub trait OnTheWire {
    /// Compares two frames in arbitration. [`Ordering::Less`] wins the bus; [`Ordering::Equal`] means equal arbitration
    /// bits. A classic frame wins against an FD frame with the same identifier: its FDF bit is dominant.
    fn arbitrates(&self, other: &Self) -> Ordering;

    /// Returns the number of bits from the start of frame to the end of the CRC sequence and its fixed stuff bits.
    fn bits_before_crc_delimiter(&self) -> u32;

    /// Returns the number of bits from the start of frame to the acknowledge slot, inclusive.
    fn bits_through_acknowledge(&self) -> u32;

    /// Returns the number of bits from the start of frame to the last but one of the end of frame: the receiver accepts
    /// it then.
    fn bits_until_valid(&self) -> u32;

    /// Returns the number of bits from the start of frame to the last of the end of frame: transmission is complete
    /// then.
    fn bits_on_the_wire(&self) -> u32;

    /// Returns the duration of the first `bits` bits, in picoseconds.
    fn picoseconds(&self, bits: u32, times: BitTimes) -> u64;
}

impl OnTheWire for Frame {
    fn arbitrates(&self, other: &Self) -> Ordering {
        arbitration(self).cmp(&arbitration(other))
    }

    fn bits_before_crc_delimiter(&self) -> u32 {
        if self.fd.is_none() {
            return stuffed(checked(self).into_iter().chain(crc_15(&checked(self))), true);
        }
        let crc = STUFF_COUNT_BITS + if self.payload().len() <= MAX_CRC_17 { 17 } else { 21 };
        // Five equal bits before the first fixed stuff bit get no further stuff bit.
        stuffed(checked(self), false) + 1 + crc + crc / 4
    }

    fn bits_through_acknowledge(&self) -> u32 {
        self.bits_before_crc_delimiter() + 2
    }

    fn bits_until_valid(&self) -> u32 {
        self.bits_on_the_wire() - 1
    }

    fn bits_on_the_wire(&self) -> u32 {
        self.bits_before_crc_delimiter() + DELIMITERS_AND_SLOT + END_OF_FRAME_BITS
    }

    fn picoseconds(&self, bits: u32, times: BitTimes) -> u64 {
        let (start, end) = data_phase(self);
        let fast = bits.clamp(start, end) - start;
        u64::from(bits - fast) * times.nominal + u64::from(fast) * times.data
    }
}

/// Returns the first bit of the data phase, and the first after it. Equal without a data phase.
fn data_phase(frame: &Frame) -> (u32, u32) {
    if !frame.switches_bit_rate() {
        return (0, 0);
    }
    (
        stuffed(through_brs(frame), false),
        frame.bits_before_crc_delimiter() + 1,
    )
}

/// Returns the arbitration field, with the bit that distinguishes FD frames from classic ones.
fn arbitration(frame: &Frame) -> Vec<bool> {
    let mut bits = Vec::with_capacity(33);
    match frame.id {
        Id::Standard(id) => {
            push(&mut bits, id.into(), 11);
            // RTR or RRS, IDE.
            bits.extend([frame.remote, false]);
        }
        Id::Extended(id) => {
            push(&mut bits, id >> 18, 11);
            // SRR, IDE.
            bits.extend([true, true]);
            push(&mut bits, id & 0x3_FFFF, 18);
            bits.push(frame.remote);
        }
    }
    bits.push(frame.fd.is_some());
    bits
}

/// Returns the bits from the start of frame to BRS, or to the bit before the DLC of a classic frame.
fn through_brs(frame: &Frame) -> Vec<bool> {
    let mut bits = vec![false];
    bits.extend(arbitration(frame));
    match (frame.fd, frame.id) {
        (Some(flags), _) => bits.extend([false, flags.bit_rate_switch]),
        // r0 follows r1.
        (None, Id::Extended(_)) => bits.push(false),
        (None, Id::Standard(_)) => {}
    }
    bits
}

/// Returns the bits from the start of frame to the end of the data.
fn checked(frame: &Frame) -> Vec<bool> {
    let mut bits = through_brs(frame);
    bits.extend(frame.fd.map(|flags| flags.error_passive));
    push(&mut bits, frame.dlc.into(), 4);
    for byte in frame.payload() {
        push(&mut bits, u32::from(*byte), 8);
    }
    bits
}

/// Appends the low `width` bits of `value`, the highest first.
fn push(bits: &mut Vec<bool>, value: u32, width: u32) {
    bits.extend((0..width).rev().map(|bit| value >> bit & 1 == 1));
}

/// Computes the CRC sequence of a classic frame.
fn crc_15(bits: &[bool]) -> Vec<bool> {
    let step = |crc: u16, &bit: &bool| {
        let next = crc << 1 & 0x7FFF;
        if (crc >> (CRC_15_BITS - 1) & 1 == 1) != bit {
            next ^ CRC_15
        } else {
            next
        }
    };
    let mut sequence = Vec::new();
    push(&mut sequence, bits.iter().fold(0, step).into(), CRC_15_BITS);
    sequence
}

/// Counts bits with their stuff bits. `at_end`: five equal bits at the end are followed by a stuff bit, too.
fn stuffed(bits: impl IntoIterator<Item = bool>, at_end: bool) -> u32 {
    let (mut count, mut run, mut last) = (0, 0, None);
    for bit in bits {
        if run == STUFF_RUN {
            (count, run, last) = (count + 1, 1, last.map(|last: bool| !last));
        }
        count += 1;
        run = if last == Some(bit) { run + 1 } else { 1 };
        last = Some(bit);
    }
    count + u32::from(at_end && run == STUFF_RUN)
}
