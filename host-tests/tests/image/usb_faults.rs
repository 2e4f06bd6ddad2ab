//! Misbehaving USB hosts: abandoned requests, resets within a request, halted endpoints, repeated configuration.

use armwire_bridge::Counters;
use armwire_host_tests::image::{
    MEGABAUD, RawArm, board_config, chip, counters, exchange, facts, noise, on_board_with, open, plug_in, read_all,
    same_bytes,
};
use armwire_virtual_board::usb::Direction;
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::usb::host::Request;
use armwire_virtual_board::{Chip, Config, Nanos, OtgVariant, Timing, VirtualBoard};

type Board = VirtualBoard<RawArm>;

/// Time limit for the adapter's next answer.
const READY: Nanos = Nanos::from_millis(100);

/// Runs a test on a board with a fast USB controller, and on one with a slow controller of the other variant.
fn on_either_board(test: impl Fn(&mut Board)) {
    let other = OtgVariant {
        disables_out_endpoints: true,
        keeps_setup_count: true,
    };
    let variants = [(Timing::Typical, OtgVariant::default()), (Timing::Worst, other)];
    for (timing, otg) in facts(chip()).variants(variants) {
        let config = Config {
            timing,
            otg,
            ..board_config(RawArm::default())
        };
        on_board_with(config, &test);
    }
}

fn get_line_coding() -> Request {
    Request::read(0xA1, 0x21, 0, 0, 7)
}

/// For 1 000 000 baud.
fn set_line_coding() -> Request {
    Request::write(0x21, 0x20, 0, 0, vec![0x40, 0x42, 0x0F, 0x00, 0, 0, 8])
}

fn read_counters() -> Request {
    let (kind, request) = Counters::READ_REQUEST;
    Request::read(kind, request, 0, 0, Counters::MAX_LEN as u16)
}

/// Expects the answer to a request in time.
fn expect_answer(board: &mut Board, after: &str) {
    let before = board.now();
    let coding = board.usb().line_coding();
    assert_eq!(coding.ok().flatten(), Some(LineCoding::new(MEGABAUD)), "{after}");
    let took = board.now().since(before);
    assert!(took < READY, "{after}: answered after {took}");
}

/// Expects that a byte passes in each direction.
fn expect_exchange(board: &mut Board, byte: u8, after: &str) {
    board.with_arm(|arm| arm.send(&[byte]));
    board.usb().write(&[!byte]).unwrap();
    let mut received = (Vec::new(), Vec::new());
    let passed = board.run_until(READY, |board| {
        received.0.extend(board.usb().read());
        received.1.extend(board.with_arm(RawArm::take_received));
        !received.0.is_empty() && !received.1.is_empty()
    });
    assert!(passed.is_ok(), "{after}: {received:?}");
    assert_eq!(received, (vec![byte], vec![!byte]), "{after}");
}

fn may_be_abandoned(request: fn() -> Request) {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        for micros in 0..=400_u16 {
            let after = format!("abandoned after {micros} us");
            board
                .usb()
                .abandon(request(), Nanos(1_000 * u64::from(micros)))
                .unwrap();
            // The next request follows immediately, or when the adapter is idle.
            if micros % 2 == 1 {
                board.run_for(Nanos(300_000)).unwrap();
            }
            match micros / 2 % 3 {
                0 => expect_answer(board, &after),
                1 => board.usb().set_line_coding(LineCoding::new(MEGABAUD)).expect(&after),
                _ => drop(counters(board)),
            }
            expect_exchange(board, micros as u8, &after);
        }
        expect_answer(board, "at the end");
        assert_eq!(counters(board).refused_line_codings, 0);
    });
}

#[test]
fn seven_byte_read_may_be_abandoned_any_time() {
    may_be_abandoned(get_line_coding);
}

#[test]
fn write_may_be_abandoned_any_time() {
    may_be_abandoned(set_line_coding);
}

#[test]
fn multi_packet_read_may_be_abandoned_any_time() {
    may_be_abandoned(read_counters);
}

#[test]
fn abandoned_requests_leave_the_next_intact() {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        for micros in (1..60).step_by(3) {
            for request in [get_line_coding, set_line_coding, read_counters, set_line_coding] {
                board.usb().abandon(request(), Nanos(1_000 * micros)).unwrap();
            }
            expect_answer(board, &format!("abandoned after {micros} us, four times"));
        }
        expect_exchange(board, 7, "at the end");
    });
}

/// The adapter may be busy with the line from the end of a request to the data of the next one.
#[test]
fn write_right_after_read_is_answered_in_full_flow() {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        board.with_arm(|arm| arm.send(&noise(1, 60_000)));
        for nth in 0..1_000 {
            let after = format!("request {nth}");
            expect_answer(board, &after);
            board.usb().set_line_coding(LineCoding::new(MEGABAUD)).expect(&after);
            board.run_for(Nanos(1_000 * (nth % 97))).unwrap();
        }
    });
}

#[test]
fn bus_may_be_reset_during_a_request() {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        for micros in (5..80).step_by(15) {
            for request in [get_line_coding, set_line_coding, read_counters] {
                let after = format!("reset after {micros} us");
                board.usb().abandon(request(), Nanos(1_000 * micros)).unwrap();
                board.usb().reset_bus();
                board.run_for(Nanos::from_millis(20)).unwrap();
                open(board, MEGABAUD);
                expect_answer(board, &after);
                expect_exchange(board, 1, &after);
            }
        }
    });
}

#[test]
fn cable_may_be_unplugged_during_a_request() {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        for micros in (5..80).step_by(15) {
            for request in [get_line_coding, set_line_coding, read_counters] {
                let after = format!("unplugged after {micros} us");
                board.usb().abandon(request(), Nanos(1_000 * micros)).unwrap();
                board.usb().detach();
                board.run_for(Nanos::from_millis(50)).unwrap();
                plug_in(board, MEGABAUD);
                expect_answer(board, &after);
                expect_exchange(board, 1, &after);
            }
        }
    });
}

#[test]
fn bus_may_be_suspended_during_a_request() {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        for micros in (5..80).step_by(15) {
            for request in [get_line_coding, set_line_coding, read_counters] {
                let after = format!("suspended after {micros} us");
                let before = counters(board).usb_suspends;
                board.usb().abandon(request(), Nanos(1_000 * micros)).unwrap();
                board.usb().suspend();
                board.run_for(Nanos::from_millis(20)).unwrap();
                board.usb().resume();
                board.run_for(Nanos::from_millis(30)).unwrap();
                expect_answer(board, &after);
                expect_exchange(board, 1, &after);
                assert_eq!(counters(board).usb_suspends, before + 1, "{after}");
            }
        }
    });
}

/// Repeats `act`. The adapter answers the next request each time, and no byte is lost.
fn costs_no_byte(act: impl Fn(&mut Board)) {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        let mut seen = [[0; 2]; 2];
        for nth in 0..6 {
            for (way, direction) in [Direction::Out, Direction::In].into_iter().enumerate() {
                seen[way][usize::from(board.usb().toggle(direction).unwrap())] += 1;
            }
            act(board);
            expect_answer(board, "a request after it");
            for byte in 0..=nth {
                expect_exchange(board, byte, &format!("byte {byte} after the {nth}th time"));
            }
        }
        assert!(seen.iter().flatten().all(|&times| times > 0), "{seen:?}");
    });
}

#[test]
fn clearing_absent_halt_costs_no_byte() {
    costs_no_byte(|board| board.usb().clear_halt(Direction::In).unwrap());
    costs_no_byte(|board| board.usb().clear_halt(Direction::Out).unwrap());
}

#[test]
fn cleared_halt_costs_no_byte() {
    costs_no_byte(|board| {
        for direction in [Direction::In, Direction::Out] {
            board.usb().set_halt(direction).unwrap();
            board.run_for(Nanos::from_millis(2)).unwrap();
            board.usb().clear_halt(direction).unwrap();
        }
    });
}

#[test]
fn halt_lasts_until_host_clears_it() {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        for (nth, direction) in [Direction::In, Direction::Out, Direction::In].into_iter().enumerate() {
            let (up, down) = (noise(nth as u64, 200), noise(10 + nth as u64, 200));
            board.usb().set_halt(direction).unwrap();
            board.with_arm(|arm| arm.send(&up));
            board.usb().write(&down).unwrap();
            board.run_for(Nanos::from_millis(20)).unwrap();
            assert!(board.usb().is_halted(direction).unwrap());
            let (mut received, mut received_by_arm) = (board.usb().read(), board.with_arm(RawArm::take_received));
            match direction {
                Direction::In => same_bytes("the host", &received, &[]),
                Direction::Out => same_bytes("the arm", &received_by_arm, &[]),
            }
            board.usb().clear_halt(direction).unwrap();
            assert!(!board.usb().is_halted(direction).unwrap());
            received.extend(read_all(board));
            received_by_arm.extend(board.with_arm(RawArm::take_received));
            same_bytes("the host", &received, &up);
            same_bytes("the arm", &received_by_arm, &down);
        }
    });
}

#[test]
fn set_configuration_or_set_interface_ends_halt() {
    costs_no_byte(|board| {
        for direction in [Direction::In, Direction::Out] {
            board.usb().set_halt(direction).unwrap();
            board.usb().set_configuration(1).unwrap();
            assert!(!board.usb().is_halted(direction).unwrap());
            board.usb().set_halt(direction).unwrap();
            board.usb().set_interface().unwrap();
            assert!(!board.usb().is_halted(direction).unwrap());
        }
    });
}

#[test]
fn halt_of_missing_endpoint_costs_no_byte() {
    costs_no_byte(|board| {
        for endpoint in [0x04, 0x0F, 0x84, 0x8F] {
            for request in [1, 3] {
                let halt = Request::write(0x02, request, 0, endpoint, Vec::new());
                board.usb().control(halt).unwrap();
            }
            board.usb().control(Request::read(0x82, 0, 0, endpoint, 2)).unwrap();
        }
    });
}

#[test]
fn repeated_set_interface_costs_no_byte() {
    costs_no_byte(|board| board.usb().set_interface().unwrap());
}

#[test]
fn repeated_set_configuration_costs_no_byte() {
    costs_no_byte(|board| board.usb().set_configuration(1).unwrap());
}

#[test]
fn removed_and_restored_configuration_costs_no_byte() {
    costs_no_byte(|board| {
        board.usb().set_configuration(0).unwrap();
        board.usb().set_configuration(1).unwrap();
    });
}

#[test]
fn pending_bytes_survive_cleared_halt_or_set_interface() {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        for (nth, len) in [5, 64, 70, 200, 300].into_iter().enumerate() {
            let sent_by_arm = noise(nth as u64, len);
            board.usb().set_reading(false);
            board.with_arm(|arm| arm.send(&sent_by_arm));
            board.run_for(Nanos::from_millis(20)).unwrap();
            match nth % 2 {
                0 => board.usb().clear_halt(Direction::In).unwrap(),
                _ => board.usb().set_interface().unwrap(),
            }
            board.usb().set_reading(true);
            same_bytes("the host", &read_all(board), &sent_by_arm);
        }
    });
}

/// Repeats `act` while both sides send. Each byte of the host reaches the arm. Each byte of the arm reaches the host or
/// is counted as lost.
fn loses_nothing_uncounted(act: impl Fn(&mut Board, u64)) {
    on_either_board(|board| {
        plug_in(board, MEGABAUD);
        exchange(board, &noise(1, 500), &noise(2, 500));
        let before = counters(board);
        board.usb().forget_packets();
        let (sent_by_arm, sent_by_host) = (noise(3, 30_000), noise(4, 10_000));
        board.with_arm(|arm| arm.send(&sent_by_arm));
        for (nth, part) in sent_by_host.chunks(500).enumerate() {
            board.usb().write(part).unwrap();
            board.run_for(Nanos(2_000_000 + 137_000 * (nth as u64 % 9))).unwrap();
            act(board, nth as u64);
        }
        board.run_for(Nanos::from_millis(300)).unwrap();
        board.usb().read();
        let packets = board.usb().packets();
        let sent = |direction| -> Vec<u8> {
            let port = packets.iter().filter(|one| one.direction == direction);
            port.flat_map(|packet| packet.data.iter().copied()).collect()
        };
        same_bytes("the arm", &board.with_arm(RawArm::take_received), &sent(Direction::Out));
        let after = counters(board);
        let missed = after.undelivered_bytes + after.dropped_bytes - before.undelivered_bytes - before.dropped_bytes;
        let received = sent(Direction::In).len();
        assert_eq!(
            received + missed as usize,
            sent_by_arm.len(),
            "{received} received, {missed} counted"
        );
        assert!(received > 1_000, "{received}");
        assert_eq!(after.refused_bytes, before.refused_bytes);
        exchange(board, &noise(5, 500), &noise(6, 500));
    });
}

#[test]
fn set_configuration_in_flow_loses_nothing_uncounted() {
    loses_nothing_uncounted(|board, _| {
        board.usb().set_configuration(1).unwrap();
        board.usb().set_control_lines(true, true).unwrap();
    });
}

#[test]
fn cleared_halt_in_full_flow_loses_nothing() {
    loses_nothing_uncounted(|board, nth| {
        board
            .usb()
            .clear_halt([Direction::In, Direction::Out][nth as usize % 2])
            .unwrap();
    });
}

/// The SETUP packet lies in the FIFO of the STM32F405 behind another packet, as the interrupt handler runs: only its count
/// tells of it.
#[test]
fn request_behind_a_packet_is_taken() {
    if chip() == Chip::Rp2040 {
        return;
    }
    on_board_with(board_config(RawArm::default()), |board| {
        plug_in(board, MEGABAUD);
        expect_exchange(board, 1, "before");
        let packets = board.usb().packets();
        let serial = packets
            .iter()
            .rfind(|packet| packet.direction == Direction::In)
            .unwrap();
        let set_halt = Request::write(0x02, 0x03, 0, 0x80 | u16::from(serial.endpoint), Vec::new());
        board.hold_core();
        board.usb().write(b"x").unwrap();
        board.run_for(Nanos(100_000)).unwrap();
        board.usb().abandon(set_halt, Nanos(100_000)).unwrap();
        board.let_core_go();
        board.run_for(Nanos::from_millis(1)).unwrap();
        assert!(board.usb().is_halted(Direction::In).unwrap());
    });
}

#[test]
fn abandoned_requests_in_full_flow_lose_nothing() {
    loses_nothing_uncounted(|board, nth| {
        for request in [get_line_coding, set_line_coding, read_counters] {
            board.usb().abandon(request(), Nanos(1_000 * (nth * 7 % 97))).unwrap();
        }
        expect_answer(board, "in full flow");
    });
}

#[test]
fn bus_reset_in_full_flow_loses_nothing_uncounted() {
    loses_nothing_uncounted(|board, nth| {
        if nth % 5 == 4 {
            board.usb().reset_bus();
            board.run_for(Nanos::from_millis(20)).unwrap();
            open(board, MEGABAUD);
        }
    });
}
