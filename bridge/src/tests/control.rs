//! The control port, on USB and on CAN.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use proptest::prelude::*;

use super::rig::{Rig, at, ling, ling_responder, send_request};
use crate::can::telemetry::{Errors, Sample, event_from_frame};
use crate::can::{Frame, Function, Node};
use crate::config::{ArmKind, Can, Config, ConfigError, Poll};
use crate::control::{ArmIdentity, Event, Failure, FromAdapter, Identity, Reply, Request, Subscription, VERSION};
use crate::{Action, Bridge, CanErrors, CanEvent, Erase, Instant, LineCoding, PACKET, Start, UartConfig, UsbEvent};

fn quiet() -> Rig {
    Rig::new(Config::default())
}

fn call_on_can(rig: &mut Rig, sequence: u8, request: Request) -> Reply {
    rig.request_on_can(sequence, request);
    rig.run(20_000);
    match rig.can_control.pop() {
        Some(FromAdapter::Reply {
            sequence: replied,
            reply,
        }) if replied == sequence => reply,
        other => panic!("{other:?}"),
    }
}

#[test]
fn simple_requests_are_answered_on_both_ports() {
    let mut rig = quiet();
    rig.can_out.push_back(ling(0x06, 0, &[0xFE]));
    rig.run(10_000);
    assert_eq!(rig.call(Request::Identify), Reply::Identity(Identity::default()));
    assert_eq!(rig.call(Request::GetConfig), Reply::Config(Config::default()));
    let Reply::Counters(counters) = rig.call(Request::GetCounters) else {
        panic!()
    };
    assert_eq!((counters.requests_can, counters.control_requests), (1, 3));
    let Reply::Latencies(latencies) = rig.call(Request::GetLatencies) else {
        panic!()
    };
    assert_eq!(latencies.answer.counts.iter().sum::<u32>(), 1);
    assert_eq!(latencies, *rig.bridge.line.settled().latencies());

    assert_eq!(
        call_on_can(&mut rig, 9, Request::Identify),
        Reply::Identity(Identity::default())
    );
    assert_eq!(
        call_on_can(&mut rig, 8, Request::GetConfig),
        Reply::Config(Config::default())
    );
    assert!(matches!(
        call_on_can(&mut rig, 7, Request::GetCounters),
        Reply::Counters(_)
    ));
    assert_eq!(
        call_on_can(&mut rig, 6, Request::GetLatencies),
        Reply::Latencies(latencies)
    );
    assert_eq!(rig.bridge.counters().control_unsupported, 0);
}

#[test]
fn adapter_reports_its_identity() {
    let identity = Identity {
        board: "stm32f405".try_into().unwrap(),
        ..Identity::default()
    };
    let mut rig = quiet();
    rig.bridge = Bridge::new(identity.clone(), Config::default(), Start::default());
    assert_eq!(rig.call(Request::Identify), Reply::Identity(identity));
}

#[test]
fn unknown_requests_are_answered() {
    let mut rig = quiet();
    // An unknown request with trailing bytes, a field too many, a truncated one, invalid COBS, an empty message.
    let messages: [(&[u8], u8); 5] = [
        (&[5, 0x21, 99, 1, 2, 3, 0], 0),
        (&[4, 0x22, 0x06, 0x01, 0], 0x22),
        (&[2, 0x23, 0], 0x23),
        (&[9, 1, 2, 0], 0),
        (&[1, 0], 0),
    ];
    for (bytes, sequence) in messages {
        rig.bridge.control_received(bytes, at(rig.now));
        rig.run(100);
        let (replied, reply) = rig.replies.pop().unwrap_or_else(|| panic!("{bytes:?}"));
        assert_eq!(
            (replied, reply),
            (sequence, Reply::Unsupported { version: VERSION }),
            "{bytes:?}"
        );
    }
    assert_eq!(rig.replies, []);
    let c = rig.bridge.counters();
    assert_eq!((c.control_requests, c.control_unsupported), (5, 5));
}

#[test]
fn requests_in_one_packet_are_answered_in_order() {
    for cut in 1..20 {
        let mut rig = quiet();
        // Requests 1 to 20 for the counters. Their replies exceed the queue.
        let stream: Vec<u8> = (1..=20).flat_map(|sequence| [3, sequence, 6, 0]).collect();
        let mut rest = &stream[..];
        while !rest.is_empty() {
            if rig.bridge.update(Instant::ZERO).control_room {
                let (packet, later) = rest.split_at(cut.min(rest.len()));
                rig.bridge.control_received(packet, at(rig.now));
                rest = later;
            }
            rig.run(10);
        }
        rig.run(1_000);
        assert!(rig.replies.iter().map(|(sequence, _)| *sequence).eq(1..=20), "by {cut}");
    }
}

#[test]
fn slow_host_is_delayed_without_lost_reply() {
    let mut rig = quiet();
    let mut requests = 0;
    for _ in 0..200 {
        if rig.bridge.update(Instant::ZERO).control_room {
            requests += 1;
            rig.bridge.control_received(&[3, requests, 2, 0], Instant::ZERO);
        }
    }
    assert!(requests < 50);
    rig.run(1_000);
    assert!(rig.replies.iter().map(|(sequence, _)| *sequence).eq(1..=requests));
}

#[test]
fn arm_is_identified_on_request() {
    let mut rig = quiet();
    let sequence = rig.request(Request::IdentifyArm);
    assert_eq!(rig.replies, []);
    rig.run(1_000);
    assert_eq!(
        call_on_can(&mut rig, 77, Request::IdentifyArm),
        Reply::Arm(identity(Some(2)))
    );
    assert_eq!(rig.replies, [(sequence, Reply::Arm(identity(Some(1))))]);
    assert_eq!(rig.bridge.counters().requests_adapter, 2);
    assert_eq!((rig.usb.len(), rig.can.len()), (0, 0));

    rig.responder = Box::new(|_| None);
    rig.request(Request::IdentifyArm);
    rig.request_on_can(78, Request::IdentifyArm);
    rig.run(20_000);
    assert_eq!(
        rig.can_control,
        [FromAdapter::Reply {
            sequence: 78,
            reply: Reply::Failed(Failure::Busy)
        }]
    );
    rig.run(50_000);
    assert_eq!(rig.replies.last().unwrap().1, Reply::Arm(identity(None)));

    // The servos have no identification request.
    let servos = Config {
        arm: ArmKind::Alpha1Servo,
        ..Config::default()
    };
    rig.call(Request::SetConfig(servos));
    let none = ArmIdentity {
        kind: ArmKind::Alpha1Servo,
        answer: None,
    };
    assert_eq!(rig.call(Request::IdentifyArm), Reply::Arm(none));
}

#[test]
fn waiting_request_is_answered_when_arm_kind_changes() {
    let servos = Config {
        arm: ArmKind::Alpha1Servo,
        ..Config::default()
    };
    let mut rig = quiet();
    rig.responder = Box::new(|_| None);
    let sequence = rig.request(Request::IdentifyArm);
    rig.run(1_000);
    assert_eq!(rig.bridge.counters().requests_adapter, 1);
    assert_eq!(call_on_can(&mut rig, 77, Request::SetConfig(servos)), Reply::Done);
    let nothing = ArmIdentity {
        kind: ArmKind::Alpha1Servo,
        answer: None,
    };
    assert_eq!(rig.replies, [(sequence, Reply::Arm(nothing))]);
}

#[test]
fn ended_request_is_answered_before_ending_one() {
    let mut rig = quiet();
    rig.responder = Box::new(|_| None);
    rig.request(Request::IdentifyArm);
    rig.run(1_000);
    let alpha1 = Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    };
    rig.request_on_can(1, Request::SetConfig(alpha1));
    while rig.replies.is_empty() {
        rig.run(1);
    }
    assert_eq!(rig.can_control, []);
}

fn identity(count: Option<u8>) -> ArmIdentity {
    let answer = count.map(|count| {
        let mut data = [0; 24];
        data[0] = count;
        ling(0x01, 0, &data)[..].try_into().unwrap()
    });
    ArmIdentity {
        kind: ArmKind::Ling,
        answer,
    }
}

#[test]
fn configuration_applies_at_once_or_not_at_all() {
    let mut rig = quiet();
    let bad = Config {
        poll: Poll::Hertz(0),
        arm: ArmKind::Alpha1,
        ..Config::default()
    };
    let error = ConfigError::PollRate { max: 1_000, got: 0 };
    assert_eq!(rig.call(Request::SetConfig(bad)), Reply::BadConfig(error));
    let mut fd = Config::default();
    fd.can.data_bit_rate = Some(5_000_000);
    assert_eq!(rig.call(Request::SetConfig(fd)), Reply::BadConfig(ConfigError::NoCanFd));
    assert_eq!(rig.bridge.config(), Config::default());

    let mut good = Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    };
    good.can.node = Node::new(3).unwrap();
    assert_eq!(rig.call(Request::SetConfig(good)), Reply::Done);
    assert_eq!(rig.call(Request::GetConfig), Reply::Config(good));
    rig.run(10);
    assert_eq!(rig.actions, [Action::RestartCan(good.can)]);
    assert_eq!((rig.bridge.config().can, rig.bridge.config()), (good.can, good));
    let baud_115200 = LineCoding {
        baud: 115_200,
        ..LineCoding::LING
    };
    assert_eq!(
        rig.uart,
        UartConfig {
            coding: baud_115200,
            half_duplex: false
        }
    );
    // The saved configuration is unchanged.
    assert!(rig.actions.iter().all(|action| matches!(action, Action::RestartCan(_))));
}

#[test]
fn reply_on_can_precedes_the_bus_change() {
    let mut rig = quiet();
    let mut other = Config::default();
    other.can.bit_rate = 125_000;
    rig.request_on_can(5, Request::SetConfig(other));
    rig.run(20_000);
    assert_eq!(
        rig.can_control,
        [FromAdapter::Reply {
            sequence: 5,
            reply: Reply::Done
        }]
    );
    assert_eq!(rig.actions, [Action::RestartCan(other.can)]);
}

#[test]
fn telemetry_begins_with_the_bus_it_is_for() {
    let mut rig = telemetry(0, Poll::Hertz(1_000));
    rig.run(10_000);
    let mut other = rig.bridge.config();
    other.can.bit_rate = 125_000;
    other.can.telemetry_hz = 100;
    rig.request_on_can(5, Request::SetConfig(other));
    while rig.actions.is_empty() {
        rig.run(1);
        assert_eq!(rig.frames, []);
    }
    rig.run(20_000);
    assert!(!samples(&rig).is_empty());
}

#[test]
fn subscription_on_can_ends_with_the_bus() {
    let mut rig = quiet();
    let all = Subscription {
        frames: true,
        events: true,
    };
    assert_eq!(call_on_can(&mut rig, 1, Request::Subscribe(all)), Reply::Done);
    rig.arm_sends(&ling(0x06, 0, &[0; 15]));
    rig.run(20_000);
    assert!(matches!(rig.can_control.pop(), Some(FromAdapter::Event { .. })));

    let mut other = Config::default();
    other.can.node = Node::MAX;
    assert_eq!(rig.call(Request::SetConfig(other)), Reply::Done);
    rig.arm_sends(&ling(0x06, 0, &[0; 15]));
    rig.run(2_000_000);
    let counters = rig.bridge.counters();
    assert_eq!((counters.unsolicited_frames, counters.isotp_failures), (2, 0));
}

#[test]
fn configuration_ending_a_request_answers_both() {
    let mut rig = quiet();
    rig.responder = Box::new(|_| None);
    rig.request_on_can(1, Request::IdentifyArm);
    rig.run(1_000);
    let alpha1 = Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    };
    rig.request_on_can(2, Request::SetConfig(alpha1));
    rig.run(20_000);
    let none = ArmIdentity {
        kind: ArmKind::Alpha1,
        answer: None,
    };
    let reply = |sequence, reply| FromAdapter::Reply { sequence, reply };
    assert_eq!(rig.can_control, [reply(2, Reply::Done), reply(1, Reply::Arm(none))]);
}

#[test]
fn cyclic_frames_change_without_leaving_the_bus() {
    let mut rig = quiet();
    let mut config = Config {
        poll: Poll::Hertz(100),
        ..Config::default()
    };
    config.can.telemetry_hz = 50;
    rig.request_on_can(1, Request::SetConfig(config));
    while rig.can_control.is_empty() {
        rig.run(1);
    }
    // The next request, right after the reply, arrives on the bus.
    rig.request_on_can(2, Request::GetConfig);
    rig.run(90_000);
    let reply = |sequence, reply| FromAdapter::Reply { sequence, reply };
    assert_eq!(
        rig.can_control,
        [reply(1, Reply::Done), reply(2, Reply::Config(config))]
    );
    assert_eq!((rig.bridge.config().can, &rig.actions[..]), (config.can, &[][..]));
    assert_eq!(samples(&rig).len(), 5);

    config.can.telemetry_hz = 0;
    assert_eq!(call_on_can(&mut rig, 3, Request::SetConfig(config)), Reply::Done);
    rig.frames.clear();
    rig.run(2_000_000);
    assert!(rig.frames.is_empty());
}

#[test]
fn firmware_saves_and_erases_configuration() {
    let mut rig = quiet();
    let config = Config {
        poll: Poll::Hertz(5),
        ..Config::default()
    };
    rig.call(Request::SetConfig(config));
    let saving = rig.request(Request::SaveConfig);
    assert_eq!(
        (&rig.replies[..], &rig.actions[..]),
        (&[][..], &[Action::Save(config, Erase::Allowed)][..])
    );
    // One at a time.
    rig.request_on_can(1, Request::ResetConfig);
    rig.run(10_000);
    assert_eq!(
        rig.can_control,
        [FromAdapter::Reply {
            sequence: 1,
            reply: Reply::Failed(Failure::Busy)
        }]
    );
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(10);
    assert_eq!(rig.replies, [(saving, Reply::Done)]);

    let reset = rig.request(Request::ResetConfig);
    assert_eq!(rig.actions.last(), Some(&Action::Reset(Erase::Allowed)));
    rig.bridge.saved(Err(Failure::Flash), at(rig.now));
    rig.run(10);
    assert_eq!(rig.replies.last(), Some(&(reset, Reply::Failed(Failure::Flash))));
    assert_eq!(rig.bridge.config(), config, "the saved one is not erased");
    rig.request(Request::ResetConfig);
    rig.bridge.saved(Ok(()), at(rig.now));
    assert_eq!(rig.bridge.config(), Config::default());
    let c = rig.bridge.counters();
    assert_eq!((c.config_saves, c.config_failures), (2, 1));
}

#[test]
fn save_erases_only_while_no_host_has_the_port_open() {
    let mut rig = quiet();
    for (dtr, erase) in [(true, Erase::Refused), (false, Erase::Allowed)] {
        rig.bridge.usb_event(UsbEvent::Dtr(dtr), at(rig.now));
        for (request, action) in [
            (Request::SaveConfig, Action::Save(Config::default(), erase)),
            (Request::ResetConfig, Action::Reset(erase)),
        ] {
            rig.call(Request::SetConfig(Config::default()));
            let saving = rig.request(request);
            assert_eq!(rig.actions.pop(), Some(action));
            rig.bridge.saved(Err(Failure::NoRoom), at(rig.now));
            rig.run(10);
            assert_eq!(rig.replies.pop(), Some((saving, Reply::Failed(Failure::NoRoom))));
        }
    }
}

#[test]
fn invalid_configuration_counts_as_lost() {
    let mut config = Config::default();
    config.host_timeout.torque_off = true;
    for (data_bit_rate, lost) in [(None, 0), (Some(2_000_000), 1)] {
        // The board has no CAN FD.
        config.can.data_bit_rate = data_bit_rate;
        let mut bridge = Bridge::new(Identity::default(), config, Start::default());
        assert_eq!(bridge.config().host_timeout.torque_off, lost == 0);
        assert_eq!(bridge.counters().config_failures, lost);
    }
}

#[test]
fn excessive_saves_get_the_waiting_time() {
    let mut rig = quiet();
    let saving = rig.request(Request::SaveConfig);
    let failure = Failure::TooManySaves { wait_s: 599 };
    rig.bridge.saved(Err(failure), at(rig.now));
    rig.run(10);
    assert_eq!(rig.replies, [(saving, Reply::Failed(failure))]);
}

#[test]
fn save_is_answered_unless_host_has_gone() {
    let mut rig = quiet();
    rig.request(Request::SaveConfig);
    rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
    rig.bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(1_000);
    assert_eq!(rig.replies, []);

    rig.request_on_can(1, Request::SaveConfig);
    rig.run(10_000);
    rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
    rig.bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(10_000);
    let done = FromAdapter::Reply {
        sequence: 1,
        reply: Reply::Done,
    };
    assert_eq!((rig.can_control, rig.replies), (Vec::from([done]), Vec::new()));
}

#[test]
fn identification_is_answered_unless_host_has_gone() {
    let mut rig = quiet();
    rig.request(Request::IdentifyArm);
    rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
    rig.bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    rig.run(1_000);
    assert_eq!(rig.replies, []);

    rig.request_on_can(1, Request::IdentifyArm);
    rig.run(200);
    rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
    rig.run(10_000);
    let reply = FromAdapter::Reply {
        sequence: 1,
        reply: Reply::Arm(identity(Some(2))),
    };
    assert_eq!(rig.can_control, [reply]);
}

#[test]
fn restart_is_confirmed_before_firmware_executes_it() {
    let mut rig = quiet();
    assert_eq!(rig.call(Request::Restart), Reply::Done);
    assert_eq!(rig.actions, [Action::Restart]);
    assert_eq!(rig.call(Request::RestartIntoBootLoader), Reply::Done);
    assert_eq!(rig.actions[1..], [Action::RestartIntoBootLoader]);
}

#[test]
fn subscribers_get_subscribed_events_and_overflow_is_counted() {
    let frames = Subscription {
        frames: true,
        events: false,
    };
    let mut rig = quiet();
    assert_eq!(call_on_can(&mut rig, 1, Request::Subscribe(frames)), Reply::Done);
    rig.usb_out.extend(ling(0x06, 0, &[0xFE]));
    rig.bridge.can_event(CanEvent::BusOff, at(rig.now));
    rig.run(20_000);
    assert_eq!(rig.events, []);
    let [
        FromAdapter::Event {
            event: Event::Frame { .. },
            ..
        },
    ] = &rig.can_control[..]
    else {
        panic!("{:?}", rig.can_control)
    };
    rig.subscribe();
    rig.bridge.can_event(CanEvent::BusOn, at(rig.now));
    rig.run(10);
    assert_eq!(rig.events[0].1, Event::BusOff { off: false });

    // A host that reads neither port.
    let frame = ling(0x06, 0, &[1; 15]);
    for _ in 0..100 {
        rig.bridge.uart_received(&frame, at(rig.now));
    }
    rig.run(100_000);
    let dropped = rig.bridge.counters().dropped_events;
    let (usb, can) = (rig.events.len() - 1, rig.can_control.len() - 1);
    assert_eq!(usb + can + dropped as usize, 200);
    assert!(usb >= 5 && can >= 5, "{usb} {can}");

    // No subscriber remains after the host on USB has disconnected.
    rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
    rig.bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    rig.bridge.uart_received(&frame, at(rig.now));
    rig.run(100_000);
    assert_eq!((rig.events.len() - 1, rig.can_control.len() - 1), (usb, can + 1));
}

/// An adapter with a subscription to frames on USB, after the reply.
fn subscribed() -> Bridge {
    let mut bridge = Bridge::default();
    let frames = Subscription {
        frames: true,
        events: false,
    };
    send_request(&mut bridge, 1, Request::Subscribe(frames), Instant::ZERO);
    assert!(bridge.control_transmit(&mut [0; PACKET], Instant::ZERO).is_some());
    bridge
}

#[test]
fn subscriber_data_ends_with_short_usb_packet() {
    let mut packet = [0; PACKET];
    let mut empty = 0;
    for len in 0..=63 {
        let mut bridge = subscribed();
        bridge.uart_received(&ling(0x06, 0, &[0x55; 63][..len]), Instant::ZERO);
        let mut last = PACKET;
        while bridge.update(Instant::ZERO).control {
            last = bridge.control_transmit(&mut packet, Instant::ZERO).unwrap_or(last);
        }
        assert!(last < PACKET, "{len}");
        empty += usize::from(last == 0);
        assert_eq!(bridge.control_transmit(&mut packet, Instant::ZERO), None);
    }
    assert_eq!(empty, 1, "one of them fills its packet");
}

#[test]
fn frames_wait_for_slow_subscriber_without_loss() {
    let mut bridge = subscribed();
    let frame = ling(0x06, 0, &[0x55; 15]);
    for _ in 0..16 {
        bridge.uart_received(&frame, Instant::ZERO);
        bridge.update(Instant::ZERO);
    }
    let mut packet = [0; PACKET];
    while bridge.update(Instant::ZERO).control {
        let _ = bridge.control_transmit(&mut packet, Instant::ZERO);
    }
    assert_eq!(bridge.counters().dropped_events, 0);
}

fn telemetry(telemetry_hz: u16, poll: Poll) -> Rig {
    Rig::new(Config {
        poll,
        can: Can {
            telemetry_hz,
            ..Can::default()
        },
        ..Config::default()
    })
}

fn samples(rig: &Rig) -> Vec<(u64, Sample)> {
    let of_sample = |frame: &Frame| {
        matches!(
            Function::of(frame.id()).unwrap().0,
            Function::JointsA | Function::JointsB | Function::State
        )
    };
    let frames: Vec<_> = rig.frames.iter().filter(|(_, frame)| of_sample(frame)).collect();
    let sample = |chunk: &[&(u64, Frame)]| {
        let &[(at, a), (_, b), (_, state)] = chunk else {
            panic!()
        };
        (*at, Sample::from_frames(&[*a, *b, *state]).unwrap())
    };
    frames.chunks_exact(3).map(sample).collect()
}

#[test]
fn telemetry_is_sent_at_rate_never_twice() {
    let mut rig = telemetry(100, Poll::Hertz(1_000));
    rig.run(1_000_000);
    let fast = samples(&rig);
    assert!((99..=101).contains(&fast.len()), "{}", fast.len());
    assert!(
        fast.windows(2)
            .all(|pair| pair[1].0 / 10_000 > pair[0].0 / 10_000 && pair[1].1.stamp > pair[0].1.stamp)
    );
    // Each is the newest one.
    assert!(fast.iter().all(|(at, sample)| at - u64::from(sample.stamp) <= 1_000));
    assert!(fast.iter().zip(0..).all(|((_, sample), count)| sample.count == count));

    let mut rig = telemetry(100, Poll::Hertz(10));
    rig.run(1_000_000);
    let slow = samples(&rig);
    assert_eq!(slow.len(), 10 - 1);
    assert!(slow.windows(2).all(|pair| pair[1].1.stamp - pair[0].1.stamp == 100_000));

    let mut rig = telemetry(0, Poll::Hertz(1_000));
    rig.run(1_000_000);
    assert_eq!(rig.frames, []);
}

#[test]
fn another_robot_has_no_telemetry() {
    let bessica = include_bytes!("bessica.bin");
    let mut rig = telemetry(100, Poll::Hertz(1_000));
    rig.responder = Box::new(|_| Some((400, bessica.to_vec())));
    rig.run(1_000_000);
    assert!(samples(&rig).is_empty());
    assert!(rig.sent.len() > 900, "it is polled");
}

#[test]
fn error_counts_go_out_once_a_second() {
    let mut rig = telemetry(10, Poll::Off);
    let errors = CanErrors {
        bus: 3,
        overruns: 1,
        unsent: 0,
    };
    rig.bridge.can_event(CanEvent::Errors(errors), Instant::ZERO);
    rig.run(5_500_000);
    let errors: Vec<_> = rig
        .frames
        .iter()
        .filter_map(|(_, frame)| Errors::from_frame(frame))
        .collect();
    assert_eq!(errors.len(), 6);
    assert_eq!(errors[5], Errors::from(&rig.bridge.counters()));
    assert_eq!(errors[5].can, 4);
}

#[test]
fn delayed_error_counts_are_sent_once() {
    let mut bridge = telemetry(10, Poll::Off).bridge;
    // First on an instant of its grid, then long after one.
    for now in [at(1_000_000), at(2_500_000), at(4_500_000)] {
        assert!(bridge.can_transmit(now).is_some());
        bridge.can_event(CanEvent::Waiting(0), now);
        assert_eq!(bridge.can_transmit(now), None);
    }
}

#[test]
fn error_counts_go_out_while_telemetry_is_on() {
    let mut rig = quiet();
    let errors = |rig: &Rig| {
        rig.frames
            .iter()
            .filter_map(|(_, frame)| Errors::from_frame(frame))
            .count()
    };
    for (telemetry_hz, expected) in [(10, 6), (0, 6), (20, 12)] {
        let mut config = rig.bridge.config();
        config.can.telemetry_hz = telemetry_hz;
        assert_eq!(rig.call(Request::SetConfig(config)), Reply::Done);
        rig.run(5_500_000);
        assert_eq!(errors(&rig), expected);
    }
}

#[test]
fn bus_off_is_reported_counted_and_ends_transfers() {
    let mut rig = quiet();
    rig.subscribe();
    let mut ling_responder = ling_responder();
    rig.responder = Box::new(move |request| ling_responder(request));
    rig.can_out.push_back(ling(0x01, 0, &[0xFE]));
    rig.run(700);
    assert_eq!(rig.can, Vec::<Vec<u8>>::new());
    rig.bridge.can_event(CanEvent::BusOff, at(rig.now));
    rig.bridge.can_event(CanEvent::BusOn, at(rig.now));
    rig.run(10_000);
    let c = rig.bridge.counters();
    assert_eq!((c.can_bus_offs, c.isotp_failures), (1, 1));
    let off = |off| Event::BusOff { off };
    assert!(
        rig.events
            .iter()
            .map(|(_, event)| event.clone())
            .filter(|event| !matches!(event, Event::Frame { .. }))
            .eq([off(true), off(false)])
    );
    assert_eq!(
        rig.frames
            .iter()
            .filter_map(|(_, frame)| event_from_frame(frame))
            .count(),
        2
    );
}

proptest! {
    #[test]
    fn garbage_on_control_port_costs_no_later_request(
        garbage in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        let mut rig = quiet();
        // Firmware's results of actions that it may not have been given.
        let act = |rig: &mut Rig| {
            rig.run(100_000);
            rig.bridge.saved(Ok(()), at(rig.now));
            rig.bridge.loaded(Ok(crate::store::Saved::Nothing), at(rig.now));
        };
        for packet in garbage.chunks(64) {
            while !rig.bridge.update(Instant::ZERO).control_room {
                act(&mut rig);
            }
            rig.bridge.control_received(packet, at(rig.now));
        }
        act(&mut rig);
        rig.bridge.control_received(&[0], at(rig.now));
        act(&mut rig);
        rig.run(100_000);
        let c = rig.bridge.counters();
        prop_assert!(c.control_requests >= c.control_unsupported);
        prop_assert_eq!(rig.replies.len(), c.control_requests as usize);
        let reply = rig.call(Request::Identify);
        prop_assert!(matches!(reply, Reply::Identity(_)), "an answer to another");
    }
}

#[test]
fn reset_reply_on_can_precedes_bus_change() {
    let mut config = Config::default();
    config.can.node = Node::new(5).unwrap();
    let mut rig = Rig::new(config);
    rig.request_on_can(7, Request::ResetConfig);
    rig.run(10_000);
    assert_eq!(rig.actions, [Action::Reset(Erase::Allowed)]);
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(10_000);
    let reply = Reply::Done;
    assert_eq!(rig.can_control, [FromAdapter::Reply { sequence: 7, reply }]);
    assert_eq!(
        rig.actions,
        [Action::Reset(Erase::Allowed), Action::RestartCan(Can::default())]
    );
}

#[test]
fn abandoned_save_does_not_answer_next_host() {
    let mut rig = quiet();
    rig.request(Request::SaveConfig);
    rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
    rig.bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    let busy = Reply::Failed(Failure::Busy);
    assert_eq!(call_on_can(&mut rig, 1, Request::SaveConfig), busy);
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(10_000);
    assert_eq!(rig.can_control, []);
    rig.request_on_can(2, Request::SaveConfig);
    rig.run(10_000);
    rig.bridge.saved(Err(Failure::Flash), at(rig.now));
    rig.run(10_000);
    let reply = Reply::Failed(Failure::Flash);
    assert_eq!(rig.can_control, [FromAdapter::Reply { sequence: 2, reply }]);
}

#[test]
fn another_silent_request_does_not_fail_identification() {
    let mut rig = quiet();
    let (mut ling_responder, mut first) = (ling_responder(), true);
    rig.responder = Box::new(move |request| ling_responder(request).filter(|_| !core::mem::take(&mut first)));
    rig.request(Request::IdentifyArm);
    rig.run(1_000);
    rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
    rig.bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    let busy = Reply::Failed(Failure::Busy);
    assert_eq!(call_on_can(&mut rig, 1, Request::IdentifyArm), busy);
    rig.run(500_000);
    let Reply::Arm(arm) = call_on_can(&mut rig, 2, Request::IdentifyArm) else {
        panic!()
    };
    assert!(arm.answer.is_some());
}

#[test]
fn can_fd_configuration_is_refused_on_classic_board() {
    let can = Can {
        data_bit_rate: Some(2_000_000),
        ..Can::default()
    };
    let config = Config {
        can,
        ..Config::default()
    };
    for (can_fd, expected) in [(true, config), (false, Config::default())] {
        let identity = Identity {
            can_fd,
            ..Identity::default()
        };
        assert_eq!(Bridge::new(identity, config, Start::default()).config(), expected);
    }
}

#[test]
fn event_of_can_request_leaves_room_for_reply() {
    let mut rig = Rig::new(Config {
        poll: Poll::Hertz(100),
        ..Config::default()
    });
    let events = Subscription {
        frames: false,
        events: true,
    };
    assert_eq!(call_on_can(&mut rig, 1, Request::Subscribe(events)), Reply::Done);
    rig.request_on_can(2, Request::ReserveLine);
    rig.run(10_000);
    let replies = rig.can_control.iter().filter_map(|message| match message {
        FromAdapter::Reply { sequence, reply } => Some((*sequence, reply.clone())),
        FromAdapter::Event { .. } => None,
    });
    assert_eq!(replies.collect::<Vec<_>>(), [(2, Reply::Done)]);
}
