//! The cyclic frames on CAN.

use core::hint::black_box;

use armwire_bridge::can::command::{Command, Commands};
use armwire_bridge::can::telemetry::{Errors, Sample, event_from_frame, event_to_frame};
use armwire_bridge::can::{Frame, Id, Node};
use armwire_bridge::control::{Event, Stamp};
use armwire_bridge::{Counters, Duration, Instant};

use crate::bytes::bytes;

pub(crate) fn call_all() {
    let now = black_box(Instant::ZERO);
    let node = black_box(Node::new(black_box(0))).unwrap_or_default();
    let id = black_box(Id::new(black_box(0))).unwrap_or(Id::MAX);
    let Ok(frame) = black_box(Frame::new_fd(id, bytes(&mut [0; 64]))) else {
        return;
    };

    if let Some(sample) = black_box(Sample::from_frames(black_box(&[frame; 3]))) {
        black_box(sample.to_frames(node));
    }
    black_box(Errors::from(black_box(&Counters::default())).to_frame(node));
    black_box(Errors::from_frame(&frame));
    black_box(event_to_frame(
        black_box(&Event::BusOff { off: true }),
        black_box(Stamp(0)),
        node,
    ));
    black_box(event_from_frame(&frame));

    let command = black_box(Command {
        sequence: 0,
        joints: [0; 6],
        speed: 0,
        gripper: 0,
    });
    black_box(command.to_frames(node));
    black_box(command.target().is_ok());

    let mut commands = Commands::new(node, black_box(Duration::ZERO));
    let commands = black_box(&mut commands);
    black_box(commands.receive(&frame, now));
    black_box(black_box(&*commands).timeout());
    black_box(black_box(&mut *commands).tick(now));
    black_box(&mut *commands).stop();
    black_box(black_box(&mut *commands).receive(&frame, now));
}
