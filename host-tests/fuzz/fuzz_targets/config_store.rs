//! With any flash content, the store loads a valid configuration or none. It loads the saved configuration; after a
//! loss of power during the save, the new or the previous one.
#![no_main]

use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use armwire_bridge::config::Config;
use armwire_bridge::store::{Error, Saved, Store};
use armwire_bridge::{Erase, Instant};
use armwire_fuzz::{Result, Unstructured, any_good_config};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // A short input is skipped.
    let _ = check(&mut Unstructured::new(input));
});

/// After ten days, the number of saves is not limited.
const UPTIME: Instant = Instant::from_millis(10 * 86_400_000);

const PAGE: usize = 256;
const SIZE: usize = 2 * PAGE;

/// NOR flash: erasing sets all bits of a page, writing clears some.
#[derive(Debug)]
struct Flash {
    bytes: [u8; SIZE],
    /// Number of steps until the power fails, and the bits changed in the step after them.
    power: Option<(u8, u8)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PowerWent;

impl NorFlashError for PowerWent {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl Flash {
    /// Sets and clears bits, as long as there is power.
    fn change(&mut self, at: usize, to: &[u8]) -> core::result::Result<(), PowerWent> {
        let mask = match &mut self.power {
            Some((0, bits)) => core::mem::take(bits),
            Some((left, _)) => {
                *left -= 1;
                0xFF
            }
            None => 0xFF,
        };
        for (byte, to) in self.bytes[at..].iter_mut().zip(to) {
            *byte = *byte & !mask | to & mask;
        }
        if mask == 0xFF { Ok(()) } else { Err(PowerWent) }
    }
}

impl ErrorType for &mut Flash {
    type Error = PowerWent;
}

impl ReadNorFlash for &mut Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> core::result::Result<(), PowerWent> {
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for &mut Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> core::result::Result<(), PowerWent> {
        (from..to)
            .step_by(PAGE / 8)
            .try_for_each(|at| self.change(at as usize, &[0xFF; PAGE / 8]))
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> core::result::Result<(), PowerWent> {
        for (at, word) in (offset as usize..).step_by(4).zip(bytes.chunks(4)) {
            let mut cleared = [0; 4];
            let places = cleared.iter_mut().zip(&self.bytes[at..]).zip(word);
            places.for_each(|((to, old), new)| *to = old & new);
            self.change(at, &cleared[..word.len()])?;
        }
        Ok(())
    }
}

/// The result of the future: this flash never has to be waited for.
fn now<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("there is nothing to wait for"),
    }
}

fn load(flash: &mut Flash) -> Saved {
    flash.power = None;
    let mut store = Store::new(flash, 0..SIZE as u32).expect("two pages");
    let saved = now(store.load()).expect("it can be read");
    if let Saved::Config(config) = saved {
        assert_eq!(config.check(), Ok(()));
    }
    saved
}

/// A configuration to save, or `None` for a reset.
fn any_change(u: &mut Unstructured<'_>, saves: bool) -> Result<Option<Config>> {
    Ok(match saves {
        false => None,
        true if u.arbitrary()? => Some(u.arbitrary()?),
        true => Some(any_good_config(u)?),
    })
}

fn check(u: &mut Unstructured<'_>) -> Result<()> {
    let mut flash = Flash {
        bytes: [0xFF; SIZE],
        power: None,
    };
    let end = u.arbitrary::<u16>()?.into();
    match Store::new(&mut flash, 0..end) {
        Ok(_) => assert!(end as usize >= SIZE && (end as usize).is_multiple_of(PAGE)),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    // The content of the flash, as long as only the store has written to it, and a save succeeded or none was tried.
    let mut kept = Some(Saved::Nothing);
    let mut is_first = true;
    while !u.is_empty() {
        match u.int_in_range(0..=3)? {
            step @ (0 | 1) => {
                let config = any_change(u, step == 0)?;
                let saved = save(&mut flash, config, kept);
                kept = kept.map(|_| saved);
                is_first &= Some(saved) != saved_as(config);
            }
            2 => {
                // The power fails after this number of words written or eighths of a page erased, in the middle of the
                // next one, of which these bits already have their new value.
                let (after, bits, saves): (u8, u8, bool) = u.arbitrary()?;
                let config = any_change(u, saves)?;
                flash.power = Some((after % 64, bits));
                let new = saved_as(config);
                let done = write(&mut flash, config);
                let loaded = load(&mut flash);
                is_first &= done.is_err();
                if let Some(old) = kept {
                    let is_cut = is_first && loaded == Saved::Unreadable;
                    assert!(
                        is_cut || loaded == old || Some(loaded) == new,
                        "{loaded:?}, neither {old:?} nor {new:?}"
                    );
                    assert!(done.is_err() || Some(loaded) == new, "done, and not there");
                }
                kept = kept.map(|_| loaded);
            }
            _ => {
                // Another writer changes the flash. The loaded configuration must still be valid.
                let (at, bytes): (u16, &[u8]) = u.arbitrary()?;
                let places = flash.bytes.iter_mut().skip(usize::from(at) % SIZE);
                places.zip(bytes).for_each(|(to, from)| *to = *from);
                kept = None;
            }
        }
        let loaded = load(&mut flash);
        assert!(kept.is_none_or(|kept| kept == loaded), "{loaded:?} is not {kept:?}");
    }
    Ok(())
}

/// The loaded result after a save of this configuration; `None` for an invalid configuration.
fn saved_as(config: Option<Config>) -> Option<Saved> {
    match config {
        Some(config) => config.check().is_ok().then_some(Saved::Config(config)),
        None => Some(Saved::Nothing),
    }
}

fn write(flash: &mut Flash, config: Option<Config>) -> core::result::Result<(), Error<PowerWent>> {
    let mut store = Store::new(flash, 0..SIZE as u32).expect("two pages");
    match config {
        Some(config) => now(store.save(&config, UPTIME, Erase::Allowed)),
        None => now(store.reset(UPTIME, Erase::Allowed)),
    }
}

/// Saves or resets. Returns the content of the flash.
fn save(flash: &mut Flash, config: Option<Config>, kept: Option<Saved>) -> Saved {
    let before = load(flash);
    let new = saved_as(config);
    match write(flash, config) {
        Ok(()) => {
            let loaded = load(flash);
            assert!(kept.is_none() || Some(loaded) == new, "saved, and not there");
            loaded
        }
        Err(error) => {
            assert!(!error.to_string().is_empty());
            let bad = matches!(error, Error::Config(_));
            assert_eq!(bad, new.is_none());
            // Flash without a fault keeps written data.
            assert!(bad || kept.is_none(), "{error}");
            assert!(kept.is_none() || before == load(flash), "what was there is lost");
            load(flash)
        }
    }
}
