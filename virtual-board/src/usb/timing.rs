//! Durations on a full-speed wire, 12 Mbit/s (USB 2.0, chapters 7 and 8).
//!
//! Stuffed bits are not counted: a packet with long runs of ones takes up to a seventh longer on a real wire.

use crate::time::Nanos;

/// A frame: the time between two starts of frame.
pub const FRAME: Nanos = Nanos(1_000_000);

/// A token: SYNC 8, PID 8, address, endpoint and CRC 16, end of packet 3 (8.4.1). A start of frame is one too.
pub const TOKEN: Nanos = bits(35);

/// A handshake: SYNC 8, PID 8, end of packet 3 (8.4.5).
pub const HANDSHAKE: Nanos = bits(19);

/// The turnaround time of the receiver of a packet: at most 6.5 bit times (7.1.18.1).
pub const TURNAROUND: Nanos = bits(7);

/// The timeout for an answer: 16 to 18 bit times (7.1.19.1).
pub const TIMEOUT: Nanos = bits(18);

/// The quiet time before the end of a frame (11.2.5, EOF1: 32 bit times).
pub const GUARD: Nanos = bits(32);

/// The idle time after which a device suspends (7.1.7.6).
pub const SUSPEND: Nanos = Nanos::from_millis(3);

/// The minimum time between connect and reset (7.1.7.3, the debounce interval).
pub const DEBOUNCE: Nanos = Nanos::from_millis(100);

/// The duration of a reset (7.1.7.5).
pub const RESET: Nanos = Nanos::from_millis(10);

/// The recovery time of a device after a reset (7.1.7.5).
pub const RESET_RECOVERY: Nanos = Nanos::from_millis(10);

/// The recovery time of a device after SET_ADDRESS (9.2.6.3).
pub const ADDRESS_RECOVERY: Nanos = Nanos::from_millis(2);

/// The duration of a resume (7.1.7.7).
pub const RESUME: Nanos = Nanos::from_millis(20);

/// A data packet with `length` bytes: SYNC 8, PID 8, data, CRC 16, end of packet 3 (8.4.4).
pub const fn data(length: usize) -> Nanos {
    bits(35 + 8 * length as u64)
}

/// The duration of `count` bits.
const fn bits(count: u64) -> Nanos {
    Nanos(count * 1_000 / 12)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_packet_takes_the_specified_time() {
        // Table 5-9: a 64-byte bulk transaction occupies 77 bytes of a frame, of 1500: 51.3 us, including bus
        // turnaround.
        let transaction = TOKEN + data(64) + TURNAROUND + HANDSHAKE;
        assert!((50_000..52_000).contains(&transaction.0), "{transaction}");
    }
}
