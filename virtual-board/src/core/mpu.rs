//! The Memory Protection Unit (ARM DDI 0403E, B3.5).

use super::memory::Memory;

/// Bits of MPU_CTRL.
mod ctrl {
    pub(super) const ENABLE: u32 = 1;
    pub(super) const HFNMIENA: u32 = 1 << 1;
    pub(super) const PRIVDEFENA: u32 = 1 << 2;
}

/// The kind of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AccessKind {
    Read,
    Write,
    Execute,
}

/// A region in the format of MPU_RBAR and MPU_RASR.
#[derive(Clone, Copy, Debug, Default)]
struct Region {
    rbar: u32,
    rasr: u32,
}

impl Region {
    fn is_enabled(self) -> bool {
        self.rasr & 1 != 0
    }

    /// The size as a power of two: 5 to 32.
    fn size_bits(self) -> u32 {
        (self.rasr >> 1 & 31).max(4) + 1
    }

    fn base(self) -> u32 {
        // A region is aligned to its size.
        let mask = u32::MAX.checked_shl(self.size_bits()).unwrap_or(0);
        self.rbar & !0x1f & mask
    }

    fn contains(self, address: u32) -> bool {
        let offset = u64::from(address.wrapping_sub(self.base()));
        if !self.is_enabled() || offset >> self.size_bits() != 0 {
            return false;
        }
        // Regions of at least 256 bytes have eight subregions that can be disabled.
        let subregion = offset >> (self.size_bits() - 3) & 7;
        self.size_bits() < 8 || self.rasr >> (8 + subregion) & 1 == 0
    }

    /// The boundaries of the region and its subregions.
    fn borders(self) -> impl Iterator<Item = u64> {
        (0..=8).map(move |eighth| u64::from(self.base()) + (eighth << self.size_bits() >> 3))
    }

    /// Table B3-15.
    fn permits(self, kind: AccessKind, privileged: bool) -> bool {
        let (read, write) = match self.rasr >> 24 & 7 {
            1 => (privileged, privileged),
            2 => (true, privileged),
            3 => (true, true),
            5 => (privileged, false),
            6 | 7 => (true, false),
            _ => (false, false),
        };
        match kind {
            AccessKind::Read => read,
            AccessKind::Write => write,
            AccessKind::Execute => read && self.rasr >> 28 & 1 == 0,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Mpu {
    regions: Vec<Region>,
    ctrl: u32,
    selected: usize,
    /// A range of addresses with known permission to read and write: start and length.
    open: (u32, u32),
}

impl Mpu {
    pub(super) fn new(regions: u8) -> Self {
        Self {
            regions: vec![Region::default(); regions.into()],
            ctrl: 0,
            selected: 0,
            open: (0, u32::MAX),
        }
    }

    /// Returns true if reads and writes of an address are known to be permitted.
    #[inline(always)]
    pub(super) fn is_open(&self, address: u32) -> bool {
        address.wrapping_sub(self.open.0) < self.open.1
    }

    pub(super) fn is_enabled(&self) -> bool {
        self.ctrl & ctrl::ENABLE != 0
    }

    /// Returns true if a transfer is permitted (ValidateAddress(), B3.5.3). `handles_fault` is set at a negative
    /// priority: in NMI, HardFault, or with FAULTMASK.
    pub(super) fn permits(&self, address: u32, kind: AccessKind, privileged: bool, handles_fault: bool) -> bool {
        // The private peripheral bus always uses the default map.
        if !self.is_enabled() || address >> 20 == 0xe00 || handles_fault && self.ctrl & ctrl::HFNMIENA == 0 {
            return true;
        }
        // The region with the highest number wins.
        match self.regions.iter().rev().find(|region| region.contains(address)) {
            Some(region) => region.permits(kind, privileged),
            None => privileged && self.ctrl & ctrl::PRIVDEFENA != 0,
        }
    }

    /// Finds the longest range of the RAM with permission for all reads and writes.
    pub(super) fn update_window(&mut self, privileged: bool, memory: &Memory) {
        if !self.is_enabled() {
            self.open = (0, u32::MAX);
            return;
        }
        let ram = u64::from(memory.ram.base())..u64::from(memory.ram.base()) + memory.ram().len() as u64;
        let enabled = self.regions.iter().filter(|region| region.is_enabled());
        let mut borders: Vec<u64> = enabled
            .flat_map(|region| region.borders())
            .filter(|b| ram.contains(b))
            .collect();
        borders.extend([ram.start, ram.end]);
        borders.sort_unstable();
        let open = |at: u64| {
            let permits = |kind| self.permits(at as u32, kind, privileged, false);
            permits(AccessKind::Read) && permits(AccessKind::Write)
        };
        // Adjacent permitted ranges are merged.
        let mut best = 0..0;
        let mut part = 0..0;
        for pair in borders.windows(2).filter(|pair| pair[0] < pair[1]) {
            if !open(pair[0]) {
                continue;
            }
            part = if part.end == pair[0] && !part.is_empty() {
                part.start..pair[1]
            } else {
                pair[0]..pair[1]
            };
            if part.end - part.start > best.end - best.start {
                best = part.clone();
            }
        }
        self.open = (best.start as u32, (best.end - best.start) as u32);
    }

    /// Reads a register by its offset from MPU_TYPE. `None` if it does not exist.
    pub(super) fn read(&self, offset: u32) -> Option<u32> {
        let region = self.regions.get(self.selected).copied().unwrap_or_default();
        Some(match offset {
            0x00 => (self.regions.len() as u32) << 8,
            0x04 => self.ctrl,
            0x08 => self.selected as u32,
            0x0c | 0x14 | 0x1c | 0x24 => region.rbar & !0x1f | self.selected as u32,
            0x10 | 0x18 | 0x20 | 0x28 => region.rasr,
            _ => return None,
        })
    }

    /// Writes a register by its offset from MPU_TYPE. `None` if it does not exist.
    pub(super) fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        match offset {
            0x04 => self.ctrl = if self.regions.is_empty() { 0 } else { value & 7 },
            0x08 => self.selected = value as usize & 0xff,
            0x0c | 0x14 | 0x1c | 0x24 => {
                // VALID: the region's number is in the lowest bits.
                if value & 0x10 != 0 {
                    self.selected = value as usize & 15;
                }
                if let Some(region) = self.regions.get_mut(self.selected) {
                    region.rbar = value;
                }
            }
            0x10 | 0x18 | 0x20 | 0x28 => {
                if let Some(region) = self.regions.get_mut(self.selected) {
                    region.rasr = value & 0x173f_ff3f;
                }
            }
            _ => return None,
        }
        Some(())
    }
}
