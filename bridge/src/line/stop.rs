//! A stop of the arm: the hold of its pose, and the refusal of motion.

use armwire::time::Instant;

use crate::control::{Failure, Initiator, StopInForce};

use super::Line;
use super::guard::{STREAMERS, Step};

impl Line {
    /// Stops the arm, by a request of this host on the control port. [`stopped`](Self::stopped) has the result.
    pub(crate) fn stop(&mut self, by: Initiator, now: Instant) -> Result<(), Failure> {
        if self.guard.rate.is_reserved_by_request() {
            return Err(Failure::LineReserved);
        }
        let steps = self.guard.stop.steps(self.kind);
        let steps = steps.ok_or(Failure::NotStoppable(self.kind))?;
        self.take_line_back(now);
        if self.guard.stop.refuse_motion(by, now) {
            for initiator in STREAMERS {
                self.guard.dead_man.end(initiator);
            }
            self.outbox.refuse_motion(self.kind, now, &mut self.journal);
        }
        if self.outbox.is_torque_off_due() {
            self.guard.stop.stopped();
        } else if self.guard.stop.begin(steps, now) {
            self.step_stop(now);
        }
        Ok(())
    }

    /// The result of a [`stop`](Self::stop), returned once.
    pub(crate) const fn stopped(&mut self) -> Option<Result<(), Failure>> {
        self.guard.stop.take_result()
    }

    /// The stop for which motion is refused.
    pub(crate) fn stop_in_force(&self, now: Instant) -> Option<StopInForce> {
        self.guard.stop.in_force(now)
    }

    /// Returns true while the adapter stops the arm.
    pub(crate) const fn is_stopping(&self) -> bool {
        self.guard.stop.is_running()
    }

    /// Executes the steps that are due.
    pub(super) fn step_stop(&mut self, now: Instant) {
        loop {
            match self.guard.stop.step(now) {
                Step::Read => self.outbox.read_for_stop(now),
                Step::Hold(request) => return self.outbox.hold_arm(self.kind, &request, now),
                Step::Done => return self.outbox.drop_stop_request(),
                Step::Wait => return,
            }
        }
    }

    /// Executes what is due, and ends the refusal of motion at its time.
    pub(super) fn tick_stop(&mut self, now: Instant) {
        if self.guard.stop.is_step_due(now) {
            self.step_stop(now);
        }
        if self.guard.stop.is_over(now) {
            self.guard.stop.end_refusal();
            self.end_stop(now);
        }
    }

    /// Drops the request of a stop that has ended, and lets motion pass.
    fn end_stop(&mut self, now: Instant) {
        self.outbox.drop_stop_request();
        self.outbox.open_gate(now, &mut self.journal);
    }

    /// Ends the stop of an arm that is replaced by another kind. Without a result so far, the other is stopped.
    pub(super) fn restart_stop(&mut self, now: Instant) {
        let restarts = self.guard.stop.change_arm();
        self.end_stop(now);
        if restarts {
            let result = self.stop(self.guard.stop.by(), now);
            self.guard.stop.repeated(result);
        }
    }
}
