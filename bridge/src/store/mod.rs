//! The configuration in flash: saved whole or not at all, whenever the power goes.
//!
//! A save appends a record to a page. When the page is full, the next one is erased and taken; so all pages wear alike,
//! and the newest record is never on a page that is being erased. The record with the highest sequence number counts; these
//! wrap, and no two in flash are half of all numbers apart.
//!
//! A record with a wrong checksum is passed over, for it is what is left of a save that was cut. One whose bytes went bad
//! later looks the same: what counts then is the one before it. If there is none, that is not taken for a store to
//! which nothing was ever saved.
//!
//! Flash wears out: a page is good for some 10 000 erases. Saves are therefore counted against a budget that lasts
//! [ten years](SAVE_INTERVAL) on every board, however often a host asks. What is left of it stands in each record, so that a
//! restart gives nothing back. What is saved already is not written again, and costs nothing. A save that the power cuts is not
//! counted.
//!
//! Each page is a queue of its own of `sequential_storage`, which finds the free place, skips what was cut off, and tells
//! by a checksum whether a record is whole. Its map over all pages would not do: it moves the newest record from page to
//! page, and marks at both ends of a page tell it whether an erase was cut. What a page has in it after a cut erase is
//! undefined (`embedded_storage_async::nor_flash::NorFlash::erase`), the marks included, and a page half erased can be
//! taken for the one to keep.
//!
//! Flash with ECC may report an error in a word that was being written when the power went. Its driver, or the handler of
//! the interrupt, must pass over that: reading gives any bytes then, and goes on.

use core::fmt;
use core::ops::Range;

use armwire::time::{Duration, Instant};
use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::queue::{QueueConfig, QueueStorage};

use crate::config::{Config, ConfigError};
use crate::control::Failure;

/// Saves that may come one after another, from flash that nothing was saved to.
pub const SAVE_BUDGET: u16 = 1_000;

/// How long an adapter must be on to earn one more save. In ten years these are 525 960.
pub const SAVE_INTERVAL: Duration = Duration::from_millis(10 * 60 * 1_000);

/// The layout of what is saved. A field more in [`Config`] is another layout.
const LAYOUT: u8 = 2;

/// The longest record of this and every later layout, in bytes.
const MAX_RECORD: usize = 128;

/// What a byte is that was erased and not written.
const ERASED: u8 = 0xFF;

/// So many bytes at the front of a page tell whether it was written to: a mark of a word, and a record's header.
const FRONT: usize = 16;

/// The length of what stands before the content of a record, in bytes.
const HEAD: usize = size_of::<u32>() + size_of::<u16>();

/// Where the configuration is kept: two pages of flash or more.
///
/// ```
/// # mod ram {
/// #     use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
/// #     pub struct Flash(pub [u8; 4096]);
/// #     impl ErrorType for Flash {
/// #         type Error = std::convert::Infallible;
/// #     }
/// #     impl ReadNorFlash for Flash {
/// #         const READ_SIZE: usize = 1;
/// #         async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
/// #             bytes.copy_from_slice(&self.0[offset as usize..][..bytes.len()]);
/// #             Ok(())
/// #         }
/// #         fn capacity(&self) -> usize {
/// #             self.0.len()
/// #         }
/// #     }
/// #     impl NorFlash for Flash {
/// #         const WRITE_SIZE: usize = 8;
/// #         const ERASE_SIZE: usize = 2048;
/// #         async fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
/// #             self.0[from as usize..to as usize].fill(0xFF);
/// #             Ok(())
/// #         }
/// #         async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
/// #             self.0[offset as usize..][..bytes.len()].copy_from_slice(bytes);
/// #             Ok(())
/// #         }
/// #     }
/// # }
/// # let flash = ram::Flash([0xFF; 4096]);
/// # let example = async {
/// use armwire_bridge::Instant;
/// use armwire_bridge::config::{Config, Poll};
/// use armwire_bridge::store::{Saved, Store};
///
/// let mut store = Store::new(flash, 0..4096)?;
/// assert_eq!(store.load().await?, Saved::Nothing);
///
/// let config = Config { poll: Poll::Hertz(200), ..Config::default() };
/// store.save(&config, Instant::ZERO).await?;
/// assert_eq!(store.load().await?, Saved::Config(config));
///
/// store.reset(Instant::ZERO).await?;
/// assert_eq!(store.load().await?, Saved::Nothing);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// # };
/// # let mut context = std::task::Context::from_waker(std::task::Waker::noop());
/// # let result = std::future::Future::poll(std::pin::pin!(example), &mut context);
/// # assert!(matches!(result, std::task::Poll::Ready(Ok(()))));
/// ```
#[derive(Debug)]
pub struct Store<F> {
    flash: F,
    range: Range<u32>,
    /// Until when time has earned saves that a record counts.
    credited: Instant,
}

/// What is saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Saved {
    /// This configuration, which an adapter can have.
    Config(Config),
    /// None: there never was one, or it was reset.
    Nothing,
    /// Something that is no configuration of this version, or none that an adapter can have. It stays in flash until
    /// enough was saved after it. What went bad is such a thing, and so is the first that was ever saved if the power went
    /// meanwhile.
    Unreadable,
}

/// Why something was not saved. What was saved before still is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error<E> {
    /// No adapter can be like that.
    Config(ConfigError),
    /// The flash reports this.
    Flash(E),
    /// What was written is not what is read.
    VerifyFailed,
    /// The [budget](SAVE_BUDGET) is spent.
    TooManySaves {
        /// In how many seconds the next save may come, at least 1.
        wait_s: u16,
    },
}

/// A range of flash that is not made of two whole pages or more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadRange {
    /// The range.
    pub range: Range<u32>,
    /// The length of a page, in bytes.
    pub page: usize,
}

impl<F: NorFlash> Store<F> {
    /// The store in `range` of `flash`, which is used for nothing else.
    ///
    /// # Errors
    ///
    /// [`BadRange`] if that is not made of two whole pages or more, or pages are too short for a record.
    ///
    /// # Panics
    ///
    /// In no case that is known. This is the one part of the crate of which that is not proved, for `sequential_storage`
    /// has assertions of its own.
    pub fn new(flash: F, range: Range<u32>) -> Result<Self, BadRange> {
        let pages = range.len() / F::ERASE_SIZE;
        if pages < 2 || F::ERASE_SIZE < 2 * MAX_RECORD || QueueConfig::<F>::try_new(range.clone()).is_err() {
            return Err(BadRange {
                range,
                page: F::ERASE_SIZE,
            });
        }
        Ok(Self {
            flash,
            range,
            credited: Instant::ZERO,
        })
    }

    /// What is saved.
    ///
    /// # Errors
    ///
    /// [`Error::Flash`] if the flash cannot be read.
    pub async fn load(&mut self) -> Result<Saved, Error<F::Error>> {
        Ok(match self.newest().await? {
            (Some((_, record)), _) => record.saved(),
            (None, false) => Saved::Nothing,
            (None, true) => Saved::Unreadable,
        })
    }

    /// Saves a configuration, unless it is the one that is saved. Until this is done, what was saved before still is.
    ///
    /// `uptime` is the time since the adapter started.
    ///
    /// # Errors
    ///
    /// [`Error`] says what is wrong.
    pub async fn save(&mut self, config: &Config, uptime: Instant) -> Result<(), Error<F::Error>> {
        config.check().map_err(Error::Config)?;
        let mut content = [0; MAX_RECORD - HEAD];
        let content = postcard::to_slice(&(LAYOUT, config), &mut content).map_err(|_| Error::VerifyFailed)?;
        self.append(content, uptime).await
    }

    /// Forgets the configuration that is saved, in the same way as another is [saved](Self::save).
    ///
    /// # Errors
    ///
    /// [`Error`] says what is wrong.
    pub async fn reset(&mut self, uptime: Instant) -> Result<(), Error<F::Error>> {
        self.append(&[], uptime).await
    }

    /// Puts a record behind the newest, or on the next page if that one is full or spoilt.
    async fn append(&mut self, content: &[u8], uptime: Instant) -> Result<(), Error<F::Error>> {
        let (page, sequence, left) = match self.newest().await?.0 {
            Some((_, newest)) if newest.content() == content => return Ok(()),
            Some((page, newest)) => (page, newest.sequence().wrapping_add(1), newest.left()),
            None => (self.range.start, 0, SAVE_BUDGET),
        };
        let (left, credited) = self.earn(left, uptime);
        let Some(left) = left.checked_sub(1) else {
            let wait = (credited + SAVE_INTERVAL).since(uptime).as_micros();
            return Err(Error::TooManySaves {
                wait_s: (wait as u32).div_ceil(1_000_000) as u16,
            });
        };
        let record = Record::new(sequence, left, content).ok_or(Error::VerifyFailed)?;
        if self.push(page, &record).await.is_err() {
            let next = self.page_after(page);
            self.queue(next).erase_all().await.map_err(error)?;
            self.push(next, &record).await?;
        }
        self.credited = credited;
        Ok(())
    }

    /// The budget with the saves that time has earned, and the instant up to which time is counted. A full budget earns nothing.
    fn earn(&self, left: u16, uptime: Instant) -> (u16, Instant) {
        let (mut left, mut credited) = (left, self.credited);
        while left < SAVE_BUDGET {
            let next = credited + SAVE_INTERVAL;
            if next > uptime {
                return (left, credited);
            }
            (left, credited) = (left.saturating_add(1), next);
        }
        (SAVE_BUDGET, uptime)
    }

    /// Puts a record behind the last of a page, and looks whether it is there.
    async fn push(&mut self, page: u32, record: &Record) -> Result<(), Error<F::Error>> {
        self.queue(page).push(&record.0, false).await.map_err(error)?;
        match self.last(page).await? {
            Some(kept) if kept == *record => Ok(()),
            _ => Err(Error::VerifyFailed),
        }
    }

    /// The newest record and its page, and whether there is a page that was written to.
    async fn newest(&mut self) -> Result<(Option<(u32, Record)>, bool), Error<F::Error>> {
        let mut newest: Option<(u32, Record)> = None;
        let mut written = false;
        for page in self.range.clone().step_by(F::ERASE_SIZE) {
            // Before a look for records, for that finishes an erase that was cut.
            let mut front = [ERASED; FRONT];
            self.flash.read(page, &mut front).await.map_err(Error::Flash)?;
            written |= front.iter().any(|byte| *byte != ERASED);
            let is_newer = |record: &Record| newest.as_ref().is_none_or(|(_, newest)| record.is_newer_than(newest));
            match self.last(page).await {
                Ok(Some(record)) if is_newer(&record) => newest = Some((page, record)),
                Err(Error::Flash(error)) => return Err(Error::Flash(error)),
                Ok(_) => {}
                Err(_) => written = true,
            }
        }
        Ok((newest, written))
    }

    /// The last record of a page.
    async fn last(&mut self, page: u32) -> Result<Option<Record>, Error<F::Error>> {
        let mut queue = self.queue(page);
        let mut entries = queue.iter().await.map_err(error)?;
        let mut buffer = [0; MAX_RECORD];
        let mut last = None;
        while let Some(entry) = entries.next(&mut buffer).await.map_err(error)? {
            last = Record::read(&entry).or(last);
        }
        Ok(last)
    }

    fn page_after(&self, page: u32) -> u32 {
        let next = page.saturating_add(F::ERASE_SIZE as u32);
        if self.range.contains(&next) {
            next
        } else {
            self.range.start
        }
    }

    fn queue(&mut self, page: u32) -> QueueStorage<&mut F, Cache<Uncached, Uncached, Uncached>> {
        let config = QueueConfig::new(page..page.saturating_add(F::ERASE_SIZE as u32));
        QueueStorage::new(&mut self.flash, config, Cache::new_uncached())
    }
}

/// A sequence number and what is left of the budget, both little endian, and what is saved: nothing after a reset; otherwise
/// the layout and, in postcard format, the configuration.
#[derive(PartialEq)]
struct Record(Vec<u8, MAX_RECORD>);

impl Record {
    fn new(sequence: u32, left: u16, content: &[u8]) -> Option<Self> {
        let mut bytes = Vec::from_slice(&sequence.to_le_bytes()).ok()?;
        bytes.extend_from_slice(&left.to_le_bytes()).ok()?;
        bytes.extend_from_slice(content).ok()?;
        Some(Self(bytes))
    }

    fn read(bytes: &[u8]) -> Option<Self> {
        let bytes = Vec::from_slice(bytes).ok()?;
        (bytes.len() >= HEAD).then_some(Self(bytes))
    }

    fn sequence(&self) -> u32 {
        self.0.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
    }

    /// Saves that may follow this one.
    fn left(&self) -> u16 {
        let bytes = self.0.get(size_of::<u32>()..).and_then(<[u8]>::first_chunk);
        bytes.map_or(0, |bytes| u16::from_le_bytes(*bytes))
    }

    /// Whether it was saved later. Sequence numbers wrap.
    fn is_newer_than(&self, other: &Self) -> bool {
        self.sequence().wrapping_sub(other.sequence()).cast_signed() > 0
    }

    fn content(&self) -> &[u8] {
        self.0.get(HEAD..).unwrap_or_default()
    }

    fn saved(&self) -> Saved {
        match self.content() {
            [] => Saved::Nothing,
            [LAYOUT, config @ ..] => match postcard::take_from_bytes::<Config>(config) {
                Ok((config, [])) if config.check().is_ok() => Saved::Config(config),
                _ => Saved::Unreadable,
            },
            _ => Saved::Unreadable,
        }
    }
}

impl<E> From<Error<E>> for Failure {
    fn from(error: Error<E>) -> Self {
        match error {
            Error::TooManySaves { wait_s } => Self::TooManySaves { wait_s },
            Error::Config(_) | Error::Flash(_) | Error::VerifyFailed => Self::Flash,
        }
    }
}

fn error<E>(error: sequential_storage::Error<E>) -> Error<E> {
    match error {
        sequential_storage::Error::Storage { value, .. } => Error::Flash(value),
        _ => Error::VerifyFailed,
    }
}

impl<E: fmt::Debug> fmt::Display for Error<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(error) => error.fmt(f),
            Self::Flash(error) => write!(f, "the flash reports {error:?}"),
            Self::VerifyFailed => f.write_str("the flash does not keep what is written"),
            Self::TooManySaves { wait_s } => {
                write!(f, "the flash would wear out: the next save may come in {wait_s} s")
            }
        }
    }
}

impl<E: fmt::Debug> core::error::Error for Error<E> {}

impl fmt::Display for BadRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { range, page } = self;
        write!(
            f,
            "flash from {:#x} to {:#x} is not two pages of {page} bytes or more",
            range.start, range.end
        )
    }
}

impl core::error::Error for BadRange {}

#[cfg(test)]
mod tests;
