//! A virtual UBT-12HB servo.
//!
//! What the manual leaves open, and what is chosen here:
//!
//! * It is switched on released, its offset 0.
//! * A turn is at constant speed, from where the servo is; in no time if no time is given.
//! * The completion time counts from the request. It can be seen ([`Servo::is_busy`]), but a servo that is told to move
//!   before it is over obeys all the same, so that angles can be streamed.
//! * To read the angle releases the servo, as the manual says. It stays where it is and can be turned by hand.
//! * The offset turns the scale against the housing. A servo that holds turns its horn with it, at once; one that is
//!   released stays where it is and tells another angle.
//! * A servo that is sent where it cannot go stays as it is and does not answer: the answer to a move cannot say no.
//! * A faulty servo does nothing, and says so where its answer has room for it.

use std::time::Duration;

use armwire::alpha1::{Address, Angle, Led, Offset, Outcome, ServoId, ServoRequest, ServoResponse};
use armwire::time;

/// The version that a servo tells, as in the manual's example.
const VERSION: [u8; 4] = [0x41, 0x16, 0x51, 0x01];

/// Angles are in millionths of a third of a degree: offsets are in thirds, so nothing is rounded but where a turn is.
const THIRD: i64 = 1_000_000;
const DEGREE: i64 = 3 * THIRD;
const MAX: i64 = 240 * DEGREE;

/// A turn at constant speed. Where it is depends on the time alone, not on how often it is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Turn {
    from: i64,
    to: i64,
    start: time::Instant,
    /// 5.1 s at most.
    span: time::Duration,
}

impl Turn {
    fn rest(at: i64) -> Self {
        Self {
            from: at,
            to: at,
            start: time::Instant::ZERO,
            span: time::Duration::ZERO,
        }
    }

    fn at(&self, now: time::Instant) -> i64 {
        let elapsed = now.since(self.start);
        if elapsed >= self.span {
            return self.to;
        }
        self.from + (self.to - self.from) * elapsed.as_micros() as i64 / self.span.as_micros() as i64
    }

    fn end(&self) -> time::Instant {
        self.start + self.span
    }
}

/// A servo: where it is, and what it was told.
///
/// It knows no line. What it tells is as of the time given, which is not before that of the last request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Servo {
    id: ServoId,
    offset: Offset,
    led: Led,
    running: bool,
    faulty: bool,
    turn: Turn,
    /// When it is done with what it was last told.
    done: time::Instant,
}

impl Servo {
    /// A released servo in the middle of the range that it has in an Alpha1.
    pub(super) fn new(id: ServoId) -> Self {
        Self {
            id,
            // Zero is in range.
            offset: Offset::new(0).expect("no offset"),
            led: Led(0),
            running: false,
            faulty: false,
            turn: Turn::rest(90 * DEGREE),
            done: time::Instant::ZERO,
        }
    }

    /// Its id.
    pub fn id(&self) -> ServoId {
        self.id
    }

    /// Its angle, in degrees.
    pub fn angle(&self, now: time::Instant) -> f64 {
        self.turn.at(now) as f64 / DEGREE as f64
    }

    /// Where its horn is against the housing, in degrees: its angle and its offset.
    pub fn horn(&self, now: time::Instant) -> f64 {
        self.angle(now) + f64::from(self.offset.thirds()) / 3.0
    }

    /// Where it goes or holds; where it is, if it is released. In degrees.
    pub fn target(&self) -> f64 {
        self.turn.to as f64 / DEGREE as f64
    }

    /// Whether it holds or moves. One that does not can be turned by hand.
    pub fn is_running(&self) -> bool {
        self.running
    }

    /// Whether it moves.
    pub fn is_moving(&self, now: time::Instant) -> bool {
        now < self.turn.end()
    }

    /// Whether it moves, or the completion time of its last move is not over.
    pub fn is_busy(&self, now: time::Instant) -> bool {
        now < self.done
    }

    /// What its light was told.
    pub fn led(&self) -> Led {
        self.led
    }

    /// Its offset.
    pub fn offset(&self) -> Offset {
        self.offset
    }

    /// Turns it by hand. Returns whether it gave way: it does when it is released.
    pub fn turn_by_hand(&mut self, angle: Angle) -> bool {
        match angle.degrees() {
            Some(degrees) if !self.running => {
                self.turn = Turn::rest(i64::from(degrees) * DEGREE);
                true
            }
            _ => false,
        }
    }

    /// Makes it faulty, or sound again.
    pub fn set_faulty(&mut self, faulty: bool) {
        self.faulty = faulty;
    }

    /// Whether it would go there.
    pub(super) fn can_go(&self, angle: Angle) -> bool {
        !self.faulty && angle.degrees().is_some()
    }

    /// Goes to an angle and holds it. Returns whether it obeys.
    pub(super) fn go(&mut self, now: time::Instant, angle: Angle, span: time::Duration, lock: time::Duration) -> bool {
        let Some(degrees) = angle.degrees().filter(|_| !self.faulty) else {
            return false;
        };
        self.turn = Turn {
            from: self.turn.at(now),
            to: i64::from(degrees) * DEGREE,
            start: now,
            span,
        };
        self.done = now + span.max(lock);
        self.running = true;
        true
    }

    /// Stays where it is. If it holds, it goes on holding.
    pub(super) fn stop(&mut self, now: time::Instant) {
        self.turn = Turn::rest(self.turn.at(now));
        self.done = now;
    }

    /// Does what is asked and returns its answer: `None` if another is meant, or all are, or it cannot say no.
    pub(super) fn obey(&mut self, now: time::Instant, request: &ServoRequest) -> Option<ServoResponse> {
        match *request {
            ServoRequest::Move { to, angle, time, lock } => self.acknowledge(to, |servo| {
                servo.go(now, angle, micros(time.duration()), micros(lock.duration()))
            }),
            ServoRequest::Release(to) => self.acknowledge(to, |servo| {
                servo.release(now);
                true
            }),
            ServoRequest::SetLed { to, led } => self.acknowledge(to, |servo| {
                servo.led = led;
                true
            }),
            ServoRequest::ReadAngles(id) if id == self.id => {
                let degrees = |angle: i64| ((angle + DEGREE / 2) / DEGREE) as u16;
                let (target, actual) = (degrees(self.turn.to), degrees(self.turn.at(now)));
                if !self.faulty {
                    self.release(now);
                }
                Some(ServoResponse::Angles {
                    servo: self.id,
                    outcome: self.outcome(),
                    target,
                    actual,
                })
            }
            ServoRequest::ChangeId { from, to } if from == self.id => {
                if !self.faulty {
                    self.id = to;
                }
                Some(ServoResponse::IdChanged {
                    servo: self.id,
                    outcome: self.outcome(),
                    was: from.get(),
                })
            }
            ServoRequest::SetOffset(id, offset) if id == self.id => {
                if !self.faulty {
                    self.set_offset(now, offset);
                }
                Some(ServoResponse::OffsetSet {
                    servo: self.id,
                    outcome: self.outcome(),
                })
            }
            ServoRequest::ReadOffset(id) if id == self.id => Some(ServoResponse::Offset {
                servo: self.id,
                outcome: self.outcome(),
                thirds: self.offset.thirds(),
            }),
            ServoRequest::ReadVersion(id) if id == self.id => Some(ServoResponse::Version {
                servo: self.id,
                outcome: self.outcome(),
                version: VERSION,
            }),
            // It is for another, or a request of a later protocol version.
            _ => None,
        }
    }

    /// Does what it is told if it is meant, and says so if it alone is meant and obeys.
    fn acknowledge(&mut self, to: Address, act: impl FnOnce(&mut Self) -> bool) -> Option<ServoResponse> {
        let meant = to == Address::All || to == Address::One(self.id);
        let obeyed = meant && !self.faulty && act(self);
        (obeyed && to != Address::All).then_some(ServoResponse::Acknowledged(self.id))
    }

    fn outcome(&self) -> Outcome {
        if self.faulty {
            Outcome::Failure
        } else {
            Outcome::Success
        }
    }

    fn release(&mut self, now: time::Instant) {
        self.stop(now);
        self.running = false;
    }

    fn set_offset(&mut self, now: time::Instant, offset: Offset) {
        if !self.running {
            let shift = i64::from(self.offset.thirds() - offset.thirds()) * THIRD;
            self.turn = Turn::rest((self.turn.at(now) + shift).clamp(0, MAX));
        }
        self.offset = offset;
    }
}

/// A duration of the wire, which is at most 1310.7 s, in microseconds.
pub(super) fn micros(duration: Duration) -> time::Duration {
    time::Duration::from_micros(duration.as_micros() as u64)
}
