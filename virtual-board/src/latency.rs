//! The adapter's latency: from the last stop bit on the arm's line to the packet at the host.
//!
//! The adapter passes bytes unchanged: the n-th byte from the arm is the n-th byte in the host. This is checked.

use crate::line::{Direction, LineByte, Outcome};
use crate::time::Nanos;
use crate::usb;
use crate::usb::host::Packet;

/// A burst of bytes from the arm, with the times of its last byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Burst {
    /// Number of bytes.
    pub bytes: usize,
    /// End of its last stop bit.
    pub last_stop: Nanos,
    /// Time at which the firmware had the packet with its last byte ready.
    pub armed: Nanos,
    /// Arrival of that packet in the host.
    pub arrived: Nanos,
}

impl Burst {
    /// From the last stop bit to the ready packet.
    pub const fn to_armed(&self) -> Nanos {
        self.armed.since(self.last_stop)
    }

    /// From the last stop bit to the packet in the host.
    pub const fn to_arrival(&self) -> Nanos {
        self.arrived.since(self.last_stop)
    }
}

/// The records do not match: a byte from the arm differs from the byte at its place in the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("byte {place} from the arm was {sent:#04x}, in the host it is {received:02x?}")]
pub struct Mismatch {
    /// Its index, from 0.
    pub place: usize,
    /// The byte sent by the arm.
    pub sent: u8,
    /// The byte received by the host, if any.
    pub received: Option<u8>,
}

/// The bursts of a run, from the records of the line and of the USB wire since the same quiet moment. A pause of more
/// than `pause` between two stop bits ends a burst.
///
/// # Errors
///
/// [`Mismatch`] at the first byte that was not received as sent.
pub fn bursts(line: &[LineByte], packets: &[Packet], pause: Nanos) -> Result<Vec<Burst>, Mismatch> {
    let mut received = packets
        .iter()
        .filter(|packet| packet.direction == usb::Direction::In)
        .flat_map(|packet| packet.data.iter().map(move |&byte| (byte, packet)));
    let sent = line
        .iter()
        .filter(|byte| byte.direction == Direction::ToBoard && byte.outcome == Outcome::Arrived);

    let mut bursts: Vec<Burst> = Vec::new();
    for (place, byte) in sent.enumerate() {
        let found = received.next();
        let Some((_, packet)) = found.filter(|&(value, _)| value == byte.sent) else {
            return Err(Mismatch {
                place,
                sent: byte.sent,
                received: found.map(|(value, _)| value),
            });
        };
        let so_far = match bursts.last() {
            Some(burst) if byte.at.since(burst.last_stop) <= pause => bursts.pop().map_or(0, |burst| burst.bytes),
            _ => 0,
        };
        bursts.push(Burst {
            bytes: so_far + 1,
            last_stop: byte.at,
            armed: packet.armed.unwrap_or(packet.start),
            arrived: packet.end,
        });
    }
    Ok(bursts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn byte(at: u64, sent: u8) -> LineByte {
        LineByte {
            at: Nanos(at),
            direction: Direction::ToBoard,
            sent,
            outcome: Outcome::Arrived,
        }
    }

    fn packet(armed: u64, end: u64, data: &[u8]) -> Packet {
        Packet {
            endpoint: 2,
            direction: usb::Direction::In,
            start: Nanos(armed),
            end: Nanos(end),
            armed: Some(Nanos(armed)),
            data: data.to_vec(),
        }
    }

    #[test]
    fn burst_is_timed_by_packet_of_last_byte() {
        let line = [byte(10, 1), byte(20, 2), byte(90, 3)];
        let packets = [packet(15, 30, &[1]), packet(25, 40, &[2]), packet(95, 99, &[3])];
        let bursts = bursts(&line, &packets, Nanos(15)).unwrap();
        let [first, second] = bursts[..] else {
            panic!("two bursts: {bursts:?}");
        };
        assert_eq!(
            (first.bytes, first.to_armed(), first.to_arrival()),
            (2, Nanos(5), Nanos(20))
        );
        assert_eq!(
            (second.bytes, second.to_armed(), second.to_arrival()),
            (1, Nanos(5), Nanos(9))
        );
    }

    #[test]
    fn undelivered_byte_is_named() {
        let mismatch = bursts(&[byte(10, 1), byte(20, 2)], &[packet(15, 30, &[1])], Nanos(15)).unwrap_err();
        assert_eq!((mismatch.place, mismatch.sent, mismatch.received), (1, 2, None));
    }
}
