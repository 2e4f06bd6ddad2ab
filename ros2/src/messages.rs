//! The ROS 2 messages of the node, with fields in the order of their `.msg` and `.srv` files.

use std::time::Duration;

use armwire_host::stamps::ros_time;
use ros2_client::Message;
use serde::{Deserialize, Deserializer, Serialize};

/// A message, or the reason why its bytes are none: the reader then still knows its sender and number.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Decoded<M>(pub(crate) Result<M, String>);

impl<'de, M: Deserialize<'de>> Deserialize<'de> for Decoded<M> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(Self(M::deserialize(deserializer).map_err(|error| error.to_string())))
    }
}

impl<M: Message> Message for Decoded<M> {}

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

    pub(crate) fn of_duration(duration: Duration) -> Self {
        Self {
            sec: i32::try_from(duration.as_secs()).unwrap_or(i32::MAX),
            nanosec: duration.subsec_nanos(),
        }
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

/// `geometry_msgs/Vector3`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Vector3 {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) z: f64,
}

/// `geometry_msgs/Quaternion`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Quaternion {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) z: f64,
    pub(crate) w: f64,
}

/// `geometry_msgs/Transform`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Transform {
    pub(crate) translation: Vector3,
    pub(crate) rotation: Quaternion,
}

/// `geometry_msgs/Twist`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Twist {
    pub(crate) linear: Vector3,
    pub(crate) angular: Vector3,
}

/// `trajectory_msgs/MultiDOFJointTrajectoryPoint`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct MultiDofPoint {
    pub(crate) transforms: Vec<Transform>,
    pub(crate) velocities: Vec<Twist>,
    pub(crate) accelerations: Vec<Twist>,
    pub(crate) time_from_start: Time,
}

/// `trajectory_msgs/MultiDOFJointTrajectory`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct MultiDofTrajectory {
    pub(crate) header: Header,
    pub(crate) joint_names: Vec<String>,
    pub(crate) points: Vec<MultiDofPoint>,
}

/// `control_msgs/JointTolerance`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct JointTolerance {
    pub(crate) name: String,
    pub(crate) position: f64,
    pub(crate) velocity: f64,
    pub(crate) acceleration: f64,
}

/// `control_msgs/JointComponentTolerance`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ComponentTolerance {
    pub(crate) joint_name: String,
    pub(crate) component: u16,
    pub(crate) position: f64,
    pub(crate) velocity: f64,
    pub(crate) acceleration: f64,
}

/// The goal of `control_msgs/FollowJointTrajectory`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct FollowGoal {
    pub(crate) trajectory: JointTrajectory,
    pub(crate) multi_dof_trajectory: MultiDofTrajectory,
    pub(crate) path_tolerance: Vec<JointTolerance>,
    pub(crate) component_path_tolerance: Vec<ComponentTolerance>,
    pub(crate) goal_tolerance: Vec<JointTolerance>,
    pub(crate) component_goal_tolerance: Vec<ComponentTolerance>,
    pub(crate) goal_time_tolerance: Time,
}

impl Message for FollowGoal {}

/// The result of `control_msgs/FollowJointTrajectory`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct FollowResult {
    pub(crate) error_code: i32,
    pub(crate) error_string: String,
}

impl FollowResult {
    pub(crate) const SUCCESSFUL: i32 = 0;
    pub(crate) const INVALID_GOAL: i32 = -1;
    pub(crate) const PATH_TOLERANCE_VIOLATED: i32 = -4;
    pub(crate) const GOAL_TOLERANCE_VIOLATED: i32 = -5;
}

impl Message for FollowResult {}

/// The feedback of `control_msgs/FollowJointTrajectory`, as in ROS 2 Jazzy
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct FollowFeedback {
    pub(crate) header: Header,
    pub(crate) joint_names: Vec<String>,
    pub(crate) desired: JointTrajectoryPoint,
    pub(crate) actual: JointTrajectoryPoint,
    pub(crate) error: JointTrajectoryPoint,
    pub(crate) multi_dof_joint_names: Vec<String>,
    pub(crate) multi_dof_desired: MultiDofPoint,
    pub(crate) multi_dof_actual: MultiDofPoint,
    pub(crate) multi_dof_error: MultiDofPoint,
}

impl Message for FollowFeedback {}
