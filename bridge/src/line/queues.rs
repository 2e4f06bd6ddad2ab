//! Requests of initiators other than the host on USB.

use armwire::time::Instant;

use crate::control::{Failure, FrameBytes, Initiator, Refusal};

use super::Line;
use super::outbox::{Limits, NotTaken};

impl Line {
    /// Queues a request of a host on CAN that was complete at `arrived`.
    pub(crate) fn request(&mut self, bytes: &[u8], arrived: Instant) -> Result<(), NotTaken> {
        if self.outbox.submit(self.kind, bytes, self.limits(), arrived)? {
            self.guard.dead_man.motion(Initiator::Can, arrived);
        }
        Ok(())
    }

    /// Queues a motion request of cyclic commands. It replaces the one that waits.
    pub(crate) fn command(&mut self, bytes: &[u8], now: Instant) {
        if let Err(reason) = self.limits().check(true) {
            return self.journal.refused(Initiator::Command, reason, now);
        }
        let replaces = self.outbox.command(self.kind, bytes, now);
        self.guard.dead_man.motion(Initiator::Command, now);
        if replaces {
            self.journal.refused(Initiator::Command, Refusal::QueueFull, now);
        }
    }

    const fn limits(&self) -> Limits {
        Limits {
            is_reserved: self.guard.is_reserved(),
            refuses_motion: self.guard.stop.refuses_motion(),
        }
    }

    /// Queues an identification request. Its result is [`identified`](Self::identified).
    pub(crate) fn identify(&mut self, now: Instant) {
        self.outbox
            .identify(self.kind, self.guard.is_reserved(), now, &mut self.journal);
    }

    /// The result of an [identification](Self::identify), returned once: `None` in it if the arm did not answer.
    pub(crate) fn identified(&mut self) -> Option<Result<Option<FrameBytes>, Failure>> {
        self.outbox.identified()
    }

    /// Drops the requests of hosts on CAN, because the bus is reconfigured.
    pub(crate) fn drop_can_requests(&mut self) {
        self.outbox.drop_can_requests(&mut self.journal);
    }

    /// Counts a refusal on the hosts' side.
    pub(crate) const fn count_refusal(&mut self, reason: Refusal) {
        self.journal.count_refusal(reason);
    }
}
