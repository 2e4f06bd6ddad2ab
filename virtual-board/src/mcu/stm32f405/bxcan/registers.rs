//! The registers of bxCAN (RM0090, 32.9): their offsets, and the bits that the model uses.

pub(super) const MCR: u32 = 0x000;
pub(super) const MSR: u32 = 0x004;
pub(super) const TSR: u32 = 0x008;
pub(super) const RF0R: u32 = 0x00C;
pub(super) const RF1R: u32 = 0x010;
pub(super) const IER: u32 = 0x014;
pub(super) const ESR: u32 = 0x018;
pub(super) const BTR: u32 = 0x01C;

/// Transmit mailboxes and receive FIFOs: four registers each, the identifier first.
pub(super) const MAILBOXES: u32 = 0x180;
pub(super) const FIFOS: u32 = 0x1B0;
pub(super) const FIFOS_END: u32 = 0x1D0;
pub(super) const MAILBOX_SPAN: u32 = 0x10;
pub(super) const IDENTIFIER: u32 = 0x0;

pub(super) const FMR: u32 = 0x200;
pub(super) const FM1R: u32 = 0x204;
pub(super) const FS1R: u32 = 0x20C;
pub(super) const FFA1R: u32 = 0x214;
pub(super) const FA1R: u32 = 0x21C;
/// Filter banks: two registers each.
pub(super) const BANKS: u32 = 0x240;
pub(super) const BANKS_END: u32 = BANKS + 8 * BANK_COUNT as u32;

/// Returns true if there is a register at this offset.
pub(super) const fn has(offset: u32) -> bool {
    matches!(
        offset,
        MCR..=BTR | MAILBOXES..FIFOS_END | FMR | FM1R | FS1R | FFA1R | FA1R | BANKS..BANKS_END
    ) && offset.is_multiple_of(4)
}

/// Number of mailboxes, FIFOs and banks.
pub(super) const MAILBOX_COUNT: usize = 3;
pub(super) const FIFO_COUNT: usize = 2;
pub(super) const BANK_COUNT: usize = 28;

/// Fields of MCR (32.9.2).
pub(super) mod mcr {
    pub(in super::super) const INRQ: u32 = 1 << 0;
    pub(in super::super) const SLEEP: u32 = 1 << 1;
    pub(in super::super) const TXFP: u32 = 1 << 2;
    pub(in super::super) const RFLM: u32 = 1 << 3;
    pub(in super::super) const NART: u32 = 1 << 4;
    pub(in super::super) const AWUM: u32 = 1 << 5;
    pub(in super::super) const ABOM: u32 = 1 << 6;
    pub(in super::super) const RESET: u32 = 1 << 15;
    /// The bits that a write sets and a read returns: DBF, TTCM and the above except RESET.
    pub(in super::super) const WRITABLE: u32 = 0x0001_00FF;
    pub(in super::super) const AFTER_RESET: u32 = 0x0001_0002;
}

/// Fields of MSR.
pub(super) mod msr {
    pub(in super::super) const INAK: u32 = 1 << 0;
    pub(in super::super) const SLAK: u32 = 1 << 1;
    pub(in super::super) const ERRI: u32 = 1 << 2;
    pub(in super::super) const WKUI: u32 = 1 << 3;
    pub(in super::super) const SLAKI: u32 = 1 << 4;
    pub(in super::super) const TXM: u32 = 1 << 8;
    pub(in super::super) const RXM: u32 = 1 << 9;
    /// The receive pin is recessive, as between frames: SAMP and RX.
    pub(in super::super) const RECESSIVE: u32 = 3 << 10;
    pub(in super::super) const CLEARABLE: u32 = ERRI | WKUI | SLAKI;
}

/// Fields of TSR: those of mailbox 0; the other mailboxes' are eight bits up, or one bit up for TME and LOW.
pub(super) mod tsr {
    pub(in super::super) const RQCP: u32 = 1 << 0;
    pub(in super::super) const TXOK: u32 = 1 << 1;
    pub(in super::super) const ALST: u32 = 1 << 2;
    pub(in super::super) const TERR: u32 = 1 << 3;
    pub(in super::super) const ABRQ: u32 = 1 << 7;
    pub(in super::super) const CODE_AT: u32 = 24;
    pub(in super::super) const TME: u32 = 1 << 26;
    pub(in super::super) const LOW: u32 = 1 << 29;
}

/// Fields of RFxR.
pub(super) mod rfr {
    pub(in super::super) const FULL: u32 = 1 << 3;
    pub(in super::super) const FOVR: u32 = 1 << 4;
    pub(in super::super) const RFOM: u32 = 1 << 5;
}

/// Fields of IER.
pub(super) mod ier {
    pub(in super::super) const TMEIE: u32 = 1 << 0;
    /// FMPIE, FFIE and FOVIE of FIFO 0; those of FIFO 1 are three bits up.
    pub(in super::super) const FMPIE: u32 = 1 << 1;
    pub(in super::super) const FFIE: u32 = 1 << 2;
    pub(in super::super) const FOVIE: u32 = 1 << 3;
    pub(in super::super) const EWGIE: u32 = 1 << 8;
    pub(in super::super) const EPVIE: u32 = 1 << 9;
    pub(in super::super) const BOFIE: u32 = 1 << 10;
    pub(in super::super) const LECIE: u32 = 1 << 11;
    pub(in super::super) const ERRIE: u32 = 1 << 15;
    pub(in super::super) const WKUIE: u32 = 1 << 16;
    pub(in super::super) const SLKIE: u32 = 1 << 17;
    pub(in super::super) const WRITABLE: u32 = 0x0003_8F7F;
}

/// Fields of ESR.
pub(super) mod esr {
    pub(in super::super) const EWGF: u32 = 1 << 0;
    pub(in super::super) const EPVF: u32 = 1 << 1;
    pub(in super::super) const BOFF: u32 = 1 << 2;
    pub(in super::super) const LEC_AT: u32 = 4;
    pub(in super::super) const LEC: u32 = 7;
    pub(in super::super) const TEC_AT: u32 = 16;
    pub(in super::super) const REC_AT: u32 = 24;
}

/// Fields of BTR.
pub(super) mod btr {
    pub(in super::super) const BRP: u32 = 0x3FF;
    pub(in super::super) const TS1_AT: u32 = 16;
    pub(in super::super) const TS1: u32 = 0xF;
    pub(in super::super) const TS2_AT: u32 = 20;
    pub(in super::super) const TS2: u32 = 0x7;
    pub(in super::super) const LBKM: u32 = 1 << 30;
    pub(in super::super) const SILM: u32 = 1 << 31;
    pub(in super::super) const WRITABLE: u32 = 0xC37F_03FF;
    pub(in super::super) const AFTER_RESET: u32 = 0x0123_0000;
}

/// Fields of TIxR and RIxR.
pub(super) mod identifier {
    pub(in super::super) const TXRQ: u32 = 1 << 0;
    pub(in super::super) const RTR: u32 = 1 << 1;
    pub(in super::super) const IDE: u32 = 1 << 2;
    pub(in super::super) const EXID_AT: u32 = 3;
    pub(in super::super) const STID_AT: u32 = 21;
}

/// Fields of TDTxR and RDTxR.
pub(super) mod length {
    pub(in super::super) const DLC: u32 = 0xF;
    pub(in super::super) const FMI_AT: u32 = 8;
}

/// Fields of FMR.
pub(super) mod fmr {
    pub(in super::super) const FINIT: u32 = 1 << 0;
    pub(in super::super) const CAN2SB_AT: u32 = 8;
    pub(in super::super) const CAN2SB: u32 = 0x3F;
    pub(in super::super) const AFTER_RESET: u32 = 0x2A1C_0E01;
}
