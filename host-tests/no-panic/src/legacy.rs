//! Ling's older generation: all but requests, of which there are none.

use core::hint::black_box;

use armwire::ling::legacy::{
    Detector, Firmware, Frame, GripperState, JointState, Legacy, MAX_FRAME, Response, SERVOS, parity,
};
use armwire::{Client, Config};

use crate::{bytes, client, decoder, device, exchange};

pub(crate) fn call_all() {
    let firmware = black_box(Firmware::V6_0);
    let joints = black_box(JointState {
        firmware,
        servos: [0; SERVOS],
    });
    let gripper = GripperState {
        firmware,
        id: 1,
        servo: 0,
        potentiometer: 0,
        sync_button: 0,
        attitude_button: 0,
    };
    decoder::call_all::<Legacy, MAX_FRAME>(&Legacy, ());
    exchange::call_all(&Legacy);
    device::call_all::<Legacy, MAX_FRAME>(Legacy, black_box(Response::Joints(joints)));
    device::call_all::<Legacy, MAX_FRAME>(Legacy, black_box(Response::Gripper(gripper)));
    black_box(joints.joints());
    black_box(joints.positions().is_ok());
    black_box((firmware.joints_command(), firmware.gripper_command()));

    let mut received = [0; 300];
    let received = bytes(&mut received);
    black_box(parity(received));
    let mut detector = Detector::new();
    black_box(black_box(&mut detector).push(received));

    black_box(Frame::parse(received));

    let mut client = Client::<Legacy, MAX_FRAME>::new(Legacy, black_box(Config::DEFAULT));
    client::drive(black_box(&mut client));
}
