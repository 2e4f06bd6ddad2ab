//! Frames in the CAN controller, and pending frames at bus-off or a reconfiguration.

extern crate std;

use std::vec::Vec;

use super::rig::{self, at, ling, transmit};
use crate::can::command::Command;
use crate::can::{Frame, Function};
use crate::config::{Can, Config};
use crate::control::{FromHost, Identity, MAX_FRAME, Request, Subscription, encode};
use crate::{Action, Bridge, CanEvent, Counters, Duration, Instant, Start, UartConfig, UartEvent};

/// An adapter on a bus with this configuration.
fn on_bus(can: Can) -> Bridge {
    let config = Config {
        can,
        ..Config::default()
    };
    Bridge::new(Identity::default(), config, Start::default())
}

/// Passes a frame of this function to the adapter.
fn receive(bridge: &mut Bridge, function: Function, data: &[u8], now: Instant) {
    let id = function.id(bridge.config().can.node);
    bridge.can_received(&Frame::new(id, data).unwrap(), now);
}

/// A request on the control connection, in a single frame.
fn send_request(bridge: &mut Bridge, request: Request, now: Instant) {
    let mut bytes = [0; 8];
    let message = FromHost { sequence: 0, request };
    let len = encode(&message, &mut bytes[1..]).unwrap();
    bytes[0] = len as u8;
    receive(bridge, Function::ControlRequest, &bytes[..=len], now);
}

/// The function of the next frame for the bus.
fn hand(bridge: &mut Bridge, now: Instant) -> Option<Function> {
    let due = bridge.update(now).can;
    let frame = bridge.can_transmit(now);
    assert_eq!(frame.is_some(), due);
    Some(Function::of(frame?.id()).unwrap().0)
}

/// An adapter that has sent the first frame of an answer, and received flow control with this separation time.
fn answering(st_min: u8) -> Bridge {
    let mut bridge = Bridge::default();
    send_request(&mut bridge, Request::GetLatencies, Instant::ZERO);
    assert_eq!(hand(&mut bridge, Instant::ZERO), Some(Function::ControlAnswer));
    assert_eq!(hand(&mut bridge, Instant::ZERO), None);
    assert!(bridge.can_event(CanEvent::Waiting(0), at(130)));
    receive(&mut bridge, Function::ControlRequest, &[0x30, 0, st_min], at(300));
    bridge
}

#[test]
fn separation_counts_from_transmission_of_previous_frame() {
    let mut bridge = answering(1);
    // The frames wait while other nodes have the bus.
    bridge.can_event(CanEvent::BusOn, at(300));
    let now = at(300);
    assert_eq!(hand(&mut bridge, now), Some(Function::Event));
    assert_eq!(hand(&mut bridge, now), Some(Function::ControlAnswer));
    bridge.can_event(CanEvent::BusOn, now);
    assert_eq!(hand(&mut bridge, now), Some(Function::Event));
    for (at, waiting, news) in [
        (5_000, 3, false),
        (5_100, 2, false),
        (5_200, 1, true),
        (5_300, 1, false),
    ] {
        assert_eq!(hand(&mut bridge, Instant::from_micros(at)), None);
        assert_eq!(
            bridge.can_event(CanEvent::Waiting(waiting), Instant::from_micros(at)),
            news
        );
    }
    // The frame left at 5.2 ms.
    assert_eq!(bridge.timeout(), Some(at(6_200)));
    assert_eq!(hand(&mut bridge, at(6_199)), None);
    assert_eq!(hand(&mut bridge, at(6_200)), Some(Function::ControlAnswer));
    assert_eq!(hand(&mut bridge, at(9_000)), None);
}

#[test]
fn without_separation_controller_always_has_a_frame() {
    let mut bridge = answering(0);
    for _ in 0..3 {
        assert_eq!(hand(&mut bridge, at(300)), Some(Function::ControlAnswer));
    }
    assert!(!bridge.can_event(CanEvent::Waiting(2), at(430)));
    assert_eq!(hand(&mut bridge, at(430)), Some(Function::ControlAnswer));
}

#[test]
fn old_bus_frames_are_not_taken_as_new() {
    let mut bridge = answering(1);
    // Three frames of the old configuration precede it.
    assert_eq!(hand(&mut bridge, at(300)), Some(Function::ControlAnswer));
    for waiting in [4, 3, 2, 1] {
        assert!(!bridge.can_event(CanEvent::Waiting(waiting), at(400)));
    }
    assert!(bridge.can_event(CanEvent::Waiting(0), at(500)));
    assert_eq!(bridge.timeout(), Some(at(1_500)));
}

/// The counts during `f`: failed transfers, dropped answers, dropped events, incomplete commands.
fn counted(bridge: &mut Bridge, f: impl FnOnce(&mut Bridge)) -> [u32; 4] {
    let counts = |c: Counters| {
        [
            c.isotp_failures,
            c.dropped_can_answers,
            c.dropped_events,
            c.commands_incomplete,
        ]
    };
    let before = counts(bridge.counters());
    f(bridge);
    let after = counts(bridge.counters());
    core::array::from_fn(|i| after[i] - before[i])
}

#[test]
fn transfer_with_stuck_frame_is_given_up_counted() {
    let mut bridge = answering(1);
    assert_eq!(hand(&mut bridge, at(300)), Some(Function::ControlAnswer));
    assert_eq!(bridge.timeout(), Some(at(1_000_300)));
    assert_eq!(counted(&mut bridge, |bridge| bridge.tick(at(1_000_299))), [0; 4]);
    assert_eq!(counted(&mut bridge, |bridge| bridge.tick(at(1_000_300))), [1, 0, 0, 0]);
    assert_eq!((hand(&mut bridge, at(1_000_300)), bridge.timeout()), (None, None));
    // The next frame is handed over after that one, and its timeout starts when both have left.
    let now = at(60_000_000);
    send_request(&mut bridge, Request::GetLatencies, now);
    assert_eq!(hand(&mut bridge, now), Some(Function::ControlAnswer));
    assert!(!bridge.can_event(CanEvent::Waiting(1), now + Duration::from_micros(100)));
    assert_eq!(bridge.timeout(), Some(now + Duration::from_micros(1_000_000)));
    assert!(bridge.can_event(CanEvent::Waiting(0), now + Duration::from_micros(200)));
    assert_eq!(bridge.timeout(), Some(now + Duration::from_micros(1_000_200)));
    receive(
        &mut bridge,
        Function::ControlRequest,
        &[0x30, 0, 0],
        now + Duration::from_micros(400),
    );
    assert_eq!(
        hand(&mut bridge, now + Duration::from_micros(400)),
        Some(Function::ControlAnswer)
    );
}

#[test]
fn request_behind_abandoned_reply_is_handled() {
    let give_up: [fn(&mut Bridge, Instant); 2] = [Bridge::tick, |bridge, now| {
        bridge.can_event(CanEvent::BusOff, now);
    }];
    for give_up in give_up {
        let mut bridge = answering(1);
        assert_eq!(hand(&mut bridge, at(300)), Some(Function::ControlAnswer));
        send_request(&mut bridge, Request::GetConfig, at(400));
        assert_eq!(bridge.counters().control_requests, 1);
        let now = at(1_000_300);
        assert_eq!(counted(&mut bridge, |bridge| give_up(bridge, now)), [1, 0, 0, 0]);
        assert_eq!(bridge.counters().control_requests, 2);
        let handed: Vec<_> = core::iter::from_fn(|| hand(&mut bridge, now)).collect();
        assert_eq!(handed.last(), Some(&Function::ControlAnswer));
    }
}

#[test]
fn transfers_at_bus_loss_are_counted_per_direction() {
    let now = at(300);
    let mut bridge = answering(0);
    receive(&mut bridge, Function::ArmRequest, &[0x10, 20, 0, 1, 2, 3, 4, 5], now);
    let lost = counted(&mut bridge, |bridge| {
        bridge.can_event(CanEvent::BusOff, now);
    });
    assert_eq!(lost, [2, 0, 0, 0]);
    // No transfer is in progress.
    let lost = counted(&mut bridge, |bridge| {
        bridge.can_event(CanEvent::BusOff, now);
    });
    assert_eq!(lost, [0; 4]);
}

/// Reconfigures the bus by request of the host on USB.
fn configure(bridge: &mut Bridge, can: Can, now: Instant) {
    let config = Config { can, ..bridge.config() };
    rig::send_request(bridge, 1, Request::SetConfig(config), now);
    assert_eq!(bridge.config(), config);
}

#[test]
fn queued_transfers_at_bus_change_are_counted() {
    let now = Instant::ZERO;
    let can = Can {
        unsolicited: true,
        commands: true,
        ..Can::default()
    };
    let mut bridge = on_bus(can);
    let everything = Subscription {
        frames: true,
        events: true,
    };
    send_request(&mut bridge, Request::Subscribe(everything), now);
    assert_eq!(hand(&mut bridge, now), Some(Function::ControlAnswer));
    // Four frames of the arm, one in transfer and three pending on each connection. The recovery of the bus is reported
    // twice.
    for _ in 0..4 {
        bridge.uart_received(&ling(0x06, 0, &[1; 15]), now);
    }
    bridge.can_event(CanEvent::BusOn, now);
    // An incomplete request, and an incomplete command.
    receive(&mut bridge, Function::ArmRequest, &[0x10, 20, 0, 1, 2, 3, 4, 5], now);
    let command = Command {
        sequence: 0,
        joints: [0; 6],
        speed: 3,
        gripper: 0,
    };
    let [half, _] = command.to_frames(can.node);
    bridge.can_received(&half, now);

    let other = Can {
        bit_rate: 500_000,
        ..can
    };
    let lost = counted(&mut bridge, |bridge| {
        configure(bridge, other, now);
        assert_eq!(bridge.action(Instant::ZERO), Some(Action::RestartCan(other)));
    });
    assert_eq!(lost, [2, 3, 3 + 3, 1]);
    assert_eq!(hand(&mut bridge, now), None);
}

#[test]
fn frame_for_slow_subscriber_is_due_once() {
    let now = Instant::ZERO;
    let mut bridge = Bridge::default();
    let frames = Subscription {
        frames: true,
        events: false,
    };
    send_request(&mut bridge, Request::Subscribe(frames), now);
    assert_eq!(hand(&mut bridge, now), Some(Function::ControlAnswer));
    bridge.can_event(CanEvent::Waiting(0), now);
    // The first frame of the first event is out, and waits for flow control; the second event is queued.
    bridge.uart_received(&ling(0x06, 0, &[1; 15]), now);
    assert_eq!(hand(&mut bridge, now), Some(Function::ControlAnswer));
    bridge.can_event(CanEvent::Waiting(0), now);
    bridge.uart_received(&ling(0x06, 0, &[2; 15]), now);
    assert!(bridge.update(now).can);
    assert_eq!(bridge.can_transmit(now), None);
    assert!(!bridge.update(now).can);
    assert_eq!(bridge.counters().dropped_events, 0);
}

#[test]
fn half_command_is_counted_at_reconfiguration() {
    let can = Can {
        commands: true,
        ..Can::default()
    };
    let mut bridge = on_bus(can);
    receive(&mut bridge, Function::CommandA, &[0; 8], Instant::ZERO);
    let other = Can {
        command_timeout_ms: 50,
        ..can
    };
    let lost = counted(&mut bridge, |bridge| configure(bridge, other, Instant::ZERO));
    assert_eq!(lost, [0, 0, 0, 1]);
}

/// An adapter that forwards unsolicited frames to CAN, after two of them, the second just now.
fn after_two_frames() -> (Bridge, [Vec<u8>; 2]) {
    let can = Can {
        unsolicited: true,
        ..Can::default()
    };
    let mut bridge = on_bus(can);
    let frames = [ling(0x04, 0x0E, &[2]), ling(0x04, 0x0E, &[1])];
    for (at, frame) in frames.iter().enumerate() {
        assert_eq!(
            bridge.uart_received(frame, Instant::from_micros(100 * (1 + at as u64))),
            1
        );
    }
    (bridge, frames)
}

#[test]
fn arm_frames_reach_bus_in_order_despite_delay() {
    for shared in [false, true] {
        let (mut bridge, frames) = after_two_frames();
        if shared {
            bridge.update(at(250));
        }
        for frame in frames {
            assert!(bridge.update(at(300)).can);
            let sent = bridge.can_transmit(at(300)).unwrap();
            assert_eq!(sent.data()[..=frame.len()], [&[frame.len() as u8], &frame[..]].concat());
            bridge.can_event(CanEvent::Waiting(0), at(300));
        }
        assert!(!bridge.update(at(300)).can);
    }
}

#[test]
fn undelivered_frame_keeps_its_original_configuration() {
    let others: [fn(&mut Bridge); 3] = [
        // Later frames have no receiver.
        |bridge| configure(bridge, Can::default(), at(300)),
        |bridge| {
            bridge.can_event(CanEvent::BusOn, at(300));
        },
        |bridge| {
            bridge.uart_event(UartEvent::Configured(UartConfig::default()), Instant::ZERO);
        },
    ];
    for other in others {
        let (mut bridge, [_, last]) = after_two_frames();
        other(&mut bridge);
        let mut answers = 0;
        for _ in 0..8 {
            let frame = bridge.can_transmit(at(300));
            bridge.can_event(CanEvent::Waiting(0), at(300));
            let of_the_arm = |frame: &Frame| Function::of(frame.id()).unwrap().0 == Function::ArmAnswer;
            if let Some(frame) = frame.filter(of_the_arm) {
                answers += 1;
                assert_eq!(answers == 2, frame.data()[1..=last.len()] == last);
            }
        }
        assert_eq!(answers, 2);
    }
}

#[test]
fn half_command_is_ignored_without_commands() {
    let mut bridge = on_bus(Can::default());
    assert!(!bridge.config().can.commands);
    receive(&mut bridge, Function::CommandA, &[0; 8], Instant::ZERO);
    assert_eq!(bridge.timeout(), None);
    assert_eq!(bridge.counters().can_frames_received, 1);
}

#[test]
fn reapplied_configuration_keeps_a_partial_command() {
    let now = Instant::ZERO;
    let can = Can {
        commands: true,
        ..Can::default()
    };
    let mut bridge = on_bus(can);
    let frames = |sequence| {
        let command = Command {
            sequence,
            joints: [2048; 6],
            speed: 3,
            gripper: 0,
        };
        command.to_frames(can.node)
    };
    for half in frames(0) {
        bridge.can_received(&half, now);
    }
    let [half, other] = frames(1);
    bridge.can_received(&half, now);
    assert_eq!(counted(&mut bridge, |bridge| configure(bridge, can, now)), [0; 4]);
    bridge.can_received(&other, now);
    configure(&mut bridge, can, now);
    let mut out = [0; MAX_FRAME];
    let sent = transmit(&mut bridge, &mut out, now).unwrap();
    assert_eq!((sent.len, &out[..3]), (34, &[0xAA, 0x06, 0x03][..]));
    assert_eq!(bridge.counters().requests_command, 1);
}
