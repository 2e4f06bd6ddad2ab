//! The cable between the adapter and the arm: single bytes on it can be damaged, and it can be pulled out.

use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;

use super::super::TicketArm;

/// The direction of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From the arm to the adapter.
    FromArm,
    /// From the adapter to the arm.
    ToArm,
}

/// Damage to a byte that a UART cannot detect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
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
pub struct Cable {
    arm: TicketArm,
    is_out: bool,
    plan: Option<(Way, u32, Damage)>,
    /// A delayed or repeated byte, sent at this time before all others.
    ahead: Option<(Instant, u8)>,
    /// Number of damaged bytes.
    hits: u32,
}

impl Cable {
    /// A connected cable.
    pub fn new(arm: TicketArm) -> Self {
        Self {
            arm,
            is_out: false,
            plan: None,
            ahead: None,
            hits: 0,
        }
    }

    /// The arm.
    pub fn arm(&mut self) -> &mut TicketArm {
        &mut self.arm
    }

    /// Damages the byte in this direction that follows `after` others.
    pub fn damage(&mut self, way: Way, after: u32, damage: Damage) {
        self.plan = Some((way, after, damage));
    }

    /// Number of damaged bytes so far.
    pub fn hits(&self) -> u32 {
        self.hits
    }

    /// Unplugs or plugs the cable. Unplugged, it loses the bytes of both sides.
    pub fn set_out(&mut self, is_out: bool) {
        self.is_out = is_out;
    }

    /// The damage for the next byte in this direction.
    fn take_damage(&mut self, way: Way) -> Option<Damage> {
        match &mut self.plan {
            Some((planned, after, _)) if *planned == way && *after > 0 => {
                *after -= 1;
                None
            }
            Some((planned, _, damage)) if *planned == way => {
                let damage = *damage;
                self.plan = None;
                self.hits += 1;
                Some(damage)
            }
            _ => None,
        }
    }
}

impl SerialDevice for Cable {
    fn receive(&mut self, now: Instant, byte: u8) {
        if self.is_out {
            return;
        }
        match self.take_damage(Way::ToArm) {
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
            match self.take_damage(Way::FromArm) {
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
