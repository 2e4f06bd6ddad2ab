//! Loss of power at every step of a save.

extern crate std;

use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use std::format;
use std::vec;
use std::vec::Vec;

use embedded_storage_async::nor_flash::{ErrorType, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use proptest::prelude::*;

use super::*;
use crate::config::{ArmKind, Can, HostTimeout, Poll as PollRate};

/// The small sectors of an STM32F405 (RM0090 table 5), written by words.
type F405 = Nor<4, 0x4000>;
/// The same, written by bytes.
type F405Bytes = Nor<1, 0x4000>;
/// The pages of an STM32G431 (RM0440 section 3.3.1), written by double words.
type G431 = Nor<8, 0x800>;
/// Small pages that fill quickly.
type Tiny = Nor<8, 0x100>;

/// NOR flash: an erase sets all bits of a page, programming clears bits, and the power may fail at any step.
///
/// A word of eight bytes has an invisible checksum: it can be programmed only when erased, or to zero (RM0440 section
/// 3.3.8, PROGERR).
#[derive(Clone)]
struct Nor<const WRITE: usize, const ERASE: usize> {
    bytes: Vec<u8>,
    /// The number of steps with power, and the damage to the next one.
    power: Option<(usize, Damage)>,
    /// The flash reports success without writing or erasing.
    worn: bool,
    /// Pages whose reads crash until their erase.
    crashing: Vec<usize>,
    /// The completed steps.
    steps: Vec<Step>,
    /// Number of erases of each page.
    erased: Vec<u32>,
}

/// The programming of a word, or the erase of a page.
#[derive(Clone)]
struct Step {
    place: Range<usize>,
    after: Vec<u8>,
    is_erase: bool,
}

/// The progress of a step at the loss of power. The `u64` selects the bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Damage {
    /// No progress.
    None,
    /// The first bytes have their final value.
    Front(u64),
    /// The last bytes have their final value.
    Back(u64),
    /// Some bits have their final value.
    Bits(u64),
    /// An erase begins by programming the page to zero, here up to some byte.
    Zeros(u64),
    /// The page is zero except for some bits.
    BitsOfZeros(u64),
    /// Complete.
    All,
}

impl Damage {
    const KINDS: [fn(u64) -> Self; 7] = [
        |_| Self::None,
        Self::Front,
        Self::Back,
        Self::Bits,
        Self::Zeros,
        Self::BitsOfZeros,
        |_| Self::All,
    ];

    /// `bytes` in transition to `after`.
    fn apply(self, bytes: &mut [u8], after: &[u8], is_erase: bool) {
        let (Self::Front(seed) | Self::Back(seed) | Self::Bits(seed) | Self::Zeros(seed) | Self::BitsOfZeros(seed)) =
            self
        else {
            if self == Self::All {
                bytes.copy_from_slice(after);
            }
            return;
        };
        let mut state = seed;
        let place = random(&mut state) as usize % bytes.len();
        match self {
            Self::Front(_) => bytes[..place].copy_from_slice(&after[..place]),
            Self::Back(_) => bytes[place..].copy_from_slice(&after[place..]),
            Self::Zeros(_) if is_erase => bytes[..place].fill(0),
            _ => {
                if self == Self::BitsOfZeros(seed) && is_erase {
                    bytes.fill(0);
                }
                for (byte, after) in bytes.iter_mut().zip(after) {
                    let changed = (random(&mut state) >> 32) as u8;
                    *byte = *byte & !changed | after & changed;
                }
            }
        }
    }
}

/// The next number of SplitMix64.
fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    NoPower,
    NotErased,
}

impl NorFlashError for Fault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<const WRITE: usize, const ERASE: usize> Nor<WRITE, ERASE> {
    fn new(pages: usize) -> Self {
        Self {
            bytes: vec![0xFF; pages * ERASE],
            power: None,
            worn: false,
            crashing: Vec::new(),
            steps: Vec::new(),
            erased: vec![0; pages],
        }
    }

    fn range(&self) -> Range<u32> {
        0..self.bytes.len() as u32
    }

    fn step(&mut self, step: Step) -> Result<(), Fault> {
        if self.worn {
            return Ok(());
        }
        match &mut self.power {
            None => {}
            Some((steps @ 1.., _)) => *steps -= 1,
            Some((0, damage)) => {
                // Later steps have no effect.
                let damage = core::mem::replace(damage, Damage::None);
                self.cut(&step, damage);
                return Err(Fault::NoPower);
            }
        }
        self.cut(&step, Damage::All);
        self.steps.push(step);
        Ok(())
    }

    /// Executes a step up to its progress at the loss of power.
    fn cut(&mut self, step: &Step, damage: Damage) {
        damage.apply(&mut self.bytes[step.place.clone()], &step.after, step.is_erase);
    }
}

impl<const WRITE: usize, const ERASE: usize> ErrorType for Nor<WRITE, ERASE> {
    type Error = Fault;
}

impl<const WRITE: usize, const ERASE: usize> ReadNorFlash for Nor<WRITE, ERASE> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        assert!(!self.crashing.contains(&(offset as usize / ERASE)), "a crash");
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const WRITE: usize, const ERASE: usize> NorFlash for Nor<WRITE, ERASE> {
    const WRITE_SIZE: usize = WRITE;
    const ERASE_SIZE: usize = ERASE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        let (from, to) = (from as usize, to as usize);
        assert!(from.is_multiple_of(ERASE) && to.is_multiple_of(ERASE) && from < to && to <= self.bytes.len());
        for page in from / ERASE..to / ERASE {
            self.step(Step {
                place: page * ERASE..(page + 1) * ERASE,
                after: vec![0xFF; ERASE],
                is_erase: true,
            })?;
            self.erased[page] += 1;
            self.crashing.retain(|crashing| *crashing != page);
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        let offset = offset as usize;
        assert!(offset.is_multiple_of(WRITE) && bytes.len().is_multiple_of(WRITE));
        for (place, word) in (offset..).step_by(WRITE).zip(bytes.chunks(WRITE)) {
            let place = place..place + WRITE;
            let before = &self.bytes[place.clone()];
            if WRITE == 8 && before != [0xFF; WRITE] && word != [0; WRITE] {
                return Err(Fault::NotErased);
            }
            let after = before.iter().zip(word).map(|(before, word)| before & word).collect();
            self.step(Step {
                place,
                after,
                is_erase: false,
            })?;
        }
        Ok(())
    }
}

/// The result of a future that never waits.
fn now<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => panic!("it waits"),
    }
}

/// An uptime at which the budget is full after any saves.
const UPTIME: Instant = Instant::from_millis(10 * 86_400_000);

fn load<F: NorFlash>(flash: &mut F) -> Saved {
    let range = 0..flash.capacity() as u32;
    now(Store::new(flash, range).unwrap().load()).unwrap()
}

fn save<F: NorFlash>(flash: &mut F, config: &Config) -> Result<(), Error<F::Error>> {
    let range = 0..flash.capacity() as u32;
    now(Store::new(flash, range).unwrap().save(config, UPTIME, Erase::Allowed))
}

fn reset<F: NorFlash>(flash: &mut F) -> Result<(), Error<F::Error>> {
    let range = 0..flash.capacity() as u32;
    now(Store::new(flash, range).unwrap().reset(UPTIME, Erase::Allowed))
}

fn append<F: NorFlash>(flash: &mut F, content: &[u8]) {
    let range = 0..flash.capacity() as u32;
    now(Store::new(flash, range)
        .unwrap()
        .append(content, UPTIME, Erase::Allowed))
    .unwrap();
}

/// Configuration number `number`.
fn config(number: u16) -> Config {
    Config {
        poll: PollRate::Hertz(number % 1_000 + 1),
        host_timeout: HostTimeout {
            after_ms: number,
            torque_off: false,
        },
        ..Config::default()
    }
}

/// Flash after this many saves, the last of them with this number.
fn filled<const WRITE: usize, const ERASE: usize>(saves: u16) -> Nor<WRITE, ERASE> {
    let mut flash = Nor::new(2);
    for number in 1..=saves {
        save(&mut flash, &config(number)).unwrap();
    }
    flash
}

/// The number of saves that fill a page.
fn saves_a_page<const WRITE: usize, const ERASE: usize>() -> u16 {
    let mut flash = Nor::<WRITE, ERASE>::new(2);
    let saves = (1..).take_while(|&number| {
        save(&mut flash, &config(number)).unwrap();
        flash.erased == [0, 0]
    });
    // The first erase comes when both are full.
    saves.count() as u16 / 2
}

/// `flash` after a loss of power at each step of a save of `config`, with each kind of damage. Many results are equal:
/// no progress in a step equals the completion of the one before, and a byte has no halves. Equal results count once.
fn cuts<const WRITE: usize, const ERASE: usize>(
    flash: &Nor<WRITE, ERASE>,
    config: &Config,
) -> Vec<(usize, Damage, Nor<WRITE, ERASE>)> {
    let mut before = flash.clone();
    before.steps.clear();
    let mut whole = before.clone();
    save(&mut whole, config).unwrap();
    let mut all: Vec<(usize, Damage, Nor<WRITE, ERASE>)> = Vec::new();
    for (number, step) in whole.steps.iter().enumerate() {
        for (kind, damage) in Damage::KINDS.into_iter().enumerate() {
            let damage = damage((number * Damage::KINDS.len() + kind) as u64);
            let mut flash = before.clone();
            flash.cut(step, damage);
            if all.iter().all(|(.., other)| other.bytes != flash.bytes) {
                all.push((number, damage, flash));
            }
        }
        before.cut(step, Damage::All);
    }
    all
}

/// Interrupts the next save after this many, at each of its steps.
fn cut_save<const WRITE: usize, const ERASE: usize>(flash: &Nor<WRITE, ERASE>, old: u16) {
    let configs = [old, old + 1, old + 2].map(config);
    let [old, new, next] = configs.map(Saved::Config);
    for (step, damage, mut flash) in cuts(flash, &configs[1]) {
        let loaded = load(&mut flash);
        assert!(
            loaded == old || loaded == new,
            "{loaded:?} after {damage:?} in step {step} of {new:?}"
        );
        assert_eq!(load(&mut flash), loaded, "after {damage:?} in step {step} of {new:?}");
        save(&mut flash, &configs[2])
            .unwrap_or_else(|error| panic!("{error} after {damage:?} in step {step} of {new:?}"));
        assert_eq!(load(&mut flash), next, "after {damage:?} in step {step} of {new:?}");
    }
}

/// Interrupts every save of three rounds through the pages.
fn cut_every_save<const WRITE: usize, const ERASE: usize>() {
    let mut flash = filled::<WRITE, ERASE>(1);
    let mut number = 1;
    while flash.erased != [3, 3] {
        cut_save(&flash, number);
        number += 1;
        save(&mut flash, &config(number)).unwrap();
    }
}

/// Interrupts the saves around the first two ends of a page.
fn cut_saves_about_page_ends<const WRITE: usize, const ERASE: usize>() {
    let saves = saves_a_page::<WRITE, ERASE>();
    let about_ends = [saves - 1, saves, 2 * saves - 1, 2 * saves];
    let mut flash = Nor::<WRITE, ERASE>::new(2);
    for number in 1..=2 * saves {
        save(&mut flash, &config(number)).unwrap();
        if about_ends.contains(&number) {
            cut_save(&flash, number);
        }
    }
}

#[test]
fn interrupted_save_keeps_old_or_new_on_g431() {
    cut_every_save::<8, 0x800>();
}

#[test]
fn interrupted_save_keeps_old_or_new_tiny_pages() {
    cut_every_save::<8, 0x100>();
    cut_every_save::<4, 0x100>();
    cut_every_save::<1, 0x100>();
}

#[test]
fn interrupted_save_keeps_old_or_new_on_f405() {
    cut_saves_about_page_ends::<4, 0x4000>();
    cut_saves_about_page_ends::<1, 0x4000>();
}

#[test]
fn two_interrupted_saves_keep_one_of_three() {
    fn cut_twice<const WRITE: usize>() {
        let saves = saves_a_page::<WRITE, 0x100>();
        for number in saves - 1..=3 * saves {
            let flash = filled::<WRITE, 0x100>(number);
            let configs = [number, number + 1, number + 2].map(config);
            for (step, damage, flash) in cuts(&flash, &configs[1]) {
                for (second_step, second_damage, mut flash) in cuts(&flash, &configs[2]) {
                    let loaded = load(&mut flash);
                    let cut = format!("{damage:?} in step {step}, {second_damage:?} in step {second_step}");
                    assert!(configs.map(Saved::Config).contains(&loaded), "{loaded:?} after {cut}");
                }
            }
        }
    }
    cut_twice::<4>();
    cut_twice::<8>();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]
    #[test]
    fn interrupted_saves_and_resets_keep_old_or_new(
        pages in 2..4_usize,
        changes in prop::collection::vec((prop::option::of(1..2_000_u16), 0..30_usize, 0..Damage::KINDS.len(), any::<u64>()), 1..100),
    ) {
        let mut flash = Tiny::new(pages);
        let mut old = Saved::Nothing;
        // Before the first save, interrupted data is unreadable, and the adapter has the factory defaults in any case.
        let mut is_first = true;
        for (number, step, kind, seed) in changes {
            flash.power = Some((step, Damage::KINDS[kind](seed)));
            let (new, result) = match number.map(config) {
                Some(config) => (Saved::Config(config), save(&mut flash, &config)),
                None => (Saved::Nothing, reset(&mut flash)),
            };
            // A load may complete an erase, which is interrupted, too.
            flash.power = Some((0, Damage::KINDS[kind](!seed)));
            let _ = now(Store::new(&mut flash, 0..pages as u32 * 0x100).unwrap().load());
            flash.power = None;
            let loaded = load(&mut flash);
            match result {
                Ok(()) => {
                    prop_assert_eq!(loaded, new);
                    is_first = false;
                }
                Err(_) if is_first && loaded == Saved::Unreadable => continue,
                Err(error) => {
                    prop_assert_eq!(error, Error::Flash(Fault::NoPower));
                    prop_assert!(loaded == old || loaded == new, "{:?} is neither {:?} nor {:?}", loaded, old, new);
                }
            }
            old = loaded;
        }
    }

    #[test]
    fn arbitrary_flash_is_unreadable_but_accepts_a_save(seed: u64, front in prop::collection::vec(any::<u8>(), 0..40)) {
        let mut flash = G431::new(2);
        let mut state = seed;
        for byte in &mut flash.bytes {
            *byte = random(&mut state) as u8;
        }
        flash.bytes[..front.len()].copy_from_slice(&front);
        prop_assert_eq!(load(&mut flash), Saved::Unreadable);
        save(&mut flash, &config(1)).unwrap();
        prop_assert_eq!(load(&mut flash), Saved::Config(config(1)));
    }
}

/// `flash` with each written byte changed, in two ways.
fn corrupted<const WRITE: usize, const ERASE: usize>(
    flash: &Nor<WRITE, ERASE>,
) -> impl Iterator<Item = (usize, Nor<WRITE, ERASE>)> {
    let written = flash.bytes.iter().enumerate().filter(|(_, byte)| **byte != ERASED);
    written.flat_map(|(at, byte)| {
        [byte ^ 0x01, ERASED].map(|bad| {
            let mut flash = flash.clone();
            flash.bytes[at] = bad;
            (at, flash)
        })
    })
}

#[test]
fn corrupt_record_is_not_taken_for_empty() {
    fn check_corruption<const WRITE: usize, const ERASE: usize>() {
        for saves in [1, 2] {
            let flash = filled::<WRITE, ERASE>(saves);
            let mut lost = 0;
            for (at, mut flash) in corrupted(&flash) {
                let loaded = load(&mut flash);
                let kept = (1..=saves).any(|number| loaded == Saved::Config(config(number)));
                assert!(kept || loaded == Saved::Unreadable, "{loaded:?} with another byte {at}");
                lost += usize::from(loaded == Saved::Unreadable);
                save(&mut flash, &config(3)).unwrap();
                assert_eq!(load(&mut flash), Saved::Config(config(3)));
            }
            assert_eq!(lost > 0, saves == 1, "{lost} of {saves}");
        }
    }
    check_corruption::<8, 0x800>();
    check_corruption::<4, 0x4000>();
    check_corruption::<1, 0x4000>();
}

#[test]
fn corrupt_reset_is_not_taken_for_empty() {
    let mut flash = G431::new(2);
    reset(&mut flash).unwrap();
    assert_eq!(load(&mut flash), Saved::Nothing);
    let loaded: Vec<_> = corrupted(&flash).map(|(_, mut flash)| load(&mut flash)).collect();
    assert!(loaded.contains(&Saved::Unreadable));
}

#[test]
fn saved_configuration_is_loaded_until_reset() {
    let mut flash = F405Bytes::new(2);
    assert_eq!(load(&mut flash), Saved::Nothing);
    save(&mut flash, &config(1)).unwrap();
    assert_eq!(load(&mut flash), Saved::Config(config(1)));
    save(&mut flash, &config(2)).unwrap();
    assert_eq!(load(&mut flash), Saved::Config(config(2)));
    reset(&mut flash).unwrap();
    assert_eq!(load(&mut flash), Saved::Nothing);
    save(&mut flash, &config(2)).unwrap();
    assert_eq!(load(&mut flash), Saved::Config(config(2)));
}

#[test]
fn unchanged_configuration_is_not_written_again() {
    let mut flash = filled::<4, 0x4000>(1);
    let before = flash.steps.len();
    save(&mut flash, &config(1)).unwrap();
    assert_eq!(flash.steps.len(), before);
    reset(&mut flash).unwrap();
    let before = flash.steps.len();
    reset(&mut flash).unwrap();
    assert_eq!(flash.steps.len(), before);
}

/// The configuration with the longest record.
fn longest() -> Config {
    Config {
        arm: ArmKind::Ling,
        poll: PollRate::Hertz(1_000),
        can: Can {
            data_bit_rate: Some(5_000_000),
            telemetry_hz: 1_000,
            commands: true,
            command_timeout_ms: 10_000,
            unsolicited: true,
            ..Can::default()
        },
        host_timeout: HostTimeout {
            after_ms: u16::MAX,
            torque_off: true,
        },
    }
}

/// Saves differing configurations, each after a restart, until one is refused. Returns the number of saves, and the
/// time to the next one in seconds.
fn save_until_refused<F: NorFlash>(flash: &mut F, uptime: Instant) -> (u32, u16) {
    let range = 0..flash.capacity() as u32;
    let mut saves = 0;
    loop {
        let differs = HostTimeout {
            after_ms: u16::MAX - (saves % 2) as u16,
            torque_off: true,
        };
        let config = Config {
            host_timeout: differs,
            ..longest()
        };
        match now(Store::new(&mut *flash, range.clone())
            .unwrap()
            .save(&config, uptime, Erase::Allowed))
        {
            Ok(()) => saves += 1,
            Err(Error::TooManySaves { wait_s }) => return (saves, wait_s),
            Err(_) => panic!("the flash has no error"),
        }
    }
}

#[test]
fn prepared_flash_takes_a_page_of_saves_without_erase() {
    fn check<const WRITE: usize, const ERASE: usize>() {
        let page = saves_a_page::<WRITE, ERASE>();
        for before in [0, 1, page - 1, page, page + 1, 3 * page] {
            let mut flash = filled::<WRITE, ERASE>(before);
            let range = flash.range();
            let mut store = Store::new(&mut flash, range).unwrap();
            now(store.prepare()).unwrap();
            let erased = store.flash.erased.clone();
            let mut number = before;
            let refused = loop {
                let content = config(number + 1);
                // Each save has earned the next.
                let uptime = Instant::from_millis(600_000 * (10_000 + u64::from(number)));
                match now(store.save(&content, uptime, Erase::Refused)) {
                    Ok(()) => number += 1,
                    Err(error) => break error,
                }
                assert_eq!(now(store.load()), Ok(Saved::Config(content)));
            };
            assert_eq!(refused, Error::NoRoom);
            assert_eq!(store.flash.erased, erased);
            // Later records are longer.
            assert!(
                number - before > page / 10 * 9,
                "{} saves after {before}",
                number - before
            );
            assert_eq!(
                now(store.load()),
                Ok(Saved::Config(config(number))),
                "the last one stays"
            );
            let uptime = Instant::from_millis(600_000 * (10_000 + u64::from(number)));
            now(store.save(&config(number + 1), uptime, Erase::Allowed)).unwrap();
            assert_eq!(now(store.load()), Ok(Saved::Config(config(number + 1))));
        }
    }
    check::<4, 0x4000>();
    check::<8, 0x800>();
    check::<1, 0x1000>();
}

#[test]
fn unreadable_pages_are_not_erased_if_refused() {
    for byte in [0x00, 0x5A] {
        let mut flash = G431::new(2);
        flash.bytes.fill(byte);
        let range = flash.range();
        let mut store = Store::new(&mut flash, range).unwrap();
        assert_eq!(now(store.save(&config(1), UPTIME, Erase::Refused)), Err(Error::NoRoom));
        assert_eq!(store.flash.erased, [0, 0]);
        now(store.prepare()).unwrap();
        now(store.save(&config(1), UPTIME, Erase::Refused)).unwrap();
        assert_eq!(store.flash.erased, [0, 1]);
        assert_eq!(now(store.load()), Ok(Saved::Config(config(1))));
    }
}

#[test]
fn prepare_erases_nothing_that_is_erased() {
    let mut flash = G431::new(2);
    for saves in 0..3 {
        if saves > 0 {
            save(&mut flash, &config(saves)).unwrap();
        }
        let range = flash.range();
        now(Store::new(&mut flash, range).unwrap().prepare()).unwrap();
        assert_eq!(flash.erased, [0, 0]);
    }
}

#[test]
fn saves_beyond_budget_are_refused_after_restarts_too() {
    let mut flash = G431::new(2);
    let start = Instant::from_millis(1_000);
    assert_eq!(save_until_refused(&mut flash, start), (SAVE_BUDGET.into(), 599));
    assert_eq!(save_until_refused(&mut flash, start), (0, 599));
    let kept = load(&mut flash);
    assert!(matches!(reset(&mut flash), Ok(())), "in ten days there is time for it");
    assert_eq!(load(&mut flash), Saved::Nothing);
    assert_ne!(kept, Saved::Nothing);
}

#[test]
fn time_earns_saves_one_by_one() {
    let mut flash = G431::new(2);
    save_until_refused(&mut flash, Instant::ZERO);
    let range = flash.range();
    let mut store = Store::new(&mut flash, range).unwrap();
    let mut refused = Vec::new();
    // Two minutes an hour, one save a second.
    for second in (1_795..1_855).chain(3_595..3_655) {
        let uptime = Instant::from_millis(second * 1_000);
        match now(store.save(&config(second as u16), uptime, Erase::Allowed)) {
            Ok(()) => refused.push(None),
            Err(Error::TooManySaves { wait_s }) => refused.push(Some(wait_s)),
            Err(error) => panic!("{error}"),
        }
    }
    let earned = |refused: &[Option<u16>]| refused.iter().filter(|refused| refused.is_none()).count();
    assert_eq!(
        refused[..8],
        [None, None, Some(3), Some(2), Some(1), None, Some(599), Some(598)]
    );
    assert_eq!((earned(&refused[..60]), earned(&refused[60..])), (3, 3));
}

#[test]
fn ten_year_budget_does_not_wear_out_flash() {
    const ERASES: u32 = 10_000; // the endurance of a page in both chips' datasheets
    let ten_years = Instant::from_millis(3_652 * 86_400_000 + 12 * 3_600_000);
    let saves = u32::from(SAVE_BUDGET) + (ten_years.as_micros() / SAVE_INTERVAL.as_micros()) as u32;
    fn erases_of<const WRITE: usize, const ERASE: usize>() -> u32 {
        let mut flash = Nor::<WRITE, ERASE>::new(2);
        let saves = save_until_refused(&mut flash, Instant::ZERO).0;
        // A partly written page counts as one erase.
        let erases = flash.erased.iter().sum::<u32>() + 2;
        saves / erases
    }
    for saves_per_erase in [erases_of::<4, 0x4000>(), erases_of::<8, 0x800>()] {
        let erases = saves / saves_per_erase / 2;
        assert!(
            erases < ERASES,
            "{saves_per_erase} saves an erase: {erases} erases a page"
        );
    }
}

#[test]
fn all_pages_wear_alike() {
    let mut flash = G431::new(3);
    for number in 0..1_000 {
        save(&mut flash, &config(number)).unwrap();
    }
    let (most, least) = (flash.erased.iter().max().unwrap(), flash.erased.iter().min().unwrap());
    assert!(*least > 3 && most - least <= 1, "{:?}", flash.erased);
}

#[test]
fn newest_record_wins_across_sequence_wraparound() {
    // The number of records before the wrap varies: the wrap then occurs in either page and between both.
    for left in 0..20 {
        let sequence = u32::MAX - left;
        let mut flash = Tiny::new(2);
        let range = flash.range();
        let record = Record::new(sequence, 0, &[]).unwrap();
        now(Store::new(&mut flash, range).unwrap().push(0, &record)).unwrap();
        // More than both pages hold.
        for number in 0..30 {
            save(&mut flash, &config(number)).unwrap();
            assert_eq!(load(&mut flash), Saved::Config(config(number)));
        }
        assert!(flash.erased.iter().all(|&erased| erased > 0), "{:?}", flash.erased);
    }
}

#[test]
fn f405_sector_takes_hundreds_of_saves() {
    let saves = saves_a_page::<4, 0x4000>();
    assert!(saves > 300, "{saves}");
    let mut flash = filled::<4, 0x4000>(saves);
    assert_eq!(flash.erased, [0, 0]);
    assert_eq!(load(&mut flash), Saved::Config(config(saves)));
}

#[test]
fn other_layout_is_unreadable_and_stays_in_flash() {
    let mut flash = F405::new(2);
    save(&mut flash, &config(1)).unwrap();
    let later = [LAYOUT + 1, 0xA5, 0x5A, 0x96, 0x69];
    append(&mut flash, &later);
    assert_eq!(load(&mut flash), Saved::Unreadable);
    save(&mut flash, &config(2)).unwrap();
    assert_eq!(load(&mut flash), Saved::Config(config(2)));
    assert!(flash.bytes.windows(later.len()).any(|bytes| bytes == later));
}

#[test]
fn configuration_of_wrong_length_is_unreadable() {
    let mut flash = F405::new(2);
    let mut content = [0; 100];
    let len = postcard::to_slice(&(LAYOUT, config(1)), &mut content).unwrap().len();
    append(&mut flash, &content[..len + 1]);
    assert_eq!(load(&mut flash), Saved::Unreadable);
    append(&mut flash, &content[..len - 1]);
    assert_eq!(load(&mut flash), Saved::Unreadable);
    append(&mut flash, &content[..len]);
    assert_eq!(load(&mut flash), Saved::Config(config(1)));
}

#[test]
fn invalid_configuration_is_neither_saved_nor_loaded() {
    let mut bad = config(1);
    bad.poll = PollRate::Hertz(1_001);
    let error = bad.check().unwrap_err();
    let mut flash = F405::new(2);
    assert_eq!(save(&mut flash, &bad), Err(Error::Config(error)));
    assert!(flash.steps.is_empty());

    let mut content = [0; 100];
    append(&mut flash, postcard::to_slice(&(LAYOUT, bad), &mut content).unwrap());
    assert_eq!(load(&mut flash), Saved::Unreadable);
}

#[test]
fn longest_record_fits() {
    let longest = longest();
    let mut flash = Tiny::new(2);
    save(&mut flash, &longest).unwrap();
    assert_eq!(load(&mut flash), Saved::Config(longest));
    append(&mut flash, &[0xA5; MAX_RECORD - HEAD]);
    assert_eq!(load(&mut flash), Saved::Unreadable);
    save(&mut flash, &config(1)).unwrap();
    assert_eq!(load(&mut flash), Saved::Config(config(1)));
}

#[test]
fn range_other_than_two_pages_is_refused() {
    let flash = G431::new(4);
    for range in [0..0x800, 0..0xC00, 0x400..0x1400, 0..0] {
        let result = Store::new(flash.clone(), range.clone());
        assert_eq!(result.err(), Some(BadRange { range, page: 0x800 }));
    }
    assert!(Store::new(flash.clone(), flash.range()).is_ok());
    let error = BadRange {
        range: 0..0x800,
        page: 0x800,
    };
    assert_eq!(
        format!("{error}"),
        "flash from 0x0 to 0x800 is not two pages of 2048 bytes or more"
    );
}

#[test]
fn flash_that_does_not_write_is_reported() {
    let mut flash = filled::<4, 0x4000>(1);
    flash.power = Some((0, Damage::None));
    let error = save(&mut flash, &config(2)).unwrap_err();
    assert_eq!(error, Error::Flash(Fault::NoPower));
    assert_eq!(format!("{error}"), "the flash reports NoPower");
    assert_eq!(load(&mut flash), Saved::Config(config(1)));
}

#[test]
fn flash_that_ignores_writes_is_reported() {
    for saves in [0, 1] {
        let mut flash = filled::<4, 0x4000>(saves);
        flash.worn = true;
        let error = save(&mut flash, &config(2)).unwrap_err();
        assert_eq!(error, Error::VerifyFailed);
        assert_eq!(format!("{error}"), "flash verification failed");
    }
}

#[test]
fn store_that_crashes_is_erased_unread() {
    let mut flash = filled::<8, 0x800>(5);
    flash.crashing = vec![0, 1];
    let range = flash.range();
    now(Store::new(&mut flash, range).unwrap().erase()).unwrap();
    assert_eq!(load(&mut flash), Saved::Nothing);
    save(&mut flash, &config(8)).unwrap();
    assert_eq!(load(&mut flash), Saved::Config(config(8)));
}
