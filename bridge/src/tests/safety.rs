//! The silence of a host that streams motion, and cyclic commands.

extern crate std;

use std::boxed::Box;
use std::vec;
use std::vec::Vec;

use armwire::ling::{self, Ling};
use armwire::messages::Messages;

use super::rig::{Rig, at, ling, ling_responder, motion, send_request, streaming_on_can_into_a_self_check, transmit};
use crate::can::command::Command;
use crate::can::telemetry::event_from_frame;
use crate::can::{Frame, Function, Node};
use crate::config::{ArmKind, Can, Config, HostTimeout};
use crate::control::{Event, Failure, Identity, Initiator, MAX_FRAME, Refusal, Reply, Request};
use crate::{Action, Bridge, Duration, Instant, PACKET, Start, TO_ARM_BUFFER, UsbEvent};

const TORQUE_OFF: [u8; 7] = [0xAA, 0x05, 0x00, 0x01, 0x00, 0x6F, 0xFF];

fn silence(after_ms: u16, torque_off: bool) -> Config {
    Config {
        host_timeout: HostTimeout { after_ms, torque_off },
        can: Can {
            commands: true,
            ..Can::default()
        },
        ..Config::default()
    }
}

fn silences(rig: &Rig) -> Vec<(u64, Event)> {
    let silent = rig
        .events
        .iter()
        .filter(|(_, event)| matches!(event, Event::HostSilent { .. }));
    silent.map(|(at, event)| (at.0, event.clone())).collect()
}

#[test]
fn torque_off_is_the_documented_frame() {
    assert_eq!(ling(0x05, 0, &[0]), TORQUE_OFF);
}

#[test]
fn silent_motion_host_is_reported_once() {
    for torque_off in [false, true] {
        let mut rig = Rig::new(silence(500, torque_off));
        rig.subscribe();
        for _ in 0..10 {
            rig.usb_out.extend(motion());
            rig.run(100_000);
        }
        rig.run(2_000_000);
        let event = Event::HostSilent {
            initiator: Initiator::Usb,
            dropped: 0,
            torque_off,
        };
        assert_eq!(silences(&rig), [(900_000 + 500_000, event.clone())]);
        let c = rig.bridge.counters();
        assert_eq!(
            (c.host_silences, c.requests_usb, c.requests_adapter),
            (1, 10, u32::from(torque_off))
        );
        let last = rig.sent.last().unwrap();
        if torque_off {
            assert_eq!(
                (last, *rig.initiators.last().unwrap()),
                (&(1_400_000, TORQUE_OFF.to_vec()), Initiator::Adapter)
            );
        } else {
            assert_eq!(last.1, motion());
        }
        let events: Vec<_> = rig
            .frames
            .iter()
            .filter_map(|(_, frame)| event_from_frame(frame))
            .collect();
        assert_eq!(events, [(1_400_000, event)]);
    }
}

#[test]
fn timeout_of_delayed_host_starts_with_room() {
    let mut bridge = Bridge::new(Identity::default(), silence(500, false), Start::default());
    bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    for _ in 0..3 {
        bridge.usb_received(&motion(), Instant::ZERO);
        assert!(transmit(&mut bridge, &mut [0; MAX_FRAME], Instant::ZERO).is_some());
    }
    // Room remains for four bytes less than a packet.
    let moves = motion()
        .into_iter()
        .cycle()
        .take(TO_ARM_BUFFER + 4 - PACKET)
        .collect::<Vec<_>>();
    for packet in moves.chunks(PACKET) {
        assert!(bridge.update(Instant::ZERO).usb_room);
        bridge.usb_received(packet, Instant::ZERO);
    }
    assert!(!bridge.update(Instant::ZERO).usb_room);
    let room = Instant::from_millis(400);
    // The next moves, the last of them in part.
    let burst = transmit(&mut bridge, &mut [0; MAX_FRAME], room).unwrap();
    assert_eq!(burst.len, MAX_FRAME);
    assert!(bridge.update(Instant::ZERO).usb_room);
    let silent = room + Duration::from_millis(500);
    bridge.tick(silent - Duration::from_micros(1));
    assert_eq!(bridge.counters().host_silences, 0);
    bridge.tick(silent);
    assert_eq!(bridge.counters().host_silences, 1);
}

#[test]
fn hosts_without_stream_or_silence_are_not_reported() {
    // Two moves are no stream, nor are moves further apart; a host that only reads is not silent; 0 is never.
    for (after, moves, gap, reads) in [
        (500, 2, 100, false),
        (500, 10, 500, false),
        (500, 10, 100, true),
        (0, 10, 100, false),
    ] {
        let mut rig = Rig::new(silence(after, true));
        rig.subscribe();
        for _ in 0..moves {
            rig.usb_out.extend(motion());
            rig.run(gap * 1_000);
        }
        for _ in 0..20 {
            if reads {
                rig.usb_out.extend(ling(0x06, 0, &[0xFE]));
            }
            rig.run(100_000);
        }
        assert_eq!(silences(&rig), []);
        assert_eq!(rig.bridge.counters().requests_adapter, 0);
    }
}

/// A host on USB streams motion until a self-check from CAN, which takes 500 ms.
fn streams_until_can_has_the_arm(config: Config) -> Rig {
    let mut rig = Rig::new(config);
    rig.subscribe();
    for _ in 0..3 {
        rig.usb_out.extend(motion());
        rig.run(10_000);
    }
    rig.responder = Box::new(|_| None);
    rig.can_out.push_back(ling::SELF_CHECK.to_vec());
    rig.run(1_000);
    rig
}

#[test]
fn unsent_bytes_of_silent_host_are_dropped() {
    let mut rig = streams_until_can_has_the_arm(silence(300, false));
    let last = [motion(), motion()].concat();
    rig.usb_out.extend(&last);
    rig.run(1_000_000);
    let dropped = last.len() as u16;
    let event = Event::HostSilent {
        initiator: Initiator::Usb,
        dropped,
        torque_off: false,
    };
    assert_eq!(silences(&rig), [(31_000 + 300_000, event)]);
    assert_eq!(rig.bridge.counters().silenced_bytes, u32::from(dropped));
    assert_eq!(rig.line(), [&motion().repeat(3)[..], &ling::SELF_CHECK].concat());
    // The stream must start again.
    rig.usb_out.extend(motion());
    rig.run(1_000_000);
    assert_eq!(rig.bridge.counters().host_silences, 1);
}

#[test]
fn stream_from_can_is_watched_too() {
    let mut rig = Rig::new(silence(200, false));
    rig.subscribe();
    for _ in 0..5 {
        rig.can_out.push_back(motion());
        rig.run(50_000);
    }
    rig.run(1_000_000);
    assert_eq!(silences(&rig).len(), 1);
    assert!(matches!(
        silences(&rig)[0].1,
        Event::HostSilent {
            initiator: Initiator::Can,
            dropped: 0,
            ..
        }
    ));
}

#[test]
fn motion_waiting_on_can_gets_150_ms() {
    let mut rig = streaming_on_can_into_a_self_check(silence(100, true));
    let first = rig.now;
    rig.can_out.push_back(motion());
    rig.run(1_000_000);
    let silent = silences(&rig);
    assert!(
        matches!(silent[..], [(at, _)] if (first + 150_000..first + 152_000).contains(&at)),
        "{silent:?}"
    );
}

#[test]
fn requests_that_find_no_room_do_not_disarm() {
    let mut rig = streaming_on_can_into_a_self_check(silence(500, true));
    for _ in 0..40 {
        rig.can_out.push_back(motion());
        rig.run(20_000);
    }
    assert!(rig.bridge.counters().refused_can_requests > 10);
    let last = rig.now;
    rig.run(1_000_000);
    assert!(matches!(silences(&rig)[..], [(at, _)] if at < last + 500_000));
    assert_eq!(rig.sent.last().unwrap().1, TORQUE_OFF);
}

#[test]
fn stream_stays_armed_while_another_has_line() {
    let mut rig = Rig::new(silence(500, true));
    rig.subscribe();
    for _ in 0..10 {
        rig.usb_out.extend(motion());
        rig.run(200_000);
    }
    rig.responder = Box::new(|_| None);
    rig.can_out.push_back(ling::SELF_CHECK.to_vec());
    for _ in 0..4 {
        rig.usb_out.extend(motion());
        rig.run(200_000);
    }
    let last = rig.now - 200_000;
    rig.run(2_000_000);
    let event = Event::HostSilent {
        initiator: Initiator::Usb,
        dropped: 0,
        torque_off: true,
    };
    assert_eq!(silences(&rig), [(last + 500_000, event)]);
    assert_eq!(rig.sent.last().unwrap(), &(last + 500_000, TORQUE_OFF.to_vec()));
}

#[test]
fn torque_off_waits_for_nobodys_answer() {
    let mut rig = streams_until_can_has_the_arm(silence(300, true));
    rig.run(2_000_000);
    assert_eq!(rig.sent.last().unwrap(), &(20_000 + 300_000, TORQUE_OFF.to_vec()));
}

#[test]
fn unsolicited_frames_do_not_delay_torque_off() {
    let mut rig = Rig::new(silence(500, true));
    for _ in 0..3 {
        rig.usb_out.extend(motion());
        rig.run(10_000);
    }
    let (mut ling_responder, mut n) = (ling_responder(), 0);
    rig.responder = Box::new(move |request| {
        n += 1;
        ling_responder(request).filter(|_| n < 9)
    });
    rig.usb_out.extend(ling(0x06, 0, &[0xFE]).repeat(9));
    let last = rig.now;
    for _ in 0..500 {
        rig.run(40_000);
        rig.arm_sends(&ling(0x77, 0, &[]));
    }
    let off = rig.sent.iter().find(|(_, bytes)| bytes == &TORQUE_OFF);
    assert_eq!(off, Some(&(last + 500_000, TORQUE_OFF.to_vec())));
    let c = rig.bridge.counters();
    assert_eq!((c.unanswered_requests, c.untracked_requests), (0, 1));
}

#[test]
fn host_ends_stream_and_keeps_torque() {
    for by_request in [false, true] {
        let mut rig = Rig::new(silence(500, true));
        rig.usb_out.extend(motion().repeat(3));
        rig.run(10_000);
        assert!(rig.bridge.update(Instant::ZERO).is_armed);
        match by_request {
            true => assert_eq!(rig.call(Request::EndStream), Reply::Done),
            false => rig.usb_out.extend(ling(0x05, 0, &[1])),
        }
        rig.run(2_000_000);
        assert!(!rig.bridge.update(Instant::ZERO).is_armed);
        assert_eq!(rig.bridge.counters().requests_adapter, 0);
    }
}

#[test]
fn torque_goes_off_before_a_restart() {
    for (request, action) in [
        (Request::Restart, Action::Restart),
        (Request::RestartIntoBootLoader, Action::RestartIntoBootLoader),
    ] {
        let mut rig = Rig::new(silence(500, true));
        rig.usb_out.extend(motion().repeat(3));
        rig.run(10_000);
        let now = at(rig.now);
        send_request(&mut rig.bridge, 1, request, now);
        assert_eq!(rig.bridge.action(at(rig.now)), None);
        let mut out = [0; MAX_FRAME];
        let burst = transmit(&mut rig.bridge, &mut out, now).unwrap();
        assert_eq!(out[..burst.len], TORQUE_OFF);
        assert_eq!(rig.bridge.action(at(rig.now)), Some(action));
        assert!(!rig.bridge.update(Instant::ZERO).is_armed);
    }
}

#[test]
fn flash_is_not_written_during_armed_stream() {
    for request in [Request::SaveConfig, Request::ResetConfig] {
        let mut rig = Rig::new(silence(500, true));
        rig.usb_out.extend(motion().repeat(3));
        rig.run(10_000);
        assert_eq!(rig.call(request), Reply::Failed(Failure::StreamArmed));
        assert_eq!(
            (rig.actions.len(), rig.bridge.update(Instant::ZERO).is_armed),
            (0, true)
        );
        rig.run(1_000_000);
        rig.request(request);
        assert_eq!(rig.actions.len(), 1);
    }
}

#[test]
fn whole_can_queue_of_silent_host_is_dropped() {
    let mut rig = streaming_on_can_into_a_self_check(silence(300, false));
    for _ in 0..3 {
        rig.can_out.push_back(motion());
    }
    rig.run(2_000_000);
    // Two in the queue, one in the connection.
    assert_eq!(rig.bridge.counters().silenced_bytes as usize, 3 * motion().len());
    assert_eq!(rig.line(), [&motion().repeat(3)[..], &ling::SELF_CHECK].concat());
    rig.can_out.push_back(motion());
    rig.run(10_000);
    assert_eq!(rig.bridge.counters().requests_can, 4);
}

fn command(sequence: u8) -> Command {
    Command {
        sequence,
        joints: [2048, 1024, 3072, 0, 4095, 2049],
        speed: 50,
        gripper: 250,
    }
}

fn send(rig: &mut Rig, command: Command) {
    for frame in command.to_frames(Node::default()) {
        rig.can_frame(&frame);
    }
}

/// Starts a stream of commands and continues it: ten in all, one every 10 ms.
fn stream_commands(rig: &mut Rig) {
    for sequence in 0..10 {
        send(rig, command(sequence));
        rig.run(10_000);
    }
}

fn refusals(rig: &Rig) -> Vec<Refusal> {
    let refused = |event: &Event| match event {
        Event::Refused {
            initiator: Initiator::Command,
            reason,
        } => Some(*reason),
        _ => None,
    };
    rig.events.iter().filter_map(|(_, event)| refused(event)).collect()
}

#[test]
fn complete_new_commands_in_range_move_the_arm() {
    let mut rig = Rig::new(silence(0, false));
    rig.subscribe();
    send(&mut rig, command(0));
    rig.run(10_000);
    assert_eq!(rig.line(), []);
    send(&mut rig, command(1));
    rig.run(10_000);
    let mut out = [0; 70];
    let target = ling::Request::Move(command(1).target().unwrap());
    let n = Ling.encode_request(&target, &mut out).unwrap();
    assert_eq!(rig.line(), out[..n]);
    assert_eq!(rig.bridge.counters().requests_command, 1);

    send(&mut rig, command(1));
    let [half, _] = command(2).to_frames(Node::default());
    rig.can_frame(&half);
    rig.run(100_000);
    send(&mut rig, command(0));
    send(&mut rig, Command { speed: 0, ..command(1) });
    rig.run(10_000);
    assert_eq!(
        refusals(&rig),
        [Refusal::Stale, Refusal::Incomplete, Refusal::OutOfRange]
    );
    let c = rig.bridge.counters();
    assert_eq!(
        (c.commands_stale, c.commands_incomplete, c.commands_out_of_range),
        (1, 1, 1)
    );
    assert_eq!((c.requests_command, rig.line().len()), (1, n));
    let events: Vec<_> = rig
        .frames
        .iter()
        .filter_map(|(_, frame)| event_from_frame(frame))
        .collect();
    assert_eq!(events.len(), 3);
}

/// A host on USB waits for a missing answer, and a command waits for its turn.
fn command_waits() -> Rig {
    let mut rig = Rig::new(silence(0, false));
    rig.subscribe();
    rig.responder = Box::new(|_| None);
    send(&mut rig, command(0));
    rig.usb_out.extend(ling(0x06, 0, &[0xFE]));
    rig.run(1_000);
    send(&mut rig, command(1));
    rig
}

#[test]
fn waiting_command_is_replaced_by_the_next() {
    let mut rig = command_waits();
    send(
        &mut rig,
        Command {
            joints: [1; 6],
            ..command(2)
        },
    );
    rig.run(90_000);
    assert_eq!(refusals(&rig), [Refusal::QueueFull]);
    assert_eq!(rig.bridge.counters().requests_command, 1);
    assert_eq!(rig.sent.last().unwrap().1[4..6], [1, 0]);
}

#[test]
fn commands_are_off_by_default() {
    let mut rig = Rig::new(Config::default());
    rig.subscribe();
    for sequence in 0..5 {
        send(&mut rig, command(sequence));
        rig.run(10_000);
    }
    assert_eq!((rig.line(), rig.events), (vec![], vec![]));
}

#[test]
fn commands_end_with_configuration_before_bus_change() {
    let mut rig = Rig::new(silence(0, false));
    send(&mut rig, command(0));
    let mut off = Config::default();
    off.can.node = Node::new(5).unwrap();
    // The controller is not reinitialised yet.
    let now = at(rig.now);
    send_request(&mut rig.bridge, 1, Request::SetConfig(off), now);
    for frame in command(1).to_frames(Node::default()) {
        rig.bridge.can_received(&frame, now);
    }
    assert!(!rig.bridge.update(now).uart);
    rig.run(10_000);
    assert_eq!((rig.line(), rig.bridge.counters().requests_command), (vec![], 0));
}

#[test]
fn silent_stream_of_commands_must_start_anew() {
    let mut rig = Rig::new(silence(50, true));
    rig.subscribe();
    for sequence in 0..5 {
        send(&mut rig, command(sequence));
        rig.run(10_000);
    }
    // Within the timeout of commands, but after that of the host.
    rig.run(60_000);
    assert_eq!(silences(&rig).len(), 1);
    assert_eq!(rig.sent.last().unwrap().1, TORQUE_OFF);
    send(&mut rig, command(5));
    rig.run(10_000);
    assert_eq!(refusals(&rig), [Refusal::Stale]);
}

#[test]
fn delayed_usb_host_is_not_silent() {
    let mut rig = streams_until_can_has_the_arm(silence(100, true));
    // More than the queue holds.
    let more = motion().repeat(30);
    rig.usb_out.extend(&more);
    rig.run(400_000);
    assert!(!rig.bridge.update(Instant::ZERO).usb_room);
    assert_eq!(silences(&rig), []);
    rig.run(200_000);
    assert_eq!(rig.line(), [&motion().repeat(3)[..], &ling::SELF_CHECK, &more].concat());
    // Torque-off is out.
    rig.run(100_000);
    let c = rig.bridge.counters();
    assert_eq!((silences(&rig).len(), c.silenced_bytes), (1, 0));
}

#[test]
fn motion_stream_ends_when_arm_kind_changes() {
    for initiator in [Initiator::Usb, Initiator::Can, Initiator::Command] {
        let mut rig = Rig::new(silence(500, false));
        rig.subscribe();
        for sequence in 0..6 {
            match initiator {
                Initiator::Usb => rig.usb_out.extend(motion()),
                Initiator::Can => rig.can_out.push_back(motion()),
                _ => send(&mut rig, command(sequence)),
            }
            rig.run(10_000);
        }
        let changed = rig.now;
        let other = Config {
            arm: ArmKind::Alpha1,
            host_timeout: HostTimeout {
                after_ms: 500,
                torque_off: true,
            },
            ..Config::default()
        };
        assert_eq!(rig.call(Request::SetConfig(other)), Reply::Done);
        let before = rig.sent.len();
        rig.run(1_000_000);
        let event = Event::HostSilent {
            initiator,
            dropped: 0,
            torque_off: false,
        };
        assert_eq!(silences(&rig), [(changed, event)]);
        assert_eq!((rig.bridge.counters().host_silences, rig.sent.len()), (1, before));
    }
}

#[test]
fn arm_kind_cannot_change_during_armed_stream() {
    let other = Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    };
    let mut rig = Rig::new(silence(500, true));
    rig.usb_out.extend(motion().repeat(3));
    rig.run(10_000);
    assert_eq!(rig.call(Request::SetConfig(other)), Reply::Failed(Failure::StreamArmed));
    // Torque-off still goes out when the host is silent.
    rig.run(1_000_000);
    assert_eq!(rig.sent.last().unwrap().1, TORQUE_OFF);
    assert_eq!(rig.call(Request::SetConfig(other)), Reply::Done);
}

#[test]
fn waiting_command_is_refused_when_arm_kind_changes() {
    let mut rig = command_waits();
    let other = Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    };
    assert_eq!(rig.call(Request::SetConfig(other)), Reply::Done);
    assert_eq!(refusals(&rig), [Refusal::NotAFrame]);
    assert_eq!(rig.bridge.counters().refused_can_frames, 1);
}

/// Sends a long request that is never answered: all other initiators must wait.
fn keep_busy(rig: &mut Rig) {
    rig.responder = Box::new(|_| None);
    rig.usb_out.extend(ling::SELF_CHECK);
    rig.run(1_000);
}

#[test]
fn command_waiting_beyond_its_timeout_moves_nothing() {
    let mut rig = Rig::new(silence(0, false));
    rig.subscribe();
    send(&mut rig, command(0));
    keep_busy(&mut rig);
    send(&mut rig, command(1));
    rig.run(1_000_000);
    assert_eq!(rig.line(), ling::SELF_CHECK);
    let refused = Event::Refused {
        initiator: Initiator::Command,
        reason: Refusal::Stale,
    };
    let events: Vec<_> = rig.events.iter().filter(|(_, event)| *event == refused).collect();
    assert!(matches!(events[..], [(at, _)] if at.0 == 101_000), "{events:?}");
    assert_eq!(rig.bridge.counters().commands_stale, 1);
}

#[test]
fn waiting_command_dies_with_commands_or_bus_change() {
    let off = Config {
        can: Can::default(),
        ..silence(0, false)
    };
    let mut elsewhere = silence(0, false);
    elsewhere.can.node = Node::new(5).unwrap();
    for config in [off, elsewhere] {
        let mut rig = Rig::new(silence(0, false));
        send(&mut rig, command(0));
        keep_busy(&mut rig);
        send(&mut rig, command(1));
        assert_eq!(rig.call(Request::SetConfig(config)), Reply::Done);
        rig.run(1_000_000);
        assert_eq!(rig.line(), ling::SELF_CHECK);
        assert_eq!(rig.bridge.counters().commands_stale, 1);
    }
}

#[test]
fn switched_off_command_stream_ends_with_torque_on() {
    let mut rig = Rig::new(silence(500, true));
    stream_commands(&mut rig);
    let off = Config {
        can: Can::default(),
        ..silence(500, true)
    };
    assert_eq!(rig.call(Request::SetConfig(off)), Reply::Done);
    rig.run(1_000_000);
    assert_eq!(rig.bridge.counters().host_silences, 1);
    assert_ne!(rig.sent.last().unwrap().1, TORQUE_OFF);
}

#[test]
fn torque_goes_off_despite_partial_host_frame() {
    use armwire::{Device, DeviceEvent};

    for cut in 1..motion().len() {
        let mut rig = Rig::new(silence(100, true));
        rig.usb_out.extend(motion().repeat(3));
        rig.run(10_000);
        rig.usb_out.extend(&motion()[..cut]);
        rig.run(1_000_000);
        // An arm that waits forever for the end of a frame.
        let mut device = Device::<Ling, { ling::MAX_FRAME }>::new(Ling);
        let line = rig.line();
        let (mut rest, mut requests) = (&line[..], Vec::new());
        while !rest.is_empty() {
            rest = device.receive(rest);
            while let Some(event) = device.poll() {
                if let DeviceEvent::Request { request, .. } = event {
                    requests.push(request);
                }
            }
        }
        assert_eq!(requests.len(), 4, "after {cut} bytes: {requests:?}");
        assert_eq!(requests[3], ling::Request::SetTorque(ling::Torque::Off));
        assert_eq!(rig.bridge.counters().requests_adapter, 5);
    }
}

#[test]
fn nothing_precedes_torque_off_after_complete_frame() {
    let mut rig = Rig::new(silence(100, true));
    rig.usb_out.extend(motion().repeat(3));
    rig.run(1_000_000);
    assert_eq!(rig.line(), [motion().repeat(3), TORQUE_OFF.to_vec()].concat());
}

#[test]
fn stream_on_can_lives_by_motion_only() {
    let others: [fn(&mut Rig); 3] = [
        |rig| {
            let flow = Frame::new(Function::ArmRequest.id(Node::default()), &[0x30, 0, 0]).unwrap();
            rig.can_frame(&flow);
        },
        |rig| rig.can_out.push_back(vec![1, 2, 3]),
        |rig| rig.can_out.push_back(ling(0x06, 0, &[0xFE])),
    ];
    for send in others {
        let mut rig = Rig::new(silence(100, true));
        for _ in 0..8 {
            rig.can_out.push_back(motion());
            rig.run(10_000);
        }
        for _ in 0..40 {
            send(&mut rig);
            rig.run(40_000);
        }
        assert_eq!(rig.bridge.counters().host_silences, 1);
        assert!(rig.sent.iter().any(|(_, bytes)| bytes == &TORQUE_OFF));
    }
}

#[test]
fn sender_of_refused_commands_only_is_silent() {
    let mut rig = Rig::new(silence(500, false));
    rig.subscribe();
    stream_commands(&mut rig);
    let last = rig.now - 10_000;
    for sequence in 10..100 {
        let too_far = Command {
            gripper: 251,
            ..command(sequence)
        };
        send(&mut rig, too_far);
        rig.run(10_000);
    }
    let silent = silences(&rig);
    assert!(matches!(silent[..], [(at, _)] if at == last + 500_000), "{silent:?}");
}

#[test]
fn waiting_can_request_keeps_its_host_alive() {
    let mut rig = Rig::new(silence(600, false));
    rig.subscribe();
    keep_busy(&mut rig);
    for _ in 0..3 {
        rig.can_out.push_back(motion());
    }
    rig.run(10_000);
    let came = rig.now;
    rig.run(3_000_000);
    let silent = silences(&rig);
    assert!(matches!(silent[..], [(at, _)] if at <= came + 600_000), "{silent:?}");
    // No turn waits for longer than 16 ms.
    assert_eq!(rig.bridge.line.settled().latencies().turn.counts[15], 3);
}

#[test]
fn while_the_flash_is_written_nobody_is_silent() {
    let mut rig = Rig::new(silence(200, false));
    for _ in 0..5 {
        rig.can_out.push_back(motion());
        rig.run(20_000);
    }
    rig.request(Request::SaveConfig);
    // The core of an STM32F405 stalls.
    rig.now += 250_000;
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(100_000);
    assert_eq!(rig.bridge.counters().host_silences, 0);
    rig.run(200_000);
    assert_eq!(rig.bridge.counters().host_silences, 1);
}
