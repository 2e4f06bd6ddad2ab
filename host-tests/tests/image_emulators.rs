//! The image for the STM32F405 on the emulator library and on our own core: the same bytes and frames, and how much time
//! each takes.

use std::fs;

use armwire::Micros;
use armwire_bridge::can::{Frame, Id};
use armwire_bridge::config::Config;
use armwire_host_tests::image::{
    MEGABAUD, Talker, Witness, chip, exchange, noise, on_board_with, path, plug_in, polled, session_on,
};
use armwire_virtual_board::line::{Direction, Outcome};
use armwire_virtual_board::{Chip, Config as BoardConfig, Emulator, Nanos, VirtualBoard};

const EMULATORS: [Emulator; 2] = [Emulator::Library, Emulator::Own];

/// Bits per second on the CAN bus.
const RATE: u32 = 1_000_000;

fn on<A>(emulator: Emulator, arm: A) -> BoardConfig<A> {
    BoardConfig {
        emulator,
        ..BoardConfig::new(path(), arm)
    }
}

/// The bytes that crossed the line in a direction, with what became of them.
fn line(board: &VirtualBoard<impl armwire_virtual_board::Arm>, direction: Direction) -> Vec<(u8, Outcome)> {
    let bytes = board.uart().bytes();
    bytes
        .iter()
        .filter(|byte| byte.direction == direction)
        .map(|byte| (byte.sent, byte.outcome))
        .collect()
}

/// Whether the image is for the chip that both can run.
fn is_for_both() -> bool {
    chip() == Chip::Stm32f405
}

#[test]
fn both_emulators_give_the_same_bytes() {
    if !is_for_both() {
        return;
    }
    let [library, own] = EMULATORS.map(|emulator| {
        on_board_with(on(emulator, Talker::default()), |board| {
            plug_in(board, MEGABAUD);
            exchange(board, &noise(1, 20_000), &noise(2, 20_000));
            let control: Vec<Vec<u8>> = board
                .usb()
                .packets()
                .iter()
                .filter(|packet| packet.endpoint == 0)
                .map(|packet| packet.data.clone())
                .collect();
            (
                line(board, Direction::ToArm),
                line(board, Direction::ToBoard),
                control,
            )
        })
    });
    assert_eq!(library.0.len(), 20_000);
    assert!(library == own);
}

#[test]
fn both_emulators_give_the_same_frames() {
    if !is_for_both() {
        return;
    }
    let [library, own] = EMULATORS.map(|emulator| {
        let arm = Witness::new(Micros(100));
        session_on(on(emulator, arm), Config::default(), |session| {
            session.hosts.usb = None;
            session.board.can().forget_frames();
            session.board.uart().forget_bytes();
            while session.hosts.can.as_ref().unwrap().asking.answered < 200 {
                session.hosts.run_for(session.board, Nanos::from_millis(1));
            }
            let frames = session.board.can().frames();
            let frames: Vec<_> = frames.iter().map(|frame| (frame.frame, frame.outcome)).collect();
            let heard = line(session.board, Direction::ToArm);
            session.finish();
            (frames[..1_000].to_vec(), heard[..2_000].to_vec())
        })
    });
    assert!(library == own);
}

/// Processor time that this process has used, in seconds.
fn processor_time() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap();
    let (_, fields) = stat.rsplit_once(')').unwrap();
    let ticks = |nth: usize| fields.split_whitespace().nth(nth).unwrap().parse::<f64>().unwrap();
    (ticks(11) + ticks(12)) / 100.0
}

/// Seconds of virtual time for a second of processor time.
fn speed<A: armwire_virtual_board::Arm>(
    board: &mut VirtualBoard<A>,
    run: impl FnOnce(&mut VirtualBoard<A>),
) -> f64 {
    let (start, began) = (board.now(), processor_time());
    run(board);
    board.now().since(start).0 as f64 / 1e9 / (processor_time() - began).max(0.01)
}

fn idle(emulator: Emulator) -> f64 {
    on_board_with(on(emulator, Talker::default()), |board| {
        plug_in(board, MEGABAUD);
        speed(board, |board| board.run_for(Nanos::from_millis(20_000)).unwrap())
    })
}

/// The arm is polled, and nobody else is there.
fn polls(emulator: Emulator, hertz: u16) -> f64 {
    let arm = Witness::new(Micros(100));
    session_on(on(emulator, arm), polled(hertz), |session| {
        session.hosts.usb = None;
        session.hosts.can = None;
        let hosts = &mut session.hosts;
        speed(session.board, |board| hosts.run_for(board, Nanos::from_millis(5_000)))
    })
}

/// Everybody asks, and the arm is polled.
fn everybody(emulator: Emulator) -> f64 {
    let arm = Witness::new(Micros(100));
    session_on(on(emulator, arm), polled(200), |session| {
        let hosts = &mut session.hosts;
        let speed = speed(session.board, |board| hosts.run_for(board, Nanos::from_millis(2_000)));
        session.finish();
        speed
    })
}

/// Bytes without a pause both ways, and a CAN bus that is full.
fn full(emulator: Emulator, can: bool) -> f64 {
    on_board_with(on(emulator, Talker::default()), |board| {
        plug_in(board, MEGABAUD);
        board.can().attach(RATE);
        if can {
            let frame = Frame::new(Id::new(0x7FF).unwrap(), &[0x55; 8]).unwrap();
            board.can().flood(Some(&frame)).unwrap();
        }
        let bytes = noise(3, 150_000);
        board.with_arm(|arm| arm.say(&bytes));
        board.usb().write(&bytes).unwrap();
        speed(board, |board| {
            for _ in 0..100 {
                board.run_for(Nanos::from_millis(10)).unwrap();
                board.usb().read();
            }
        })
    })
}

#[test]
#[ignore = "it prints the speed of both"]
fn the_speed_of_both_emulators() {
    if !is_for_both() {
        return;
    }
    let scenes: [(&str, &dyn Fn(Emulator) -> f64); 6] = [
        ("idle", &idle),
        ("polls at 200 Hz", &|emulator| polls(emulator, 200)),
        ("polls at 400 Hz", &|emulator| polls(emulator, 400)),
        ("everybody, polls at 200 Hz", &everybody),
        ("1 Mbaud both ways", &|emulator| full(emulator, false)),
        ("1 Mbaud both ways, CAN full", &|emulator| full(emulator, true)),
    ];
    for (name, scene) in scenes {
        let [library, own] = EMULATORS.map(scene);
        println!(
            "{name}: library {library:.2} times real time, own {own:.2}, ratio {:.1}",
            own / library
        );
    }
}
