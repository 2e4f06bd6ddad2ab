//! Registers of FDCAN1 (RM0440, 44.4), by their offsets, and their bits.

pub(super) const CREL: u32 = 0x000;
pub(super) const ENDN: u32 = 0x004;
pub(super) const DBTP: u32 = 0x00C;
pub(super) const TEST: u32 = 0x010;
pub(super) const RWD: u32 = 0x014;
pub(super) const CCCR: u32 = 0x018;
pub(super) const NBTP: u32 = 0x01C;
pub(super) const TSCC: u32 = 0x020;
pub(super) const TSCV: u32 = 0x024;
pub(super) const TOCC: u32 = 0x028;
pub(super) const TOCV: u32 = 0x02C;
pub(super) const ECR: u32 = 0x040;
pub(super) const PSR: u32 = 0x044;
pub(super) const TDCR: u32 = 0x048;
pub(super) const IR: u32 = 0x050;
pub(super) const IE: u32 = 0x054;
pub(super) const ILS: u32 = 0x058;
pub(super) const ILE: u32 = 0x05C;
pub(super) const RXGFC: u32 = 0x080;
pub(super) const XIDAM: u32 = 0x084;
pub(super) const HPMS: u32 = 0x088;
pub(super) const RXF0S: u32 = 0x090;
pub(super) const RXF0A: u32 = 0x094;
pub(super) const RXF1S: u32 = 0x098;
pub(super) const RXF1A: u32 = 0x09C;
pub(super) const TXBC: u32 = 0x0C0;
pub(super) const TXFQS: u32 = 0x0C4;
pub(super) const TXBRP: u32 = 0x0C8;
pub(super) const TXBAR: u32 = 0x0CC;
pub(super) const TXBCR: u32 = 0x0D0;
pub(super) const TXBTO: u32 = 0x0D4;
pub(super) const TXBCF: u32 = 0x0D8;
pub(super) const TXBTIE: u32 = 0x0DC;
pub(super) const TXBCIE: u32 = 0x0E0;
pub(super) const TXEFS: u32 = 0x0E4;
pub(super) const TXEFA: u32 = 0x0E8;
pub(super) const CKDIV: u32 = 0x100;

/// The name of a register with reserved bits, and the bits that may be written as 1 (44.4). CCCR has its own rules.
pub(super) const fn bits(offset: u32) -> Option<(&'static str, u32)> {
    /// The number of a receive buffer, or a bit for each transmit buffer.
    const BUFFERS: u32 = 0b111;
    Some(match offset {
        DBTP => ("DBTP", dbtp::WRITABLE),
        NBTP => ("NBTP", 0xFFFF_FF7F),
        TDCR => ("TDCR", TDCR_WRITABLE),
        IR => ("IR", ir::ALL),
        IE => ("IE", ir::ALL),
        ILS => ("ILS", ir::ALL_GROUPS),
        ILE => ("ILE", EINT0 | EINT1),
        RXGFC => ("RXGFC", 0x0F1F_033F),
        XIDAM => ("XIDAM", 0x1FFF_FFFF),
        RXF0A => ("RXF0A", BUFFERS),
        RXF1A => ("RXF1A", BUFFERS),
        TXBC => ("TXBC", TFQM),
        TXBAR => ("TXBAR", BUFFERS),
        TXBCR => ("TXBCR", BUFFERS),
        TXBTIE => ("TXBTIE", BUFFERS),
        TXBCIE => ("TXBCIE", BUFFERS),
        CKDIV => ("CKDIV", PDIV),
        _ => return None,
    })
}

/// Values of CREL and ENDN (44.4.1, 44.4.2).
pub(super) const RELEASE: u32 = 0x3214_1218;
pub(super) const ENDIANNESS: u32 = 0x8765_4321;

/// Fields of DBTP (44.4.3).
pub(super) mod dbtp {
    pub(in super::super) const DSJW: u32 = 0xF;
    pub(in super::super) const DTSEG2_AT: u32 = 4;
    pub(in super::super) const DTSEG2: u32 = 0xF;
    pub(in super::super) const DTSEG1_AT: u32 = 8;
    pub(in super::super) const DTSEG1: u32 = 0x1F;
    pub(in super::super) const DBRP_AT: u32 = 16;
    pub(in super::super) const DBRP: u32 = 0x1F;
    pub(in super::super) const TDC: u32 = 1 << 23;
    pub(in super::super) const AT_RESET: u32 = 0x0000_0A33;
    pub(in super::super) const WRITABLE: u32 = DSJW | DTSEG2 << DTSEG2_AT | DTSEG1 << DTSEG1_AT | DBRP << DBRP_AT | TDC;
}

/// Bits of CCCR (44.4.6).
pub(super) mod cccr {
    pub(in super::super) const INIT: u32 = 1;
    pub(in super::super) const CCE: u32 = 1 << 1;
    pub(in super::super) const CSA: u32 = 1 << 3;
    pub(in super::super) const CSR: u32 = 1 << 4;
    pub(in super::super) const MON: u32 = 1 << 5;
    pub(in super::super) const DAR: u32 = 1 << 6;
    pub(in super::super) const FDOE: u32 = 1 << 8;
    pub(in super::super) const BRSE: u32 = 1 << 9;
    pub(in super::super) const PXHD: u32 = 1 << 12;
    pub(in super::super) const TXP: u32 = 1 << 14;
    /// Bits that are writable only with CCE and INIT.
    pub(in super::super) const HELD: u32 = MON | DAR | FDOE | BRSE | PXHD | TXP;
    pub(in super::super) const MODELLED: u32 = INIT | CCE | CSA | CSR | MON | DAR | FDOE | BRSE | PXHD;
}

/// Fields of NBTP (44.4.7).
pub(super) mod nbtp {
    pub(in super::super) const NTSEG2: u32 = 0x7F;
    pub(in super::super) const NTSEG1_AT: u32 = 8;
    pub(in super::super) const NTSEG1: u32 = 0xFF;
    pub(in super::super) const NBRP_AT: u32 = 16;
    pub(in super::super) const NBRP: u32 = 0x1FF;
    pub(in super::super) const AT_RESET: u32 = 0x0600_0A03;
}

/// Fields of ECR (44.4.12).
pub(super) mod ecr {
    pub(in super::super) const REC_AT: u32 = 8;
    pub(in super::super) const REC: u32 = 0x7F;
    pub(in super::super) const RP: u32 = 1 << 15;
}

/// Fields of PSR (44.4.13).
pub(super) mod psr {
    /// Values of LEC and DLEC: no error, and no change since the last read.
    pub(in super::super) const NONE: u32 = 0;
    pub(in super::super) const UNCHANGED: u32 = 7;
    pub(in super::super) const ACT_AT: u32 = 3;
    pub(in super::super) const SYNCHRONIZING: u32 = 0;
    pub(in super::super) const IDLE: u32 = 1;
    pub(in super::super) const RECEIVER: u32 = 2;
    pub(in super::super) const TRANSMITTER: u32 = 3;
    pub(in super::super) const EP: u32 = 1 << 5;
    pub(in super::super) const EW: u32 = 1 << 6;
    pub(in super::super) const BO: u32 = 1 << 7;
    pub(in super::super) const DLEC_AT: u32 = 8;
    pub(in super::super) const RESI: u32 = 1 << 11;
    pub(in super::super) const RBRS: u32 = 1 << 12;
    pub(in super::super) const REDL: u32 = 1 << 13;
}

/// Fields of TDCR (44.4.14).
pub(super) const TDCR_WRITABLE: u32 = 0x7F << 8 | 0x7F;

/// Flags of IR and enables of IE (44.4.15, 44.4.16).
pub(super) mod ir {
    /// RF0N, RF0F and RF0L; those of FIFO 1 are three bits higher.
    pub(in super::super) const RFN: u32 = 1;
    pub(in super::super) const RFF: u32 = 1 << 1;
    pub(in super::super) const RFL: u32 = 1 << 2;
    pub(in super::super) const FIFO_BITS: usize = 3;
    pub(in super::super) const TC: u32 = 1 << 7;
    pub(in super::super) const TCF: u32 = 1 << 8;
    pub(in super::super) const TFE: u32 = 1 << 9;
    pub(in super::super) const EP: u32 = 1 << 17;
    pub(in super::super) const EW: u32 = 1 << 18;
    pub(in super::super) const BO: u32 = 1 << 19;
    pub(in super::super) const PEA: u32 = 1 << 21;
    pub(in super::super) const PED: u32 = 1 << 22;
    pub(in super::super) const ALL: u32 = (1 << 24) - 1;
    /// The flags of each group of ILS (44.4.17).
    pub(in super::super) const ALL_GROUPS: u32 = 0x7F;
    pub(in super::super) const GROUPS: [u32; 7] = [0x7, 0x38, 0x1C0, 0x1E00, 0xE000, 0x3_0000, 0xFC_0000];
}

/// Bits of ILE (44.4.18): the interrupt lines.
pub(super) const EINT0: u32 = 1;
pub(super) const EINT1: u32 = 1 << 1;

/// Fields of RXGFC (44.4.19).
pub(super) mod rxgfc {
    pub(in super::super) const RRFE: u32 = 1;
    pub(in super::super) const RRFS: u32 = 1 << 1;
    pub(in super::super) const ANFE_AT: u32 = 2;
    pub(in super::super) const ANFS_AT: u32 = 4;
    pub(in super::super) const F1OM: u32 = 1 << 8;
    pub(in super::super) const F0OM: u32 = 1 << 9;
    pub(in super::super) const LSS_AT: u32 = 16;
    pub(in super::super) const LSS: u32 = 0x1F;
    pub(in super::super) const LSE_AT: u32 = 24;
    pub(in super::super) const LSE: u32 = 0xF;
}

/// Fields of RXFnS (44.4.22, 44.4.24).
pub(super) mod rxfs {
    pub(in super::super) const FGI_AT: u32 = 8;
    pub(in super::super) const FPI_AT: u32 = 16;
    pub(in super::super) const FF: u32 = 1 << 24;
    pub(in super::super) const RFL: u32 = 1 << 25;
}

/// TFQM of TXBC (44.4.26): a queue rather than a FIFO.
pub(super) const TFQM: u32 = 1 << 24;

/// Fields of TXFQS (44.4.27).
pub(super) mod txfqs {
    pub(in super::super) const TFGI_AT: u32 = 8;
    pub(in super::super) const TFQPI_AT: u32 = 16;
    pub(in super::super) const TFQF: u32 = 1 << 21;
}

/// PDIV of CKDIV (44.4.37): the clock is divided by 1 or by twice this.
pub(super) const PDIV: u32 = 0xF;
