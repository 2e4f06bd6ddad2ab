//! The board with small programs. The real image is tested elsewhere.

mod trace;

use std::collections::BTreeSet;

use armwire_bridge::can::{Frame, Id};
use armwire_bridge::{Duration, Instant};

use super::*;
use crate::can::{BusFrame, ErrorState, NodeConfig, Outcome, Sender};
use crate::report::{Cause, Crash, Restart, Violations};

/// A UART without an arm.
#[derive(Debug, Default)]
pub(crate) struct NoArm;

impl armwire_sim::serial::SerialDevice for NoArm {
    fn receive(&mut self, _: Instant, _: u8) {}

    fn transmit(&mut self, _: Instant) -> Option<u8> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

/// ldr r`register`, the literal `words` after the program counter, which is two instructions ahead, rounded down to a word
const fn ldr(register: u16, words: u16) -> u16 {
    0x4800 | register << 8 | words
}
/// str r`from`, [r`to`]
const fn str(from: u16, to: u16) -> u16 {
    0x6000 | to << 3 | from
}
/// ldr r`to`, [r`from`]
const fn load(to: u16, from: u16) -> u16 {
    0x6800 | from << 3 | to
}
/// b .
const HANG: u16 = 0xE7FE;
const NOP: u16 = 0xBF00;
const WFI: u16 = 0xBF30;
/// adds r0, #1, and a branch to the instruction before
const ADD: u16 = 0x3001;
const BACK: u16 = 0xE7FD;

/// A board whose flash holds a vector table, `code` and `literals`.
///
/// The code starts at 0x0800_0008; the literals follow it, aligned to words.
fn board(code: &[u16], literals: &[u32]) -> VirtualBoard<NoArm> {
    board_with(code, literals, |config| config)
}

fn board_with(
    code: &[u16],
    literals: &[u32],
    change: impl FnOnce(Config<NoArm>) -> Config<NoArm>,
) -> VirtualBoard<NoArm> {
    assert!(code.len().is_multiple_of(2), "literals are aligned");
    let mut flash = Vec::new();
    flash.extend(0x2000_1000u32.to_le_bytes());
    flash.extend(0x0800_0009u32.to_le_bytes());
    flash.extend(code.iter().flat_map(|half| half.to_le_bytes()));
    flash.extend(literals.iter().flat_map(|word| word.to_le_bytes()));
    let image = Image::plain(0x0800_0000, flash);
    VirtualBoard::start_image(image, change(Config::new("test", NoArm))).unwrap()
}

/// A board that enters its boot loader.
pub(crate) fn board_into_boot_loader() -> VirtualBoard<NoArm> {
    // Twenty instructions, then ldr r0, =the boot loader's reset vector; ldr r0, [r0]; bx r0.
    let mut code = vec![NOP; 20];
    code.extend([ldr(0, 1), load(0, 0), 0x4700, NOP]);
    board(&code, &[0x1FFF_0004])
}

#[test]
fn nothing_runs_before_a_call() {
    let board = board(&[HANG, NOP], &[]);
    assert_eq!(board.now(), Nanos(0));
}

#[test]
fn gdb_address_is_reported() {
    assert_eq!(board(&[HANG, NOP], &[]).gdb(), None);
    let board = board_with(&[HANG, NOP], &[], |config| Config { gdb: Some(0), ..config });
    let gdb = board.gdb().unwrap();
    assert!(gdb.ip().is_loopback() && gdb.port() != 0, "{gdb}");
}

#[test]
fn time_advances_by_the_requested_span() {
    let mut board = board(&[HANG, NOP], &[]);
    board.run_for(Duration::from_micros(1_234)).unwrap();
    assert!(board.now().since(Nanos(1_234_000)) < Nanos(10), "{}", board.now());
    board.check().unwrap();
}

#[test]
fn wait_without_the_event_times_out() {
    let mut board = board(&[HANG, NOP], &[]);
    let error = board.run_until(Duration::from_micros(2_500), |_| false).unwrap_err();
    assert!(
        matches!(
            error,
            Error::TimedOut {
                limit: Nanos(2_500_000)
            }
        ),
        "{error}"
    );
    assert_eq!(board.now().instant(), Instant::from_micros(2_500));
}

#[test]
fn unfed_watchdog_restarts_the_chip() {
    // ldr r0, =IWDG_KR; ldr r1, =start; str r1, [r0]; b .
    let mut board = board(&[ldr(0, 1), ldr(1, 2), str(1, 0), HANG], &[0x4000_3000, 0xCCCC]);
    board.run_for(Nanos::from_millis(600)).unwrap();
    let [Restart { at, cause }] = board.report().restarts[..] else {
        panic!("one restart: {:?}", board.report());
    };
    assert_eq!(cause, Cause::Watchdog);
    // RM0090 table 107: 512 ms at the shortest prescaler and the longest reload, from the 32 kHz LSI.
    assert!((512_000..513_000).contains(&at.instant().as_micros()), "{at}");
}

#[test]
fn access_to_nothing_fails_the_check() {
    // UART7 belongs to the F427.
    let mut board = board(&[ldr(0, 1), load(1, 0), HANG, NOP], &[0x4000_7800]);
    // The bus fault has no handler, nor has the resulting fault.
    let crashed = board.run_for(Duration::from_micros(10));
    assert!(
        matches!(
            crashed,
            Err(Error::Crashed {
                crash: Crash::Lockup,
                ..
            })
        ),
        "{crashed:?}"
    );
    let Err(Error::Violations(Violations(found))) = board.check() else {
        panic!("unmapped");
    };
    let nothing = Violation::Unmapped {
        address: 0x4000_7800,
        program_counter: 0x0800_000A,
    };
    assert_eq!(found[0], nothing, "{found:?}");
}

#[test]
fn unclocked_peripheral_refuses_unmodelled_one_is_named() {
    // USART2's clock is off; EXTI has no model.
    let mut board = board(
        &[ldr(0, 2), load(1, 0), ldr(0, 2), load(1, 0), HANG, NOP],
        &[0x4000_4400, 0x4001_3C00],
    );
    board.run_for(Duration::from_micros(10)).unwrap();
    let found = board.report().violations;
    let named = |violation: &Violation| match violation {
        Violation::Refused { address, .. } => *address == 0x4000_4400,
        Violation::Unimplemented { instance, .. } => *instance == "EXTI",
        _ => false,
    };
    assert!(found.len() == 2 && found.iter().all(named), "{found:?}");
}

#[test]
fn unique_id_and_flash_size_have_documented_addresses() {
    let unique_id = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
    let mut board = board_with(&[HANG, NOP], &[], |config| Config { unique_id, ..config });
    assert_eq!(board.read_word(0x1FFF_7A10).unwrap(), 0x0403_0201);
    assert_eq!(board.read_word(0x1FFF_7A14).unwrap(), 0x0807_0605);
    assert_eq!(board.read_word(0x1FFF_7A18).unwrap(), 0x0C0B_0A09);
    // The half word at 0x1FFF_7A22: 1024 KiB. The one before it is unknown.
    let code = [ldr(0, 1), 0x8801, HANG, NOP];
    let mut board = board_with(&code, &[0x1FFF_7A22], |config| config);
    board.run_for(Duration::from_micros(10)).unwrap();
    board.check().unwrap();
}

#[test]
fn equal_runs_leave_equal_traces() {
    let run = |address| {
        let mut board = board(&[ldr(0, 1), load(1, 0), HANG, NOP], &[address]);
        board.run_for(Duration::from_micros(100)).unwrap();
        board.trace_hash()
    };
    assert_eq!(run(0x4002_3800), run(0x4002_3800));
    assert_ne!(run(0x4002_3800), run(0x4002_3804));
}

#[test]
fn instructions_take_their_configured_cycles() {
    let refused_after = |percent| {
        // Forty-one cycles at 16 MHz are 2.6 us; then an access to USART2, whose clock is off.
        let mut code = vec![NOP; 40];
        code.extend([ldr(0, 1), load(1, 0), HANG, NOP]);
        let mut board = board_with(&code, &[0x4000_4400], |config| Config {
            instruction_cost: NonZeroU32::new(percent).unwrap(),
            ..config
        });
        board.run_for(Duration::from_micros(3)).unwrap();
        board.report().violations.len()
    };
    assert_eq!(refused_after(100), 1);
    assert_eq!(refused_after(200), 0);
}

#[test]
fn instructions_are_counted_except_in_sleep() {
    let mut board = board(&[NOP, NOP, NOP, WFI, HANG, NOP], &[]);
    board.run_for(Nanos::from_millis(1)).unwrap();
    assert_eq!(board.instructions(), 4);
    // An endless addition: at two cycles each, 8 000 in a millisecond of 16 000 cycles.
    let mut board = board_with(&[ADD, BACK], &[], |config| Config {
        instruction_cost: NonZeroU32::new(200).unwrap(),
        ..config
    });
    board.run_for(Nanos::from_millis(1)).unwrap();
    assert!(board.instructions().abs_diff(8_000) <= 1, "{}", board.instructions());
}

#[test]
fn profile_has_every_instruction_since_the_last() {
    // An endless addition.
    let mut board = board(&[ADD, BACK], &[]);
    assert!(board.profile().is_empty());
    for _ in 0..2 {
        let before = board.instructions();
        board.run_for(Nanos::from_millis(1)).unwrap();
        let profile = board.profile();
        assert_eq!(profile.values().sum::<u64>(), board.instructions() - before);
        let [add, back] = [0x0800_0008, 0x0800_000A].map(|address| profile[&address]);
        assert!(add + back == board.instructions() - before && add.abs_diff(back) <= 1);
    }
}

#[test]
fn wait_ends_with_the_can_frame() {
    let mut board = board(&[HANG, NOP], &[]);
    board.can().attach(500_000);
    let frame = Frame::new(Id::new(0x123).unwrap(), b"joints").unwrap();
    board.can().send(&frame).unwrap();
    let without = board.trace_hash();
    // 92 bits of 2 us.
    let took = board
        .run_until(Nanos::from_millis(1), |board| board.can().unsent() == 0)
        .unwrap();
    assert_eq!(took, Nanos(92 * 2_000));
    let expected = BusFrame {
        requested: None,
        start: Nanos(0),
        end: Nanos(92 * 2_000),
        sender: Sender::Node(0),
        frame: Some(frame),
        on_the_wire: frame.into(),
        outcome: Outcome::Sent,
    };
    assert_eq!(board.can().frames(), [expected]);
    assert_ne!(board.trace_hash(), without);
    board.can().forget_frames();
    assert!(board.can().frames().is_empty());
    // The nodes do not receive each other's frames here: the next frame adds no unread one.
    board.can().send(&frame).unwrap();
    let start = board.now();
    assert!(!board.run_until_can_received(Nanos::from_millis(1)).unwrap());
    assert_eq!(board.now(), start + Nanos::from_millis(1));
    assert_eq!(board.can().unsent(), 0);
    let fd = Frame::new_fd(Id::new(1).unwrap(), &[0; 12]).unwrap();
    assert!(matches!(board.can().send(&fd), Err(Error::FdFrame)));
}

#[test]
fn fd_frames_pass_between_nodes_that_know_them() {
    let mut board = board(&[HANG, NOP], &[]);
    let can = board.can();
    can.attach_as(NodeConfig::fd(1_000_000, 2_000_000));
    can.join(3, NodeConfig::fd(1_000_000, 2_000_000));
    can.join(4, NodeConfig::classic(1_000_000).silent());
    board.run_for(Nanos::from_millis(1)).unwrap();
    let can = board.can();
    let data: Vec<u8> = (0..24).collect();
    let frame = Frame::new_fd(Id::new(0x610).unwrap(), &data).unwrap();
    can.send(&frame).unwrap();
    assert!(matches!(can.send_from(4, &frame), Err(Error::FdFrame)));
    assert_eq!((can.unsent_by(0), can.unsent_by(4)), (1, 0));
    board.run_for(Nanos::from_millis(1)).unwrap();
    let [sent] = board.can().frames()[..] else {
        panic!("{:?}", board.can().frames());
    };
    assert_eq!((sent.frame, sent.outcome), (Some(frame), Outcome::Sent));
    // 27 bits of 1 us and 246 of 0.5 us.
    assert_eq!(sent.end.since(sent.start), Nanos(150_000));
    assert!(board.can().read().is_empty(), "it is not the board's");
    let received = board.can().read_by(3);
    assert_eq!(
        received.iter().map(|frame| frame.to_adapter()).collect::<Vec<_>>(),
        [Some(frame)]
    );
    assert_eq!(board.can().errors(3), Some((0, 0, ErrorState::Active)));
}

#[test]
fn missing_usb_device_is_an_error_not_hang() {
    let mut board = board(&[HANG, NOP], &[]);
    board.usb().attach();
    assert!(matches!(board.usb().enumerate(), Err(Error::NoDevice { .. })));
    assert!(matches!(board.usb().write(b"x"), Err(Error::NotOpen)));
    assert!(board.usb().read().is_empty());
}

#[test]
fn missing_or_foreign_image_is_refused() {
    let missing = VirtualBoard::start(Config::new("/nowhere/at/all", NoArm)).unwrap_err();
    assert!(missing.to_string().contains("/nowhere/at/all"), "{missing}");
    let native = std::env::current_exe().unwrap();
    assert!(VirtualBoard::start(Config::new(native, NoArm)).is_err());
}

/// Code that makes these stores in order and then idles, and its literals.
fn stores(stores: &[(u32, u32)]) -> (Vec<u16>, Vec<u32>) {
    let length = (3 * stores.len() + 1).next_multiple_of(2);
    let mut code = Vec::new();
    for nth in 0..stores.len() {
        for register in 0..2 {
            let counter = (code.len() + 2) & !1;
            let words = (length - counter) / 2 + 2 * nth + usize::from(register);
            code.push(ldr(register, words as u16));
        }
        code.push(str(1, 0));
    }
    code.push(HANG);
    code.resize(length, NOP);
    let literals = stores.iter().flat_map(|&(address, value)| [address, value]);
    (code, literals.collect())
}

/// Programs a word of sector 1, then stores to USART2, whose clock is off.
const PROGRAM: [(u32, u32); 5] = [
    (0x4002_3C04, 0x4567_0123),
    (0x4002_3C04, 0xCDEF_89AB),
    (0x4002_3C10, 2 << 8 | 1),
    (0x0800_4000, WORD),
    (0x4000_4400, 0),
];
const WORD: u32 = 0x6000_00F0;

fn programmer(change: impl FnOnce(Config<NoArm>) -> Config<NoArm>) -> VirtualBoard<NoArm> {
    let (code, literals) = stores(&PROGRAM);
    board_with(&code, &literals, change)
}

fn flash_word(board: &VirtualBoard<NoArm>) -> u32 {
    u32::from_le_bytes(board.flash()[0x4000..0x4004].try_into().unwrap())
}

#[test]
fn core_stalls_while_flash_is_busy() {
    let mut board = programmer(|config| config);
    board.run_for(Duration::from_micros(15)).unwrap();
    assert_eq!((board.flash_operations(), flash_word(&board)), (1, u32::MAX));
    assert!(board.report().violations.is_empty());
    board.run_for(Duration::from_micros(4)).unwrap();
    assert_eq!(flash_word(&board), WORD);
    assert!(matches!(
        board.report().violations[..],
        [Violation::Refused {
            address: 0x4000_4400,
            ..
        }]
    ));
}

#[test]
fn power_cycle_restarts_with_the_same_flash() {
    let mut board = programmer(|config| config);
    board.run_for(Duration::from_micros(20)).unwrap();
    board.power_cycle().unwrap();
    assert_eq!((flash_word(&board), board.flash_operations()), (WORD, 1));
    board.run_for(Duration::from_micros(20)).unwrap();
    assert_eq!(board.flash_operations(), 2, "it ran again");
    let restarts = board.report().restarts;
    assert!(
        matches!(
            restarts[..],
            [Restart {
                cause: Cause::Power,
                ..
            }]
        ),
        "{restarts:?}"
    );
}

#[test]
fn ram_is_random_after_power_on_and_kept_at_reset() {
    const RAM: u64 = 0x2000_0000;
    let content = |board: &mut VirtualBoard<NoArm>| -> Vec<u32> {
        (0..256).map(|nth| board.read_word(RAM + 4 * nth).unwrap()).collect()
    };
    let mut board = programmer(|config| config);
    let first = content(&mut board);
    assert!(first.iter().collect::<BTreeSet<_>>().len() > 250, "{first:x?}");
    assert_eq!(content(&mut programmer(|config| config)), first, "the same seed");
    board.restart_after_flashing();
    assert_eq!(content(&mut board), first);
    board.dip_power();
    board.run_for(Duration::from_micros(20)).unwrap();
    assert_eq!(content(&mut board), first);
    board.power_cycle().unwrap();
    assert_ne!(content(&mut board), first);
    let causes: Vec<_> = board.report().restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(causes, [Cause::Software, Cause::Power]);
}

#[test]
fn next_board_starts_with_given_flash() {
    let mut first = programmer(|config| config);
    first.run_for(Duration::from_micros(20)).unwrap();
    let mut board = board_with(&[NOP, HANG], &[], |config| Config {
        flash: Some(first.flash()),
        ..config
    });
    assert_eq!(flash_word(&board), WORD);
    assert_eq!(board.read_word(0x0800_4000).unwrap(), WORD, "the core has it");
    assert_eq!(board.flash()[10..12], HANG.to_le_bytes(), "the image is in it, too");
}

#[test]
fn power_cut_leaves_half_word_and_dead_board() {
    let run = |seed| {
        let mut board = programmer(|config| Config {
            power_cut_after: Some(0),
            seed,
            ..config
        });
        let error = board.run_for(Duration::from_micros(100)).unwrap_err();
        let Error::PowerCut { at, operation: 1 } = error else {
            panic!("{error}");
        };
        assert_eq!(at, board.now());
        assert!(matches!(
            board.run_for(Duration::from_micros(1)),
            Err(Error::PowerCut { .. })
        ));
        let word = flash_word(&board);
        assert_eq!(word & WORD, WORD, "only bits that are to be clear are");
        (board, word)
    };
    let (mut board, word) = run(1);
    assert!(word != u32::MAX && word != WORD, "{word:#010x}");
    assert_eq!(run(1).1, word);
    assert_ne!(run(2).1, word);
    board.power_cycle().unwrap();
    board.run_for(Duration::from_micros(20)).unwrap();
    assert_eq!(flash_word(&board), WORD);

    board.cut_power_after(0);
    board.power_cycle().unwrap();
    assert!(matches!(
        board.run_for(Duration::from_micros(100)),
        Err(Error::PowerCut { operation: 3, .. })
    ));
}

#[test]
fn power_cut_leaves_a_sector_half_erased() {
    // Sector 1, 32 bits at a time: SER, SNB, PSIZE, STRT (3.6.3).
    let erase = [
        (0x4002_3C04, 0x4567_0123),
        (0x4002_3C04, 0xCDEF_89AB),
        (0x4002_3C10, 1 << 16 | 2 << 8 | 1 << 3 | 1 << 1),
    ];
    let (code, literals) = stores(&erase);
    let mut board = board_with(&code, &literals, |config| Config {
        flash: Some(vec![0; Chip::Stm32f405.flash_size()]),
        power_cut_after: Some(0),
        ..config
    });
    let error = board.run_for(Duration::from_micros(260_000)).unwrap_err();
    assert!(matches!(error, Error::PowerCut { operation: 1, .. }), "{error}");
    let flash = board.flash();
    let sector = &flash[0x4000..0x8000];
    assert!(sector.contains(&0) && sector.contains(&0xFF));
    assert!(flash[0x8000..].iter().all(|&byte| byte == 0));
}

#[test]
fn flash_contents_of_another_size_are_refused() {
    let image = Image::plain(0x0800_0000, vec![0; 8]);
    let config = Config {
        flash: Some(vec![0; 3]),
        ..Config::new("test", NoArm)
    };
    let error = VirtualBoard::start_image(image, config).unwrap_err();
    assert_eq!(error.to_string(), "3 bytes for the flash, which has 1048576");
}

#[test]
fn firmware_in_boot_loader_stays_until_reset() {
    let mut board = board_into_boot_loader();
    assert!(!board.is_in_boot_loader());
    let took = board
        .run_until(Duration::from_micros(10), |board| board.is_in_boot_loader())
        .unwrap();
    // 23 cycles of 16 MHz, and a check every millisecond.
    assert!(took < Duration::from_micros(3).into(), "{took}");
    board.run_for(Nanos::from_millis(1)).unwrap();
    assert!(board.is_in_boot_loader());
    board.check().unwrap();
    board.power_cycle().unwrap();
    board.run_for(Duration::from_micros(1)).unwrap();
    assert!(!board.is_in_boot_loader());
    board.run_for(Duration::from_micros(2)).unwrap();
    assert!(board.is_in_boot_loader());
}

#[test]
fn address_0_may_be_remapped_to_boot_loader() {
    // RCC_APB2ENR: SYSCFGEN; SYSCFG_MEMRMP: system memory (9.2.1).
    let (code, literals) = stores(&[(0x4002_3844, 1 << 14), (0x4001_3800, 1)]);
    let mut board = board(&code, &literals);
    board.run_for(Duration::from_micros(10)).unwrap();
    board.check().unwrap();
    assert_eq!(board.read_word(0x4001_3800).unwrap(), 1);
}

#[test]
fn closed_interface_neither_accepts_nor_returns_data() {
    let mut board = board(&[HANG, NOP], &[]);
    let usb = board.usb();
    for pipe in [usb.vendor(), usb.serial()] {
        assert!(matches!(pipe.write(b"x"), Err(Error::NotOpen)));
        assert_eq!((pipe.is_open(), pipe.unsent(), pipe.unread()), (false, 0, 0));
        assert!(pipe.read().is_empty());
    }
}

/// The addresses reached by two interrupts of these priorities. The first one's handler sets the second pending.
///
/// The first handler then stores to USART2, the second one to CAN1, whose clocks are off; each then hangs.
fn preemption(first: u32, second: u32) -> Vec<u64> {
    const FIRST: (u32, u32) = (0x4000_4400, 0);
    const SECOND: (u32, u32) = (0x4000_6400, 0);
    let programs = [
        // NVIC_IPR0, ISER0 and ISPR0.
        stores(&[
            (0xE000_E400, second << 8 | first),
            (0xE000_E100, 0b11),
            (0xE000_E200, 0b01),
        ]),
        stores(&[(0xE000_E200, 0b10), FIRST]),
        stores(&[SECOND]),
    ];
    let mut vectors = [0u32; 18];
    let mut code = Vec::new();
    vectors[0] = 0x2000_1000;
    for (vector, (program, literals)) in [1, 16, 17].into_iter().zip(programs) {
        vectors[vector] = 0x0800_0000 + 4 * 18 + code.len() as u32 + 1;
        code.extend(program.iter().flat_map(|half| half.to_le_bytes()));
        code.extend(literals.iter().flat_map(|word| word.to_le_bytes()));
    }
    let mut flash: Vec<u8> = vectors.iter().flat_map(|vector| vector.to_le_bytes()).collect();
    flash.extend(code);
    let image = Image::plain(0x0800_0000, flash);
    let mut board = VirtualBoard::start_image(image, Config::new("test", NoArm)).unwrap();
    board.run_for(Duration::from_micros(10)).unwrap();
    let address = |violation: &Violation| match violation {
        Violation::Refused { address, .. } => *address,
        other => panic!("{other:?}"),
    };
    board.report().violations.iter().map(address).collect()
}

#[test]
fn only_a_more_urgent_interrupt_preempts_a_handler() {
    assert_eq!(preemption(0x20, 0x10), [0x4000_6400]);
    assert_eq!(preemption(0x10, 0x10), [0x4000_4400]);
    assert_eq!(preemption(0x10, 0x20), [0x4000_4400]);
    // Priorities have only the four high bits (12.1).
    assert_eq!(preemption(0x1F, 0x10), [0x4000_4400]);
}

#[test]
fn held_core_stops_until_release_or_reset() {
    // ldr r0, =IWDG_KR; ldr r1, =start; str r1, [r0]; b .
    let mut board = board(&[ldr(0, 1), ldr(1, 2), str(1, 0), HANG], &[0x4000_3000, 0xCCCC]);
    board.hold_core();
    board.run_for(Nanos::from_millis(600)).unwrap();
    board.let_core_go();
    // The watchdog is started only now; it resets the chip after 512 ms, with the core held or not.
    board.run_for(Nanos::from_millis(10)).unwrap();
    board.hold_core();
    board.run_for(Nanos::from_millis(490)).unwrap();
    assert_eq!(board.report().restarts, []);
    // The core then runs, starts the watchdog again, and is reset again.
    board.run_for(Nanos::from_millis(600)).unwrap();
    let restarts = board.report().restarts;
    let causes: Vec<Cause> = restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(causes, [Cause::Watchdog; 2]);
}

#[test]
fn words_are_written_to_memory_and_registers_only() {
    // ldr r0, =memory; ldr r1, =IWDG_KR; ldr r2, [r0]; str r2, [r1]; b .
    let code = [ldr(0, 2), ldr(1, 3), load(2, 0), str(2, 1), HANG, NOP];
    let mut board = board(&code, &[0x2000_0100, 0x4000_3000]);
    board.write_word(0x2000_0100, 0xCCCC).unwrap();
    board.run_for(Nanos::from_millis(400)).unwrap();
    // The firmware has read the word that starts the watchdog; this one feeds it.
    board.write_word(0x4000_3000, 0xAAAA).unwrap();
    board.run_for(Nanos::from_millis(400)).unwrap();
    assert_eq!(board.report().restarts, []);
    board.run_for(Nanos::from_millis(200)).unwrap();
    assert_eq!(board.report().restarts.len(), 1);
    let error = board.write_word(0x6000_0000, 0).unwrap_err();
    assert!(matches!(error, Error::Nothing { address: 0x6000_0000 }), "{error}");
}
