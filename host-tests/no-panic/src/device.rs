//! The arm's side.

use core::hint::black_box;

use armwire::ling::{Ling, MAX_FRAME, Response};
use armwire::{Device, Input, Protocol};

use crate::bytes;

pub(crate) fn call_all() {
    let mut device = Device::<Ling, MAX_FRAME>::new();
    let device = black_box(&mut device);
    let mut received = [0; 300];
    let inputs = [Input::Bytes(bytes(&mut received)), Input::Idle, Input::Tick];
    for mut input in black_box(inputs) {
        while let Some(heard) = black_box(&mut *device).handle(&mut input) {
            black_box(heard);
        }
    }
    let response = black_box(Response::Stroke(armwire::ling::Stroke::Mm50));
    let _ = black_box(device.respond(&response, bytes(&mut [0; 300])));
    let _ = black_box(Ling::encode_response(&response, bytes(&mut [0; 300])));
}
