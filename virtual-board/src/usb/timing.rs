//! How long things take on a full-speed wire, 12 Mbit/s (USB 2.0, chapters 7 and 8).
//!
//! Stuffed bits are not counted: a packet with long runs of ones takes up to a seventh longer on a real wire.

use crate::time::Nanos;

/// A frame: what passes between two starts of frame.
pub const FRAME: Nanos = Nanos(1_000_000);

/// A token: SYNC 8, PID 8, address, endpoint and CRC 16, end of packet 3 (8.4.1). A start of frame is one too.
pub const TOKEN: Nanos = bits(35);

/// A handshake: SYNC 8, PID 8, end of packet 3 (8.4.5).
pub const HANDSHAKE: Nanos = bits(19);

/// What the one that has heard a packet takes before it answers: at most 6.5 bit times (7.1.18.1).
pub const TURNAROUND: Nanos = bits(7);

/// How long one that expects an answer waits before it gives up: 16 to 18 bit times (7.1.19.1).
pub const TIMEOUT: Nanos = bits(18);

/// How long before the end of a frame the wire has to be quiet (11.2.5, EOF1: 32 bit times).
pub const GUARD: Nanos = bits(32);

/// How long an idle bus lets a device believe that it is not being used (7.1.7.6).
pub const SUSPEND: Nanos = Nanos::from_millis(3);

/// How long a device must have been connected before it is reset (7.1.7.3, the debounce interval).
pub const DEBOUNCE: Nanos = Nanos::from_millis(100);

/// How long a reset lasts (7.1.7.5).
pub const RESET: Nanos = Nanos::from_millis(10);

/// What a device may take after a reset before it must answer (7.1.7.5).
pub const RESET_RECOVERY: Nanos = Nanos::from_millis(10);

/// What a device may take after it got its address before it must answer to it (9.2.6.3).
pub const ADDRESS_RECOVERY: Nanos = Nanos::from_millis(2);

/// How long the host drives a resume (7.1.7.7).
pub const RESUME: Nanos = Nanos::from_millis(20);

/// A data packet with `length` bytes: SYNC 8, PID 8, data, CRC 16, end of packet 3 (8.4.4).
pub const fn data(length: usize) -> Nanos {
    bits(35 + 8 * length as u64)
}

/// The time `count` bits take.
const fn bits(count: u64) -> Nanos {
    Nanos(count * 1_000 / 12)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_packet_takes_what_the_specification_says() {
        // Table 5-9: a 64-byte bulk transaction occupies 77 bytes of a frame, of 1500: 51.3 us, bus turnaround included.
        let transaction = TOKEN + data(64) + TURNAROUND + HANDSHAKE;
        assert!((50_000..52_000).contains(&transaction.0), "{transaction}");
    }
}
