//! The adapter's behaviour, event by event.

extern crate std;

mod act_first;
mod can;
mod control;
mod delayed;
mod line_rate;
mod no_can;
mod order;
mod polls;
mod recovery;
mod rig;
mod safety;
mod share;
mod stop;

use std::vec::Vec;

use crate::{
    Bridge, Duration, Instant, LineCoding, PACKET, RxThreshold, TO_ARM_BUFFER, TO_HOST_BUFFER, UartConfig, UartErrors,
    UartEvent, UnsupportedCoding, UsbEvent,
};
use armwire::ling::{Frame, MAX_FRAME};
use proptest::prelude::*;

/// An adapter whose host has the port open.
fn open() -> Bridge {
    let mut bridge = Bridge::default();
    bridge.usb_event(UsbEvent::Configured(true), NOW);
    bridge.usb_event(UsbEvent::Dtr(true), NOW);
    bridge
}

fn frame(data: &[u8]) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let frame = Frame {
        command: 0x06,
        function: 0x00,
        data,
    };
    let n = frame.encode(&mut out).unwrap();
    out[..n].to_vec()
}

/// The next packet for the host.
fn packet(bridge: &mut Bridge) -> Option<Vec<u8>> {
    let mut packet = [0; PACKET];
    let due = bridge.update(NOW).usb;
    let n = bridge.usb_transmit(&mut packet);
    assert_eq!(n.is_some(), due);
    n.map(|n| packet[..n].to_vec())
}

fn packets(bridge: &mut Bridge) -> Vec<Vec<u8>> {
    core::iter::from_fn(|| packet(bridge)).collect()
}

/// All bytes for the arm.
fn sent(bridge: &mut Bridge) -> Vec<u8> {
    core::iter::from_fn(|| burst(bridge)).flatten().collect()
}

/// The bytes of one burst to the arm.
fn burst(bridge: &mut Bridge) -> Option<Vec<u8>> {
    let mut out = [0; MAX_FRAME];
    let burst = rig::transmit(bridge, &mut out, NOW)?;
    Some(out[..burst.len].to_vec())
}

fn line(coding: [u8; 7]) -> UartConfig {
    let coding = LineCoding::from_cdc(coding).unwrap();
    UartConfig {
        coding,
        half_duplex: false,
    }
}

const NOW: Instant = Instant::ZERO;
/// The time at which a rate that was set takes effect on an open port.
const SETTLED: Instant = Instant::from_millis(100);
const BAUD_115200: [u8; 7] = [0x00, 0xC2, 0x01, 0x00, 0, 0, 8];

#[test]
fn frame_reaches_host_with_its_last_byte() {
    let mut bridge = open();
    let frame = frame(&[0xAA; 15]);
    for &byte in &frame[..frame.len() - 1] {
        bridge.uart_received(&[byte], NOW);
        assert_eq!(packet(&mut bridge), None);
    }
    bridge.uart_received(&frame[frame.len() - 1..], NOW);
    assert_eq!(packets(&mut bridge), [frame]);
    assert_eq!(bridge.counters().frames, 1);
}

#[test]
fn start_of_next_frame_waits_for_its_end() {
    let mut bridge = open();
    let first = frame(&[1]);
    let second = frame(&[2, 3]);
    let line = [&first[..], &second[..]].concat();
    bridge.uart_received(&line[..first.len() + 3], NOW);
    assert_eq!(packets(&mut bridge), [&first[..]]);
    bridge.uart_received(&line[first.len() + 3..], NOW);
    assert_eq!(packets(&mut bridge), [second]);
}

#[test]
fn stray_bytes_are_sent_when_line_is_idle() {
    let mut bridge = open();
    bridge.uart_received(&[1, 2, 0xAA, 3], NOW);
    assert_eq!(packet(&mut bridge), None);
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packets(&mut bridge), [[1, 2, 0xAA, 3]]);
    assert_eq!((bridge.counters().noise_bytes, bridge.counters().frames), (4, 0));
}

#[test]
fn full_packet_waits_for_nothing() {
    let mut bridge = open();
    bridge.uart_received(&[7; PACKET - 1], NOW);
    assert_eq!(packet(&mut bridge), None);
    bridge.uart_received(&[7; 2], NOW);
    assert_eq!(packets(&mut bridge), [[7; PACKET]]);
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packets(&mut bridge), [[7; 1]]);
}

#[test]
fn first_packet_of_longer_frame_is_sent_early() {
    let mut bridge = open();
    let frame = frame(&[7; 63]);
    bridge.uart_received(&frame[..PACKET], NOW);
    assert_eq!(packets(&mut bridge), [&frame[..PACKET]]);
    bridge.uart_received(&frame[PACKET..], NOW);
    assert_eq!(packets(&mut bridge), [&frame[PACKET..]]);
}

#[test]
fn full_packet_at_end_is_followed_by_empty() {
    let mut bridge = open();
    bridge.uart_received(&[7; PACKET], NOW);
    assert_eq!(packet(&mut bridge).unwrap().len(), PACKET);
    assert_eq!(packet(&mut bridge), None); // more may be coming
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packets(&mut bridge), [[]; 1]);
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packet(&mut bridge), None); // once is enough

    // The same when the line was idle before the packet was fetched, and when a frame ends there.
    bridge.uart_received(&[7; 2 * PACKET], NOW);
    bridge.uart_event(UartEvent::Idle, NOW);
    let lengths: Vec<_> = packets(&mut bridge).iter().map(Vec::len).collect();
    assert_eq!(lengths, [PACKET, PACKET, 0]);
    bridge.uart_received(&frame(&[0; PACKET - 6]), NOW);
    let lengths: Vec<_> = packets(&mut bridge).iter().map(Vec::len).collect();
    assert_eq!(lengths, [PACKET, 0]);
    assert_eq!(bridge.counters().empty_packets_to_host, 3);
}

#[test]
fn short_packet_ends_a_transfer_by_itself() {
    let mut bridge = open();
    bridge.uart_received(&[7; PACKET + 1], NOW);
    bridge.uart_event(UartEvent::Idle, NOW);
    let lengths: Vec<_> = packets(&mut bridge).iter().map(Vec::len).collect();
    assert_eq!(lengths, [PACKET, 1]);
}

#[test]
fn stopped_host_blocks_no_arm_loses_only_overflow() {
    let mut bridge = open();
    let line: Vec<u8> = (0..4_000_u32).map(|i| (i % 251) as u8).collect();
    for chunk in line.chunks(50) {
        bridge.uart_received(chunk, NOW);
        bridge.usb_received(&[1; 10], NOW);
        assert_eq!(sent(&mut bridge), [1; 10]);
    }
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packets(&mut bridge).concat(), line[..TO_HOST_BUFFER]);
    assert_eq!(bridge.counters().dropped_bytes, 4_000 - TO_HOST_BUFFER as u32);

    let frame = frame(&[1, 2, 3]);
    bridge.uart_received(&frame, NOW);
    assert_eq!(packets(&mut bridge), [frame]);
}

#[test]
fn bytes_that_were_dropped_delay_nothing() {
    let mut bridge = Bridge::default();
    bridge.usb_event(UsbEvent::Configured(true), NOW);
    bridge.uart_received(&[7; TO_HOST_BUFFER], NOW);
    bridge.uart_event(UartEvent::Idle, NOW);
    let line = [frame(&[1]), frame(&[2, 3])].concat();
    bridge.uart_received(&line[..line.len() - 1], NOW);
    assert_eq!(packets(&mut bridge).concat(), [7; TO_HOST_BUFFER]);
}

#[test]
fn host_is_delayed_until_packet_fits() {
    let mut bridge = open();
    let mut expected = Vec::new();
    while bridge.update(NOW).usb_room {
        let packet = [expected.len() as u8; PACKET];
        bridge.usb_received(&packet, NOW);
        expected.extend(packet);
    }
    assert_eq!(expected.len(), TO_ARM_BUFFER);
    bridge.usb_received(&[0xEE; 3], NOW); // against the contract: counted, never mixed in
    assert_eq!(bridge.counters().refused_bytes, 3);

    assert_eq!(sent(&mut bridge), expected);
    assert_eq!(bridge.counters().host_to_arm_bytes, TO_ARM_BUFFER as u32);

    bridge.usb_received(&[0], NOW);
    let mut len = 1;
    while bridge.update(NOW).usb_room {
        bridge.usb_received(&[0; PACKET], NOW);
        len += PACKET;
    }
    assert_eq!(len, TO_ARM_BUFFER - (PACKET - 1), "one byte less is no room");
    assert_eq!(burst(&mut bridge).unwrap().len(), MAX_FRAME);
    assert!(bridge.update(NOW).usb_room);
}

#[test]
fn line_coding_changes_between_earlier_and_later_bytes() {
    let mut bridge = open();
    bridge.usb_received(&[1, 2, 3], NOW);
    bridge.set_line_coding(BAUD_115200, NOW).unwrap();
    assert!(bridge.update(NOW).usb_room, "the first byte for it has room");
    bridge.usb_received(&[4, 5], NOW);
    assert!(!bridge.update(NOW).usb_room, "the next packet waits");
    assert_eq!(bridge.line_coding().baud, 115_200);
    assert_eq!(bridge.line.settled().uart_change(), None);

    assert_eq!(sent(&mut bridge), [1, 2, 3]);
    assert_eq!(sent(&mut bridge), []);
    let line = bridge.line.settled().uart_change().unwrap();
    bridge.uart_event(UartEvent::Configured(line), NOW);
    assert_eq!(bridge.line.settled().uart_change(), None);
    assert_eq!(sent(&mut bridge), [4, 5]);
    assert_eq!(bridge.counters().line_codings, 1);
}

#[test]
fn bytes_between_two_codings_use_the_first() {
    const BAUD_2M: [u8; 7] = [0x80, 0x84, 0x1E, 0, 0, 0, 8];
    for last in [BAUD_2M, LineCoding::LING.to_cdc()] {
        let mut bridge = open();
        bridge.usb_received(b"AAA", NOW);
        bridge.set_line_coding(BAUD_115200, NOW).unwrap();
        bridge.usb_received(b"BBB", NOW);
        bridge.set_line_coding(last, NOW).unwrap();
        let last = LineCoding::from_cdc(last).unwrap();
        assert_eq!(bridge.line_coding(), last);
        bridge.tick(SETTLED);

        let mut sent = Vec::new();
        let mut baud = LineCoding::LING.baud;
        for _ in 0..4 {
            let bytes = burst(&mut bridge).unwrap_or_default();
            sent.extend(bytes.into_iter().map(|byte| (byte, baud)));
            if let Some(line) = bridge.line.settled().uart_change() {
                baud = line.coding.baud;
                bridge.uart_event(UartEvent::Configured(line), NOW);
            }
        }
        assert_eq!(sent, [[(b'A', 1_000_000); 3], [(b'B', 115_200); 3]].concat());
        assert_eq!((baud, bridge.counters().line_codings), (last.baud, 2));
        assert!(bridge.update(NOW).usb_room);
    }
}

#[test]
fn current_coding_needs_no_change_and_cancels_one() {
    let mut bridge = open();
    bridge.set_line_coding(LineCoding::LING.to_cdc(), NOW).unwrap();
    bridge.tick(SETTLED);
    assert_eq!(bridge.line.settled().uart_change(), None);
    bridge.set_line_coding(BAUD_115200, SETTLED).unwrap();
    bridge.tick(SETTLED + Duration::from_millis(100));
    assert!(bridge.line.settled().uart_change().is_some());
    bridge.set_line_coding(LineCoding::LING.to_cdc(), NOW).unwrap();
    assert_eq!(bridge.line.settled().uart_change(), None);
    assert_eq!(bridge.line_coding(), LineCoding::LING);
    // A change may have been in progress.
    bridge.uart_event(UartEvent::Configured(UartConfig::default()), NOW);
    assert_eq!(bridge.line.settled().uart_change(), None);
}

#[test]
fn coding_during_a_change_takes_effect_afterwards() {
    const BAUD_2M: [u8; 7] = [0x80, 0x84, 0x1E, 0, 0, 0, 8];
    for last in [BAUD_2M, LineCoding::LING.to_cdc()] {
        let mut bridge = open();
        bridge.set_line_coding(BAUD_115200, NOW).unwrap();
        bridge.tick(SETTLED);
        let first = bridge.line.settled().uart_change().unwrap();
        // Firmware waits for the last bit to leave. Meanwhile:
        bridge.set_line_coding(last, SETTLED).unwrap();
        bridge.tick(SETTLED + Duration::from_millis(100));
        bridge.uart_event(UartEvent::Configured(first), NOW);
        assert_eq!(bridge.line_coding().to_cdc(), last);
        let line = bridge.line.settled().uart_change().unwrap();
        assert_eq!(line.coding.to_cdc(), last);
        bridge.uart_event(UartEvent::Configured(line), NOW);
        assert_eq!(bridge.line.settled().uart_change(), None);
        assert_eq!(bridge.line_coding().to_cdc(), last);
    }
}

#[test]
fn unsupported_coding_is_counted_without_effect() {
    let mut bridge = open();
    bridge.set_line_coding(BAUD_115200, NOW).unwrap();
    let refused = bridge.set_line_coding([0x00, 0xC2, 0x01, 0x00, 0, 3, 8], NOW);
    assert_eq!(refused, Err(UnsupportedCoding::Parity(3)));
    assert_eq!(bridge.line_coding().baud, 115_200);
    assert_eq!(bridge.counters().refused_line_codings, 1);
}

#[test]
fn new_coding_ends_a_partial_frame() {
    let mut bridge = open();
    let frame = frame(&[1, 2, 3]);
    bridge.uart_received(&frame[..4], NOW);
    bridge.uart_event(UartEvent::Configured(line(BAUD_115200)), NOW);
    assert_eq!(packets(&mut bridge), [&frame[..4]]);
    bridge.uart_received(&frame, NOW);
    assert_eq!(packets(&mut bridge), [frame]);
}

#[test]
fn bus_reset_drops_unread_data_keeps_written_data() {
    let mut bridge = open();
    bridge.uart_received(&[7; PACKET], NOW);
    packet(&mut bridge).unwrap();
    bridge.uart_received(&[7; 100], NOW);
    bridge.usb_received(&[1, 2], NOW);
    assert!(bridge.update(NOW).is_attached);
    bridge.usb_event(UsbEvent::Reset, NOW);
    assert!(!bridge.update(NOW).is_attached);
    bridge.uart_received(&[7; 20], NOW); // no host
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packet(&mut bridge), None);
    assert_eq!(sent(&mut bridge), [1, 2]);
    assert_eq!(
        (bridge.counters().usb_resets, bridge.counters().undelivered_bytes),
        (1, 120)
    );

    bridge.usb_event(UsbEvent::Configured(true), NOW);
    let frame = frame(&[1]);
    bridge.uart_received(&frame, NOW);
    assert_eq!(packets(&mut bridge), [frame]);
}

#[test]
fn unsendable_packet_is_counted() {
    let mut bridge = open();
    bridge.uart_received(&[7; PACKET], NOW);
    let lost = packet(&mut bridge).unwrap();
    bridge.usb_event(UsbEvent::Lost(lost.len()), NOW);
    assert_eq!(bridge.counters().undelivered_bytes, PACKET as u32);
}

#[test]
fn host_that_never_raises_dtr_gets_everything() {
    let mut bridge = Bridge::default();
    bridge.usb_event(UsbEvent::Configured(true), NOW);
    bridge.usb_event(UsbEvent::Dtr(false), NOW);
    bridge.uart_received(&[1, 2], NOW);
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packets(&mut bridge), [[1, 2]]);
}

#[test]
fn closed_port_receives_nothing_and_reopens_clean() {
    let mut bridge = open();
    bridge.uart_received(&[1, 2], NOW);
    assert!(bridge.usb_event(UsbEvent::Dtr(false), NOW));
    bridge.uart_received(&[3; 100], NOW);
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packet(&mut bridge), None);
    assert!(bridge.usb_event(UsbEvent::Dtr(true), NOW));
    bridge.uart_received(&[4], NOW);
    bridge.uart_event(UartEvent::Idle, NOW);
    assert!(!bridge.usb_event(UsbEvent::Dtr(true), NOW)); // no change
    assert_eq!(packets(&mut bridge), [[4]]);
    assert_eq!(bridge.counters().undelivered_bytes, 102);
}

#[test]
fn dtr_without_a_configuration_means_nothing() {
    let mut bridge = Bridge::default();
    bridge.usb_event(UsbEvent::Dtr(true), NOW);
    assert!(!bridge.update(NOW).is_attached);
    bridge.uart_received(&[1], NOW);
    bridge.uart_event(UartEvent::Idle, NOW);
    assert_eq!(packet(&mut bridge), None);
}

/// Any frame, and at most a packet or the bytes of a millisecond.
const fn any_frame(most: usize) -> RxThreshold {
    RxThreshold {
        max: most,
        min: 6,
        terminator: Some(0xFF),
    }
}

#[test]
fn threshold_covers_rest_of_a_started_frame() {
    let mut bridge = open();
    let frame = frame(&[9; 15]);
    assert_eq!(bridge.rx_wait().threshold, any_frame(PACKET));
    for (at, missing) in [(1, 5), (6, 15), (6, 15), (20, 1)] {
        let from = bridge.counters().arm_to_host_bytes as usize;
        bridge.uart_received(&frame[from..at], NOW);
        let need = RxThreshold {
            max: missing,
            min: missing,
            terminator: None,
        };
        assert_eq!(bridge.rx_wait().threshold, need);
        assert!(need.is_met(missing, 0) && !need.is_met(missing - 1, 0xFF));
    }
    bridge.uart_received(&frame[20..], NOW);
    // The host has not fetched the 21 bytes.
    assert_eq!(bridge.rx_wait().threshold, any_frame(PACKET - 21));
}

#[test]
fn threshold_covers_rest_of_a_nearly_full_packet() {
    let mut bridge = open();
    bridge.uart_received(&[0x11; 62], NOW);
    assert_eq!(bridge.rx_wait().threshold, any_frame(2));
    bridge.uart_received(&[0x11; 3], NOW);
    assert_eq!(bridge.rx_wait().threshold, any_frame(PACKET));
}

#[test]
fn slow_line_state_stays_fresh_while_bytes_arrive() {
    for (baud, most, rest) in [(115_200, 11, 11), (9_600, 6, 1)] {
        let mut bridge = open();
        let coding = LineCoding {
            baud,
            ..LineCoding::LING
        };
        bridge.uart_event(UartEvent::Configured(line(coding.to_cdc())), NOW);
        assert_eq!(bridge.rx_wait().threshold, any_frame(most));
        bridge.uart_received(&frame(&[9; 15])[..6], NOW);
        assert_eq!(bridge.rx_wait().threshold.max, rest);
    }
}

#[test]
fn unread_host_costs_no_extra_polls() {
    let mut bridge = open();
    bridge.uart_received(&[0x11; 500], Instant::ZERO);
    assert_eq!(bridge.rx_wait().threshold, any_frame(PACKET));
}

#[test]
fn uart_errors_are_counted_by_kind() {
    let mut bridge = open();
    bridge.uart_event(
        UartEvent::Errors(UartErrors {
            framing: 1,
            parity: 2,
            noise: 3,
            overrun: 4,
            ..UartErrors::default()
        }),
        NOW,
    );
    bridge.uart_event(
        UartEvent::Errors(UartErrors {
            ring_overrun: 1,
            ..UartErrors::default()
        }),
        NOW,
    );
    bridge.usb_event(UsbEvent::Suspended, NOW);
    let c = bridge.counters();
    assert_eq!((c.framing_errors, c.parity_errors, c.noise_errors), (1, 2, 3));
    assert_eq!((c.overrun_errors, c.ring_overruns, c.usb_suspends), (4, 1, 1));
}

#[test]
fn stuck_bytes_are_a_fault_unlike_unread_host() {
    let at = Instant::from_millis;
    let mut bridge = open();
    bridge.uart_received(&[7; 500], at(5_000));
    assert!(!bridge.is_stuck(at(6_000)));

    bridge.usb_received(&[1; PACKET], at(5_500));
    bridge.usb_received(&[1; 10], at(5_500));
    bridge.uart_received(&[], at(6_500));
    assert!(!bridge.is_stuck(at(6_500)));
    assert!(bridge.is_stuck(at(6_501)));
    let burst = rig::transmit(&mut bridge, &mut [0; MAX_FRAME], at(6_501)).unwrap();
    assert_eq!(burst.len, PACKET + 6);
    assert!(!bridge.is_stuck(at(6_502)));
    sent(&mut bridge);
    assert!(!bridge.is_stuck(at(7_500)));

    bridge.set_line_coding(BAUD_115200, at(6_501)).unwrap();
    bridge.usb_received(&[1; 10], at(6_501));
    assert!(!bridge.is_stuck(at(7_500)));
    bridge.uart_received(&[], at(7_502));
    assert!(bridge.is_stuck(at(7_502)));
}

/// An arm's output: frames, parts of frames, arbitrary bytes.
fn arm_output() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        prop::collection::vec(any::<u8>(), 1..20).prop_map(|data| frame(&data)),
        prop::collection::vec(any::<u8>(), 58).prop_map(|data| frame(&data)),
        (0..30_usize, prop::collection::vec(any::<u8>(), 1..20)).prop_map(|(n, data)| {
            let frame = frame(&data);
            frame[..n.min(frame.len())].to_vec()
        }),
        prop::collection::vec(prop_oneof![Just(0xAA), any::<u8>()], 0..150),
    ]
}

/// A host's view: packets join to transfers, and a short packet ends a transfer.
#[derive(Default)]
struct Host {
    bytes: Vec<u8>,
    open: bool,
}

impl Host {
    fn read(&mut self, bridge: &mut Bridge) {
        for packet in packets(bridge) {
            assert!(!packet.is_empty() || self.open, "an empty packet that ends nothing");
            self.open = packet.len() == PACKET;
            self.bytes.extend(packet);
        }
    }
}

proptest! {
    #[test]
    fn host_gets_every_byte_in_any_chunks(
        bytes in prop::collection::vec(arm_output(), 0..12),
        cuts in prop::collection::vec((1..100_usize, any::<bool>(), any::<bool>()), 1..40),
    ) {
        let bytes = bytes.concat();
        let mut bridge = Bridge::default();
        bridge.usb_event(UsbEvent::Configured(true), NOW);
        let mut host = Host::default();

        let mut rest = &bytes[..];
        for &(n, idle, read) in cuts.iter().cycle() {
            if rest.is_empty() {
                break;
            }
            let (now, later) = rest.split_at(n.min(rest.len()));
            bridge.uart_received(now, NOW);
            prop_assert!(bridge.rx_wait().threshold.max >= 1);
            if idle {
                bridge.uart_event(UartEvent::Idle, NOW);
            }
            if read {
                host.read(&mut bridge);
                prop_assert!(!idle || !host.open, "the line is idle and the host still waits");
            }
            rest = later;
        }
        bridge.uart_event(UartEvent::Idle, NOW);
        host.read(&mut bridge);
        prop_assert_eq!(&host.bytes, &bytes);
        prop_assert!(!host.open);

        let counters = bridge.counters();
        prop_assert_eq!(counters.arm_to_host_bytes as usize, bytes.len());
        prop_assert_eq!(counters.dropped_bytes + counters.undelivered_bytes, 0);
    }

    #[test]
    fn no_frame_completes_before_the_threshold(
        bytes in prop::collection::vec(arm_output(), 0..12),
        late in prop::collection::vec(0..30_usize, 1..20),
    ) {
        let bytes = bytes.concat();
        // One gets each byte at once, the other only at its threshold.
        let (mut eager, mut lazy) = (Bridge::default(), Bridge::default());
        let mut from = 0;
        let mut late = late.iter().cycle();
        for (at, &byte) in bytes.iter().enumerate() {
            let due = eager.uart_received(&[byte], NOW) > 0;
            let unreported = &bytes[from..=at];
            if lazy.rx_wait().threshold.is_met(unreported.len(), byte) || unreported.len() > *late.next().unwrap() + 40 {
                prop_assert_eq!(lazy.uart_received(unreported, NOW) > 0, due, "at {}", at);
                from = at + 1;
            } else {
                prop_assert!(!due, "an unreported frame at {}", at);
            }
        }
    }

    #[test]
    fn frame_never_waits_for_the_idle_line(
        before in prop::collection::vec(any::<u8>().prop_filter("no header", |&b| b != 0xAA), 0..200),
        data in prop::collection::vec(any::<u8>(), 0..60),
        cut in 1..70_usize,
    ) {
        let mut bridge = Bridge::default();
        bridge.usb_event(UsbEvent::Configured(true), NOW);
        let mut host = Host::default();
        let line = [before, frame(&data)].concat();
        for chunk in line.chunks(cut) {
            bridge.uart_received(chunk, NOW);
            host.read(&mut bridge);
        }
        prop_assert_eq!(host.bytes, line);
        prop_assert!(!host.open);
    }

    #[test]
    fn arm_gets_every_byte_in_any_chunks(
        packets in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..=PACKET), 0..40),
    ) {
        let mut bridge = open();
        let mut got = Vec::new();
        for packet in &packets {
            while !bridge.update(NOW).usb_room {
                got.extend(burst(&mut bridge).unwrap());
            }
            bridge.usb_received(packet, NOW);
        }
        got.extend(sent(&mut bridge));
        prop_assert_eq!(got, packets.concat());
        prop_assert_eq!(bridge.counters().refused_bytes, 0);
    }
}

#[test]
fn threshold_is_met_by_terminator_or_maximum() {
    let need = RxThreshold {
        max: 5,
        min: 2,
        terminator: Some(0xFF),
    };
    for (bytes, last, is_met) in [
        (5, 0, true),
        (4, 0, false),
        (4, 0xFF, true),
        (2, 0xFF, true),
        (1, 0xFF, false),
    ] {
        assert_eq!(need.is_met(bytes, last), is_met, "{bytes} bytes, the last {last}");
    }
    let unmarked = RxThreshold {
        terminator: None,
        ..need
    };
    assert!(!unmarked.is_met(4, 0xFF) && unmarked.is_met(5, 0xFF));
}
