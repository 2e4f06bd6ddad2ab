//! The configuration in flash. A save is atomic at any loss of power.
//!
//! A save appends a record to a page. When the page is full, the next page is used, and erased before unless
//! [`prepare`](Store::prepare) has done so. All pages therefore wear evenly, and the newest record is never on a page that
//! is being erased. The record with the highest sequence number
//! is valid. Sequence numbers wrap, and no two in flash are half of the number range apart.
//!
//! A record with a wrong checksum is skipped: it remains from an interrupted save. A record that was corrupted later is
//! skipped, too, and the one before it becomes valid. If there is none, the store counts as unreadable, not as empty.
//!
//! Flash wears out: a page endures some 10 000 erases. Saves are therefore limited by a budget that lasts [ten
//! years](SAVE_INTERVAL) on every board, however often a host saves. Each record contains the rest of the budget: a
//! restart does not reset it. A configuration that is already saved is not written again and costs nothing. A save
//! interrupted by loss of power is not counted.
//!
//! Each page is a `sequential_storage` queue of its own. The queue finds the free space, skips an interrupted write,
//! and verifies each record by a checksum. The map of `sequential_storage` over all pages does not fit: it moves the
//! newest record from page to page, and detects an interrupted erase by marks at both ends of a page. The content of a
//! page after an interrupted erase is undefined (`embedded_storage_async::nor_flash::NorFlash::erase`), including the
//! marks, and a partly erased page could be taken for the valid one.
//!
//! Flash with ECC may report an error in a word that was being written at a loss of power. The driver or the interrupt
//! handler must tolerate it: the read then returns arbitrary bytes and continues.

use core::fmt;
use core::ops::Range;

use armwire::time::{Duration, Instant};
use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::queue::{QueueConfig, QueueStorage};

use crate::action::Erase;
use crate::config::{Config, ConfigError};
use crate::control::Failure;

pub use crate::config::Saved;

/// Number of saves in a row, starting with empty flash.
pub const SAVE_BUDGET: u16 = 1_000;

/// Uptime that earns one more save. Ten years earn 525 960.
pub const SAVE_INTERVAL: Duration = Duration::from_millis(10 * 60 * 1_000);

/// The layout of a record. An additional field in [`Config`] needs a new layout.
const LAYOUT: u8 = 2;

/// Maximum length of a record in this and every later layout, in bytes.
const MAX_RECORD: usize = 128;

/// The value of an erased byte.
const ERASED: u8 = 0xFF;

/// Number of bytes at the front of a page that show whether it was written: a mark of one word, and a record's header.
const FRONT: usize = 16;

/// The length of a record's header before its content, in bytes.
const HEAD: usize = size_of::<u32>() + size_of::<u16>();

/// The store of the configuration: two or more pages of flash.
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
/// use armwire_bridge::{Erase, Instant};
/// use armwire_bridge::config::{Config, Poll};
/// use armwire_bridge::store::{Saved, Store};
///
/// let mut store = Store::new(flash, 0..4096)?;
/// assert_eq!(store.load().await?, Saved::Nothing);
///
/// let config = Config { poll: Poll::Hertz(200), ..Config::default() };
/// store.save(&config, Instant::ZERO, Erase::Allowed).await?;
/// assert_eq!(store.load().await?, Saved::Config(config));
///
/// store.reset(Instant::ZERO, Erase::Allowed).await?;
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
    /// Uptime up to which earned saves are included in a record.
    credited: Instant,
}

/// The reason for a failed save. The previous content stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error<E> {
    /// The configuration is not valid.
    Config(ConfigError),
    /// The error of the flash driver.
    Flash(E),
    /// The data read back differs from the data written.
    VerifyFailed,
    /// Both the page of the newest record and the next one are full, and no [`Erase`] is allowed.
    NoRoom,
    /// The [budget](SAVE_BUDGET) is exhausted.
    TooManySaves {
        /// Time until the next save is possible, in seconds, at least 1.
        wait_s: u16,
    },
}

/// A range of flash that does not consist of two or more whole pages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadRange {
    /// The range.
    pub range: Range<u32>,
    /// The length of a page, in bytes.
    pub page: usize,
}

impl<F: NorFlash> Store<F> {
    /// A store in `range` of `flash`, which must have no other use.
    ///
    /// # Errors
    ///
    /// [`BadRange`] if `range` does not consist of two or more whole pages, or if pages are too short for a record.
    ///
    /// # Panics
    ///
    /// None known. This is the only part of the crate without a proof, because `sequential_storage` has assertions of
    /// its own.
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

    /// Reads the saved content.
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

    /// Erases the page behind that of the newest record, unless it is erased: later saves have room for as many records
    /// without an erase.
    ///
    /// # Errors
    ///
    /// [`Error::Flash`] if the flash cannot be read or erased.
    pub async fn prepare(&mut self) -> Result<(), Error<F::Error>> {
        let page = self.newest().await?.0.map_or(self.range.start, |(page, _)| page);
        self.clear(self.page_after(page)).await
    }

    /// Saves a configuration, unless it is already saved. The previous one stays valid until this completes.
    ///
    /// `uptime` is the time since the adapter started.
    ///
    /// # Errors
    ///
    /// [`Error`] has the reason.
    pub async fn save(&mut self, config: &Config, uptime: Instant, erase: Erase) -> Result<(), Error<F::Error>> {
        config.check().map_err(Error::Config)?;
        let mut content = [0; MAX_RECORD - HEAD];
        let content = postcard::to_slice(&(LAYOUT, config), &mut content).map_err(|_| Error::VerifyFailed)?;
        self.append(content, uptime, erase).await
    }

    /// Discards the saved configuration, by the same procedure as a [save](Self::save).
    ///
    /// # Errors
    ///
    /// [`Error`] has the reason.
    pub async fn reset(&mut self, uptime: Instant, erase: Erase) -> Result<(), Error<F::Error>> {
        self.append(&[], uptime, erase).await
    }

    /// Erases all pages without reading them: for a store whose content crashes a read. The budget begins anew.
    ///
    /// # Errors
    ///
    /// [`Error::Flash`] if the flash cannot be erased.
    pub async fn erase(&mut self) -> Result<(), Error<F::Error>> {
        let Range { start, end } = self.range;
        self.flash.erase(start, end).await.map_err(Error::Flash)
    }

    /// Appends a record after the newest, or on the next page if that page is full or corrupted.
    async fn append(&mut self, content: &[u8], uptime: Instant, erase: Erase) -> Result<(), Error<F::Error>> {
        let newest = self.newest().await?.0;
        let has_record = newest.is_some();
        let (page, sequence, left) = match newest {
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
        // The queue would erase a page without a record.
        let pushed = match has_record || self.is_erased(page).await? {
            true => self.push(page, &record).await,
            false => Err(Error::NoRoom),
        };
        if let Err(failed) = pushed {
            let next = self.page_after(page);
            match erase {
                Erase::Allowed => self.clear(next).await?,
                Erase::Refused if self.is_erased(next).await? => {}
                // The page may have had room.
                Erase::Refused if matches!(failed, Error::Flash(_)) => return Err(failed),
                Erase::Refused => return Err(Error::NoRoom),
            }
            self.push(next, &record).await?;
        }
        self.credited = credited;
        Ok(())
    }

    /// Erases a page, unless it is erased.
    async fn clear(&mut self, page: u32) -> Result<(), Error<F::Error>> {
        match self.is_erased(page).await? {
            true => Ok(()),
            false => self.queue(page).erase_all().await.map_err(error),
        }
    }

    /// Returns true if no byte of a page is written.
    async fn is_erased(&mut self, page: u32) -> Result<bool, Error<F::Error>> {
        for part in (page..page.saturating_add(F::ERASE_SIZE as u32)).step_by(MAX_RECORD) {
            let mut bytes = [ERASED; MAX_RECORD];
            self.flash.read(part, &mut bytes).await.map_err(Error::Flash)?;
            if bytes.iter().any(|byte| *byte != ERASED) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The budget including the saves earned since, and the uptime up to which they are counted. A full budget earns
    /// none.
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

    /// Appends a record to a page, and verifies it.
    async fn push(&mut self, page: u32, record: &Record) -> Result<(), Error<F::Error>> {
        self.queue(page).push(&record.0, false).await.map_err(error)?;
        match self.last(page).await? {
            Some(kept) if kept == *record => Ok(()),
            _ => Err(Error::VerifyFailed),
        }
    }

    /// The newest record with its page, and true if any page was written.
    async fn newest(&mut self) -> Result<(Option<(u32, Record)>, bool), Error<F::Error>> {
        let mut newest: Option<(u32, Record)> = None;
        let mut written = false;
        for page in self.range.clone().step_by(F::ERASE_SIZE) {
            // This comes before the search for records, which completes an interrupted erase.
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

/// A sequence number and the rest of the budget, both little endian, followed by the content: nothing after a reset;
/// otherwise the layout and the configuration in postcard format.
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

    /// The rest of the budget after this record.
    fn left(&self) -> u16 {
        let bytes = self.0.get(size_of::<u32>()..).and_then(<[u8]>::first_chunk);
        bytes.map_or(0, |bytes| u16::from_le_bytes(*bytes))
    }

    /// Returns true if this record was saved later. Sequence numbers wrap.
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
            Error::NoRoom => Self::NoRoom,
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
            Self::VerifyFailed => f.write_str("flash verification failed"),
            Self::NoRoom => f.write_str("the flash has no room without an erase"),
            Self::TooManySaves { wait_s } => {
                write!(f, "too many saves for the flash: retry in {wait_s} s")
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
