//! The DDS side: one participant, and for each arm a ROS 2 node with its topics, its services and its action.

use std::fmt::Display;
use std::net::{IpAddr, Ipv4Addr};

use ros2_client::action::ActionServerQosPolicies;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    ActionServer, ActionTypeName, Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile,
    Server, ServiceMapping, ServiceTypeName, Subscription,
};
use rustdds::DomainParticipantBuilder;

use crate::messages::{
    Decoded, DiagnosticArray, FollowFeedback, FollowGoal, FollowResult, JointState, JointTrajectory, Outcome,
    SetBoolRequest, TriggerRequest,
};
use crate::options::{Checked, Rmw};

/// The participant in the DDS domain.
pub(crate) struct Network {
    context: Context,
}

/// The topics, the services and the action of one arm.
pub(crate) struct Endpoints {
    pub(crate) states: Publisher<JointState>,
    pub(crate) diagnostics: Publisher<DiagnosticArray>,
    pub(crate) trajectories: Subscription<Decoded<JointTrajectory>>,
    pub(crate) follow: ActionServer<Decoded<FollowGoal>, FollowResult, FollowFeedback>,
    pub(crate) torque: Server<Decoded<SetBoolRequest>, Outcome>,
    pub(crate) set_zero: Server<Decoded<TriggerRequest>, Outcome>,
}

/// Reliable, for readers of both kinds. Never waits for a slow reader, for which the last samples are kept.
fn qos() -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .history(History::KeepLast { depth: 10 })
}

/// The QoS of an action in ROS 2: a late client gets the last states of the goals.
fn action_qos() -> ActionServerQosPolicies {
    ActionServerQosPolicies {
        goal_service: qos(),
        result_service: qos(),
        cancel_service: qos(),
        feedback_publisher: qos(),
        status_publisher: qos()
            .durability(Durability::TransientLocal)
            .history(History::KeepLast { depth: 1 }),
    }
}

impl Network {
    /// Joins the domain on the one interface that has this address.
    pub(crate) fn join(options: &Checked) -> Result<Self, String> {
        let builder = DomainParticipantBuilder::new(options.domain)
            .with_only_networks([IpAddr::V4(options.address)])
            .same_host_loopback(options.address == Ipv4Addr::LOCALHOST);
        let participant = builder
            .build()
            .map_err(|error| format!("cannot join domain {}: {error}", options.domain))?;
        let context = Context::from_domain_participant(participant).map_err(|error| error.to_string())?;
        Ok(Self { context })
    }

    /// Returns false when the participant has ended: its threads do so at an interrupted system call, for example when the
    /// process is stopped and continued, or the computer suspended. Nothing is received then.
    pub(crate) fn is_alive(&self) -> bool {
        self.context.domain_participant().assert_liveliness().is_ok()
    }

    /// The node `/NAME/armwire`, which other nodes see until it is dropped, with its topics, its services and its action.
    pub(crate) fn endpoints(&self, arm: &str, rmw: Rmw) -> Result<(Node, Endpoints), String> {
        let namespace = format!("/{arm}");
        let name = NodeName::new(&namespace, "armwire").map_err(of_arm(arm))?;
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let mut node = self.context.new_node(name, options).map_err(of_arm(arm))?;
        let topic = |node: &Node, namespace: &str, name: &str, package: &str, kind: &str| {
            let name = Name::new(namespace, name).map_err(of_arm(arm))?;
            node.create_topic(&name, MessageTypeName::new(package, kind), &qos())
                .map_err(of_arm(arm))
        };
        let states = topic(&node, &namespace, "joint_states", "sensor_msgs", "JointState")?;
        let diagnostics = topic(&node, "/", "diagnostics", "diagnostic_msgs", "DiagnosticArray")?;
        let trajectories = topic(
            &node,
            &namespace,
            "joint_trajectory",
            "trajectory_msgs",
            "JointTrajectory",
        )?;
        let mapping = match rmw {
            Rmw::Fastrtps => ServiceMapping::Enhanced,
            Rmw::Cyclonedds => ServiceMapping::Cyclone,
        };
        let service = |name: &str| Name::new(&namespace, name).map_err(of_arm(arm));
        let follow = Name::new(&namespace, "follow_joint_trajectory").map_err(of_arm(arm))?;
        let follow_type = ActionTypeName::new("control_msgs", "FollowJointTrajectory");
        let set_bool = ServiceTypeName::new("std_srvs", "SetBool");
        let trigger = ServiceTypeName::new("std_srvs", "Trigger");
        let endpoints = Endpoints {
            states: node.create_publisher(&states, None).map_err(of_arm(arm))?,
            diagnostics: node.create_publisher(&diagnostics, None).map_err(of_arm(arm))?,
            trajectories: node.create_subscription(&trajectories, None).map_err(of_arm(arm))?,
            follow: node
                .create_action_server(mapping, &follow, &follow_type, action_qos())
                .map_err(of_arm(arm))?,
            torque: node
                .create_server(mapping, &service("torque")?, &set_bool, qos(), qos())
                .map_err(of_arm(arm))?,
            set_zero: node
                .create_server(mapping, &service("set_zero")?, &trigger, qos(), qos())
                .map_err(of_arm(arm))?,
        };
        Ok((node, endpoints))
    }
}

/// Adds the arm to an error.
fn of_arm<E: Display>(arm: &str) -> impl Fn(E) -> String {
    move |error| format!("arm {arm}: {error}")
}
