//! Cyclic frames of a Ling arm on the bus: telemetry out, commands in.

use armwire::ling::{JointState, Ling, MotionStatus, Request};
use armwire::messages::Messages;

use crate::can::command::Commands;
use crate::can::telemetry::Sample;
use crate::can::{Frame, Node, RefusedRequest};
use crate::config::{self, ArmKind};
use crate::control::{FrameBytes, Refusal};
use armwire::time::{Duration, Instant};

use super::grid;

const SAMPLE_FRAMES: usize = 3;

/// Telemetry and commands of one node.
pub(super) struct Cyclic {
    node: Node,
    telemetry_hz: u16,
    commands: Commands,
    /// The newest state of the arm that was not sent.
    newest: Option<(JointState, Instant)>,
    /// The sample in transmission, and the number of its frames that were sent.
    sample: Option<(Sample, usize)>,
    samples: u8,
    /// Earliest start of the next sample.
    sample_at: Instant,
}

impl Cyclic {
    pub(super) fn new(config: &config::Can) -> Self {
        let timeout = Duration::from_millis(config.command_timeout_ms.into());
        Self {
            node: config.node,
            telemetry_hz: config.telemetry_hz,
            commands: Commands::new(config.node, timeout),
            newest: None,
            sample: None,
            samples: 0,
            sample_at: Instant::ZERO,
        }
    }

    /// Changes telemetry and commands, on the same bus. A sample in transmission continues.
    pub(super) fn adopt(&mut self, config: &config::Can) {
        *self = Self {
            sample: self.sample.take(),
            samples: self.samples,
            ..Self::new(config)
        };
    }

    // ---- Commands ----

    /// Handles a command frame. Returns the request that moves the arm, or the reason for a refusal.
    pub(super) fn receive(&mut self, frame: &Frame, now: Instant) -> Option<Result<FrameBytes, RefusedRequest>> {
        let target = match self.commands.receive(frame, now)? {
            Ok(target) => target,
            Err(refused) => return Some(Err(refused)),
        };
        let mut bytes = FrameBytes::new();
        let _ = bytes.resize_default(bytes.capacity());
        let len = Ling.encode_request(&Request::Move(target), &mut bytes).ok()?;
        bytes.truncate(len);
        Some(Ok(bytes))
    }

    /// Ends the stream of commands: the next command must start one.
    pub(super) fn stop_commands(&mut self) {
        self.commands.stop();
    }

    /// The timeout of a command that waits for its other half.
    pub(super) fn command_timeout(&self) -> Option<Instant> {
        self.commands.timeout()
    }

    /// Advances the time to `now`. A command without its other half is refused.
    pub(super) fn tick(&mut self, now: Instant) -> Option<Refusal> {
        self.commands.tick(now)
    }

    // ---- Telemetry ----

    /// Handles a frame of the arm, the last byte of which arrived at `at`. The frames on the bus cannot name another robot
    /// than an Alicia-D: its joints are not sent.
    pub(super) fn frame(&mut self, kind: ArmKind, bytes: &[u8], at: Instant) {
        if self.telemetry_hz > 0
            && kind == ArmKind::Ling
            && let Some(state) = JointState::of_frame(bytes)
            && !matches!(state.status, MotionStatus::Foreign(_))
        {
            self.newest = Some((state, at));
        }
    }

    /// The time from which a frame is due.
    pub(super) fn transmit_at(&self) -> Option<Instant> {
        match self.sample {
            Some(_) => Some(Instant::ZERO),
            None => self.newest.map(|_| self.sample_at),
        }
    }

    /// The next frame for the bus.
    pub(super) fn transmit(&mut self, now: Instant) -> Option<Frame> {
        if self.sample.is_none() && self.sample_at <= now {
            self.begin_sample(now);
        }
        let (sample, sent) = self.sample.as_mut()?;
        let frame = sample.frame(*sent, self.node);
        *sent = sent.saturating_add(1);
        if *sent >= SAMPLE_FRAMES {
            self.sample = None;
        }
        frame
    }

    fn begin_sample(&mut self, now: Instant) {
        let Some((state, stamp)) = self.newest.take() else {
            return;
        };
        let sample = Sample {
            state,
            stamp: stamp.as_micros() as u32,
            count: self.samples,
        };
        self.samples = self.samples.wrapping_add(1);
        self.sample = Some((sample, 0));
        let period = 1_000_000_u64.checked_div(self.telemetry_hz.into());
        let period = Duration::from_micros(period.unwrap_or(0));
        self.sample_at = grid::next(self.sample_at, period, now);
    }
}
