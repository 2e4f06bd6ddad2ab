//! The arm's side.

use core::hint::black_box;

use armwire::messages::Messages;
use armwire::{Device, DeviceEvent};

use crate::bytes;

pub(crate) fn call_all<M: Messages, const N: usize>(messages: M, response: M::Response<'_>) {
    let response = black_box(response);

    let mut device = Device::<M, N>::new(messages);
    let device = black_box(&mut device);
    black_box(device.receive(bytes(&mut [0; 300])));
    black_box(device.space());
    black_box(black_box(&mut *device).received(black_box(0)).is_ok());
    black_box(&mut *device).idle();
    let mut to = None;
    while let Some(event) = black_box(&mut *device).poll() {
        if let DeviceEvent::Request { key, .. } = black_box(event) {
            to = key;
        }
    }
    black_box(device.respond(&response, to, bytes(&mut [0; 300])).is_ok());
}
