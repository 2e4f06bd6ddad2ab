//! Cyclic command frames that move the arm, with safety checks for use by a PLC.
//!
//! A command is two frames, COMMAND_A and COMMAND_B, with the same sequence number. `docs/armwire.dbc` describes them.
//! It takes effect if
//!
//! * both arrived within the timeout,
//! * its stream has started: by a command with sequence number 0, which moves nothing,
//! * its sequence number is newer than that of the stream's last command: 1 to 127 more, modulo 256,
//! * and every value is in range.
//!
//! Otherwise the whole command is refused with a reason. The last command of a stream is one that took effect, or that
//! was refused only for its speed. A stream ends without such a command within the timeout. A sender that repeats one
//! command forever therefore moves nothing: a start command does not move, and a moving command does not start a
//! stream.

use armwire::OutOfRange;
use armwire::ling::{GripperSpeed, JOINTS, Move, Opening, Position, Speed};
use armwire::time::{Duration, Instant};

use super::{Frame, Function, Node, RefusedRequest, telemetry};
use crate::control::Refusal;

/// One step of a command's speed, in ticks per second.
pub const SPEED_STEP: u8 = 20;

/// One step of a command's gripper opening, in thousandths of the stroke.
pub const GRIPPER_STEP: u8 = 4;

/// The maximum speed and opening, in steps: 5000 ticks/s, and open.
const MAX_STEPS: u8 = 250;

/// The minimum speed, in steps: 60 ticks/s, the first step from [`Speed::SLOWEST`] on.
const MIN_SPEED_STEPS: u8 = Speed::SLOWEST.ticks_per_second().div_ceil(SPEED_STEP as u16) as u8;

/// A command as encoded in its frames. Its values may be out of the arm's range.
///
/// | Frame | Word 0 | Word 1 | Word 2 | Word 3 |
/// |---|---|---|---|---|
/// | COMMAND_A | joint 1, ticks | joint 2 | joint 3 | sequence number, speed |
/// | COMMAND_B | joint 4, ticks | joint 5 | joint 6 | sequence number, gripper |
///
/// ```
/// use armwire_bridge::can::{Node, command::Command};
///
/// let command = Command { sequence: 1, joints: [2048; 6], speed: 25, gripper: 125 };
/// let target = command.target().unwrap();
/// assert_eq!(target.joints[0].1.ticks_per_second(), 500);
/// assert_eq!(target.gripper.0.per_mille(), 500);
///
/// let [a, _] = command.to_frames(Node::new(0).unwrap());
/// assert_eq!(a.data(), [0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 1, 25]);
///
/// let error = Command { speed: 0, ..command }.target().unwrap_err();
/// assert_eq!(error.to_string(), "command speed is 0 times 20 ticks/s, must be 3..=250");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Command {
    /// Sequence number: one more than in the previous command, modulo 256; 0 starts a stream.
    pub sequence: u8,
    /// Target positions of joints 1 to 6, in ticks: 0 to 4095, 2048 is 0 rad.
    pub joints: [u16; JOINTS],
    /// Speed of the joints and the gripper, in steps of [`SPEED_STEP`]: 3 to 250.
    pub speed: u8,
    /// Opening of the gripper, in steps of [`GRIPPER_STEP`]: 0, closed, to 250, open.
    pub gripper: u8,
}

impl Command {
    /// COMMAND_A and COMMAND_B.
    pub fn to_frames(&self, node: Node) -> [Frame; 2] {
        let [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6] = self.joints;
        let speed = u16::from_le_bytes([self.sequence, self.speed]);
        let gripper = u16::from_le_bytes([self.sequence, self.gripper]);
        [
            telemetry::frame(Function::CommandA.id(node), [joint_1, joint_2, joint_3, speed]),
            telemetry::frame(Function::CommandB.id(node), [joint_4, joint_5, joint_6, gripper]),
        ]
    }

    /// The arm's request for this command.
    ///
    /// # Errors
    ///
    /// The first value that is out of range. A speed under 3 steps is out of range: an arm may take it for 0, whose
    /// effect is unknown.
    pub fn target(&self) -> Result<Move, OutOfRange> {
        let steps = |what, unit, got, min| match got {
            _ if (min..=MAX_STEPS).contains(&got) => Ok(u16::from(got)),
            _ => Err(OutOfRange {
                what,
                unit,
                got: got.into(),
                min: min.into(),
                max: MAX_STEPS.into(),
            }),
        };
        let speed = steps("command speed", "times 20 ticks/s", self.speed, MIN_SPEED_STEPS)? * u16::from(SPEED_STEP);
        let opening = steps("command gripper", "times 4 ‰", self.gripper, 0)? * u16::from(GRIPPER_STEP);
        let mut joints = [(Position::CENTRE, Speed::new(speed)?); JOINTS];
        for ((position, _), ticks) in joints.iter_mut().zip(self.joints) {
            *position = Position::new(ticks)?;
        }
        Ok(Move {
            joints,
            gripper: (Opening::new(opening)?, GripperSpeed(speed)),
        })
    }

    /// Returns true if all values but the speed are in range.
    fn is_in_range_but_for_speed(&self) -> bool {
        let at_full_speed = Self {
            speed: MAX_STEPS,
            ..*self
        };
        at_full_speed.target().is_ok()
    }
}

/// Assembles and checks command frames.
///
/// ```
/// use armwire_bridge::{Duration, Instant};
/// use armwire_bridge::can::{Node, command::{Command, Commands}};
/// use armwire_bridge::control::Refusal;
///
/// let node = Node::new(0).unwrap();
/// let mut commands = Commands::new(node, Duration::from_millis(100));
/// let mut send = |sequence, at| {
///     let [a, b] = Command { sequence, joints: [2048; 6], speed: 25, gripper: 0 }.to_frames(node);
///     assert_eq!(commands.receive(&a, Instant::from_millis(at)), None);
///     commands.receive(&b, Instant::from_millis(at))
/// };
/// assert_eq!(send(9, 0), Some(Err(Refusal::Stale.into()))); // there is no stream
/// assert_eq!(send(0, 10), None); // now there is
/// assert!(send(1, 20).unwrap().is_ok());
/// assert_eq!(send(1, 30), Some(Err(Refusal::Stale.into())));
/// assert!(send(2, 40).unwrap().is_ok());
/// assert_eq!(send(3, 140), Some(Err(Refusal::Stale.into()))); // it has ended
/// ```
#[derive(Clone, Debug)]
pub struct Commands {
    node: Node,
    timeout: Duration,
    /// The first frame of a command, until the second arrives.
    half: Option<Half>,
    /// The sequence number of the stream's last command, and its time.
    last: Option<(u8, Instant)>,
    /// A command followed the start: 0 is an ordinary sequence number from then on.
    has_gone_on: bool,
}

#[derive(Clone, Copy, Debug)]
struct Half {
    function: Function,
    words: [u16; 4],
    at: Instant,
}

impl Half {
    const fn sequence(&self) -> u8 {
        let [.., last] = self.words;
        last as u8
    }

    fn deadline(&self, timeout: Duration) -> Instant {
        self.at + timeout
    }
}

impl Commands {
    /// Commands for `node`, with this timeout.
    pub const fn new(node: Node, timeout: Duration) -> Self {
        Self {
            node,
            timeout,
            half: None,
            last: None,
            has_gone_on: false,
        }
    }

    /// Handles a received frame. Returns the target of the arm, or the reason for a refusal: [`Refusal::Incomplete`]
    /// for the previous command; [`Refusal::Stale`] or [`Refusal::OutOfRange`] for this one; [`Refusal::NotAFrame`]
    /// unless it has 8 bytes. `None` if no action follows: the frame is a first half, starts a stream, or is no command
    /// for this node.
    pub fn receive(&mut self, frame: &Frame, now: Instant) -> Option<Result<Move, RefusedRequest>> {
        let (function @ (Function::CommandA | Function::CommandB), node) = Function::of(frame.id())? else {
            return None;
        };
        if node != self.node {
            return None;
        }
        let Some((_, words)) = telemetry::words(frame, function) else {
            return Some(Err(Refusal::NotAFrame.into()));
        };
        let half = Half {
            function,
            words,
            at: now,
        };
        let other = self.half.replace(half)?;
        if other.sequence() != half.sequence() || now >= other.deadline(self.timeout) {
            return Some(Err(Refusal::Incomplete.into()));
        }
        let (a, b) = match (other.function, function) {
            (Function::CommandA, Function::CommandB) => (other.words, words),
            (Function::CommandB, Function::CommandA) => (words, other.words),
            // A repeated half does not extend the timeout of the other.
            _ => {
                self.half = Some(Half { at: other.at, ..half });
                return None;
            }
        };
        self.half = None;
        self.check(&joined(a, b), now)
    }

    /// Advances the time to `now`. Returns [`Refusal::Incomplete`] if the second half of a command is late.
    pub fn tick(&mut self, now: Instant) -> Option<Refusal> {
        self.half.take_if(|half| now >= half.deadline(self.timeout))?;
        Some(Refusal::Incomplete)
    }

    /// The time of the next [`tick`](Self::tick) unless the second half arrives first. `None` if no half is pending.
    pub fn timeout(&self) -> Option<Instant> {
        self.half.map(|half| half.deadline(self.timeout))
    }

    /// Ends the stream: the next command must start one.
    pub fn stop(&mut self) {
        self.last = None;
    }

    /// Checks a complete command.
    fn check(&mut self, command: &Command, now: Instant) -> Option<Result<Move, RefusedRequest>> {
        let running = self.last.filter(|&(_, at)| now < at + self.timeout);
        let has_gone_on = self.has_gone_on && running.is_some();
        match running.map(|(last, _)| last) {
            None | Some(0) if command.sequence == 0 && !has_gone_on => {
                (self.last, self.has_gone_on) = (Some((0, now)), false);
                None
            }
            Some(last) if (1..=127).contains(&command.sequence.wrapping_sub(last)) => {
                let target = command.target();
                let keeps_stream = target.is_ok() || command.is_in_range_but_for_speed();
                if keeps_stream {
                    (self.last, self.has_gone_on) = (Some((command.sequence, now)), true);
                }
                Some(target.map_err(|_| RefusedRequest {
                    reason: Refusal::OutOfRange,
                    keeps_stream,
                }))
            }
            _ => Some(Err(Refusal::Stale.into())),
        }
    }
}

/// The command in the words of both halves.
fn joined([joint_1, joint_2, joint_3, speed]: [u16; 4], [joint_4, joint_5, joint_6, gripper]: [u16; 4]) -> Command {
    let [sequence, speed] = speed.to_le_bytes();
    let [_, gripper] = gripper.to_le_bytes();
    Command {
        sequence,
        joints: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6],
        speed,
        gripper,
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    const TIMEOUT: Duration = Duration::from_millis(100);

    /// Commands to node 3, and the time.
    #[derive(Clone)]
    struct Bus {
        commands: Commands,
        node: Node,
        now: Instant,
    }

    impl Bus {
        fn new() -> Self {
            let node = Node::new(3).unwrap();
            Self {
                commands: Commands::new(node, TIMEOUT),
                node,
                now: Instant::from_micros(1_000_000),
            }
        }

        /// A bus whose stream has reached `sequence`.
        fn running(sequence: u8) -> Self {
            let mut bus = Self::new();
            assert_eq!(bus.send(command(0)), None);
            for sequence in 1..=sequence {
                assert!(bus.send(command(sequence)).unwrap().is_ok());
            }
            bus
        }

        fn pass(&mut self, millis: u64) {
            self.now += Duration::from_millis(millis);
        }

        fn receive(&mut self, frame: &Frame) -> Option<Result<Move, Refusal>> {
            let moved = self.commands.receive(frame, self.now)?;
            Some(moved.map_err(|refused| refused.reason))
        }

        fn send(&mut self, command: Command) -> Option<Result<Move, Refusal>> {
            let [a, b] = command.to_frames(self.node);
            assert_eq!(self.receive(&a), None);
            self.receive(&b)
        }
    }

    fn command(sequence: u8) -> Command {
        Command {
            sequence,
            joints: [2048, 1024, 3072, 0, 4095, 2049],
            speed: 50,
            gripper: 250,
        }
    }

    #[test]
    fn command_moves_to_target_at_given_speed() {
        let target = Bus::running(7).send(command(8)).unwrap().unwrap();
        assert_eq!(target.joints.map(|(position, _)| position.ticks()), command(8).joints);
        assert!(target.joints.iter().all(|(_, speed)| speed.ticks_per_second() == 1000));
        assert_eq!(target.gripper, (Opening::OPEN, GripperSpeed(1000)));
    }

    #[test]
    fn values_in_range_are_exact_others_are_refused() {
        for steps in 0..=u8::MAX {
            let target = Command {
                speed: steps,
                ..command(1)
            }
            .target();
            match steps {
                3..=250 => assert_eq!(target.unwrap().joints[5].1.ticks_per_second(), u16::from(steps) * 20),
                _ => assert_eq!(target.unwrap_err().got, steps.into()),
            }
            let target = Command {
                gripper: steps,
                ..command(1)
            }
            .target();
            match steps {
                0..=250 => assert_eq!(target.unwrap().gripper.0.per_mille(), u16::from(steps) * 4),
                _ => assert_eq!(target.unwrap_err().got, steps.into()),
            }
        }
        for joint in 0..JOINTS {
            for ticks in [0, 4095, 4096, u16::MAX] {
                let mut command = command(1);
                command.joints[joint] = ticks;
                match ticks {
                    0..=4095 => assert_eq!(command.target().unwrap().joints[joint].0.ticks(), ticks),
                    _ => assert_eq!(command.target().unwrap_err().got, ticks),
                }
            }
        }
    }

    #[test]
    fn either_half_may_come_first() {
        let mut bus = Bus::running(1);
        let [a, b] = command(2).to_frames(bus.node);
        assert_eq!(bus.receive(&b), None);
        assert_eq!(bus.receive(&a), Some(Ok(command(2).target().unwrap())));
    }

    #[test]
    fn value_out_of_range_refuses_command_keeps_stream() {
        let mut bus = Bus::running(4);
        for bad in [
            Command {
                joints: [4096, 0, 0, 0, 0, 0],
                ..command(5)
            },
            Command {
                gripper: 251,
                ..command(5)
            },
            Command { speed: 0, ..command(5) },
        ] {
            assert_eq!(bus.send(bad), Some(Err(Refusal::OutOfRange)));
        }
        assert!(bus.send(command(6)).unwrap().is_ok());
    }

    #[test]
    fn command_refused_for_its_speed_counts_on() {
        let mut bus = Bus::running(1);
        for sequence in 2..=255 {
            bus.pass(90);
            let bad = Command {
                speed: 0,
                ..command(sequence)
            };
            assert_eq!(bus.send(bad), Some(Err(Refusal::OutOfRange)));
            assert_eq!(bus.send(command(sequence)), Some(Err(Refusal::Stale)));
        }
        assert!(bus.send(command(0)).unwrap().is_ok());
    }

    #[test]
    fn half_command_is_refused_at_timeout_despite_repeats() {
        let mut bus = Bus::running(4);
        let [a, b] = command(5).to_frames(bus.node);
        assert_eq!(bus.commands.timeout(), None);
        assert_eq!(bus.receive(&a), None);
        let due = bus.now + TIMEOUT;
        bus.pass(99);
        assert_eq!(bus.receive(&a), None);
        assert_eq!(bus.commands.timeout(), Some(due));
        assert_eq!(bus.commands.tick(bus.now), None);
        bus.pass(1);
        assert_eq!(bus.commands.tick(bus.now), Some(Refusal::Incomplete));
        assert_eq!((bus.commands.timeout(), bus.commands.tick(bus.now)), (None, None));
        // The next frame is a first half again.
        assert_eq!(bus.receive(&b), None);
    }

    #[test]
    fn late_or_foreign_half_completes_no_command() {
        let mut bus = Bus::running(4);
        let [a, _] = command(5).to_frames(bus.node);
        let [_, b] = command(6).to_frames(bus.node);
        assert_eq!(bus.receive(&a), None);
        assert_eq!(bus.receive(&b), Some(Err(Refusal::Incomplete)));
        let [a, _] = command(6).to_frames(bus.node);
        bus.pass(100);
        assert_eq!(bus.receive(&a), Some(Err(Refusal::Incomplete)));
    }

    #[test]
    fn stream_starts_with_0_and_ends_after_silence() {
        let mut bus = Bus::new();
        assert_eq!(bus.send(command(1)), Some(Err(Refusal::Stale)));
        assert_eq!(bus.send(Command { speed: 0, ..command(0) }), None);
        bus.pass(99);
        assert!(bus.send(command(1)).unwrap().is_ok());
        bus.pass(100);
        assert_eq!(bus.send(command(2)), Some(Err(Refusal::Stale)));
        // A sender that waits for the timeout and sends 0 starts a new stream.
        for _ in 0..5 {
            assert_eq!(bus.send(command(0)), None);
            bus.pass(70);
        }
        assert!(bus.send(command(1)).unwrap().is_ok());
    }

    #[test]
    fn stream_that_was_stopped_must_start() {
        let mut bus = Bus::running(4);
        bus.commands.stop();
        assert_eq!(bus.send(command(5)), Some(Err(Refusal::Stale)));
        assert_eq!(bus.send(command(0)), None);
        assert!(bus.send(command(1)).unwrap().is_ok());
    }

    #[test]
    fn running_stream_counts_on_through_0() {
        let mut bus = Bus::running(200);
        assert_eq!(bus.send(command(0)), Some(Ok(command(0).target().unwrap())));
        assert!(bus.send(command(1)).unwrap().is_ok());
        for sequence in 2..=100 {
            assert!(bus.send(command(sequence)).unwrap().is_ok());
        }
        assert_eq!(bus.send(command(0)), Some(Err(Refusal::Stale)));
    }

    #[test]
    fn newer_is_up_to_127_more() {
        for last in 1..=u8::MAX {
            let running = Bus::running(last);
            for more in 0..=u8::MAX {
                let mut bus = running.clone();
                let sent = bus.send(command(last.wrapping_add(more))).unwrap();
                match more {
                    1..=127 => assert!(sent.is_ok()),
                    _ => assert_eq!(sent, Err(Refusal::Stale)),
                }
            }
        }
    }

    #[test]
    fn frames_for_other_nodes_or_functions_are_ignored() {
        let mut bus = Bus::running(4);
        let [a, _] = command(5).to_frames(bus.node);
        let [_, other] = command(6).to_frames(Node::default());
        assert_eq!(bus.receive(&a), None);
        assert_eq!(bus.receive(&other), None);
        for function in Function::ALL {
            if !matches!(function, Function::CommandA | Function::CommandB) {
                assert_eq!(bus.receive(&telemetry::frame(function.id(bus.node), [5; 4])), None);
            }
        }
        let [_, b] = command(5).to_frames(bus.node);
        assert!(bus.receive(&b).unwrap().is_ok());
    }

    #[test]
    fn frame_of_wrong_length_is_refused_without_effect() {
        let mut bus = Bus::running(4);
        let [a, b] = command(5).to_frames(bus.node);
        assert_eq!(bus.receive(&a), None);
        for frame in [
            Frame::new(b.id(), &b.data()[..7]).unwrap(),
            Frame::new_fd(b.id(), &[0; 12]).unwrap(),
        ] {
            assert_eq!(bus.receive(&frame), Some(Err(Refusal::NotAFrame)));
        }
        assert!(bus.receive(&b).unwrap().is_ok());
    }

    /// A half: its kind, its sequence number, and the time since the previous one. The joints identify the command and
    /// the attempt.
    fn halves() -> impl Strategy<Value = (bool, u8, u64)> {
        // Usually the next number, sometimes any.
        let millis = prop_oneof![8 => 0..20_u64, 1 => 90..210_u64];
        (any::<bool>(), 0..6_u8, millis)
    }

    proptest! {
        #[test]
        fn command_survives_the_bus(
            joints in any::<[u16; JOINTS]>(),
            (sequence, speed, gripper) in any::<(u8, u8, u8)>(),
        ) {
            let command = Command { sequence, joints, speed, gripper };
            let [a, b] = command.to_frames(Node::default());
            let (_, a) = telemetry::words(&a, Function::CommandA).unwrap();
            let (_, b) = telemetry::words(&b, Function::CommandB).unwrap();
            prop_assert_eq!(joined(a, b), command);
        }

        #[test]
        fn only_complete_timely_newer_stream_commands_move(
            halves in prop::collection::vec(halves(), 1..200),
        ) {
            let mut bus = Bus::new();
            let mut sent: Vec<(bool, u8, u64)> = Vec::new();
            let mut moved: Option<(u8, Instant)> = None;
            for (is_a, sequence, millis) in halves {
                bus.pass(millis);
                sent.push((is_a, sequence, bus.now.as_micros()));
                // The joints identify the frame's command.
                let command = Command { joints: [sent.len() as u16 - 1; JOINTS], ..command(sequence) };
                let [a, b] = command.to_frames(bus.node);
                let Some(Ok(target)) = bus.receive(if is_a { &a } else { &b }) else {
                    continue;
                };
                let [a, .., b] = target.joints.map(|(position, _)| usize::from(position.ticks()));
                let ((a_is_a, a_sequence, a_at), (b_is_a, b_sequence, b_at)) = (sent[a], sent[b]);
                prop_assert!(a_is_a && !b_is_a);
                prop_assert_eq!((a_sequence, b_sequence), (sequence, sequence));
                prop_assert!(a_at.abs_diff(b_at) < TIMEOUT.as_micros());
                match moved {
                    Some((last, at)) if bus.now.since(at) < TIMEOUT => {
                        prop_assert!(sequence > last);
                    }
                    _ => {
                        // A complete command with sequence number 0 was received since the last move.
                        let since = moved.map_or(0, |(_, at)| at.as_micros());
                        let zeros = sent.iter().copied().filter(|&(_, sequence, at)| sequence == 0 && at >= since);
                        let (a, b): (Vec<_>, Vec<_>) = zeros.partition(|(is_a, ..)| *is_a);
                        prop_assert!(!a.is_empty() && !b.is_empty());
                        prop_assert!(sequence != 0);
                    }
                }
                moved = Some((sequence, bus.now));
            }
        }

        #[test]
        fn sender_that_repeats_itself_moves_nothing(
            last in any::<u8>(),
            frames in prop::collection::vec(any::<bool>(), 1..4),
            sequence in any::<u8>(),
            millis in 0..250_u64,
        ) {
            let mut bus = Bus::running(last);
            // The previous stream has ended.
            bus.pass(100);
            let [a, b] = command(sequence).to_frames(bus.node);
            for is_a in frames.iter().cycle().take(300) {
                bus.pass(millis);
                let _ = bus.commands.tick(bus.now);
                let moved = bus.receive(if *is_a { &a } else { &b });
                prop_assert!(!matches!(moved, Some(Ok(_))), "{:?}", moved);
            }
        }
    }

    #[test]
    fn after_wraparound_0_moves_and_repeat_is_stale() {
        let mut bus = Bus::running(255);
        assert!(bus.send(command(0)).unwrap().is_ok());
        assert_eq!(bus.send(command(0)), Some(Err(Refusal::Stale)));
        assert!(bus.send(command(1)).unwrap().is_ok());
        bus.pass(100);
        assert_eq!(bus.send(command(0)), None);
        assert_eq!(bus.send(command(0)), None);
    }
}
