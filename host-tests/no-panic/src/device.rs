//! The arm's side.

use core::hint::black_box;

use armwire::{Device, Input, Protocol};

use crate::bytes;

pub(crate) fn call_all<P: Protocol, const N: usize>(response: P::Response) {
    let response = black_box(response);

    let mut device = Device::<P, N>::new();
    let device = black_box(&mut device);
    let mut received = [0; 300];
    let inputs = [Input::Bytes(bytes(&mut received)), Input::Idle, Input::Tick];
    for mut input in black_box(inputs) {
        while let Some(heard) = black_box(&mut *device).handle(&mut input) {
            black_box(heard);
        }
    }
    black_box(device.respond(&response, bytes(&mut [0; 300])).is_ok());
    black_box(P::encode_response(&response, bytes(&mut [0; 300])).is_ok());
}
