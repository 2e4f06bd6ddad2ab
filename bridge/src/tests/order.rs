//! Calls in orders that the firmware's tasks can produce, without a request for the status in between.

extern crate std;

use std::boxed::Box;
use std::vec;
use std::vec::Vec;

use armwire::ling;

use super::rig::{Rig, at, ling, motion, send_request, streaming_on_can_into_a_self_check, transmit};
use crate::can::command::Command;
use crate::can::{Frame, Function, Node};
use crate::config::{Can, Config, HostTimeout, Poll};
use crate::control::{
    ArmIdentity, Event, FromAdapter, Identity, MAX_FRAME, MAX_MESSAGE, Reader, Refusal, Reply, Request, Stamp,
    Subscription,
};
use crate::{Action, Bridge, CanEvent, PACKET, Start, UsbEvent};

const FRAMES: Request = Request::Subscribe(Subscription {
    frames: true,
    events: false,
});

/// An adapter with a host on USB.
fn adapter(config: Config) -> Bridge {
    let mut bridge = Bridge::new(Identity::default(), config, Start::default());
    bridge.usb_event(UsbEvent::Configured(true), at(0));
    bridge
}

/// A configuration with torque-off at this timeout.
fn silent_after(after_ms: u16) -> Config {
    Config {
        host_timeout: HostTimeout {
            after_ms,
            torque_off: true,
        },
        ..Config::default()
    }
}

/// The pending messages for the host on the control interface.
fn messages(bridge: &mut Bridge, now: u64) -> Vec<FromAdapter> {
    let mut reader = Reader::<MAX_MESSAGE>::new();
    let mut messages = vec![];
    let mut packet = [0; PACKET];
    while bridge.update(at(now)).control {
        let len = bridge.control_transmit(&mut packet, at(now)).unwrap_or(0);
        let mut left = &packet[..len];
        while !left.is_empty() {
            left = reader.push(left);
            messages.extend(reader.next::<FromAdapter>().map(Result::unwrap));
        }
    }
    messages
}

/// A frame on the bus, to a function of node 0.
fn receive(bridge: &mut Bridge, function: Function, data: &[u8], now: u64) {
    let id = function.id(Node::new(0).unwrap());
    bridge.can_received(&Frame::new(id, data).unwrap(), at(now));
}

#[test]
fn identification_follows_the_bus_check() {
    let mut bridge = adapter(Config {
        can: Can {
            telemetry_hz: 100,
            ..Can::default()
        },
        ..Config::default()
    });
    send_request(&mut bridge, 1, Request::IdentifyArm, at(0));
    assert!(transmit(&mut bridge, &mut [0; MAX_FRAME], at(0)).is_some());
    assert_eq!(bridge.uart_received(&ling(0x01, 0, &[0; 24]), at(700)), 1);
    while bridge.can_transmit(at(700)).is_some() {}
    assert!(bridge.update(at(700)).control);
    assert!(matches!(
        messages(&mut bridge, 700)[..],
        [FromAdapter::Reply {
            sequence: 1,
            reply: Reply::Arm(_)
        }]
    ));
}

#[test]
fn motion_of_silent_host_is_dropped_without_listener() {
    let mut rig = streaming_on_can_into_a_self_check(silent_after(200));
    // Three motions wait.
    for _ in 0..3 {
        rig.can_out.push_back(motion());
        rig.run(5_000);
    }
    let frame = ling(0x77, 0, &[]);
    rig.bridge.uart_received(&frame.repeat(8), at(rig.now));
    rig.bridge.uart_received(&frame.repeat(7), at(rig.now));
    while rig.bridge.counters().host_silences == 0 {
        rig.now = rig.bridge.timeout().unwrap().as_micros().max(rig.now);
        rig.bridge.tick(at(rig.now));
    }
    let before = rig.sent.len();
    rig.run(2_000_000);
    let torque_off = ling(0x05, 0, &[0]);
    assert_eq!(
        rig.sent[before..].iter().map(|(_, bytes)| bytes).collect::<Vec<_>>(),
        [&torque_off]
    );
}

#[test]
fn request_behind_abandoned_reply_is_served() {
    let mut bridge = Bridge::default();
    // GetCounters: its reply has several frames. GetConfig waits for room.
    receive(&mut bridge, Function::ControlRequest, &[2, 0, 6], 0);
    assert!(bridge.can_transmit(at(0)).is_some());
    bridge.can_event(CanEvent::Waiting(0), at(130));
    receive(&mut bridge, Function::ControlRequest, &[2, 1, 2], 200);
    assert_eq!(bridge.counters().control_requests, 1);
    // The host has no room for the reply.
    receive(&mut bridge, Function::ControlRequest, &[0x32, 0, 0], 300);
    assert!(bridge.can_transmit(at(300)).is_some());
    assert_eq!(bridge.counters().control_requests, 2);
}

#[test]
fn subscriber_gets_the_frames_of_its_subscription() {
    let mut bridge = adapter(Config::default());
    let done = |sequence| FromAdapter::Reply {
        sequence,
        reply: Reply::Done,
    };
    send_request(&mut bridge, 1, FRAMES, at(0));
    assert_eq!(messages(&mut bridge, 0), [done(1)]);
    // A frame received before the host disconnected.
    bridge.uart_received(&ling(0x77, 0, &[1]), at(100));
    bridge.usb_event(UsbEvent::Reset, at(200));
    bridge.usb_event(UsbEvent::Configured(true), at(300));
    send_request(&mut bridge, 2, FRAMES, at(3_600_000_000));
    assert_eq!(messages(&mut bridge, 3_600_000_000), [done(2)]);
    // A frame received before the subscription ends.
    bridge.uart_received(&ling(0x77, 0, &[2]), at(3_600_000_100));
    let nothing = Subscription {
        frames: false,
        events: false,
    };
    send_request(&mut bridge, 3, Request::Subscribe(nothing), at(3_600_000_200));
    let received = messages(&mut bridge, 3_600_000_200);
    assert_eq!(received.len(), 2, "{received:?}");
    assert!(matches!(
        received[0],
        FromAdapter::Event {
            at: Stamp(3_600_000_100),
            event: Event::Frame { .. }
        }
    ));
    assert_eq!(received[1], done(3));
}

#[test]
fn old_bus_answer_is_not_sent_on_new() {
    let mut bridge = adapter(Config::default());
    let mut request = vec![0];
    request.extend(ling(0x06, 2, &[0xFE]));
    request[0] = request.len() as u8 - 1;
    receive(&mut bridge, Function::ArmRequest, &request, 0);
    assert!(transmit(&mut bridge, &mut [0; MAX_FRAME], at(0)).is_some());
    let config = Config {
        can: Can {
            node: Node::new(5).unwrap(),
            ..Can::default()
        },
        ..Config::default()
    };
    send_request(&mut bridge, 1, Request::SetConfig(config), at(10));
    assert_eq!(bridge.action(at(20)), None);
    assert_eq!(bridge.uart_received(&ling(0x06, 2, &[1]), at(700)), 1);
    assert!(matches!(bridge.action(at(700)), Some(Action::RestartCan(_))));
    assert_eq!(bridge.can_transmit(at(700)), None);
    assert_eq!(bridge.counters().isotp_failures, 1);
}

#[test]
fn torque_off_waits_for_the_request_in_flight() {
    let mut bridge = adapter(silent_after(200));
    let mut out = [0; MAX_FRAME];
    for _ in 0..3 {
        bridge.usb_received(&motion(), at(0));
        assert!(transmit(&mut bridge, &mut out, at(0)).is_some());
    }
    send_request(&mut bridge, 1, Request::IdentifyArm, at(199_990));
    assert!(transmit(&mut bridge, &mut out, at(199_995)).is_some());
    assert_eq!(out[1], 0x01);
    // The host is silent while the adapter's own request goes out.
    bridge.tick(at(200_000));
    assert!(bridge.update(at(200_001)).is_armed);
    // The arm does not answer the identification; then torque-off follows.
    let silent = loop {
        let now = bridge.timeout().unwrap();
        bridge.tick(now);
        if transmit(&mut bridge, &mut out, now).is_some() {
            break now;
        }
    };
    assert_eq!(out[..7], ling(0x05, 0, &[0])[..]);
    assert!(!bridge.update(silent).is_armed);
    assert!(matches!(
        messages(&mut bridge, silent.as_micros())[..],
        [FromAdapter::Reply {
            sequence: 1,
            reply: Reply::Arm(ArmIdentity { answer: None, .. })
        }]
    ));
}

#[test]
fn frames_of_two_packets_are_published() {
    let mut bridge = adapter(Config::default());
    send_request(&mut bridge, 1, FRAMES, at(0));
    messages(&mut bridge, 0);
    let frame = ling(0x77, 0, &[]);
    let packet = frame.repeat(PACKET / frame.len());
    let mut frames = 0;
    for now in [100, 200] {
        frames += bridge.uart_received(&packet, at(now));
        assert_eq!(bridge.counters().dropped_events, 0);
    }
    assert_eq!(messages(&mut bridge, 200).len(), frames);
}

#[test]
fn all_frames_of_a_long_read_are_published() {
    let mut bridge = adapter(Config::default());
    send_request(&mut bridge, 1, FRAMES, at(0));
    messages(&mut bridge, 0);
    let frame = ling(0x77, 0, &[]);
    assert_eq!(bridge.uart_received(&frame.repeat(30), at(100)), 30);
    assert_eq!(messages(&mut bridge, 100).len(), 30);
    assert_eq!(bridge.counters().dropped_events, 0);
}

#[test]
fn undelivered_frames_leave_room_for_refusals() {
    let mut rig = Rig::new(Config {
        poll: Poll::Hertz(100),
        can: Can {
            telemetry_hz: 100,
            commands: true,
            ..Can::default()
        },
        ..Config::default()
    });
    let events = Subscription {
        frames: false,
        events: true,
    };
    assert_eq!(rig.call(Request::Subscribe(events)), Reply::Done);
    rig.responder = Box::new(|_| None);
    rig.can_out.push_back(ling::SELF_CHECK.to_vec());
    rig.run(5_000);
    for _ in 0..3 {
        rig.can_out.push_back(ling(0x06, 0, &[0xFE]));
    }
    rig.run(5_000);
    rig.request(Request::IdentifyArm);
    for sequence in 0..2 {
        let command = Command {
            sequence,
            joints: [2048; 6],
            speed: 10,
            gripper: 0,
        };
        for frame in command.to_frames(Node::default()) {
            rig.can_frame(&frame);
        }
    }
    let now = at(rig.now);
    let frame = ling(0x77, 0, &[]);
    let packet = frame.repeat(PACKET / frame.len());
    for _ in 0..2 {
        rig.bridge.uart_received(&packet, now);
    }
    rig.bridge.set_line_coding([0x80, 0x25, 0, 0, 0, 0, 8], now).unwrap();
    rig.bridge.usb_received(&[1], now);
    rig.run(5_000);
    let is_refusal = |event: &Event| {
        matches!(
            event,
            Event::Refused {
                reason: Refusal::LineReserved,
                ..
            }
        )
    };
    let refusals = rig.events.iter().filter(|(_, event)| is_refusal(event)).count();
    assert_eq!((refusals, rig.bridge.counters().dropped_events), (6, 0));
}
