//! The registers of OTG_FS in device mode (RM0090, 34.16): their offsets and bits.
//!
//! Only device registers are included. An access to a host register is deliberately an access to a hole, which fails
//! the run.

/// Number of endpoints of the core in each direction, including endpoint 0 (34.1).
pub(super) const ENDPOINTS: usize = 4;

// Global registers (34.16.2).
pub(super) const GOTGCTL: u32 = 0x000;
pub(super) const GOTGINT: u32 = 0x004;
pub(super) const GAHBCFG: u32 = 0x008;
pub(super) const GUSBCFG: u32 = 0x00C;
pub(super) const GRSTCTL: u32 = 0x010;
pub(super) const GINTSTS: u32 = 0x014;
pub(super) const GINTMSK: u32 = 0x018;
pub(super) const GRXSTSR: u32 = 0x01C;
pub(super) const GRXSTSP: u32 = 0x020;
pub(super) const GRXFSIZ: u32 = 0x024;
pub(super) const DIEPTXF0: u32 = 0x028;
pub(super) const GCCFG: u32 = 0x038;
pub(super) const CID: u32 = 0x03C;
/// Not in the manual. Drivers for this core in any chip read the width of the PHY interface here, which has no meaning
/// for this chip's internal PHY. It reads zero.
pub(super) const GHWCFG4: u32 = 0x050;
pub(super) const DIEPTXF1: u32 = 0x104;
pub(super) const DIEPTXF2: u32 = 0x108;
pub(super) const DIEPTXF3: u32 = 0x10C;

// Device registers (34.16.4).
pub(super) const DCFG: u32 = 0x800;
pub(super) const DCTL: u32 = 0x804;
pub(super) const DSTS: u32 = 0x808;
pub(super) const DIEPMSK: u32 = 0x810;
pub(super) const DOEPMSK: u32 = 0x814;
pub(super) const DAINT: u32 = 0x818;
pub(super) const DAINTMSK: u32 = 0x81C;
pub(super) const DIEPEMPMSK: u32 = 0x834;
/// Each endpoint has [`ENDPOINT_SPAN`] bytes of registers from here, IN and OUT.
pub(super) const DIEP: u32 = 0x900;
pub(super) const DOEP: u32 = 0xB00;
pub(super) const ENDPOINT_SPAN: u32 = 0x20;
const DIEP_END: u32 = DIEP + ENDPOINTS as u32 * ENDPOINT_SPAN;
const DOEP_END: u32 = DOEP + ENDPOINTS as u32 * ENDPOINT_SPAN;
// Within an endpoint's registers.
pub(super) const CTL: u32 = 0x00;
pub(super) const INT: u32 = 0x08;
pub(super) const TSIZ: u32 = 0x10;
pub(super) const TXFSTS: u32 = 0x18;

/// Power and clock gating (34.16.5).
pub(super) const PCGCCTL: u32 = 0xE00;

/// The FIFO windows, 4 KiB for each endpoint (34.16.1).
pub(super) const FIFO: u32 = 0x1000;
pub(super) const FIFO_SPAN: u32 = 0x1000;
const FIFO_END: u32 = FIFO + ENDPOINTS as u32 * FIFO_SPAN;

/// The name of the register or FIFO window at this offset, if there is one. Endpoint registers are named by their
/// offset.
pub(super) const fn name(offset: u32) -> Option<&'static str> {
    Some(match offset {
        GOTGCTL => "GOTGCTL",
        GOTGINT => "GOTGINT",
        GAHBCFG => "GAHBCFG",
        GUSBCFG => "GUSBCFG",
        GRSTCTL => "GRSTCTL",
        GINTSTS => "GINTSTS",
        GINTMSK => "GINTMSK",
        GRXSTSR => "GRXSTSR",
        GRXSTSP => "GRXSTSP",
        GRXFSIZ => "GRXFSIZ",
        DIEPTXF0 => "DIEPTXF0",
        GCCFG => "GCCFG",
        CID => "CID",
        GHWCFG4 => "GHWCFG4",
        DIEPTXF1 => "DIEPTXF1",
        DIEPTXF2 => "DIEPTXF2",
        DIEPTXF3 => "DIEPTXF3",
        DCFG => "DCFG",
        DCTL => "DCTL",
        DSTS => "DSTS",
        DIEPMSK => "DIEPMSK",
        DOEPMSK => "DOEPMSK",
        DAINT => "DAINT",
        DAINTMSK => "DAINTMSK",
        DIEPEMPMSK => "DIEPEMPMSK",
        PCGCCTL => "PCGCCTL",
        DIEP..DIEP_END => match (offset - DIEP) % ENDPOINT_SPAN {
            CTL => "DIEPCTL",
            INT => "DIEPINT",
            TSIZ => "DIEPTSIZ",
            TXFSTS => "DTXFSTS",
            _ => return None,
        },
        DOEP..DOEP_END => match (offset - DOEP) % ENDPOINT_SPAN {
            CTL => "DOEPCTL",
            INT => "DOEPINT",
            TSIZ => "DOEPTSIZ",
            _ => return None,
        },
        FIFO..FIFO_END if (offset - FIFO).is_multiple_of(FIFO_SPAN) => "FIFO",
        _ => return None,
    })
}

/// The bits of a register that may be written as 1 in device mode (34.16.2, 34.16.4, 34.16.5). Endpoint 0 has fewer.
/// GINTSTS takes all: drivers, also the manufacturer's, clear its flags by a write of all ones.
pub(super) const fn bits(offset: u32) -> u32 {
    match offset {
        GOTGCTL => 0x000F_0F03,
        GOTGINT => 0x000E_0304,
        GAHBCFG => 0x181,
        GUSBCFG => 0xE000_3F47,
        GRSTCTL => 0x8000_07F7,
        GINTMSK => 0xF73E_FCFE,
        GRXFSIZ | DIEPEMPMSK => 0xFFFF,
        GCCFG => 0x003D_0000,
        DCFG => 0x1FF7,
        DCTL => 0xFFF,
        DIEPMSK => 0x7B,
        DOEPMSK => 0x1B,
        PCGCCTL => 0x13,
        DIEP..DIEP_END => match ((offset - DIEP) % ENDPOINT_SPAN, offset < DIEP + ENDPOINT_SPAN) {
            (CTL, true) => 0xCFEE_8003,
            (CTL, false) => 0xFFEF_87FF,
            (INT, _) => 0xDB,
            (TSIZ, true) => 0x0018_007F,
            (TSIZ, false) => 0x7FFF_FFFF,
            _ => 0,
        },
        DOEP..DOEP_END => match ((offset - DOEP) % ENDPOINT_SPAN, offset < DOEP + ENDPOINT_SPAN) {
            (CTL, true) => 0xCC3E_8003,
            (CTL, false) => 0xFC3F_87FF,
            (INT, _) => 0x5B,
            (TSIZ, true) => 0x6008_007F,
            (TSIZ, false) => 0x7FFF_FFFF,
            _ => 0,
        },
        _ => u32::MAX,
    }
}

/// Returns true for a write that sets MCNT of endpoint 0, which has none. Drivers for this core do so.
pub(super) const fn is_reserved_count(offset: u32, value: u32) -> bool {
    offset == DIEP + TSIZ && value & eptsiz::MCNT != 0
}

/// Returns true if a read of the register pops the receive FIFO.
pub(super) const fn pops(offset: u32) -> bool {
    offset == GRXSTSP || offset >= FIFO
}

/// Bits of GAHBCFG.
pub(super) mod gahbcfg {
    pub(in super::super) const GINTMSK: u32 = 1 << 0;
    pub(in super::super) const TXFELVL: u32 = 1 << 7;
}

/// Bits of GOTGCTL and GOTGINT.
pub(super) mod gotg {
    /// GOTGCTL: the connector's ID pin indicates a B-device.
    pub(in super::super) const CIDSTS: u32 = 1 << 16;
    /// GOTGCTL: the bus voltage is present.
    pub(in super::super) const BSVLD: u32 = 1 << 19;
    /// GOTGINT: the session ended.
    pub(in super::super) const SEDET: u32 = 1 << 2;
}

/// Bits of GRSTCTL.
pub(super) mod grstctl {
    pub(in super::super) const CSRST: u32 = 1 << 0;
    pub(in super::super) const RXFFLSH: u32 = 1 << 4;
    pub(in super::super) const TXFFLSH: u32 = 1 << 5;
    pub(in super::super) const TXFNUM_AT: u32 = 6;
    pub(in super::super) const TXFNUM: u32 = 0x1F << TXFNUM_AT;
    /// The TXFNUM value for all transmit FIFOs.
    pub(in super::super) const ALL: u32 = 0x10;
    pub(in super::super) const AHBIDL: u32 = 1 << 31;
}

/// Bits of GINTSTS and GINTMSK.
pub(super) mod gint {
    pub(in super::super) const OTGINT: u32 = 1 << 2;
    pub(in super::super) const SOF: u32 = 1 << 3;
    pub(in super::super) const RXFLVL: u32 = 1 << 4;
    pub(in super::super) const NPTXFE: u32 = 1 << 5;
    pub(in super::super) const GINAKEFF: u32 = 1 << 6;
    pub(in super::super) const GONAKEFF: u32 = 1 << 7;
    pub(in super::super) const ESUSP: u32 = 1 << 10;
    pub(in super::super) const USBSUSP: u32 = 1 << 11;
    pub(in super::super) const USBRST: u32 = 1 << 12;
    pub(in super::super) const ENUMDNE: u32 = 1 << 13;
    pub(in super::super) const IEPINT: u32 = 1 << 18;
    pub(in super::super) const OEPINT: u32 = 1 << 19;
    pub(in super::super) const PTXFE: u32 = 1 << 26;
    pub(in super::super) const SRQINT: u32 = 1 << 30;
    pub(in super::super) const WKUPINT: u32 = 1 << 31;

    /// Flags set by the core and cleared by writing 1.
    pub(in super::super) const LATCHED: u32 = SOF | ESUSP | USBSUSP | USBRST | ENUMDNE | SRQINT | WKUPINT;
}

/// Fields of GRXSTSR and GRXSTSP, and the values of PKTSTS in device mode.
pub(super) mod grxsts {
    pub(in super::super) const BCNT_AT: u32 = 4;
    pub(in super::super) const DPID_AT: u32 = 15;
    pub(in super::super) const PKTSTS_AT: u32 = 17;
    pub(in super::super) const GLOBAL_OUT_NAK: u32 = 1;
    pub(in super::super) const OUT_DATA: u32 = 2;
    pub(in super::super) const OUT_DONE: u32 = 3;
    pub(in super::super) const SETUP_DONE: u32 = 4;
    pub(in super::super) const SETUP_DATA: u32 = 6;
}

/// Bits of GCCFG.
pub(super) mod gccfg {
    /// Enables the transceiver.
    pub(in super::super) const PWRDWN: u32 = 1 << 16;
    pub(in super::super) const VBUSBSEN: u32 = 1 << 19;
    pub(in super::super) const NOVBUSSENS: u32 = 1 << 21;
}

/// Fields of DCFG, DCTL and DSTS.
pub(super) mod device {
    /// DCFG: the device's address.
    pub(in super::super) const DAD_AT: u32 = 4;
    pub(in super::super) const DAD: u32 = 0x7F << DAD_AT;
    /// DCFG: the requested speed; a core reset keeps it.
    pub(in super::super) const DSPD: u32 = 3;
    /// DCTL: soft disconnect.
    pub(in super::super) const SDIS: u32 = 1 << 1;
    /// DCTL: global NAK in force, for IN and for OUT.
    pub(in super::super) const GINSTS: u32 = 1 << 2;
    pub(in super::super) const GONSTS: u32 = 1 << 3;
    /// DCTL: set and clear bits of the global NAKs.
    pub(in super::super) const SGINAK: u32 = 1 << 7;
    pub(in super::super) const CGINAK: u32 = 1 << 8;
    pub(in super::super) const SGONAK: u32 = 1 << 9;
    pub(in super::super) const CGONAK: u32 = 1 << 10;
    /// DSTS: suspended.
    pub(in super::super) const SUSPSTS: u32 = 1 << 0;
    /// DSTS: full speed, with the PHY at 48 MHz.
    pub(in super::super) const ENUMSPD_FULL: u32 = 3 << 1;
    /// DSTS: the number of the last frame.
    pub(in super::super) const FNSOF_AT: u32 = 8;
}

/// Bits of DIEPCTLx and DOEPCTLx.
pub(super) mod epctl {
    pub(in super::super) const MPSIZ: u32 = 0x7FF;
    pub(in super::super) const USBAEP: u32 = 1 << 15;
    /// The next data PID: DATA1 when set.
    pub(in super::super) const DPID: u32 = 1 << 16;
    pub(in super::super) const NAKSTS: u32 = 1 << 17;
    pub(in super::super) const STALL: u32 = 1 << 21;
    pub(in super::super) const CNAK: u32 = 1 << 26;
    pub(in super::super) const SNAK: u32 = 1 << 27;
    pub(in super::super) const SD0PID: u32 = 1 << 28;
    pub(in super::super) const SD1PID: u32 = 1 << 29;
    pub(in super::super) const EPDIS: u32 = 1 << 30;
    pub(in super::super) const EPENA: u32 = 1 << 31;
}

/// Bits of DIEPINTx and DOEPINTx.
pub(super) mod epint {
    pub(in super::super) const XFRC: u32 = 1 << 0;
    pub(in super::super) const EPDISD: u32 = 1 << 1;
    /// OUT: a SETUP phase has ended.
    pub(in super::super) const STUP: u32 = 1 << 3;
    /// IN: a token arrived while the FIFO held no packet.
    pub(in super::super) const ITTXFE: u32 = 1 << 4;
    /// OUT: a token arrived while the endpoint was not enabled.
    pub(in super::super) const OTEPDIS: u32 = 1 << 4;
    /// IN: a NAK has taken effect.
    pub(in super::super) const INEPNE: u32 = 1 << 6;
    /// IN: the FIFO is empty, or half empty; read only.
    pub(in super::super) const TXFE: u32 = 1 << 7;
}

/// Fields of DIEPTSIZx and DOEPTSIZx. Endpoint 0 has fewer bits of each.
pub(super) mod eptsiz {
    pub(in super::super) const XFRSIZ: u32 = 0x7_FFFF;
    pub(in super::super) const PKTCNT_AT: u32 = 19;
    pub(in super::super) const PKTCNT: u32 = 0x3FF << PKTCNT_AT;
    /// DIEPTSIZx: number of packets in a frame. It has no effect.
    pub(in super::super) const MCNT: u32 = 3 << 29;
    /// DOEPTSIZ0: number of further SETUP packets that the firmware has room for.
    pub(in super::super) const STUPCNT_AT: u32 = 29;
    pub(in super::super) const STUPCNT: u32 = 3 << STUPCNT_AT;
}
