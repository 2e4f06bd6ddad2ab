//! The acceptance filters (RM0090, 32.7.4): 28 banks. Banks below CAN2SB belong to CAN1.

use super::registers::*;

/// The FIFO of a frame, and the number of the matching filter, as in RDTxR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Match {
    pub(super) fifo: usize,
    pub(super) index: u32,
}

/// The filter registers.
#[derive(Debug)]
pub(super) struct Filters {
    control: u32,
    list: u32,
    wide: u32,
    assignment: u32,
    active: u32,
    banks: [[u32; 2]; BANK_COUNT],
}

impl Default for Filters {
    fn default() -> Self {
        Self {
            control: fmr::AFTER_RESET,
            list: 0,
            wide: 0,
            assignment: 0,
            active: 0,
            banks: [[0; 2]; BANK_COUNT],
        }
    }
}

/// One bit for each bank.
const ALL_BANKS: u32 = (1 << BANK_COUNT) - 1;

/// The layout of a bank: its width in bits, and list or mask mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shape {
    wide: bool,
    list: bool,
}

impl Shape {
    /// Number of filters in a bank.
    fn filters(self) -> u32 {
        match self {
            Self {
                wide: true,
                list: false,
            } => 1,
            Self { wide: true, list: true }
            | Self {
                wide: false,
                list: false,
            } => 2,
            Self {
                wide: false,
                list: true,
            } => 4,
        }
    }

    /// The priority of the layout: 32 bits before 16, then lists before masks.
    fn rank(self) -> u32 {
        u32::from(!self.wide) << 1 | u32::from(!self.list)
    }

    /// The index of the filter in `bank` that accepts a frame with this identifier register.
    fn matches(self, [first, second]: [u32; 2], identifier: u32) -> Option<u32> {
        let short = short(identifier);
        let halves = [first & 0xFFFF, first >> 16, second & 0xFFFF, second >> 16];
        // The lowest bit of a wide filter is reserved.
        let wide = |filter: u32, mask: u32| (identifier ^ filter) & mask & !1 == 0;
        let place = match self {
            Self {
                wide: true,
                list: false,
            } => wide(first, second).then_some(0),
            Self { wide: true, list: true } => [first, second].iter().position(|&filter| wide(filter, !0)),
            Self {
                wide: false,
                list: false,
            } => halves
                .as_chunks::<2>()
                .0
                .iter()
                .position(|[filter, mask]| (short ^ filter) & mask == 0),
            Self {
                wide: false,
                list: true,
            } => halves.iter().position(|&filter| filter == short),
        };
        place.map(|place| place as u32)
    }
}

/// An identifier register in the format of 16-bit filters (figure "Filter bank scale configuration"): STID, RTR, IDE
/// and the three highest bits of EXID.
fn short(identifier: u32) -> u32 {
    let bit = |mask: u32| u32::from(identifier & mask != 0);
    (identifier >> identifier::STID_AT) << 5
        | bit(identifier::RTR) << 4
        | bit(identifier::IDE) << 3
        | identifier >> (identifier::EXID_AT + 15) & 7
}

impl Filters {
    pub(super) fn read(&self, offset: u32) -> u32 {
        match offset {
            FMR => self.control,
            FM1R => self.list,
            FS1R => self.wide,
            FFA1R => self.assignment,
            FA1R => self.active,
            BANKS..BANKS_END => self.banks[bank(offset)][register(offset)],
            _ => 0,
        }
    }

    /// Modes, widths and assignments change only while FINIT is set; a bank also while it is not active (32.9.4).
    pub(super) fn write(&mut self, offset: u32, value: u32) {
        let open = self.control & fmr::FINIT != 0;
        let banks = value & ALL_BANKS;
        match offset {
            FMR => {
                let writable = fmr::FINIT | fmr::CAN2SB << fmr::CAN2SB_AT;
                self.control = self.control & !writable | value & writable;
            }
            FM1R if open => self.list = banks,
            FS1R if open => self.wide = banks,
            FFA1R if open => self.assignment = banks,
            FA1R => self.active = banks,
            BANKS..BANKS_END if open || self.active >> bank(offset) & 1 == 0 => {
                self.banks[bank(offset)][register(offset)] = value;
            }
            _ => {}
        }
    }

    /// The match of a frame with this identifier register, if any. While FINIT is set, no frame is received.
    pub(super) fn find(&self, identifier: u32) -> Option<Match> {
        if self.control & fmr::FINIT != 0 {
            return None;
        }
        let own = (self.control >> fmr::CAN2SB_AT & fmr::CAN2SB) as usize;
        let mut numbers = [0; FIFO_COUNT];
        let mut found: Option<(u32, Match)> = None;
        for (bank, &registers) in self.banks.iter().enumerate().take(own) {
            let is_set = |bits: u32| bits >> bank & 1 == 1;
            let shape = Shape {
                wide: is_set(self.wide),
                list: is_set(self.list),
            };
            let fifo = usize::from(is_set(self.assignment));
            let place = is_set(self.active)
                .then(|| shape.matches(registers, identifier))
                .flatten();
            if let Some(place) = place
                && found.is_none_or(|(rank, _)| shape.rank() < rank)
            {
                let index = numbers[fifo] + place;
                found = Some((shape.rank(), Match { fifo, index }));
            }
            // Inactive banks are numbered too.
            numbers[fifo] += shape.filters();
        }
        found.map(|(_, found)| found)
    }
}

fn bank(offset: u32) -> usize {
    ((offset - BANKS) / 8) as usize
}

fn register(offset: u32) -> usize {
    usize::from(offset & 4 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STANDARD: u32 = 0x123 << identifier::STID_AT;

    fn filters(writes: &[(u32, u32)]) -> Filters {
        let mut filters = Filters::default();
        for &(offset, value) in writes {
            filters.write(offset, value);
        }
        filters.write(FMR, filters.control & !fmr::FINIT);
        filters
    }

    fn found(filters: &Filters, identifier: u32) -> Option<(usize, u32)> {
        filters.find(identifier).map(|found| (found.fifo, found.index))
    }

    #[test]
    fn zero_mask_accepts_all_no_filter_accepts_none() {
        let open = filters(&[(FS1R, 1), (FA1R, 1)]);
        assert_eq!(found(&open, STANDARD), Some((0, 0)));
        assert_eq!(found(&open, 0x1234_5678 << 3 | identifier::IDE), Some((0, 0)));
        assert_eq!(found(&filters(&[(FS1R, 1)]), STANDARD), None);
    }

    #[test]
    fn wide_mask_compares_the_bits_it_has() {
        let mask = 0x7F0 << identifier::STID_AT | identifier::IDE | identifier::RTR;
        let filters = filters(&[
            (FS1R, 1),
            (BANKS, 0x120 << identifier::STID_AT),
            (BANKS + 4, mask),
            (FA1R, 1),
        ]);
        assert_eq!(found(&filters, STANDARD), Some((0, 0)));
        assert_eq!(found(&filters, 0x130 << identifier::STID_AT), None);
        assert_eq!(found(&filters, STANDARD | identifier::IDE), None, "29 bits");
        assert_eq!(found(&filters, STANDARD | identifier::RTR), None, "remote");
    }

    #[test]
    fn wide_list_has_two_identifiers() {
        let filters = filters(&[
            (FS1R, 1),
            (FM1R, 1),
            (BANKS, STANDARD),
            (BANKS + 4, 5 << 3 | identifier::IDE),
            (FA1R, 1),
        ]);
        assert_eq!(found(&filters, STANDARD), Some((0, 0)));
        assert_eq!(found(&filters, 5 << 3 | identifier::IDE), Some((0, 1)));
        assert_eq!(found(&filters, 0x124 << identifier::STID_AT), None);
    }

    #[test]
    fn narrow_filters_have_two_masks_or_four_identifiers() {
        let id = |id: u32| id << 5;
        let masks = filters(&[
            (BANKS, id(0x7F0) << 16 | id(0x120)),
            (BANKS + 4, id(0x7FF) << 16 | id(0x456)),
            (FA1R, 1),
        ]);
        assert_eq!(found(&masks, STANDARD), Some((0, 0)));
        assert_eq!(found(&masks, 0x456 << identifier::STID_AT), Some((0, 1)));
        assert_eq!(found(&masks, 0x457 << identifier::STID_AT), None);
        let list = filters(&[
            (FM1R, 1),
            (BANKS, id(2) << 16 | id(1)),
            (BANKS + 4, id(0x123) << 16 | id(3)),
            (FA1R, 1),
        ]);
        assert_eq!(found(&list, STANDARD), Some((0, 3)));
        assert_eq!(found(&list, STANDARD | identifier::RTR), None);
    }

    #[test]
    fn filters_are_numbered_per_fifo_through_disabled_banks() {
        // Bank 0: two filters for FIFO 0, off. Bank 1: one for FIFO 1. Bank 2: one for FIFO 0.
        let filters = filters(&[
            (FS1R, 0b110),
            (FFA1R, 0b010),
            (BANKS + 8, 7 << identifier::STID_AT),
            (BANKS + 12, !0),
            (FA1R, 0b110),
        ]);
        assert_eq!(found(&filters, 7 << identifier::STID_AT), Some((1, 0)));
        assert_eq!(found(&filters, STANDARD), Some((0, 2)));
    }

    #[test]
    fn wide_filter_before_narrow_and_list_before_mask() {
        let narrow = 0x123 << 5;
        // Narrow list, wide mask that takes all, wide list.
        let writes = [
            (FM1R, 0b101),
            (FS1R, 0b110),
            (FFA1R, 0b010),
            (BANKS, narrow),
            (BANKS + 16, STANDARD),
            (FA1R, 0b111),
        ];
        assert_eq!(found(&filters(&writes), STANDARD), Some((0, 4)), "the wide list");
        let mut without = writes;
        without[5] = (FA1R, 0b011);
        assert_eq!(found(&filters(&without), STANDARD), Some((1, 0)), "the wide mask");
    }

    #[test]
    fn lower_bank_and_place_win_among_equals() {
        let two = |assignment| {
            filters(&[
                (FS1R, 0b11),
                (FM1R, 0b11),
                (FFA1R, assignment),
                (BANKS, STANDARD),
                (BANKS + 4, STANDARD),
                (BANKS + 8, STANDARD),
                (FA1R, 0b11),
            ])
        };
        assert_eq!(found(&two(0b10), STANDARD), Some((0, 0)));
        assert_eq!(found(&two(0b01), STANDARD), Some((1, 0)));
    }

    #[test]
    fn narrow_filter_sees_rtr_ide_and_three_bits() {
        // Only these five bits are compared; bits 17 to 15 of the 29-bit identifier are 101.
        let filter = 0b1_1111 << 16 | 0b0_1101;
        let narrow = filters(&[(BANKS, filter), (BANKS + 4, filter), (FA1R, 1)]);
        let wide = |low: u32| low << identifier::EXID_AT | identifier::IDE;
        assert_eq!(found(&narrow, wide(0b101 << 15 | 0x7FFF)), Some((0, 0)));
        assert_eq!(found(&narrow, wide(0b100 << 15)), None);
        assert_eq!(found(&narrow, wide(0b101 << 15) | identifier::RTR), None);
        assert_eq!(found(&narrow, STANDARD), None);
    }

    #[test]
    fn banks_from_can2sb_on_are_can2s() {
        let filters = filters(&[(FMR, 1 << fmr::CAN2SB_AT | 1), (FS1R, 0b10), (FA1R, 0b10)]);
        assert_eq!(found(&filters, STANDARD), None);
    }

    #[test]
    fn bank_in_use_is_write_protected() {
        let mut filters = filters(&[(FS1R, 1), (FA1R, 1)]);
        filters.write(BANKS, 5);
        filters.write(FS1R, 0);
        assert_eq!((filters.read(BANKS), filters.read(FS1R)), (0, 1));
        filters.write(FA1R, 0);
        filters.write(BANKS, 5);
        assert_eq!(filters.read(BANKS), 5);
        filters.write(FMR, fmr::FINIT);
        assert_eq!(found(&filters, STANDARD), None, "no reception while FINIT is set");
    }
}
