//! A virtual UBT-12HB servo.
//!
//! The manual leaves some behaviour open. This model assumes:
//!
//! * At power-on a servo is released, with offset 0.
//! * A motion has constant speed and starts at the current position. With duration zero it is instantaneous.
//! * The completion time counts from the request. It is visible ([`Servo::is_busy`]), but a move before its end is
//!   executed, so that angles can be streamed.
//! * An angle read releases the servo, as the manual specifies. It keeps its position and can be turned by hand.
//! * The offset rotates the scale against the housing. A holding servo turns its horn at once; a released one keeps its
//!   position and reports another angle.
//! * A move out of range has no effect and no answer, since the answer to a move cannot carry a failure.
//! * A faulty servo does nothing, and reports its fault in answers that have a field for it.

use std::time::Duration;

use armwire::alpha1::{Address, Angle, Led, Offset, Outcome, ServoId, ServoRequest, ServoResponse};
use armwire::time;

/// Version of every servo, as in the manual's example.
const VERSION: [u8; 4] = [0x41, 0x16, 0x51, 0x01];

/// Angle unit: a millionth of a third of a degree. Offsets are in thirds, so only angles during a motion are rounded.
const THIRD: i64 = 1_000_000;
const DEGREE: i64 = 3 * THIRD;
const MAX: i64 = 240 * DEGREE;

/// A motion at constant speed. The position depends on the time alone, not on the polling rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Turn {
    from: i64,
    to: i64,
    start: time::Instant,
    /// At most 5.1 s.
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

/// A servo: position, target and settings.
///
/// It has no line. Readings apply to the given time, which is not before that of the last request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Servo {
    id: ServoId,
    offset: Offset,
    led: Led,
    running: bool,
    faulty: bool,
    turn: Turn,
    /// End of the last request's completion time.
    done: time::Instant,
}

impl Servo {
    /// Creates a released servo in the middle of its range in an Alpha1.
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

    /// Returns the id.
    pub fn id(&self) -> ServoId {
        self.id
    }

    /// Returns the angle, in degrees.
    pub fn angle(&self, now: time::Instant) -> f64 {
        self.turn.at(now) as f64 / DEGREE as f64
    }

    /// Returns the horn's angle to the housing, in degrees: angle plus offset.
    pub fn horn(&self, now: time::Instant) -> f64 {
        self.angle(now) + f64::from(self.offset.thirds()) / 3.0
    }

    /// Returns the target angle, or the current angle of a released servo, in degrees.
    pub fn target(&self) -> f64 {
        self.turn.to as f64 / DEGREE as f64
    }

    /// Returns true if the servo holds or moves. A servo that does neither can be turned by hand.
    pub fn is_running(&self) -> bool {
        self.running
    }

    /// Returns true if the servo moves.
    pub fn is_moving(&self, now: time::Instant) -> bool {
        now < self.turn.end()
    }

    /// Returns true if the servo moves, or the completion time of its last move is not over.
    pub fn is_busy(&self, now: time::Instant) -> bool {
        now < self.done
    }

    /// Returns the LED setting.
    pub fn led(&self) -> Led {
        self.led
    }

    /// Returns the offset.
    pub fn offset(&self) -> Offset {
        self.offset
    }

    /// Turns the servo by hand. Returns true if it moved: only a released servo does.
    pub fn turn_by_hand(&mut self, angle: Angle) -> bool {
        match angle.degrees() {
            Some(degrees) if !self.running => {
                self.turn = Turn::rest(i64::from(degrees) * DEGREE);
                true
            }
            _ => false,
        }
    }

    /// Sets or clears the servo's fault.
    pub fn set_faulty(&mut self, faulty: bool) {
        self.faulty = faulty;
    }

    /// Returns true if a move to this angle would be executed.
    pub(super) fn can_go(&self, angle: Angle) -> bool {
        !self.faulty && angle.degrees().is_some()
    }

    /// Moves to an angle and holds it. Returns true if the move was accepted.
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

    /// Stops at the current position. A holding servo continues to hold.
    pub(super) fn stop(&mut self, now: time::Instant) {
        self.turn = Turn::rest(self.turn.at(now));
        self.done = now;
    }

    /// Executes a request and returns the answer. `None` for another servo's request, a broadcast, or a failed move.
    pub(super) fn execute(&mut self, now: time::Instant, request: &ServoRequest) -> Option<ServoResponse> {
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
            // Another servo's request, or one of a later protocol version.
            _ => None,
        }
    }

    /// Executes a request that addresses this servo. Acknowledges it if it is not a broadcast and was accepted.
    fn acknowledge(&mut self, to: Address, act: impl FnOnce(&mut Self) -> bool) -> Option<ServoResponse> {
        let meant = to == Address::All || to == Address::One(self.id);
        let accepted = meant && !self.faulty && act(self);
        (accepted && to != Address::All).then_some(ServoResponse::Acknowledged(self.id))
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

/// Converts a duration of the protocol, at most 1310.7 s, to microseconds.
pub(super) fn micros(duration: Duration) -> time::Duration {
    time::Duration::from_micros(duration.as_micros() as u64)
}
