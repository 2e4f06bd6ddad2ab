//! The ROS 2 messages of the node, with fields in the order of their `.msg` and `.srv` files.

use armwire_host::stamps::ros_time;
use ros2_client::Message;
use serde::{Deserialize, Serialize};

/// `builtin_interfaces/Time`; `builtin_interfaces/Duration` has the same fields.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Time {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

impl Time {
    /// Nanoseconds since 1970 as a ROS time.
    pub(crate) fn from_nanos(nanos: i64) -> Self {
        let (sec, nanosec) = ros_time(nanos);
        Self { sec, nanosec }
    }
}

/// `std_msgs/Header`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) stamp: Time,
    pub(crate) frame_id: String,
}

/// `sensor_msgs/JointState`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct JointState {
    pub(crate) header: Header,
    pub(crate) name: Vec<String>,
    pub(crate) position: Vec<f64>,
    pub(crate) velocity: Vec<f64>,
    pub(crate) effort: Vec<f64>,
}

impl Message for JointState {}

/// `trajectory_msgs/JointTrajectoryPoint`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct JointTrajectoryPoint {
    pub(crate) positions: Vec<f64>,
    pub(crate) velocities: Vec<f64>,
    pub(crate) accelerations: Vec<f64>,
    pub(crate) effort: Vec<f64>,
    pub(crate) time_from_start: Time,
}

/// `trajectory_msgs/JointTrajectory`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct JointTrajectory {
    pub(crate) header: Header,
    pub(crate) joint_names: Vec<String>,
    pub(crate) points: Vec<JointTrajectoryPoint>,
}

impl Message for JointTrajectory {}

/// `diagnostic_msgs/KeyValue`
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct KeyValue {
    pub(crate) key: String,
    pub(crate) value: String,
}

/// `diagnostic_msgs/DiagnosticStatus`
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DiagnosticStatus {
    pub(crate) level: u8,
    pub(crate) name: String,
    pub(crate) message: String,
    pub(crate) hardware_id: String,
    pub(crate) values: Vec<KeyValue>,
}

/// `diagnostic_msgs/DiagnosticArray`
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DiagnosticArray {
    pub(crate) header: Header,
    pub(crate) status: Vec<DiagnosticStatus>,
}

impl Message for DiagnosticArray {}

/// The request of `std_srvs/SetBool`
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct SetBoolRequest {
    pub(crate) data: bool,
}

impl Message for SetBoolRequest {}

/// The request of `std_srvs/Trigger`. DDS needs a field in an empty message.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct TriggerRequest {
    structure_needs_at_least_one_member: u8,
}

impl Message for TriggerRequest {}

/// The response of `std_srvs/SetBool` and of `std_srvs/Trigger`
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub(crate) success: bool,
    pub(crate) message: String,
}

impl Message for Outcome {}
