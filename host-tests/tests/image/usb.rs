//! Actions of a USB host: enumerate, stop reading, delay, reset, suspend, unplug.

use armwire::ling::{Ling, Request, Response, Stroke};
use armwire::messages::Messages;
use armwire_bridge::Duration;
use armwire_host_tests::image::requests::encoded;
use armwire_host_tests::image::{
    MEGABAUD, Program, RawArm, board_config, byte_time, chip, counters, exchange, facts, noise, on_board,
    on_board_with, open, plug_in, read_all, same_bytes,
};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::line::Direction as LineDirection;
use armwire_virtual_board::usb::Direction;
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::usb::host::Request as UsbRequest;
use armwire_virtual_board::{Nanos, VirtualBoard};

/// Exchanges enough to wrap every queue of the adapter.
fn exchange_some(board: &mut VirtualBoard<RawArm>, seed: u64) {
    exchange(board, &noise(seed, 5_000), &noise(seed + 1_000, 5_000));
}

fn serial_number(unique_id: [u8; 12]) -> String {
    let mut config = board_config(RawArm::default());
    config.unique_id = unique_id;
    on_board_with(config, |board| {
        board.usb().attach();
        board.usb().enumerate().unwrap().serial.clone().unwrap()
    })
}

#[test]
fn serial_number_is_the_chips_unique_id() {
    let serial = facts(chip()).serial;
    assert_eq!(serial_number(*b"\x20\x00\x41\x00\x0B51P\x35V03"), serial);
    assert_eq!(serial_number([0xFF; 12]), "F".repeat(serial.len()));
}

/// The Microsoft OS 2.0 descriptors, and the platform capability that announces them.
#[test]
fn windows_uses_winusb_for_the_control_interface() {
    let bos = [
        &[0x05, 0x0F, 40, 0, 2][..],
        // USB 2.0 extension
        &[0x07, 0x10, 0x02, 0, 0, 0, 0],
        // platform: Windows 8.1, 178 bytes by request 0x20
        &[0x1C, 0x10, 0x05, 0],
        b"\xDF\x60\xDD\xD8\x89\x45\xC7\x4C\x9C\xD2\x65\x9D\x9E\x64\x8A\x9F",
        &[0, 0, 3, 6, 178, 0, 0x20, 0],
    ]
    .concat();
    let set = [
        // set: Windows 8.1
        &[10, 0, 0, 0, 0, 0, 3, 6, 178, 0][..],
        // the first configuration
        &[8, 0, 1, 0, 0, 0, 168, 0],
        // the function that begins with interface 2
        &[8, 0, 2, 0, 2, 0, 160, 0],
        // compatible id
        &[20, 0, 3, 0],
        b"WINUSB\0\0\0\0\0\0\0\0\0\0",
        // registry property: REG_MULTI_SZ
        &[132, 0, 4, 0, 7, 0],
        &[42, 0],
        &utf16("DeviceInterfaceGUIDs\0"),
        &[80, 0],
        &utf16("{4C757248-7066-47AD-9A38-E3D4ADFA1B0A}\0\0"),
    ]
    .concat();
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let read_bos = UsbRequest::read(0x80, 0x06, 0x0F00, 0, 40);
        assert_eq!(board.usb().control(read_bos).unwrap(), bos);
        let read_set = UsbRequest::read(0xC0, 0x20, 0, 7, 178);
        assert_eq!(board.usb().control(read_set).unwrap(), set);
    });
}

fn utf16(text: &str) -> Vec<u8> {
    text.encode_utf16().flat_map(u16::to_le_bytes).collect()
}

#[test]
fn line_coding_is_read_back() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        for baud in [1_200, 115_200, 2_000_000, MEGABAUD] {
            board.usb().set_line_coding(LineCoding::new(baud)).unwrap();
            assert_eq!(board.usb().line_coding().unwrap(), Some(LineCoding::new(baud)));
        }
    });
}

#[test]
fn unsupported_line_coding_is_refused_without_effect() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let seven_bits = LineCoding {
            bits: 7,
            ..LineCoding::new(MEGABAUD)
        };
        for coding in [LineCoding::new(3_000_000), LineCoding::new(0), seven_bits] {
            assert!(board.usb().set_line_coding(coding).is_err(), "{coding:?}");
        }
        assert_eq!(board.usb().line_coding().unwrap(), Some(LineCoding::new(MEGABAUD)));
        assert_eq!(counters(board).refused_line_codings, 3);
        exchange_some(board, 0);
    });
}

#[test]
fn stopped_host_does_not_block_the_arm() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        exchange_some(board, 0);
        let before = counters(board);

        // The host's program hangs. The traffic from and to the arm continues.
        board.usb().set_reading(false);
        let (sent_by_arm, sent_by_host) = (noise(1, 50_000), noise(2, 50_000));
        board.with_arm(|arm| arm.send(&sent_by_arm));
        board.usb().write(&sent_by_host).unwrap();
        board.run_for(Nanos::from_millis(600)).unwrap();
        same_bytes("the arm", &board.with_arm(RawArm::take_received), &sent_by_host);

        // The host reads again, and receives the buffered bytes from the beginning.
        board.usb().set_reading(true);
        let received = read_all(board);
        let dropped = (counters(board).dropped_bytes - before.dropped_bytes) as usize;
        assert!(received.len() >= 2_048, "{} bytes were kept", received.len());
        same_bytes("the host", &received, &sent_by_arm[..received.len()]);
        assert_eq!(received.len() + dropped, sent_by_arm.len());

        exchange_some(board, 3);
        assert_eq!(counters(board).dropped_bytes as usize, dropped);
    });
}

#[test]
fn missed_bytes_are_counted_and_rest_keeps_order() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let sent_by_arm = noise(1, 100_000);
        board.with_arm(|arm| arm.send(&sent_by_arm));
        for _ in 0..4 {
            board.run_for(Nanos::from_millis(100)).unwrap();
            board.usb().set_reading(false);
            board.run_for(Nanos::from_millis(100)).unwrap();
            board.usb().set_reading(true);
        }
        let received = read_all(board);
        let missed = missing(&sent_by_arm, &received);
        assert!(missed.len() == 4, "{missed:?}: one gap for each time");
        let dropped = counters(board).dropped_bytes as usize;
        assert_eq!(missed.iter().sum::<usize>(), dropped);
        assert_eq!(received.len() + dropped, sent_by_arm.len());
        exchange_some(board, 2);
    });
}

/// The lengths of the gaps in `received`, which must otherwise equal `sent`.
fn missing(sent: &[u8], received: &[u8]) -> Vec<usize> {
    const ENOUGH: usize = 8;
    let mut gaps = Vec::new();
    let mut at = 0;
    for (nth, &byte) in received.iter().enumerate() {
        if sent.get(at) != Some(&byte) {
            let next = &received[nth..received.len().min(nth + ENOUGH)];
            let gap = sent[at..].windows(next.len()).position(|window| window == next);
            let gap = gap.unwrap_or_else(|| panic!("byte {nth} was never sent, or out of order"));
            gaps.push(gap);
            at += gap;
        }
        at += 1;
    }
    if at < sent.len() {
        gaps.push(sent.len() - at);
    }
    gaps
}

#[test]
fn host_that_never_reads_causes_no_restart() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        board.usb().set_reading(false);
        for second in 0..5 {
            board.with_arm(|arm| arm.send(&noise(second, 5_000)));
            board.run_for(Nanos::from_millis(1_000)).unwrap();
        }
        board.usb().set_reading(true);
        read_all(board);
        exchange_some(board, 9);
    });
}

#[test]
fn adapter_waits_for_a_host() {
    on_board(RawArm::default(), |board| {
        // The adapter receives nothing before its UART runs.
        board.run_for(Nanos::from_millis(10)).unwrap();
        board.with_arm(|arm| arm.send(&noise(1, 3_000)));
        board.run_for(Nanos::from_millis(5_000)).unwrap();
        plug_in(board, MEGABAUD);
        assert_eq!(read_all(board), b"", "bytes from before the port was opened");
        assert_eq!(counters(board).undelivered_bytes, 3_000);
        exchange_some(board, 2);
    });
}

#[test]
fn naks_cost_no_byte() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let (down, up) = (noise(1, 20_000), noise(2, 20_000));
        board.with_arm(|arm| arm.send(&up));
        board.usb().write(&down).unwrap();
        let mut received = Vec::new();
        for nth in 0..100 {
            board.usb().inject_naks(Direction::In, nth % 7);
            board.usb().inject_naks(Direction::Out, nth % 5);
            board.run_for(Nanos::from_millis(2)).unwrap();
            received.extend(board.usb().read());
        }
        received.extend(read_all(board));
        same_bytes("the host", &received, &up);
        same_bytes("the arm", &board.with_arm(RawArm::take_received), &down);
    });
}

#[test]
fn replugged_port_works() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        for nth in 0..4 {
            exchange_some(board, nth);
            board.usb().detach();
            board.with_arm(|arm| arm.send(b"sent while closed"));
            board.run_for(Duration::from_millis(20 + nth)).unwrap();
            assert!(!board.usb().connected());
            plug_in(board, MEGABAUD);
            assert_eq!(read_all(board), b"");
        }
        exchange_some(board, 9);
    });
}

/// Disconnects the adapter in full flow, several times. It must work after each reconnection.
fn interrupt_flow(disconnect: fn(&mut VirtualBoard<RawArm>), reconnect: fn(&mut VirtualBoard<RawArm>)) {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        for nth in 0..8 {
            board.with_arm(|arm| arm.send(&noise(nth, 10_000)));
            board.usb().write(&noise(nth, 10_000)).unwrap();
            board.run_for(Duration::from_micros(20_000 + 137 * nth)).unwrap();
            disconnect(board);
            board.run_for(Nanos::from_millis(200)).unwrap();
            reconnect(board);
            assert_eq!(read_all(board), b"", "bytes for the previous host");
            exchange_some(board, nth);
        }
        assert!(counters(board).usb_resets >= 8);
    });
}

#[test]
fn adapter_unplugged_in_full_flow_works_again() {
    interrupt_flow(|board| board.usb().detach(), |board| plug_in(board, MEGABAUD));
}

#[test]
fn port_works_after_bus_reset_in_flow() {
    interrupt_flow(|board| board.usb().reset_bus(), |board| open(board, MEGABAUD));
}

#[test]
fn resumed_port_delivers_pending_bytes() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        exchange_some(board, 0);
        let before = counters(board).usb_suspends;
        board.usb().suspend();
        board.run_for(Nanos::from_millis(3_000)).unwrap();
        let sent_by_arm = noise(1, 500);
        board.with_arm(|arm| arm.send(&sent_by_arm));
        board.run_for(Nanos::from_millis(100)).unwrap();
        assert_eq!(board.usb().read(), b"");
        board.usb().resume();
        board.run_for(Nanos::from_millis(30)).unwrap();
        same_bytes("the host", &read_all(board), &sent_by_arm);
        exchange_some(board, 2);
        assert_eq!(counters(board).usb_suspends - before, 1);
    });
}

#[test]
fn suspended_port_counts_lost_bytes() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let (sent_by_arm, sent_by_host) = (noise(1, 20_000), noise(2, 20_000));
        board.with_arm(|arm| arm.send(&sent_by_arm));
        board.usb().write(&sent_by_host).unwrap();
        board.run_for(Duration::from_micros(50_123)).unwrap();
        board.usb().suspend();
        board.run_for(Nanos::from_millis(50)).unwrap();
        board.usb().resume();
        board.run_for(Nanos::from_millis(300)).unwrap();
        let received = read_all(board);
        let missed = missing(&sent_by_arm, &received);
        assert_eq!(missed.iter().sum::<usize>(), counters(board).dropped_bytes as usize);
        same_bytes("the arm", &board.with_arm(RawArm::take_received), &sent_by_host);
        exchange_some(board, 3);
    });
}

#[test]
fn reopened_port_delivers_only_later_bytes() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        exchange_some(board, 0);
        board.usb().set_control_lines(false, false).unwrap();
        board.with_arm(|arm| arm.send(b"sent while closed"));
        board.run_for(Nanos::from_millis(50)).unwrap();
        board.usb().set_control_lines(true, true).unwrap();
        assert_eq!(read_all(board), b"");
        assert_eq!(counters(board).undelivered_bytes, 17);
        exchange_some(board, 1);
    });
}

#[test]
fn next_program_receives_no_earlier_bytes() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        exchange_some(board, 0);
        // Less than a packet, one, two and more: one lies in the endpoint, one waits for it.
        for (nth, len) in [17, 64, 128, 300].into_iter().enumerate() {
            let before = counters(board).undelivered_bytes;
            board.usb().set_reading(false);
            board.with_arm(|arm| arm.send(&noise(nth as u64, len)));
            board.run_for(Nanos::from_millis(50)).unwrap();
            board.usb().set_control_lines(false, false).unwrap();
            board.run_for(Nanos::from_millis(10_000)).unwrap();
            board.usb().set_control_lines(true, true).unwrap();
            board.usb().set_reading(true);
            assert_eq!(read_all(board), b"", "of {len} bytes");
            assert_eq!(counters(board).undelivered_bytes - before, len as u32);
            exchange_some(board, nth as u64);
        }
    });
}

#[test]
fn bytes_are_received_or_counted_across_reopening() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let sent_by_arm = noise(1, 60_000);
        board.with_arm(|arm| arm.send(&sent_by_arm));
        // The phase within a packet differs each time.
        for nth in 0..200 {
            board.run_for(Nanos((2_000 + 37 * nth % 1_300) * 1_000)).unwrap();
            board.usb().set_control_lines(nth % 2 == 1, true).unwrap();
        }
        let received = read_all(board);
        let missed: usize = missing(&sent_by_arm, &received).iter().sum();
        let counters = counters(board);
        assert_eq!(received.len() + missed, sent_by_arm.len());
        assert_eq!(missed, (counters.undelivered_bytes + counters.dropped_bytes) as usize);
        assert!(counters.undelivered_bytes > 1_000 && received.len() > 1_000);
        exchange_some(board, 1);
    });
}

#[test]
fn answer_at_any_moment_of_reopening_is_accounted_for() {
    const TIMES: u64 = 500;
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let frame = encoded(|bytes| Ling.encode_response(&Response::Stroke(Stroke::Mm50), None, bytes));
        let on_line = frame.len() as u64 * byte_time(MEGABAUD).0;
        let mut received = 0;
        for nth in 0..TIMES {
            // It ends up to 62 µs after the request to the port begins, in steps of 250 ns.
            board.with_arm(|arm| arm.send(&frame));
            board.run_for(Nanos(on_line - nth / 2 * 250)).unwrap();
            board.usb().set_control_lines(nth % 2 == 1, true).unwrap();
            received += read_all(board).len();
        }
        let counters = counters(board);
        assert_eq!(
            received + counters.undelivered_bytes as usize,
            TIMES as usize * frame.len()
        );
        assert!(received > 1_000 && counters.undelivered_bytes > 1_000);
    });
}

#[test]
fn port_may_be_closed_at_any_moment_of_a_packet() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let frame = encoded(|bytes| Ling.encode_response(&Response::Stroke(Stroke::Mm50), None, bytes));
        let on_line = frame.len() as u64 * byte_time(MEGABAUD).0;
        for nth in 0..1_000 {
            // It ends up to 20 µs after the request to the port begins, in steps of 20 ns.
            board.with_arm(|arm| arm.send(&frame));
            board.run_for(Nanos(on_line - nth * 20)).unwrap();
            board.usb().set_control_lines(false, true).unwrap();
            read_all(board);
            board.usb().set_control_lines(true, true).unwrap();
            board.with_arm(|arm| arm.send(&frame));
            assert_eq!(read_all(board), frame, "{nth}");
        }
    });
}

#[test]
fn arm_is_readable_after_every_cable_event() {
    on_board(LingArm::new(armwire_sim::ling::Config::follower()), |board| {
        let mut program = Program::default();
        plug_in(board, MEGABAUD);
        let mut read = |board: &mut VirtualBoard<LingArm>| {
            let answer = program.call(board, Request::ReadJoints);
            assert!(matches!(answer, Some(Response::Joints(_))), "{answer:?}");
        };
        read(board);
        board.usb().detach();
        board.run_for(Nanos::from_millis(100)).unwrap();
        plug_in(board, MEGABAUD);
        read(board);
        board.usb().reset_bus();
        open(board, MEGABAUD);
        read(board);
        board.usb().suspend();
        board.run_for(Nanos::from_millis(100)).unwrap();
        board.usb().resume();
        board.run_for(Nanos::from_millis(30)).unwrap();
        read(board);
        let requested = board
            .uart()
            .bytes()
            .iter()
            .filter(|byte| byte.direction == LineDirection::ToArm)
            .count();
        assert_eq!(requested, 4 * 7, "each was requested once");
    });
}
