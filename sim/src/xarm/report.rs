//! The report that the arm sends five times a second to clients of its report port (30002, "rich").
//!
//! The document does not describe it: the fields are those that the vendor's Python SDK parses. A real arm's report has
//! 233 to 587 bytes, depending on its firmware, and the SDK infers the fields from the length. This report ends with
//! the torque source.
//!
//! Fields that a virtual arm does not have are zero: torques, currents, voltages, temperatures; tool, load and offsets;
//! inputs and outputs; a force sensor; collision sensitivity; limits on jerk and on Cartesian motion; ids and error
//! codes of its servos.

use armwire::time::Instant;
use armwire::xarm::TorqueSource;

use super::body::{MAX_ACCELERATION, MAX_SPEED};
use super::{VirtualXArm, floats};

/// Length of a report, in bytes. The SDK closes a connection when the length changes.
pub const REPORT: usize = 495;

impl VirtualXArm {
    /// Returns a report, [`REPORT`] bytes, which a real arm sends five times a second.
    pub fn report(&mut self, now: Instant) -> Vec<u8> {
        self.advance(now);
        let body = &self.body;
        let placed = body.placed();
        let flange = &placed.flange;
        let kind = self.config.model.joints() as u8;

        let mut out = Fields(Vec::with_capacity(REPORT));
        out.bytes(&(REPORT as u32).to_be_bytes());
        out.bytes(&[body.mode() << 4 | body.state()]);
        out.bytes(&(body.moves() as u16).to_be_bytes());
        out.floats(body.joints());
        out.floats(&flange.position);
        out.floats(&flange.roll_pitch_yaw());
        out.zeros(7 * 4); // torques
        // Brake bits: 1 means off, which a motor that is on has.
        out.bytes(&[body.motors(), body.motors(), body.error(), body.warning()]);
        out.zeros(6 * 4 + 4 * 4); // tool and load
        out.zeros(2); // sensitivity to collisions and to guiding hands
        out.floats(&[0.0, 0.0, -1.0]); // gravity
        out.bytes(&[kind, kind, 0, 0, 0, 0]); // type, axes, ids
        out.bytes(&self.config.version[..29]);
        out.zeros(1);
        out.zeros(5 * 4); // Cartesian motion: jerk, accelerations, speeds
        out.floats(&[0.0, 0.0, MAX_ACCELERATION.into(), 0.0, MAX_SPEED.into()]); // joint motion: the same
        out.zeros(2 * 4); // Cartesian rotation: jerk, acceleration
        out.zeros(7 * 2 + 2); // status and error code of each servo and of the flange's electronics
        out.zeros(7); // temperatures
        out.floats(&[placed.speed(body.velocities())]);
        out.floats(body.velocities());
        out.zeros(4); // a counter
        out.zeros(6 * 4); // base offset
        out.zeros(2); // resetting of outputs
        out.zeros(3 + 6 * 4); // simulation, self-collision, shape of the tool
        out.zeros(7 * 2 + 7 * 4); // voltages, currents
        out.zeros(2 + 8 * 2 + 4 * 8); // inputs and outputs
        out.zeros(2 * 6 * 4); // force sensor
        out.zeros(1); // identification
        out.floats(&flange.rotation_vector());
        let current = u8::from(self.torque_source == TorqueSource::Current);
        out.bytes(&[current << 2 | u8::from(self.approximates) << 3]);
        out.0
    }
}

/// Fields, one after the other.
struct Fields(Vec<u8>);

impl Fields {
    fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    fn floats(&mut self, values: &[f64]) {
        self.0.extend(floats(values));
    }

    fn zeros(&mut self, n: usize) {
        self.0.resize(self.0.len() + n, 0);
    }
}
