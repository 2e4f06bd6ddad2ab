//! A stub without cyclic frames: they belong to the Ling arm, whose protocol is not compiled in.

use crate::can::{Frame, RefusedRequest};
use crate::config::{self, ArmKind};
use crate::control::{FrameBytes, Refusal};
use armwire::time::Instant;

/// No telemetry and no commands.
pub(super) struct Cyclic;

impl Cyclic {
    pub(super) const fn new(_: &config::Can) -> Self {
        Self
    }

    pub(super) const fn adopt(&mut self, _: &config::Can) {}

    pub(super) const fn receive(&mut self, _: &Frame, _: Instant) -> Option<Result<FrameBytes, RefusedRequest>> {
        None
    }

    pub(super) const fn stop_commands(&mut self) {}

    pub(super) const fn command_timeout(&self) -> Option<Instant> {
        None
    }

    pub(super) const fn tick(&mut self, _: Instant) -> Option<Refusal> {
        None
    }

    pub(super) const fn frame(&mut self, _: ArmKind, _: &[u8], _: Instant) {}

    pub(super) const fn transmit_at(&self) -> Option<Instant> {
        None
    }

    pub(super) const fn transmit(&mut self, _: Instant) -> Option<Frame> {
        None
    }
}
