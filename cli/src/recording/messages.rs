//! The ROS 2 messages of a recording, field by field in the order of their definitions.

use armwire_host::describe::Protocol;
use armwire_host::stamps::ros_time;
use byteorder::LittleEndian;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::frame::Frame;
use crate::args::Speaker;
use crate::printable::cut;

/// Type and definition of [`JointState`].
pub(crate) const JOINT_STATE: (&str, &str) = ("sensor_msgs/msg/JointState", include_str!("joint_state.ros2msg"));
/// Type and definition of the message for a [`Frame`].
pub(crate) const FRAME: (&str, &str) = ("armwire_msgs/msg/Frame", include_str!("frame.ros2msg"));
/// The encoding of definitions.
pub(super) const SCHEMA_ENCODING: &str = "ros2msg";
/// The encoding of messages.
pub(crate) const MESSAGE_ENCODING: &str = "cdr";

/// The first bytes of an encoded message: CDR, little-endian.
const LITTLE_ENDIAN: [u8; 4] = [0, 1, 0, 0];

const TO_ARM: u8 = 0;
const FROM_ARM: u8 = 1;
const PROTOCOLS: [(Protocol, &str); 4] = [
    (Protocol::Ling, "ling"),
    (Protocol::LingLegacy, "ling-legacy"),
    (Protocol::Xarm, "xarm"),
    (Protocol::Alpha1, "alpha1"),
];

/// `builtin_interfaces/msg/Time`
#[derive(Serialize, Deserialize)]
struct Time {
    sec: i32,
    nanosec: u32,
}

impl Time {
    fn from_nanos(nanos: i64) -> Self {
        let (sec, nanosec) = ros_time(nanos);
        Self { sec, nanosec }
    }

    fn as_nanos(&self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }
}

/// `std_msgs/msg/Header`
#[derive(Serialize)]
struct Header {
    stamp: Time,
    frame_id: &'static str,
}

/// `sensor_msgs/msg/JointState`
#[derive(Serialize)]
struct JointState<'a> {
    header: Header,
    name: &'a [String],
    position: &'a [f64],
    velocity: &'a [f64],
    effort: &'a [f64],
}

/// `armwire_msgs/msg/Frame`
#[derive(Serialize, Deserialize)]
struct FrameMessage {
    stamp: Time,
    arm: String,
    direction: u8,
    data: Vec<u8>,
}

/// The fields of `std_msgs/msg/Header` and of the front of `sensor_msgs/msg/JointState` of any program.
#[derive(Deserialize)]
struct AnyJointState {
    stamp: Time,
    _frame_id: String,
    name: Vec<String>,
    position: Vec<f64>,
}

/// Joints by their names. The stamp is in nanoseconds since 1970; 0 for none.
#[derive(Debug)]
pub(crate) struct NamedJoints {
    pub(crate) stamp: i64,
    /// In rad, and m for what slides, as the message's definition says.
    pub(crate) positions: Vec<(String, f64)>,
}

/// Joint positions at a time in nanoseconds since 1970, as an encoded message.
pub(super) fn joint_state(nanos: i64, name: &[String], position: &[f64]) -> Vec<u8> {
    encode(&JointState {
        header: Header {
            stamp: Time::from_nanos(nanos),
            frame_id: "",
        },
        name,
        position,
        velocity: &[],
        effort: &[],
    })
}

/// A frame as an encoded message.
pub(super) fn frame(frame: &Frame) -> Vec<u8> {
    let (_, arm) = PROTOCOLS
        .into_iter()
        .find(|(protocol, _)| *protocol == frame.protocol)
        .expect("each protocol has a name");
    encode(&FrameMessage {
        stamp: Time::from_nanos(frame.stamp),
        arm: arm.to_owned(),
        direction: match frame.from {
            Speaker::Host => TO_ARM,
            Speaker::Arm => FROM_ARM,
        },
        data: frame.bytes.clone(),
    })
}

/// The frame in an encoded message that was logged at this time.
///
/// # Errors
///
/// The reason, if it is no frame.
pub(crate) fn parse_frame(log_time: i64, message: &[u8]) -> Result<Frame, String> {
    let message: FrameMessage = decode(message)?;
    let (protocol, _) = PROTOCOLS
        .into_iter()
        .find(|(_, arm)| *arm == message.arm)
        .ok_or_else(|| format!("the arm '{}' is unknown", cut(&message.arm)))?;
    let from = match message.direction {
        TO_ARM => Speaker::Host,
        FROM_ARM => Speaker::Arm,
        other => return Err(format!("direction {other} is unknown")),
    };
    Ok(Frame {
        log_time,
        stamp: message.stamp.as_nanos(),
        protocol,
        from,
        bytes: message.data,
    })
}

/// The joints in an encoded `sensor_msgs/msg/JointState`.
///
/// # Errors
///
/// The reason, if it is none.
pub(crate) fn parse_joint_state(message: &[u8]) -> Result<NamedJoints, String> {
    let AnyJointState {
        stamp, name, position, ..
    } = decode(message)?;
    if name.len() != position.len() {
        return Err(format!("it has {} names and {} positions", name.len(), position.len()));
    }
    Ok(NamedJoints {
        stamp: stamp.as_nanos(),
        positions: name.into_iter().zip(position).collect(),
    })
}

/// The front of an encoded message.
fn decode<T: DeserializeOwned>(message: &[u8]) -> Result<T, String> {
    let body = match message.split_first_chunk() {
        // The last two bytes are options, which have no meaning.
        Some(([0, 1, _, _], body)) => body,
        _ => return Err("it is not in little-endian CDR".to_owned()),
    };
    let decoded = cdr_encoding::from_bytes::<T, LittleEndian>(body);
    decoded.map(|(message, _)| message).map_err(|error| error.to_string())
}

fn encode(message: &impl Serialize) -> Vec<u8> {
    let body = cdr_encoding::to_vec::<_, LittleEndian>(message).expect("messages have CDR's types");
    [&LITTLE_ENDIAN[..], &body].concat()
}
