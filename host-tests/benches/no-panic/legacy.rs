//! Ling's older generation, which has no requests.

use core::hint::black_box;

use armwire::ling::legacy::{Detector, Firmware, Frame, JointState, Legacy, MAX_FRAME, Response, SERVOS, parity};

use crate::bytes::bytes;
use crate::protocol;

pub(crate) fn call_all() {
    let firmware = black_box(Firmware::V6_0);
    let joints = black_box(JointState {
        firmware,
        servos: [0; SERVOS],
    });
    protocol::call_all::<Legacy, MAX_FRAME>(Legacy, None, Response::Joints(joints), ());
    black_box(joints.joints());
    black_box(joints.positions().is_ok());
    black_box((firmware.joints_command(), firmware.gripper_command()));

    let mut received = [0; 300];
    let received = bytes(&mut received);
    black_box(parity(received));
    let mut detector = Detector::new();
    black_box(black_box(&mut detector).push(received));

    black_box(Frame::parse(received));
}
