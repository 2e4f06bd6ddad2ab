//! A CAN frame on the bus (ISO 11898-1:2015), and its duration.
//!
//! ```
//! use armwire_sim::can::{BitTimes, Frame, Id, OnTheWire};
//!
//! let frame = Frame::fd_frame(Id::Standard(0x123), &[0; 64], true).unwrap();
//! let times = BitTimes::new(1_000_000, 5_000_000);
//! let time = frame.picoseconds(frame.bits_on_the_wire(), times);
//! assert_eq!(time, 26_000_000 + 652 * 200_000);
//! ```

mod bits;
#[cfg(test)]
mod tests;

pub use armwire_bridge::can::bus::{FdFlags, Frame, Id};
pub use bits::{
    BUS_IDLE_BITS, BitTimes, END_OF_FRAME_BITS, ERROR_DELIMITER_BITS, ERROR_FLAG_BITS, INTERMISSION_BITS, OnTheWire,
    SUSPEND_BITS,
};
