//! The cable between the adapter and the arm: single bytes on it can be damaged, and it can be unplugged.

use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;
use armwire_virtual_board::line::Direction;

use super::super::TicketArm;

/// Damage to a byte that a UART cannot detect.
#[derive(Clone, Copy, Debug)]
pub(super) enum Damage {
    /// The byte is lost.
    Drop,
    /// The byte arrives twice.
    Duplicate,
    /// The byte and all later bytes are delayed. Only for bytes from the arm.
    Delay(Duration),
    /// The bits set in this mask are flipped.
    Corrupt(u8),
}

/// A [`TicketArm`] at the end of a cable.
#[derive(Debug)]
pub(super) struct Cable {
    pub(super) arm: TicketArm,
    /// True while unplugged: the bytes of both sides are lost.
    pub(super) is_out: bool,
    /// The damage of the byte in this direction that follows this number of others.
    pub(super) plan: Option<(Direction, u32, Damage)>,
    /// A delayed or repeated byte, sent at this time before all others.
    ahead: Option<(Instant, u8)>,
}

impl Cable {
    /// A connected cable.
    pub(super) fn new(arm: TicketArm) -> Self {
        Self {
            arm,
            is_out: false,
            plan: None,
            ahead: None,
        }
    }

    /// The damage for the next byte in this direction.
    fn take_damage(&mut self, direction: Direction) -> Option<Damage> {
        let (_, after, damage) = self.plan.as_mut().filter(|plan| plan.0 == direction)?;
        if let Some(left) = after.checked_sub(1) {
            *after = left;
            return None;
        }
        let damage = *damage;
        self.plan = None;
        Some(damage)
    }
}

impl SerialDevice for Cable {
    fn receive(&mut self, now: Instant, byte: u8) {
        if self.is_out {
            return;
        }
        match self.take_damage(Direction::ToArm) {
            Some(Damage::Drop) => {}
            Some(Damage::Duplicate) => {
                self.arm.receive(now, byte);
                self.arm.receive(now, byte);
            }
            Some(Damage::Corrupt(mask)) => self.arm.receive(now, byte ^ mask),
            Some(Damage::Delay(_)) | None => self.arm.receive(now, byte),
        }
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        if let Some((due, byte)) = self.ahead {
            if due > now {
                return None;
            }
            self.ahead = None;
            return (!self.is_out).then_some(byte);
        }
        while let Some(byte) = self.arm.transmit(now) {
            if self.is_out {
                continue;
            }
            match self.take_damage(Direction::ToBoard) {
                None => return Some(byte),
                Some(Damage::Drop) => {}
                Some(Damage::Duplicate) => {
                    self.ahead = Some((now, byte));
                    return Some(byte);
                }
                Some(Damage::Delay(span)) => {
                    self.ahead = Some((now + span, byte));
                    return None;
                }
                Some(Damage::Corrupt(mask)) => return Some(byte ^ mask),
            }
        }
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self.ahead {
            Some((due, _)) => Some(due),
            None => self.arm.poll_timeout(),
        }
    }
}
