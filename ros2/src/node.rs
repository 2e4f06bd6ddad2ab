//! The DDS side: one participant, and for each arm a ROS 2 node with its topics and services.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use ros2_client::qos::{History, WhenFull};
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile, Server, ServiceMapping,
    ServiceTypeName, Subscription,
};
use rustdds::DomainParticipantBuilder;

use crate::messages::{DiagnosticArray, JointState, JointTrajectory, Outcome, SetBoolRequest, TriggerRequest};
use crate::options::{Checked, Rmw};

/// Interval at which a node checks for a request to end.
const LOOK: Duration = Duration::from_millis(100);

/// Our place in the network.
pub(crate) struct Network {
    context: Context,
}

/// A node, which others see as long as it is kept.
pub(crate) struct Kept(Node);

/// The topics and services of one arm.
pub(crate) struct Endpoints {
    pub(crate) states: Publisher<JointState>,
    pub(crate) diagnostics: Publisher<DiagnosticArray>,
    pub(crate) trajectories: Subscription<JointTrajectory>,
    pub(crate) torque: Server<SetBoolRequest, Outcome>,
    pub(crate) set_zero: Server<TriggerRequest, Outcome>,
}

/// Reliable, so that readers of both kinds are served, and never waiting for a slow one: the last few are kept for it.
fn qos(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .history(History::KeepLast { depth })
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

    /// The node `/NAME/armwire` with its topics and services.
    pub(crate) fn endpoints(&self, arm: &str, rmw: Rmw) -> Result<(Kept, Endpoints), String> {
        let told = |error: &dyn std::fmt::Display| format!("arm {arm}: {error}");
        let namespace = format!("/{arm}");
        let name = NodeName::new(&namespace, "armwire").map_err(|error| told(&error))?;
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let mut node = self.context.new_node(name, options).map_err(|error| told(&error))?;
        let topic = |node: &Node, namespace: &str, name: &str, package: &str, kind: &str, depth: usize| {
            let name = Name::new(namespace, name).map_err(|error| told(&error))?;
            node.create_topic(&name, MessageTypeName::new(package, kind), &qos(depth))
                .map_err(|error| told(&error))
        };
        let states = topic(&node, &namespace, "joint_states", "sensor_msgs", "JointState", 10)?;
        let diagnostics = topic(&node, "/", "diagnostics", "diagnostic_msgs", "DiagnosticArray", 10)?;
        let trajectories = topic(
            &node,
            &namespace,
            "joint_trajectory",
            "trajectory_msgs",
            "JointTrajectory",
            1,
        )?;
        let mapping = match rmw {
            Rmw::Fastrtps => ServiceMapping::Enhanced,
            Rmw::Cyclonedds => ServiceMapping::Cyclone,
        };
        let service = |name: &str| Name::new(&namespace, name).map_err(|error| told(&error));
        let set_bool = ServiceTypeName::new("std_srvs", "SetBool");
        let trigger = ServiceTypeName::new("std_srvs", "Trigger");
        let endpoints = Endpoints {
            states: node.create_publisher(&states, None).map_err(|error| told(&error))?,
            diagnostics: node
                .create_publisher(&diagnostics, None)
                .map_err(|error| told(&error))?,
            trajectories: node
                .create_subscription(&trajectories, None)
                .map_err(|error| told(&error))?,
            torque: node
                .create_server(mapping, &service("torque")?, &set_bool, qos(10), qos(10))
                .map_err(|error| told(&error))?,
            set_zero: node
                .create_server(mapping, &service("set_zero")?, &trigger, qos(10), qos(10))
                .map_err(|error| told(&error))?,
        };
        Ok((Kept(node), endpoints))
    }
}

impl Kept {
    /// Keeps the node until it is to end.
    pub(crate) fn keep_until(self, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            thread::sleep(LOOK);
        }
        drop(self.0);
    }
}
