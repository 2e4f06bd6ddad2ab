//! The board that the image is for, as listed in `armwire-boards`: its crystal and its pins.

use std::collections::BTreeSet;

use armwire_boards::{Board, Pin, Port};
use armwire_bridge::can::{Function, Node};
use armwire_bridge::config::{self, Config, Poll};
use armwire_bridge::control::{Reply, Request};
use armwire_host_tests::image::{
    BIT_RATE, Control, MEGABAUD, RawArm, board_config, chip, exchange, facts, on_board_with, path, plug_in,
};
use armwire_sim::ling::{self, LingArm};
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Chip, Nanos, VirtualBoard};

/// Distance of two ports of an STM32, and their registers (RM0090 8.4, RM0440 9.4).
const PORT: u64 = 0x400;
const MODER: u64 = 0x00;
const ODR: u64 = 0x14;
const AFRL: u64 = 0x20;
/// Values of a pin in MODER.
const INPUT: u32 = 0b00;
const OUTPUT: u32 = 0b01;
const ALTERNATE: u32 = 0b10;
/// The alternate function of CAN.
const CAN: u32 = 9;

/// Ports of an STM32: GPIOA to GPIOG.
const PORTS: u64 = 7;
const PINS: u64 = 16;

/// The pins of an RP2040, and their registers (2.19.6.1).
const GP_PINS: u64 = 30;
const GP_STATUS: u64 = 0x4001_4000;
const GP_CONTROL: u64 = 0x4001_4004;
const GP_REGISTERS: u64 = 8;
/// OUTTOPAD in GP_STATUS.
const GP_LEVEL: u32 = 9;
/// FUNCSEL in GP_CONTROL: the function of the processor, and none.
const GP_FUNCTION: u32 = 0x1F;
const GP_SIO: u32 = 5;
const GP_NONE: u32 = 0x1F;

/// The pins of USB: PA11 and PA12, which the STM32G431 connects without an alternate function. Those of the RP2040 have no
/// other use.
fn usb_pins() -> &'static [Pin] {
    match chip() {
        Chip::Rp2040 => &[],
        _ => &[Pin(Port::A, 11), Pin(Port::A, 12)],
    }
}

const fn millis(millis: u64) -> Nanos {
    Nanos::from_millis(millis)
}

/// The image's board, by the name of the file.
fn this() -> &'static Board {
    let file = path();
    let name = file.file_stem().unwrap().to_str().unwrap();
    let name = name.strip_prefix("armwire-").expect("a file of `cargo fw`");
    Board::find(name).expect("a board of the list")
}

/// Runs a test on the image's board.
fn on_this<A: Arm, R>(arm: A, test: impl FnOnce(&mut VirtualBoard<A>, &'static Board) -> R) -> R {
    let this = this();
    on_board_with(board_config(arm).on(this), |board| test(board, this))
}

/// A register of a pin's port.
fn register(Pin(port, _): Pin, register: u64) -> u64 {
    facts(chip()).registers().gpioa + port as u64 * PORT + register
}

/// The mode of each pin of the chip, by port and number.
fn modes<A: Arm>(board: &mut VirtualBoard<A>) -> Vec<u32> {
    if chip() == Chip::Rp2040 {
        let pins = (0..GP_PINS).map(|pin| board.read_word(GP_CONTROL + pin * GP_REGISTERS).unwrap());
        return pins
            .map(|control| match control & GP_FUNCTION {
                GP_NONE => INPUT,
                GP_SIO => OUTPUT,
                _ => ALTERNATE,
            })
            .collect();
    }
    let ports = (0..PORTS).map(|port| facts(chip()).registers().gpioa + port * PORT + MODER);
    ports
        .flat_map(|moder| {
            let moder = board.read_word(moder).unwrap();
            (0..PINS).map(move |pin| moder >> (2 * pin) & 0b11)
        })
        .collect()
}

/// The place of a pin in [`modes`].
fn place(Pin(port, number): Pin) -> usize {
    match port {
        Port::Gp => number.into(),
        port => port as usize * PINS as usize + usize::from(number),
    }
}

/// The pins of CAN, if the board has it.
fn can_pins(board: &Board) -> impl Iterator<Item = Pin> {
    board.can.into_iter().flat_map(|pins| [pins.rx, pins.tx])
}

fn is_high<A: Arm>(board: &mut VirtualBoard<A>, pin: Pin) -> bool {
    let (register, bit) = match pin {
        Pin(Port::Gp, number) => (GP_STATUS + u64::from(number) * GP_REGISTERS, GP_LEVEL),
        Pin(_, number) => (register(pin, ODR), number.into()),
    };
    board.read_word(register).unwrap() >> bit & 1 != 0
}

#[test]
fn identity_has_the_name_of_the_board() {
    on_this(RawArm::default(), |board, this| {
        plug_in(board, MEGABAUD);
        let reply = Control::open(board).call(board, Request::Identify);
        let Reply::Identity(identity) = reply else {
            panic!("{reply:?}");
        };
        assert_eq!(identity.board, this.name);
    });
}

#[test]
fn image_takes_only_the_pins_of_its_board() {
    on_this(RawArm::default(), |board, this| {
        let at_reset = modes(board);
        let mut taken = BTreeSet::new();
        let mut look = |board: &mut VirtualBoard<RawArm>| {
            let modes = modes(board);
            let changed = (0..modes.len()).filter(|&pin| modes[pin] != at_reset[pin]);
            taken.extend(changed.filter(|&pin| matches!(modes[pin], OUTPUT | ALTERNATE)));
        };
        for _ in 0..250 {
            board.run_for(Nanos(80_000)).unwrap();
            look(board);
        }
        plug_in(board, MEGABAUD);
        if facts(chip()).can {
            board.can().attach(BIT_RATE);
        }
        exchange(board, &[1, 2, 3, 4], &[5, 6, 7, 8]);
        for _ in 0..100 {
            board.run_for(millis(10)).unwrap();
            look(board);
        }
        for pin in usb_pins() {
            taken.remove(&place(*pin));
        }
        let line = [this.uart.tx(), this.uart.rx()];
        let expected = line.into_iter().chain(can_pins(this)).chain([this.led.pin]);
        assert_eq!(taken, expected.map(place).collect());
    });
}

#[test]
fn led_flashes_each_second_without_a_host() {
    on_this(RawArm::default(), |board, this| {
        const STEP_MS: u64 = 5;
        board.run_for(millis(500)).unwrap();
        assert_eq!(modes(board)[place(this.led.pin)], OUTPUT);
        let mut lit = 0;
        for _ in (0..4_000).step_by(STEP_MS as usize) {
            board.run_for(millis(STEP_MS)).unwrap();
            lit += u64::from(is_high(board, this.led.pin) == this.led.on) * STEP_MS;
        }
        assert_eq!(lit, 4 * 50, "milliseconds with the LED on, in 4 s");
        plug_in(board, MEGABAUD);
        board.run_for(millis(200)).unwrap();
        assert_eq!(is_high(board, this.led.pin), this.led.on, "with a host");
    });
}

#[test]
fn telemetry_leaves_at_the_pins_of_can() {
    on_this(LingArm::new(ling::Config::follower()), |board, this| {
        plug_in(board, MEGABAUD);
        board.can().attach(BIT_RATE);
        let telemetry = Config {
            poll: Poll::Hertz(100),
            can: config::Can {
                telemetry_hz: 100,
                ..config::Can::default()
            },
            ..Config::default()
        };
        Control::open(board).order(board, Request::SetConfig(telemetry));
        board.run_for(millis(100)).unwrap();
        board.can().read();
        board.run_for(millis(1_000)).unwrap();
        let id = Function::JointsA.id(Node::default());
        let joints = board.can().read().iter().filter(|frame| frame.id() == id).count();
        assert!((99..=101).contains(&joints), "{joints} in a second");
        for pin in can_pins(this) {
            assert_eq!(modes(board)[place(pin)], ALTERNATE, "{pin}");
            let (half, nibble) = (u64::from(pin.1 / 8), 4 * (pin.1 % 8));
            let function = board.read_word(register(pin, AFRL + 4 * half)).unwrap() >> nibble & 0xF;
            assert_eq!(function, CAN, "{pin}");
        }
    });
}
