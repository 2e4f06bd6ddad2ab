//! Cyclic frames of the adapter. `docs/armwire.dbc` describes them for CAN tools.
//!
//! All are classic frames of 8 bytes, little-endian, on an FD bus too. Each value is sent once and only if known:
//! without a new value there is no frame.

use armwire::ling::{JointState, MotionStatus};

use super::{Frame, Function, Id, MAX_CLASSIC, Node};
use crate::Counters;
use crate::control::{Event, Initiator, Refusal, Stamp};

/// A Ling arm's state and its time: one answer of the arm, in three frames.
///
/// | Frame | Word 0 | Word 1 | Word 2 | Word 3 |
/// |---|---|---|---|---|
/// | JOINTS_A | joint 1, ticks | joint 2 | joint 3 | stamp, low half |
/// | JOINTS_B | joint 4, ticks | joint 5 | joint 6 | stamp, low half |
/// | STATE | gripper, ‰ | motion status, count | stamp, low half | stamp, high half |
///
/// The values are the arm's, bit for bit, including values that no arm should send. Frames with the same stamp belong
/// together.
///
/// ```
/// use armwire::ling::{JointState, MotionStatus};
/// use armwire_bridge::can::{Node, telemetry::Sample};
///
/// let sample = Sample {
///     state: JointState { joints: [2048, 1024, 0, 4095, 2048, 2048], gripper: 500, status: MotionStatus::Locked },
///     stamp: 0x0001_86A0,
///     count: 7,
/// };
/// let frames = sample.to_frames(Node::new(3).unwrap());
/// assert_eq!(frames[0].data(), [0x00, 0x08, 0x00, 0x04, 0x00, 0x00, 0xA0, 0x86]);
/// assert_eq!(Sample::from_frames(&frames), Some(sample));
///
/// // Frames of different samples are not combined.
/// let [_, other, _] = Sample { stamp: 0x0001_86A1, ..sample }.to_frames(Node::new(3).unwrap());
/// assert_eq!(Sample::from_frames(&[frames[0], other, frames[2]]), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Sample {
    /// The state that the arm reported.
    pub state: JointState,
    /// Arrival of its last byte: the low 32 bits of a [`Stamp`], which wrap after 71 minutes.
    pub stamp: u32,
    /// One more than in the previous sample, modulo 256: a gap indicates lost frames.
    pub count: u8,
}

impl Sample {
    /// JOINTS_A, JOINTS_B and STATE.
    pub fn to_frames(&self, node: Node) -> [Frame; 3] {
        self.words().map(|(function, words)| frame(function.id(node), words))
    }

    /// Frame number `place` of [these](Self::to_frames), which are sent one by one.
    pub(crate) fn frame(&self, place: usize, node: Node) -> Option<Frame> {
        let (function, words) = *self.words().get(place)?;
        Some(frame(function.id(node), words))
    }

    fn words(&self) -> [(Function, [u16; 4]); 3] {
        let [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6] = self.state.joints;
        let [low, high] = halves(self.stamp);
        let status = u16::from_le_bytes([self.state.status.into(), self.count]);
        [
            (Function::JointsA, [joint_1, joint_2, joint_3, low]),
            (Function::JointsB, [joint_4, joint_5, joint_6, low]),
            (Function::State, [self.state.gripper, status, low, high]),
        ]
    }

    /// Decodes JOINTS_A, JOINTS_B and STATE, in this order. `None` unless they are the frames of one sample of one
    /// adapter.
    pub fn from_frames([a, b, state]: &[Frame; 3]) -> Option<Self> {
        let (node, [joint_1, joint_2, joint_3, stamp_a]) = words(a, Function::JointsA)?;
        let (node_b, [joint_4, joint_5, joint_6, stamp_b]) = words(b, Function::JointsB)?;
        let (node_state, [gripper, status, low, high]) = words(state, Function::State)?;
        if [node_b, node_state] != [node; 2] || [stamp_a, stamp_b] != [low; 2] {
            return None;
        }
        let [status, count] = status.to_le_bytes();
        Some(Self {
            state: JointState {
                joints: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6],
                gripper,
                status: MotionStatus::from(status),
            },
            stamp: whole(low, high),
            count,
        })
    }
}

/// Error counts in one frame, ERRORS: the [`Counters`] that matter on the bus.
///
/// | Word 0 | Word 1 | Word 2 | Word 3 |
/// |---|---|---|---|
/// | noise bytes | UART errors | CAN errors | unanswered requests, refused ones |
///
/// Each count wraps. The increase between two frames is their difference modulo 65 536, or 256.
///
/// ```
/// use armwire_bridge::Counters;
/// use armwire_bridge::can::{Node, telemetry::Errors};
///
/// let mut counters = Counters::default();
/// counters.unanswered_requests = 257;
/// counters.framing_errors = 2;
/// counters.overrun_errors = 1;
/// let errors = Errors::from(&counters);
/// assert_eq!((errors.unanswered, errors.uart), (1, 3));
///
/// let frame = errors.to_frame(Node::new(0).unwrap());
/// assert_eq!(frame.data(), [0, 0, 3, 0, 0, 0, 1, 0]);
/// assert_eq!(Errors::from_frame(&frame), Some(errors));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Errors {
    /// Bytes from the arm that were in no frame.
    pub noise_bytes: u16,
    /// Framing, parity and noise errors and overruns that the UART reported, and overruns of its ring.
    pub uart: u16,
    /// Errors that the CAN controller saw on the bus, and its receive overruns.
    pub can: u16,
    /// Requests that the arm should have answered but did not.
    pub unanswered: u8,
    /// Requests and commands from CAN that were refused, and all motion refused because the arm was stopped.
    pub refused: u8,
}

impl From<&Counters> for Errors {
    fn from(counters: &Counters) -> Self {
        let sum = |counts: &[u32]| counts.iter().fold(0, |sum: u32, count| sum.wrapping_add(*count));
        Self {
            noise_bytes: counters.noise_bytes as u16,
            uart: sum(&[
                counters.framing_errors,
                counters.parity_errors,
                counters.noise_errors,
                counters.overrun_errors,
                counters.ring_overruns,
            ]) as u16,
            can: sum(&[counters.can_bus_errors, counters.can_receive_overruns]) as u16,
            unanswered: counters.unanswered_requests as u8,
            refused: sum(&[
                counters.refused_can_requests,
                counters.refused_can_frames,
                counters.commands_incomplete,
                counters.commands_stale,
                counters.commands_out_of_range,
                counters.refused_line_reserved,
                counters.refused_stopped,
            ]) as u8,
        }
    }
}

impl Errors {
    /// ERRORS.
    pub fn to_frame(&self, node: Node) -> Frame {
        let last = u16::from_le_bytes([self.unanswered, self.refused]);
        frame(Function::Errors.id(node), [self.noise_bytes, self.uart, self.can, last])
    }

    /// Decodes ERRORS. `None` for any other frame.
    pub fn from_frame(frame: &Frame) -> Option<Self> {
        let (_, [noise_bytes, uart, can, last]) = words(frame, Function::Errors)?;
        let [unanswered, refused] = last.to_le_bytes();
        Some(Self {
            noise_bytes,
            uart,
            can,
            unanswered,
            refused,
        })
    }
}

/// An event as an EVENT frame. `None` for a frame of the arm, which goes out by ISO-TP.
///
/// | Word 0 | Word 1 | Word 2 | Word 3 |
/// |---|---|---|---|
/// | kind, initiator | bytes dropped | stamp, low half | stamp, high half |
///
/// ```
/// use armwire_bridge::can::Node;
/// use armwire_bridge::can::telemetry::{event_from_frame, event_to_frame};
/// use armwire_bridge::control::{Initiator, Event, Refusal, Stamp};
///
/// let event = Event::Refused { initiator: Initiator::Command, reason: Refusal::Stale };
/// let frame = event_to_frame(&event, Stamp(0x1_0000_0002), Node::new(0).unwrap()).unwrap();
/// assert_eq!(frame.data(), [4, 4, 0, 0, 2, 0, 0, 0]);
/// assert_eq!(event_from_frame(&frame), Some((2, event)));
/// ```
pub fn event_to_frame(event: &Event, at: Stamp, node: Node) -> Option<Frame> {
    Frame::new(Function::Event.id(node), &event_to_data(event, at)?).ok()
}

/// The data of an EVENT frame.
pub(crate) fn event_to_data(event: &Event, at: Stamp) -> Option<[u8; MAX_CLASSIC]> {
    let (kind, initiator, dropped) = match *event {
        // In recovery the CAN controller is off.
        Event::Frame { .. } | Event::Recovery { .. } => return None,
        Event::Refused { initiator, reason } => (refusal_code(reason), initiator_code(initiator), 0),
        Event::HostSilent {
            initiator,
            dropped,
            torque_off,
        } => {
            let kind = if torque_off {
                HOST_SILENT_TORQUE_OFF
            } else {
                HOST_SILENT
            };
            (kind, initiator_code(initiator), dropped)
        }
        Event::BusOff { off } => (if off { BUS_OFF } else { BUS_ON }, NO_INITIATOR, 0_u16),
    };
    let [drop_low, drop_high] = dropped.to_le_bytes();
    let [a, b, c, d] = (at.0 as u32).to_le_bytes();
    Some([kind, initiator, drop_low, drop_high, a, b, c, d])
}

/// Decodes EVENT: the low 32 bits of its stamp, and the event. `None` for any other frame, or for an event that no
/// adapter of this version sends.
pub fn event_from_frame(frame: &Frame) -> Option<(u32, Event)> {
    let (function, _) = Function::of(frame.id())?;
    let data = frame.data().try_into().ok().filter(|_| function == Function::Event)?;
    event_from_data(data)
}

/// Decodes the data of an EVENT frame.
pub(crate) fn event_from_data(
    [kind, initiator, drop_low, drop_high, a, b, c, d]: [u8; MAX_CLASSIC],
) -> Option<(u32, Event)> {
    let dropped = u16::from_le_bytes([drop_low, drop_high]);
    let of = Initiator::ALL.into_iter().find(|&of| initiator_code(of) == initiator);
    let event = match (kind, dropped) {
        (BUS_OFF | BUS_ON, 0) if initiator == NO_INITIATOR => Event::BusOff { off: kind == BUS_OFF },
        (HOST_SILENT | HOST_SILENT_TORQUE_OFF, _) => Event::HostSilent {
            initiator: of?,
            dropped,
            torque_off: kind == HOST_SILENT_TORQUE_OFF,
        },
        (_, 0) => Event::Refused {
            initiator: of?,
            reason: Refusal::ALL.into_iter().find(|&reason| refusal_code(reason) == kind)?,
        },
        _ => return None,
    };
    Some((u32::from_le_bytes([a, b, c, d]), event))
}

/// Kinds of events other than refusals.
const HOST_SILENT: u8 = 16;
const HOST_SILENT_TORQUE_OFF: u8 = 17;
const BUS_OFF: u8 = 32;
const BUS_ON: u8 = 33;

const fn refusal_code(reason: Refusal) -> u8 {
    match reason {
        Refusal::QueueFull => 1,
        Refusal::NotAFrame => 2,
        Refusal::Incomplete => 3,
        Refusal::Stale => 4,
        Refusal::OutOfRange => 5,
        Refusal::LineReserved => 6,
        Refusal::OtherRate => 7,
        Refusal::Stopped => 8,
    }
}

/// The code for no initiator.
const NO_INITIATOR: u8 = 0;

const fn initiator_code(initiator: Initiator) -> u8 {
    match initiator {
        Initiator::Usb => 1,
        Initiator::Can => 2,
        Initiator::Poll => 3,
        Initiator::Command => 4,
        Initiator::Adapter => 5,
    }
}

/// A frame of four words.
pub(super) fn frame(id: Id, words: [u16; 4]) -> Frame {
    Frame::padded(id, false, words.map(u16::to_le_bytes).as_flattened(), &[])
}

/// The frame's node and words. `None` for another function or length.
pub(super) fn words(frame: &Frame, function: Function) -> Option<(Node, [u16; 4])> {
    let (found, node) = Function::of(frame.id())?;
    let &[a, b, c, d, e, f, g, h] = frame.data() else {
        return None;
    };
    (found == function).then_some((node, [[a, b], [c, d], [e, f], [g, h]].map(u16::from_le_bytes)))
}

/// The low and the high half of a sample's stamp.
const fn halves(stamp: u32) -> [u16; 2] {
    [stamp as u16, (stamp >> 16) as u16]
}

fn whole(low: u16, high: u16) -> u32 {
    u32::from(high) << 16 | u32::from(low)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn node() -> impl Strategy<Value = Node> {
        (0..=15_u8).prop_map(|node| Node::new(node).unwrap())
    }

    fn sample() -> impl Strategy<Value = Sample> {
        (any::<([u16; 6], u16, u8)>(), any::<(u32, u8)>()).prop_map(|((joints, gripper, status), (stamp, count))| {
            Sample {
                state: JointState {
                    joints,
                    gripper,
                    status: MotionStatus::from(status),
                },
                stamp,
                count,
            }
        })
    }

    fn event() -> impl Strategy<Value = Event> {
        let initiator = || prop::sample::select(&Initiator::ALL[..]);
        prop_oneof![
            (initiator(), prop::sample::select(&Refusal::ALL[..]))
                .prop_map(|(initiator, reason)| Event::Refused { initiator, reason }),
            (initiator(), any::<(u16, bool)>()).prop_map(|(initiator, (dropped, torque_off))| Event::HostSilent {
                initiator,
                dropped,
                torque_off
            }),
            any::<bool>().prop_map(|off| Event::BusOff { off }),
        ]
    }

    proptest! {
        #[test]
        fn sample_survives_the_bus_bit_for_bit(sample in sample(), node in node()) {
            let frames = sample.to_frames(node);
            prop_assert!(frames.iter().all(|frame| !frame.is_fd() && frame.data().len() == 8));
            prop_assert_eq!(Sample::from_frames(&frames), Some(sample));
        }

        #[test]
        fn mixed_samples_or_adapters_make_no_sample(
            (sample, node) in (sample(), node()),
            (other, other_node) in (sample(), node()),
            exchanged in 0..3_usize,
        ) {
            prop_assume!(sample.stamp as u16 != other.stamp as u16 || node != other_node);
            let mut frames = sample.to_frames(node);
            frames[exchanged] = other.to_frames(other_node)[exchanged];
            prop_assert_eq!(Sample::from_frames(&frames), None);
        }

        #[test]
        fn errors_survive_the_bus(words in any::<([u16; 3], [u8; 2])>(), node in node()) {
            let ([noise_bytes, uart, can], [unanswered, refused]) = words;
            let errors = Errors { noise_bytes, uart, can, unanswered, refused };
            prop_assert_eq!(Errors::from_frame(&errors.to_frame(node)), Some(errors));
        }

        #[test]
        fn event_survives_the_bus(event in event(), at in any::<u64>(), node in node()) {
            let frame = event_to_frame(&event, Stamp(at), node).unwrap();
            prop_assert_eq!(event_from_frame(&frame), Some((at as u32, event)));
        }

        #[test]
        fn decoded_event_encodes_to_the_same_frame(data in any::<[u8; 8]>(), kind in 0..40_u8, initiator in 0..7_u8) {
            let node = Node::default();
            let [_, _, rest @ ..] = data;
            let [a, b, c, d, e, f] = rest;
            for data in [data, [kind, initiator, a, b, c, d, e, f], [kind, initiator, 0, 0, c, d, e, f]] {
                let frame = Frame::new(Function::Event.id(node), &data).unwrap();
                if let Some((at, event)) = event_from_frame(&frame) {
                    prop_assert_eq!(event_to_frame(&event, Stamp(at.into()), node), Some(frame));
                }
            }
        }
    }

    #[test]
    fn frame_of_wrong_function_or_length_is_ignored() {
        let node = Node::default();
        let [a, b, state] = Sample {
            state: JointState {
                joints: [0; 6],
                gripper: 0,
                status: MotionStatus::Idle,
            },
            stamp: 0,
            count: 0,
        }
        .to_frames(node);
        assert!(Sample::from_frames(&[a, b, state]).is_some());
        assert_eq!(Sample::from_frames(&[b, a, state]), None);
        assert_eq!(Errors::from_frame(&state), None);
        assert_eq!(event_from_frame(&state), None);
        for length in 0..8 {
            let short = Frame::new(Function::State.id(node), &[0; 8][..length]).unwrap();
            assert_eq!(Sample::from_frames(&[a, b, short]), None);
        }
    }

    #[test]
    fn arm_frame_is_no_event_frame() {
        let event = Event::Frame {
            initiator: None,
            bytes: crate::control::FrameBytes::default(),
        };
        assert_eq!(event_to_frame(&event, Stamp(0), Node::default()), None);
    }
}
