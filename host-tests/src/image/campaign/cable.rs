//! The cable between the adapter and the arm: single bytes on it can be damaged, and it can be pulled out.

use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;

use super::super::TicketArm;

/// Which way a byte goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From the arm to the adapter.
    FromArm,
    /// From the adapter to the arm.
    ToArm,
}

/// What happens to a byte, which no UART notices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// It is lost.
    Drop,
    /// It arrives twice.
    Duplicate,
    /// It, and so what follows it, is so much later. Only on the way from the arm.
    Delay(Duration),
    /// Some of its bits, those that are set here, are flipped.
    Corrupt(u8),
}

/// A [`TicketArm`] at the end of a cable.
#[derive(Debug)]
pub struct Cable {
    arm: TicketArm,
    is_out: bool,
    plan: Option<(Way, u32, Damage)>,
    /// What goes before all else that the arm says, and from when on.
    ahead: Option<(Instant, u8)>,
    /// Bytes that were damaged.
    hits: u32,
}

impl Cable {
    /// A cable that is in.
    pub fn new(arm: TicketArm) -> Self {
        Self {
            arm,
            is_out: false,
            plan: None,
            ahead: None,
            hits: 0,
        }
    }

    /// The arm at its end.
    pub fn arm(&mut self) -> &mut TicketArm {
        &mut self.arm
    }

    /// Damages the byte that goes this way after `after` others.
    pub fn damage(&mut self, way: Way, after: u32, damage: Damage) {
        self.plan = Some((way, after, damage));
    }

    /// How many bytes were damaged so far.
    pub fn hits(&self) -> u32 {
        self.hits
    }

    /// Pulls the cable out, or puts it in: without it, what either side says is lost.
    pub fn set_out(&mut self, is_out: bool) {
        self.is_out = is_out;
    }

    /// The damage for the next byte that goes this way.
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
