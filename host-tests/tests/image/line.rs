//! Errors on the arm's line, and other rates.

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{JOINTS, JointState, Ling, MAX_FRAME, MotionStatus, Response};
use armwire::messages::Messages;
use armwire_bridge::{Counters, Duration, Instant};
use armwire_host_tests::image::requests::encoded;
use armwire_host_tests::image::{
    MEGABAUD, RawArm, as_received, board_config, byte_time, chip, counters, exchange, facts, noise, on_board,
    on_board_with, plug_in, read_all, same_bytes,
};
use armwire_virtual_board::line::{Fault, FaultRates, LineByte, Outcome, Parity};
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::{Config, Nanos, Reenabled, VirtualBoard};

/// Longer than a line coding takes to come into effect.
const RATE_SETTLES: Nanos = Nanos::from_millis(110);

/// Runs `test` with a DMA that restarts and with one that resumes.
fn with_either_dma(test: impl Fn(&mut VirtualBoard<RawArm>)) {
    let variants = [Reenabled::Restarts, Reenabled::Resumes];
    for reenabled in facts(chip()).variants(variants) {
        println!("a stream that is enabled again: {reenabled:?}");
        let mut config = board_config(RawArm::default());
        config.reenabled = reenabled;
        config.seed = 7;
        on_board_with(config, |board| {
            plug_in(board, MEGABAUD);
            test(board);
        });
    }
}

/// The joints answer that carries `nth`.
fn frame(nth: u16) -> Vec<u8> {
    let state = JointState {
        joints: [nth % 4_096; JOINTS],
        gripper: nth / 4_096,
        status: MotionStatus::Idle,
    };
    encoded(|bytes| Ling.encode_response(&Response::Joints(state), None, bytes))
}

/// The numbers of the frames in `bytes`.
fn frames(bytes: &[u8]) -> Vec<u16> {
    let mut decoder = Decoder::<_, MAX_FRAME>::new();
    let mut numbers = Vec::new();
    let mut rest = bytes;
    loop {
        rest = decoder.push(rest);
        while let Some(item) = decoder.next(&Ling, ()) {
            if item.kind == Kind::Frame
                && let Ok(Response::Joints(state)) = Ling.parse_response(item.bytes, ())
            {
                numbers.push(state.joints[0] + 4_096 * state.gripper);
            }
        }
        if rest.is_empty() {
            return numbers;
        }
    }
}

/// Sends numbered frames from the arm, with `fault` at each position of the second one. All bytes but the faulty one
/// must arrive, hence every frame but the second, and the error must be counted once.
fn one_fault(board: &mut VirtualBoard<RawArm>, fault: Fault, counted: fn(&Counters) -> u32) {
    const FRAMES: u16 = 4;
    const BAD: u16 = 1;
    let length = frame(0).len() as u64;
    // With a pause after each frame, and without.
    for pause in [Instant::ZERO, Instant::from_micros(300)] {
        // A byte is lost to an overrun only right after another.
        let first = u64::from(fault == Fault::Overrun && pause > Instant::ZERO);
        for place in first..length {
            board.uart().forget_bytes();
            let before = counted(&counters(board));
            board.uart().plan_fault(length * u64::from(BAD) + place, fault);
            for nth in 0..FRAMES {
                board.with_arm(|arm| arm.send(&frame(nth)));
                board.run_for(pause).unwrap();
            }
            let received = read_all(board);
            same_bytes("the host", &received, &as_received(&board.uart().bytes()));
            let mut numbers = frames(&received);
            numbers.retain(|&nth| nth != BAD);
            assert_eq!(numbers, [0, 2, 3], "byte {place}, {pause:?} after a frame");
            let errors = counted(&counters(board)) - before;
            assert_eq!(errors, 1, "byte {place}, {pause:?} after a frame");
        }
    }
}

#[test]
fn framing_error_is_counted_and_next_frame_arrives() {
    with_either_dma(|board| one_fault(board, Fault::Framing, |c| c.framing_errors));
}

#[test]
fn noise_is_counted_and_every_frame_arrives() {
    with_either_dma(|board| one_fault(board, Fault::Noise, |c| c.noise_errors));
}

#[test]
fn break_is_counted_and_next_frame_arrives() {
    with_either_dma(|board| one_fault(board, Fault::Break, |c| c.framing_errors));
}

#[test]
fn overrun_is_counted_and_next_frame_arrives() {
    with_either_dma(|board| one_fault(board, Fault::Overrun, |c| c.overrun_errors));
}

#[test]
fn constant_line_errors_lose_only_affected_frames() {
    with_either_dma(|board| {
        board.uart().set_fault_rates(FaultRates {
            framing: 3_000,
            noise: 3_000,
            line_break: 3_000,
            overrun: 3_000,
        });
        let (up, down) = (noise(1, 50_000), noise(2, 50_000));
        board.with_arm(|arm| arm.send(&up));
        board.usb().write(&down).unwrap();
        let received = read_all(board);
        // The RP2040 takes longer for the bytes to the arm.
        board.run_for(Nanos::from_millis(50)).unwrap();
        same_bytes("the host", &received, &as_received(&board.uart().bytes()));
        same_bytes("the arm", &board.with_arm(RawArm::take_received), &down);

        let line = board.uart().bytes();
        let injected = |faults: &[Fault]| {
            if faults == [Fault::Noise] && !facts(chip()).reports_noise {
                return 0;
            }
            let hit = |byte: &&LineByte| faults.iter().any(|&fault| byte.outcome == Outcome::Faulty(fault));
            line.iter().filter(hit).count()
        };
        let counters = counters(board);
        for (name, counted, injected) in [
            (
                "framing errors",
                counters.framing_errors,
                injected(&[Fault::Framing, Fault::Break]),
            ),
            ("noise", counters.noise_errors, injected(&[Fault::Noise])),
            ("overruns", counters.overrun_errors, injected(&[Fault::Overrun])),
        ] {
            println!("{counted} {name} counted of {injected} in 50000 bytes");
        }
        assert_eq!(
            counters.framing_errors as usize,
            injected(&[Fault::Framing, Fault::Break])
        );
        assert_eq!(counters.noise_errors as usize, injected(&[Fault::Noise]));
        // The UART has one flag for all bytes lost before the next read by the DMA.
        let overruns = injected(&[Fault::Overrun]);
        assert!((overruns - 5..=overruns).contains(&(counters.overrun_errors as usize)));
        assert_eq!(counters.ring_overruns, 0);

        board.uart().set_fault_rates(FaultRates::default());
        exchange(board, &noise(3, 5_000), &noise(4, 5_000));
    });
}

#[test]
fn errors_in_many_bytes_are_counted_individually() {
    const BYTES: u32 = 500;
    with_either_dma(|board| {
        for fault in [Fault::Framing, Fault::Noise] {
            let before = counters(board);
            let rate = |of| if fault == of { 1_000_000 } else { 0 };
            board.uart().set_fault_rates(FaultRates {
                framing: rate(Fault::Framing),
                noise: rate(Fault::Noise),
                ..FaultRates::default()
            });
            board.with_arm(|arm| arm.send(&noise(3, BYTES as usize)));
            let received = read_all(board);
            same_bytes("the host", &received, &as_received(&board.uart().bytes()));
            board.uart().forget_bytes();
            let after = counters(board);
            let counted = [
                after.framing_errors - before.framing_errors,
                after.noise_errors - before.noise_errors,
                after.overrun_errors - before.overrun_errors,
            ];
            let expected = [rate(Fault::Framing), rate(Fault::Noise), 0].map(|rate| rate / 1_000_000 * BYTES);
            assert_eq!(counted, expected);
        }
    });
}

#[test]
fn parity_errors_are_counted_individually() {
    const BYTES: usize = 10_000;
    let even = LineCoding {
        parity: 2,
        ..LineCoding::new(MEGABAUD)
    };
    // Each third byte has the error, and some that follow it.
    let faulty: Vec<u64> = (0..BYTES as u64).filter(|nth| nth % 3 == 0 || nth % 10 == 1).collect();
    for exact_cycles in [false, true] {
        let config = Config {
            exact_cycles,
            ..board_config(RawArm::default())
        };
        on_board_with(config, |board| {
            plug_in(board, MEGABAUD);
            board.usb().set_line_coding(even).unwrap();
            board.run_for(RATE_SETTLES).unwrap();
            let format = board.uart().format();
            assert_eq!(format.parity, Parity::Even);
            board.uart().set_arm_format(format);
            // The instants of the two sides' bytes pass each other in steps of 33 ns.
            board.uart().set_arm_baud(1_003_000);
            let up = noise(1, BYTES);
            for down in [noise(2, BYTES), Vec::new()] {
                let before = counters(board).parity_errors;
                for &nth in &faulty {
                    board.uart().plan_fault(nth, Fault::Parity);
                }
                board.with_arm(|arm| arm.send(&up));
                board.usb().write(&down).unwrap();
                same_bytes("the host", &read_all(board), &up);
                same_bytes("the arm", &board.with_arm(RawArm::take_received), &down);
                let counted = counters(board).parity_errors - before;
                assert_eq!(counted as usize, faulty.len(), "{} bytes to the arm", down.len());
            }
        });
    }
}

#[test]
fn constant_breaks_do_not_stop_host_side() {
    with_either_dma(|board| {
        board.uart().set_fault_rates(FaultRates {
            line_break: 1_000_000,
            ..FaultRates::default()
        });
        let down = noise(1, 5_000);
        board.with_arm(|arm| arm.send(&[0; 20_000]));
        board.usb().write(&down).unwrap();
        read_all(board);
        same_bytes("the arm", &board.with_arm(RawArm::take_received), &down);
        board.uart().set_fault_rates(FaultRates::default());
        exchange(board, &noise(2, 5_000), &noise(3, 5_000));
    });
}

/// Changes the rate of the port, and of the arm's line as soon as the adapter has.
fn change_rate(board: &mut VirtualBoard<RawArm>, baud: u32) {
    board.usb().set_line_coding(LineCoding::new(baud)).unwrap();
    follow_rate(board, baud);
}

fn follow_rate(board: &mut VirtualBoard<RawArm>, baud: u32) {
    for _ in 0..100_000 {
        let actual = board.uart().baud().unwrap();
        if actual.abs_diff(baud.into()) * 100 < u64::from(baud) {
            board.uart().set_arm_baud(baud);
            // The change of the rate disables the UART for some microseconds. The arm has no request and is silent.
            board.run_for(Duration::from_micros(50)).unwrap();
            return;
        }
        board.run_for(Duration::from_micros(5)).unwrap();
    }
    panic!(
        "the UART did not come to {baud} baud, it runs at {:?}",
        board.uart().baud()
    );
}

#[test]
fn rate_changes_between_any_two_rates() {
    const RATES: [u32; 7] = [115_200, MEGABAUD, 2_000_000, MEGABAUD, 115_200, 2_000_000, 115_200];
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        for (nth, baud) in RATES.into_iter().enumerate() {
            change_rate(board, baud);
            exchange(board, &noise(nth as u64, 3_000), &noise(100 + nth as u64, 3_000));
        }
        assert_eq!(counters(board).framing_errors, 0);
    });
}

#[test]
fn bytes_before_rate_change_use_old_rate() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let mut old = MEGABAUD;
        for (nth, baud) in [115_200, 2_000_000, MEGABAUD, 115_200].into_iter().enumerate() {
            let before = noise(nth as u64, 300);
            board.usb().write(&before).unwrap();
            board
                .run_until(Duration::from_millis(50), |board| board.usb().unsent() == 0)
                .unwrap();
            board.usb().set_line_coding(LineCoding::new(baud)).unwrap();
            follow_rate(board, baud);
            same_bytes("the arm", &board.with_arm(RawArm::take_received), &before);
            println!("{old} -> {baud} baud");
            exchange(board, &noise(10 + nth as u64, 1_000), &noise(20 + nth as u64, 1_000));
            old = baud;
        }
    });
}

/// The byte may arrive while the adapter waits for the line to be quiet at the old rate.
#[test]
fn byte_right_before_rate_change_arrives_without_another() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let mut before_change = 0;
        for nth in 0..24 {
            change_rate(board, 9_600);
            board.usb().set_line_coding(LineCoding::new(MEGABAUD)).unwrap();
            board.run_for(Nanos(100_000 * nth)).unwrap();
            board.uart().forget_bytes();
            board.with_arm(|arm| arm.send(&[0x55]));
            follow_rate(board, MEGABAUD);
            let changed = board.now();
            let received = read_all(board);
            let line = board.uart().bytes();
            // One that is cut by the change, or that comes later, is arbitrary.
            let is_before = |byte: &LineByte| byte.outcome == Outcome::Arrived && byte.at + Nanos(100_000) < changed;
            if line.first().is_some_and(is_before) {
                same_bytes("the host", &received, &[0x55]);
                before_change += 1;
            }
        }
        assert!(before_change > 3, "{before_change}");
    });
}

#[test]
fn rate_change_during_arm_transmission_keeps_later_bytes() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let rates = [2_000_000, 115_200, MEGABAUD, 115_200].into_iter().cycle();
        for (baud, nth) in rates.zip(0..24) {
            board.with_arm(|arm| arm.send(&noise(nth, 3_000)));
            // The phase within a byte and a packet differs each time.
            board.run_for(Nanos(3_000_000 + 1_370 * nth)).unwrap();
            change_rate(board, baud);
            // Bytes received while the rates differed are arbitrary. Up to a full packet of them waits.
            board.run_for(Nanos(1_000_000 + 100 * byte_time(baud).0)).unwrap();
            board.usb().read();
            let received = read_all(board);
            let line = board.uart().bytes();
            let rest: Vec<u8> = line[line.len() - received.len()..]
                .iter()
                .map(|byte| byte.sent)
                .collect();
            same_bytes("the host", &received, &rest);
            exchange(board, &noise(100 + nth, 1_000), &noise(200 + nth, 1_000));
        }
    });
}

/// The change is small enough for either end to receive at the other's rate: no byte is garbled by that.
#[test]
fn byte_in_reception_is_not_garbled_by_a_line_change() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        for nth in 0..24 {
            board.uart().forget_bytes();
            board.with_arm(|arm| arm.send(&noise(nth, 3_000)));
            // The phase within a byte differs each time.
            board.run_for(Nanos(3_000_000 + 1_370 * nth)).unwrap();
            let baud = if nth % 2 == 0 { 1_010_000 } else { MEGABAUD };
            board.usb().set_line_coding(LineCoding::new(baud)).unwrap();
            let received = read_all(board);
            let line = board.uart().bytes();
            same_bytes("the host", &received, &as_received(&line));
            let lost = line.iter().filter(|byte| byte.outcome == Outcome::Lost).count();
            assert!(lost <= 4, "{lost} bytes lost at change {nth}");
        }
        assert_eq!(counters(board).framing_errors, 0);
    });
}
