//! The content of the board's flash, and the effects of a loss of power.

use crate::chip::Chip;
use crate::error::Error;
use crate::image::Image;
use crate::soc::chance::draw;
use crate::time::Nanos;
use crate::timing::Clock;

/// The flash size of the STM32F405RG, in bytes.
pub(crate) const SIZE: usize = 1 << 20;

/// The nominal supply voltage, in millivolts.
pub(crate) const SUPPLY_MV: u32 = 3_300;

/// The value of an erased byte.
pub(crate) const ERASED: u8 = 0xFF;

/// The flash content, shared by the chip and the board's owner.
#[derive(Debug)]
pub(crate) struct Flash {
    bytes: Vec<u8>,
    /// Number of operations started.
    operations: u32,
    /// Number of operations before one is interrupted.
    left: Option<u32>,
    /// Time of the loss of power.
    pub(crate) cut: Option<Nanos>,
    /// The program's request for the supply.
    pub(crate) supply: Option<bool>,
    /// The supply voltage, in millivolts.
    pub(crate) millivolts: u32,
    /// Duration of operations.
    pub(crate) clock: Clock,
    /// Start and end of each sector erase.
    pub(crate) erases: Vec<(Nanos, Nanos)>,
    seed: u64,
}

impl Flash {
    pub(crate) fn new(bytes: Vec<u8>, cut_after: Option<u32>, clock: Clock) -> Self {
        Self {
            bytes,
            operations: 0,
            left: cut_after,
            cut: None,
            supply: None,
            millivolts: SUPPLY_MV,
            clock,
            erases: Vec::new(),
            seed: clock.seed,
        }
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Number of operations started.
    pub(crate) fn operations(&self) -> u32 {
        self.operations
    }

    pub(crate) fn cut_after(&mut self, operations: Option<u32>) {
        self.left = operations;
    }

    /// Starts an operation that lasts at least `shortest`. Returns the time of a loss of power within it, if any.
    pub(crate) fn start(&mut self, shortest: Nanos) -> Option<Nanos> {
        self.operations += 1;
        match &mut self.left {
            Some(0) => {
                self.left = None;
                let part = draw(self.seed, "power cut", self.operations.into()) % shortest.0.max(1);
                Some(Nanos(part))
            }
            Some(left) => {
                *left -= 1;
                None
            }
            None => None,
        }
    }

    /// The eight bytes at `word` words from the start.
    pub(crate) fn get(&self, word: usize) -> [u8; 8] {
        self.bytes.as_chunks().0.get(word).copied().unwrap_or([ERASED; 8])
    }

    pub(crate) fn set(&mut self, word: usize, value: [u8; 8]) {
        if let Some(held) = self.bytes.as_chunks_mut().0.get_mut(word) {
            *held = value;
        }
    }

    /// Changes the content from this offset on. Returns false, without a change, unless all bytes are inside.
    pub(crate) fn write(&mut self, offset: usize, bytes: &[u8]) -> bool {
        let range = offset..offset.saturating_add(bytes.len());
        let held = self.bytes.get_mut(range);
        held.map(|held| held.copy_from_slice(bytes)).is_some()
    }

    /// Random bits for the progress of an interrupted operation on `word`.
    pub(crate) fn chance(&self, word: usize) -> u64 {
        draw(self.seed ^ u64::from(self.operations), "interrupted", word as u64)
    }
}

/// The flash content of a chip, with `image` in it and `contents` around it.
pub(crate) fn around(image: &Image, contents: Option<Vec<u8>>, chip: Chip) -> Result<Vec<u8>, Error> {
    let size = chip.flash_size();
    let mut bytes = contents.unwrap_or_else(|| vec![ERASED; size]);
    if bytes.len() != size {
        return Err(Error::FlashSize { got: bytes.len(), size });
    }
    for (address, segment) in image.segments() {
        let start = address
            .checked_sub(chip.flash_base())
            .and_then(|start| usize::try_from(start).ok());
        if let Some(place) = start.and_then(|start| bytes.get_mut(start..start + segment.len())) {
            place.copy_from_slice(segment);
        }
    }
    Ok(bytes)
}

/// The result of an interrupted programming of `new` over `old`: some of the bits that it clears are clear.
pub(crate) fn programmed_in_part(old: u64, new: u64, chance: u64) -> u64 {
    old & (new | chance)
}

/// The result of an interrupted erase of `old`: some of the bits that it sets are set.
pub(crate) fn erased_in_part(old: u64, chance: u64) -> u64 {
    match chance % 4 {
        0 => old,
        1 => u64::MAX,
        _ => old | chance,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_operation_after_the_limit_is_interrupted() {
        let mut flash = Flash::new(vec![ERASED; SIZE], Some(2), Clock::default());
        let cuts: Vec<bool> = (0..5).map(|_| flash.start(Nanos(16_000)).is_some()).collect();
        assert_eq!(cuts, [false, false, true, false, false]);
        assert_eq!(flash.operations(), 5);
    }

    #[test]
    fn interrupted_operation_is_partly_done() {
        let (old, new) = (0xFFFF_FFFF_0F0F_0F0F, 0x1234_5678_0000_0000);
        let part = programmed_in_part(old, new, 0x5555_5555_5555_5555);
        assert_eq!(
            (part & !old, part & new),
            (0, new & old),
            "programming only clears the requested bits"
        );
        assert!(part != old && part != new);
        let words: Vec<u64> = (0..16).map(|nth| erased_in_part(0, draw(3, "test", nth))).collect();
        assert!(words.contains(&0) && words.contains(&u64::MAX));
        assert!(words.iter().any(|&word| word != 0 && word != u64::MAX));
    }
}
