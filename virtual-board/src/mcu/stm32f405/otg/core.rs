//! The device controller (RM0090, chapter 34, in device and slave mode): its registers, and its interface to the wire.
//!
//! | Behaviour | Section |
//! |---|---|
//! | Pull-up: transceiver on, session valid, no soft disconnect | 34.4.2, 34.16.2 GCCFG, 34.16.4 DCTL |
//! | Session: VBUS sensed, or assumed with NOVBUSSENS; SRQINT and SEDET | 34.4.2, 34.16.2 |
//! | Reset, enumeration done, start of frame, suspend, wake-up | 34.4.2, 34.17.3 |
//! | One receive FIFO for all OUT endpoints: a status word, then the data; popped through GRXSTSP | 34.11.1, 34.17.5 |
//! | A transmit FIFO for each IN endpoint; TXFE, free space; a full one accepts no more, and none may overlap | 34.11.2, 34.16.4 |
//! | SETUP: always accepted, sets both NAKs of endpoint 0, clears its STALLs, done at the next token | 34.17.5 |
//! | STUPCNT: one less with each SETUP, by the variant | 34.17.5 |
//! | OUT: NAK without room, packet count, or with NAKSTS; NAKSTS after the transfer; XFRC as its status is popped | 34.17.5 |
//! | IN: sent once enabled, no NAK, and the FIFO holds the packet; XFRC at the host's ACK | 34.17.6 |
//! | Data toggles, STALL, NAK set and cleared, endpoint disable, global IN NAK | 34.16.4 |
//! | Global OUT NAK: at once on the wire, in force once its word is popped from the receive FIFO | 34.17.5 |
//! | FIFO flushes, core soft reset | 34.16.2 GRSTCTL |
//! | Endpoint disable, endpoint NAK, global NAKs, flushes and the soft reset take time; premature accesses are reported | 34.16.2, 34.16.4, 34.17.5, 34.17.6 |
//!
//! Not modelled: host mode, isochronous endpoints, the periodic end-of-frame interrupt (EOPF), remote wake-up, and the
//! wake-up line to the EXTI. Interrupts that are not modelled are never raised.
//!
//! Where the manual and drivers disagree, [`OtgVariant`] decides.

use std::collections::VecDeque;
use std::ops::Range;

use super::registers::*;
use super::variant::OtgVariant;
use crate::time::Nanos;
use crate::timing::Clock;
use crate::usb::{Direction, Function, Handshake, Reply};

/// The core's identification (34.16.2 CID).
const CORE_ID: u32 = 0x0000_1200;

/// Number of words shared by the FIFOs (34.11: 1.25 kB).
const FIFO_RAM: usize = 320;

/// A step that takes time after the firmware's request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// EPDIS of an endpoint.
    Disable(Direction, usize),
    /// SNAK of an IN endpoint.
    Nak(usize),
    /// SGINAK.
    InNak,
    /// SGONAK.
    OutNak,
    /// TXFFLSH, with TXFNUM.
    FlushTransmit(u32),
    /// RXFFLSH.
    FlushReceive,
    /// CSRST.
    Reset,
}

impl Step {
    /// Maximum duration. The manual requires firmware to wait for each step, but specifies only the flushes: eight
    /// clocks of the slower side. The others are assumptions above the times that drivers report. The typical duration
    /// is zero.
    fn worst(self) -> Nanos {
        match self {
            Self::Disable(..) => Nanos(20_000),
            Self::Nak(_) => Nanos(2_000),
            Self::InNak | Self::OutNak | Self::Reset => Nanos(10_000),
            Self::FlushTransmit(_) | Self::FlushReceive => Nanos(1_000),
        }
    }
}

#[derive(Debug, Default)]
struct InEndpoint {
    control: u32,
    interrupts: u32,
    size: u32,
    fifo: VecDeque<u32>,
    /// Depth in words and start, as DIEPTXFx holds them.
    allocation: u32,
    /// Time at which the packet to send became ready.
    armed: Option<Nanos>,
    /// True while a packet of it is on the wire.
    sends: bool,
}

#[derive(Debug, Default)]
struct OutEndpoint {
    control: u32,
    interrupts: u32,
    size: u32,
}

/// An entry of the receive FIFO.
#[derive(Debug)]
struct Entry {
    status: u32,
    data: Vec<u32>,
}

/// The controller.
#[derive(Debug, Default)]
pub(super) struct Core {
    /// The instant of the present event.
    pub(super) now: Nanos,
    /// The PHY has its 48 MHz (34.3).
    pub(super) clocked: bool,
    vbus: bool,
    gotgint: u32,
    gahbcfg: u32,
    gusbcfg: u32,
    grstctl: u32,
    latched: u32,
    gintmsk: u32,
    grxfsiz: u32,
    gccfg: u32,
    dcfg: u32,
    /// The address before DCFG was written: the status stage of SET_ADDRESS still uses it.
    old_address: u8,
    dctl: u32,
    /// The word that reports the global OUT NAK was popped.
    out_nak_reported: bool,
    suspended: bool,
    enumerated: bool,
    frame: u16,
    diepmsk: u32,
    doepmsk: u32,
    daintmsk: u32,
    diepempmsk: u32,
    pcgcctl: u32,
    input: [InEndpoint; ENDPOINTS],
    output: [OutEndpoint; ENDPOINTS],
    received: VecDeque<Entry>,
    /// Data words of entries whose status was popped.
    popped: VecDeque<u32>,
    /// A SETUP was received, and the token that ends its phase was not.
    setup_open: bool,
    misuse: Option<&'static str>,
    /// The durations of steps, and the steps in progress with their ends.
    clock: Clock,
    steps: Vec<(Nanos, Step)>,
    variant: OtgVariant,
}

impl Core {
    /// The reset state of the controller.
    pub(super) fn new() -> Self {
        let mut core = Self {
            gusbcfg: 0x0000_0A00,
            grstctl: grstctl::AHBIDL,
            grxfsiz: 0x0000_0200,
            dcfg: 0x0220_0000,
            ..Self::default()
        };
        core.input[0].control = epctl::USBAEP;
        core.output[0].control = epctl::USBAEP;
        core.input[0].allocation = 0x0200_0200;
        for (endpoint, start) in core.input.iter_mut().skip(1).zip([0x400, 0x600, 0x800]) {
            endpoint.allocation = 0x0200_0000 | start;
        }
        core
    }
}

/// The processor's interface.
impl Core {
    /// The controller after a reset of the chip or of the peripheral: the cable state stays.
    pub(super) fn restarted(&self) -> Self {
        Self {
            now: self.now,
            vbus: self.vbus,
            ..Self::of(self.clock, self.variant)
        }
    }

    /// A controller of this variant, with step durations from this clock.
    pub(super) fn of(clock: Clock, variant: OtgVariant) -> Self {
        Self {
            clock,
            variant,
            ..Self::new()
        }
    }

    /// The end of the next step.
    pub(super) fn next_step(&self) -> Option<Nanos> {
        self.steps.iter().map(|&(done, _)| done).min()
    }

    /// Completes the steps that end by now.
    pub(super) fn advance(&mut self) {
        while let Some(first) = (0..self.steps.len()).min_by_key(|&nth| self.steps[nth].0)
            && self.steps[first].0 <= self.now
        {
            let (_, step) = self.steps.remove(first);
            self.finish(step);
        }
        self.arm();
    }

    fn begin(&mut self, step: Step) {
        let span = self.clock.span("otg", Nanos(0), step.worst());
        if span == Nanos(0) {
            self.finish(step);
        } else {
            self.steps.push((self.now + span, step));
        }
    }

    fn is_under_way(&self, is: impl Fn(Step) -> bool) -> bool {
        self.steps.iter().any(|&(_, step)| is(step))
    }

    fn finish(&mut self, step: Step) {
        match step {
            Step::Disable(direction, endpoint) => {
                let (control, interrupts) = match direction {
                    Direction::In => {
                        let input = &mut self.input[endpoint];
                        (&mut input.control, &mut input.interrupts)
                    }
                    Direction::Out => {
                        let output = &mut self.output[endpoint];
                        (&mut output.control, &mut output.interrupts)
                    }
                };
                *control &= !epctl::EPENA;
                *interrupts |= epint::EPDISD;
            }
            Step::Nak(endpoint) => self.input[endpoint].take_nak(),
            Step::InNak => self.dctl |= device::GINSTS,
            Step::OutNak => {
                self.dctl |= device::GONSTS;
                self.receive(0, grxsts::GLOBAL_OUT_NAK, false, &[]);
            }
            Step::FlushTransmit(number) => {
                self.grstctl &= !grstctl::TXFFLSH;
                for (each, input) in self.input.iter_mut().enumerate() {
                    if is_of(number, each) {
                        input.fifo.clear();
                    }
                }
            }
            Step::FlushReceive => {
                self.grstctl &= !grstctl::RXFFLSH;
                self.received.clear();
                self.popped.clear();
            }
            Step::Reset => {
                // 34.16.2: all registers except some of PCGCCTL and DCFG's speed.
                *self = Self {
                    clocked: self.clocked,
                    dcfg: Self::new().dcfg | self.dcfg & device::DSPD,
                    pcgcctl: self.pcgcctl,
                    ..self.restarted()
                };
            }
        }
    }

    /// The value of a read of `offset`, without side effects.
    pub(super) fn peek(&self, offset: u32) -> u32 {
        if let Some((direction, endpoint, register)) = endpoint_register(offset) {
            let (input, output) = (&self.input[endpoint], &self.output[endpoint]);
            return match (direction, register) {
                // Endpoint 0 does not show its DPID.
                (Direction::In, CTL) => input.control & bits(offset),
                (Direction::In, INT) => self.in_interrupts(endpoint),
                (Direction::In, TSIZ) => input.size,
                (Direction::In, TXFSTS) => (input.depth().saturating_sub(input.fifo.len())) as u32,
                (Direction::Out, CTL) => output.control & bits(offset),
                (Direction::Out, INT) => output.interrupts,
                (Direction::Out, TSIZ) => output.size,
                _ => 0,
            };
        }
        match offset {
            GOTGCTL => gotg::CIDSTS | if self.session() { gotg::BSVLD } else { 0 },
            GOTGINT => self.gotgint,
            GAHBCFG => self.gahbcfg,
            GUSBCFG => self.gusbcfg,
            GRSTCTL => self.grstctl,
            GINTSTS => self.status(),
            GINTMSK => self.gintmsk,
            GRXSTSR | GRXSTSP => self.received.front().map_or(0, |entry| entry.status),
            GRXFSIZ => self.grxfsiz,
            DIEPTXF0 => self.input[0].allocation,
            DIEPTXF1..=DIEPTXF3 => self.input[fifo_of(offset)].allocation,
            GCCFG => self.gccfg,
            CID => CORE_ID,
            DCFG => self.dcfg,
            DCTL => self.dctl,
            DSTS => {
                let mut status = u32::from(self.frame) << device::FNSOF_AT;
                if self.suspended {
                    status |= device::SUSPSTS;
                }
                if self.enumerated {
                    status |= device::ENUMSPD_FULL;
                }
                status
            }
            DIEPMSK => self.diepmsk,
            DOEPMSK => self.doepmsk,
            DAINT => self.all_endpoints(),
            DAINTMSK => self.daintmsk,
            DIEPEMPMSK => self.diepempmsk,
            PCGCCTL => self.pcgcctl,
            // Every window reads the single receive FIFO (34.11.1).
            FIFO.. => self.popped.front().copied().unwrap_or(0),
            _ => 0,
        }
    }

    pub(super) fn read(&mut self, offset: u32) -> u32 {
        let value = self.peek(offset);
        match offset {
            GRXSTSP => self.pop(),
            FIFO.. => {
                self.popped.pop_front();
            }
            _ => {}
        }
        value
    }

    /// Pops the status word at the front of the FIFO; its data is read next.
    fn pop(&mut self) {
        let Some(entry) = self.received.pop_front() else {
            return;
        };
        self.popped.extend(entry.data);
        let output = &mut self.output[(entry.status & 0xF) as usize % ENDPOINTS];
        match entry.status >> grxsts::PKTSTS_AT & 0xF {
            grxsts::GLOBAL_OUT_NAK => self.out_nak_reported = self.dctl & device::GONSTS != 0,
            grxsts::OUT_DONE => output.interrupts |= epint::XFRC,
            grxsts::SETUP_DONE => output.interrupts |= epint::STUP,
            _ => {}
        }
    }

    pub(super) fn write(&mut self, offset: u32, value: u32) {
        if let Some((direction, endpoint, register)) = endpoint_register(offset) {
            if register == CTL && value & epctl::CNAK != 0 && value & epctl::SNAK != 0 {
                self.misuse = Some("34.16.4: one write sets and clears an endpoint's NAK");
            }
            match (direction, register) {
                (Direction::In, CTL) => self.write_in_control(endpoint, value),
                (Direction::In, INT) => self.input[endpoint].interrupts &= !value,
                (Direction::In, TSIZ) => self.input[endpoint].size = value,
                (Direction::Out, CTL) => {
                    self.check_enable(Direction::Out, endpoint, value);
                    let output = &mut self.output[endpoint];
                    let disabled = value & epctl::EPDIS != 0 && output.control & epctl::EPENA != 0;
                    output.control = control(endpoint, output.control, value);
                    if disabled {
                        self.begin(Step::Disable(Direction::Out, endpoint));
                    }
                }
                (Direction::Out, INT) => self.output[endpoint].interrupts &= !value,
                (Direction::Out, TSIZ) => self.output[endpoint].size = value,
                _ => {}
            }
            self.arm();
            return;
        }
        match offset {
            GOTGINT => self.gotgint &= !value,
            GAHBCFG => self.gahbcfg = value,
            GUSBCFG => self.gusbcfg = value,
            GRSTCTL => self.write_reset(value),
            GINTSTS => self.latched &= !(value & gint::LATCHED),
            GINTMSK => self.gintmsk = value,
            GRXFSIZ => self.grxfsiz = value & 0xFFFF,
            DIEPTXF0 => self.input[0].allocation = value,
            DIEPTXF1..=DIEPTXF3 => self.input[fifo_of(offset)].allocation = value,
            GCCFG => self.gccfg = value,
            DCFG => {
                self.old_address = self.address();
                self.dcfg = value;
            }
            DCTL => self.write_device_control(value),
            DIEPMSK => self.diepmsk = value,
            DOEPMSK => self.doepmsk = value,
            DAINTMSK => self.daintmsk = value,
            DIEPEMPMSK => self.diepempmsk = value,
            PCGCCTL => self.pcgcctl = value,
            FIFO.. => {
                let endpoint = ((offset - FIFO) / FIFO_SPAN) as usize % ENDPOINTS;
                self.push(endpoint, value);
            }
            _ => {}
        }
        self.arm();
    }

    /// Pushes a word into a transmit FIFO, if it has room. The manual does not specify the overflow; here the word is
    /// lost.
    fn push(&mut self, endpoint: usize, word: u32) {
        let input = &self.input[endpoint];
        if input.fifo.len() >= input.depth() {
            self.misuse = Some("34.11.2: more than a transmit FIFO holds was written to it");
            return;
        }
        let flushes = |step| matches!(step, Step::FlushTransmit(number) if is_of(number, endpoint));
        if self.is_under_way(flushes) {
            self.misuse = Some("34.16.2: a transmit FIFO was written to while it is flushed");
        }
        if self.overlaps(endpoint) {
            self.misuse = Some("34.11: a FIFO overlaps another, or the end of the FIFO RAM");
        }
        self.input[endpoint].fifo.push_back(word);
    }

    /// Returns true if the transmit FIFO of `endpoint` overlaps another, or exceeds the RAM.
    fn overlaps(&self, endpoint: usize) -> bool {
        let own = self.input[endpoint].words();
        let others = self.input.iter().enumerate();
        let active = |(each, input): &(usize, &InEndpoint)| *each != endpoint && input.control & epctl::USBAEP != 0;
        let shared = |words: Range<usize>| words.start < own.end && own.start < words.end;
        own.end > FIFO_RAM
            || shared(0..self.grxfsiz as usize)
            || others.filter(active).any(|(_, input)| shared(input.words()))
    }

    /// The forbidden access of the firmware since the last call, if any.
    pub(super) fn take_misuse(&mut self) -> Option<&'static str> {
        self.misuse.take()
    }

    /// Reports an endpoint that is enabled while it is being disabled: the core would disable it.
    fn check_enable(&mut self, direction: Direction, endpoint: usize, value: u32) {
        let disables = |step| step == Step::Disable(direction, endpoint);
        let is_let_go = value & epctl::CNAK != 0 && value & epctl::EPENA != 0;
        if is_let_go && self.is_under_way(disables) {
            self.misuse = Some("34.17.6: an endpoint was enabled while it is being disabled");
        }
    }

    fn write_in_control(&mut self, endpoint: usize, value: u32) {
        self.check_enable(Direction::In, endpoint, value);
        let input = &mut self.input[endpoint];
        let disabled = value & epctl::EPDIS != 0 && input.control & epctl::EPENA != 0;
        if value & epctl::CNAK != 0 {
            input.interrupts &= !epint::INEPNE;
        }
        input.control = control(endpoint, input.control, value);
        if value & epctl::SNAK != 0 {
            self.begin(Step::Nak(endpoint));
        }
        if disabled {
            self.begin(Step::Disable(Direction::In, endpoint));
        }
    }

    fn write_reset(&mut self, value: u32) {
        if value & grstctl::CSRST != 0 {
            self.grstctl |= grstctl::CSRST;
            self.begin(Step::Reset);
            return;
        }
        let number = (value & grstctl::TXFNUM) >> grstctl::TXFNUM_AT;
        let busy = self.grstctl & (grstctl::RXFFLSH | grstctl::TXFFLSH);
        let begun = value & (grstctl::RXFFLSH | grstctl::TXFFLSH);
        self.grstctl = grstctl::AHBIDL | value & grstctl::TXFNUM | busy | begun;
        if begun & grstctl::TXFFLSH != 0 && (0..ENDPOINTS).any(|each| is_of(number, each) && self.may_send(each)) {
            self.misuse = Some("34.16.2: a transmit FIFO was flushed while its endpoint may send from it");
        }
        for (bit, step) in [
            (grstctl::RXFFLSH, Step::FlushReceive),
            (grstctl::TXFFLSH, Step::FlushTransmit(number)),
        ] {
            if begun & bit != 0 {
                self.begin(step);
            }
        }
    }

    /// Returns true if an IN endpoint is enabled, and no NAK of it is in force (34.16.2, TXFFLSH: "NAK Effective").
    fn may_send(&self, endpoint: usize) -> bool {
        let input = &self.input[endpoint];
        let held = input.control & epctl::NAKSTS != 0
            && !input.sends
            && !self.is_under_way(|step| step == Step::Nak(endpoint));
        input.control & epctl::EPENA != 0 && !held && self.dctl & device::GINSTS == 0
    }

    fn write_device_control(&mut self, value: u32) {
        let commands = device::SGINAK | device::CGINAK | device::SGONAK | device::CGONAK;
        let states = device::GINSTS | device::GONSTS;
        self.dctl = value & !(commands | states) | self.dctl & states;
        for (bit, set, clear, step) in [
            (device::GINSTS, device::SGINAK, device::CGINAK, Step::InNak),
            (device::GONSTS, device::SGONAK, device::CGONAK, Step::OutNak),
        ] {
            if value & clear != 0 {
                self.steps.retain(|&(_, each)| each != step);
                self.dctl &= !bit;
            } else if value & set != 0 && self.dctl & bit == 0 && !self.is_under_way(|each| each == step) {
                self.begin(step);
            }
        }
        self.out_nak_reported &= self.dctl & device::GONSTS != 0;
    }

    /// Returns true if the core drives its interrupt line (34.15).
    pub(super) fn interrupt(&self) -> bool {
        self.gahbcfg & gahbcfg::GINTMSK != 0 && self.status() & self.gintmsk != 0
    }

    /// GINTSTS. The current mode, bit 0, is always device.
    fn status(&self) -> u32 {
        let mut status = self.latched | gint::NPTXFE | gint::PTXFE;
        let endpoints = self.all_endpoints() & self.daintmsk;
        for (bit, is) in [
            (gint::OTGINT, self.gotgint != 0),
            (gint::RXFLVL, !self.received.is_empty()),
            (gint::GINAKEFF, self.dctl & device::GINSTS != 0),
            (gint::GONAKEFF, self.out_nak_reported),
            (gint::IEPINT, endpoints & 0xFFFF != 0),
            (gint::OEPINT, endpoints >> 16 != 0),
        ] {
            if is {
                status |= bit;
            }
        }
        status
    }

    /// DAINT: the endpoints with interrupts.
    fn all_endpoints(&self) -> u32 {
        let mut all = 0;
        for endpoint in 0..ENDPOINTS {
            let input = self.in_interrupts(endpoint);
            let empty = input & epint::TXFE != 0 && self.diepempmsk >> endpoint & 1 != 0;
            if empty || input & !epint::TXFE & self.diepmsk != 0 {
                all |= 1 << endpoint;
            }
            if self.output[endpoint].interrupts & self.doepmsk != 0 {
                all |= 1 << (16 + endpoint);
            }
        }
        all
    }

    fn in_interrupts(&self, endpoint: usize) -> u32 {
        let input = &self.input[endpoint];
        let empty = if self.gahbcfg & gahbcfg::TXFELVL != 0 {
            input.fifo.is_empty()
        } else {
            2 * input.fifo.len() <= input.depth()
        };
        input.interrupts | if empty { epint::TXFE } else { 0 }
    }

    /// Records the time at which a packet becomes ready.
    fn arm(&mut self) {
        for (endpoint, input) in self.input.iter_mut().enumerate() {
            if !input.loaded(endpoint) {
                input.armed = None;
            } else if input.armed.is_none() {
                input.armed = Some(self.now);
            }
        }
    }
}

/// The wire's interface.
impl Core {
    /// Returns true if the core sees the bus voltage (34.16.2 GCCFG).
    fn session(&self) -> bool {
        self.gccfg & gccfg::NOVBUSSENS != 0 || self.gccfg & gccfg::VBUSBSEN != 0 && self.vbus
    }

    fn address(&self) -> u8 {
        ((self.dcfg & device::DAD) >> device::DAD_AT) as u8
    }

    /// Returns true if a token with `address` is for this device. The first use of the new address invalidates the old
    /// one.
    fn addressed(&mut self, address: u8) -> bool {
        if address == self.address() {
            self.old_address = address;
        }
        self.clocked && address == self.old_address
    }

    /// A token after SETUP ends its phase: the core reports it in the receive FIFO (34.17.5).
    fn end_setup(&mut self) {
        if std::mem::take(&mut self.setup_open) {
            self.receive(0, grxsts::SETUP_DONE, false, &[]);
        }
    }

    fn receive(&mut self, endpoint: usize, status: u32, toggle: bool, data: &[u8]) {
        let words = data.chunks(4).map(|bytes| {
            let mut word = [0; 4];
            word[..bytes.len()].copy_from_slice(bytes);
            u32::from_le_bytes(word)
        });
        self.received.push_back(Entry {
            status: endpoint as u32
                | (data.len() as u32) << grxsts::BCNT_AT
                | (if toggle { 2 } else { 0 }) << grxsts::DPID_AT
                | status << grxsts::PKTSTS_AT,
            data: words.collect(),
        });
    }

    /// Returns true if the receive FIFO has room for a packet and its two status words (34.11.1).
    fn room(&self, length: usize) -> bool {
        let used: usize = self.received.iter().map(|entry| 1 + entry.data.len()).sum();
        used + self.popped.len() + 2 + length.div_ceil(4) <= self.grxfsiz as usize
    }

    /// The handshake for an OUT packet of `length` bytes.
    fn takes(&self, endpoint: usize, length: usize) -> Handshake {
        let output = &self.output[endpoint];
        if output.control & epctl::USBAEP == 0 {
            return Handshake::NoResponse;
        }
        if output.control & epctl::STALL != 0 {
            return Handshake::Stall;
        }
        // Drivers do not set EPENA and the packet count of endpoint 0; NAKSTS decides for it.
        let enabled = endpoint == 0 || output.control & epctl::EPENA != 0 && output.size & eptsiz::PKTCNT != 0;
        let nak = output.control & epctl::NAKSTS != 0 || self.dctl & device::GONSTS != 0;
        if enabled && !nak && self.room(length) {
            Handshake::Ack
        } else {
            Handshake::Nak
        }
    }

    /// The handshake for an IN token.
    fn gives(&self, endpoint: usize) -> Handshake {
        let input = &self.input[endpoint];
        if input.control & epctl::USBAEP == 0 {
            Handshake::NoResponse
        } else if input.control & epctl::STALL != 0 {
            Handshake::Stall
        } else if input.loaded(endpoint) && self.dctl & device::GINSTS == 0 {
            Handshake::Ack
        } else {
            Handshake::Nak
        }
    }
}

impl Function for Core {
    fn pulls_up(&self) -> bool {
        self.clocked && self.session() && self.gccfg & gccfg::PWRDWN != 0 && self.dctl & device::SDIS == 0
    }

    fn power(&mut self, vbus: bool) {
        self.vbus = vbus;
        if self.gccfg & gccfg::VBUSBSEN != 0 && self.gccfg & gccfg::NOVBUSSENS == 0 {
            if vbus {
                self.latched |= gint::SRQINT;
            } else {
                self.gotgint |= gotg::SEDET;
            }
        }
    }

    fn reset(&mut self) {
        self.suspended = false;
        self.enumerated = false;
        self.setup_open = false;
        self.latched |= gint::USBRST;
        // All endpoints except 0 are deactivated, and no packet is armed (34.16.4, USBAEP; 34.17.3).
        for (endpoint, input) in self.input.iter_mut().enumerate() {
            input.sends = false;
            input.control = after_reset(endpoint, input.control);
        }
        for (endpoint, output) in self.output.iter_mut().enumerate() {
            output.control = after_reset(endpoint, output.control);
        }
        self.arm();
    }

    fn reset_done(&mut self) {
        self.enumerated = true;
        self.latched |= gint::ENUMDNE;
    }

    fn start_of_frame(&mut self, number: u16) {
        // An unacknowledged packet on the wire is aborted.
        self.input.iter_mut().for_each(InEndpoint::end);
        self.frame = number;
        self.latched |= gint::SOF;
    }

    fn suspend(&mut self) {
        if self.pulls_up() {
            self.suspended = true;
            self.latched |= gint::ESUSP | gint::USBSUSP;
        }
    }

    fn resume(&mut self) {
        if std::mem::take(&mut self.suspended) {
            self.latched |= gint::WKUPINT;
        }
    }

    fn ready(&self, endpoint: u8, direction: Direction) -> bool {
        let endpoint = usize::from(endpoint);
        if endpoint >= ENDPOINTS || endpoint == 0 && self.setup_open {
            return true;
        }
        let answer = match direction {
            Direction::In => self.gives(endpoint),
            Direction::Out => self.takes(endpoint, (self.output[endpoint].control & epctl::MPSIZ) as usize),
        };
        answer != Handshake::Nak
    }

    fn setup(&mut self, address: u8, request: [u8; 8]) -> bool {
        if !self.addressed(address) {
            return false;
        }
        self.setup_open = true;
        self.receive(0, grxsts::SETUP_DATA, false, &request);
        if !self.variant.keeps_setup_count {
            let size = &mut self.output[0].size;
            let left = ((*size & eptsiz::STUPCNT) >> eptsiz::STUPCNT_AT).saturating_sub(1);
            *size = *size & !eptsiz::STUPCNT | left << eptsiz::STUPCNT_AT;
        }
        for control in [&mut self.input[0].control, &mut self.output[0].control] {
            *control = *control & !epctl::STALL | epctl::NAKSTS | epctl::DPID;
        }
        self.arm();
        true
    }

    fn output(&mut self, address: u8, endpoint: u8, toggle: bool, data: &[u8]) -> Handshake {
        let endpoint = usize::from(endpoint);
        if !self.addressed(address) || endpoint >= ENDPOINTS {
            return Handshake::NoResponse;
        }
        if endpoint == 0 {
            self.end_setup();
        }
        let answer = self.takes(endpoint, data.len());
        let output = &mut self.output[endpoint];
        match answer {
            Handshake::Nak if endpoint != 0 && output.control & epctl::EPENA == 0 => {
                output.interrupts |= epint::OTEPDIS;
            }
            Handshake::Ack if toggle == (output.control & epctl::DPID != 0) => {
                output.control ^= epctl::DPID;
                let packets = ((output.size & eptsiz::PKTCNT) >> eptsiz::PKTCNT_AT).saturating_sub(1);
                let bytes = (output.size & eptsiz::XFRSIZ).saturating_sub(data.len() as u32);
                output.size = output.size & !(eptsiz::PKTCNT | eptsiz::XFRSIZ) | packets << eptsiz::PKTCNT_AT | bytes;
                let done = packets == 0 || data.len() < output.packet(endpoint);
                if done {
                    output.control |= epctl::NAKSTS;
                }
                // Drivers do not enable endpoint 0.
                if done && endpoint != 0 && self.variant.disables_out_endpoints {
                    output.control &= !epctl::EPENA;
                }
                self.receive(endpoint, grxsts::OUT_DATA, toggle, data);
                if done {
                    self.receive(endpoint, grxsts::OUT_DONE, false, &[]);
                }
            }
            // A packet received before is acknowledged and dropped (USB 2.0, 8.6.4).
            _ => {}
        }
        answer
    }

    fn input(&mut self, address: u8, endpoint: u8) -> Reply {
        let endpoint = usize::from(endpoint);
        if !self.addressed(address) || endpoint >= ENDPOINTS {
            return Reply::NoResponse;
        }
        if endpoint == 0 {
            self.end_setup();
        }
        let answer = self.gives(endpoint);
        let input = &mut self.input[endpoint];
        match answer {
            Handshake::NoResponse => Reply::NoResponse,
            Handshake::Stall => Reply::Stall,
            Handshake::Nak => {
                if input.fifo.is_empty() {
                    input.interrupts |= epint::ITTXFE;
                }
                Reply::Nak
            }
            Handshake::Ack => {
                let length = input.next(endpoint);
                let mut bytes: Vec<u8> = input
                    .fifo
                    .iter()
                    .flat_map(|word| word.to_le_bytes())
                    .take(length)
                    .collect();
                bytes.truncate(length);
                input.sends = true;
                Reply::Data {
                    toggle: input.control & epctl::DPID != 0,
                    bytes,
                    armed: input.armed.unwrap_or(self.now),
                }
            }
        }
    }

    fn acknowledged(&mut self, endpoint: u8) {
        let endpoint = usize::from(endpoint);
        let Some(input) = self.input.get_mut(endpoint) else {
            return;
        };
        let length = input.next(endpoint);
        input.fifo.drain(..length.div_ceil(4).min(input.fifo.len()));
        input.control ^= epctl::DPID;
        input.armed = None;
        let packets = ((input.size & eptsiz::PKTCNT) >> eptsiz::PKTCNT_AT).saturating_sub(1);
        let bytes = (input.size & eptsiz::XFRSIZ).saturating_sub(length as u32);
        input.size = input.size & !(eptsiz::PKTCNT | eptsiz::XFRSIZ) | packets << eptsiz::PKTCNT_AT | bytes;
        if packets == 0 {
            input.control &= !epctl::EPENA;
            input.interrupts |= epint::XFRC;
        }
        input.end();
        self.arm();
    }
}

impl InEndpoint {
    /// Its FIFO's depth in words.
    fn depth(&self) -> usize {
        (self.allocation >> 16) as usize
    }

    /// The range of its FIFO in the FIFO RAM.
    fn words(&self) -> Range<usize> {
        let start = (self.allocation & 0xFFFF) as usize;
        start..start + self.depth()
    }

    /// The length of the next packet, in bytes.
    fn next(&self, endpoint: usize) -> usize {
        ((self.size & eptsiz::XFRSIZ) as usize).min(packet(endpoint, self.control))
    }

    /// SNAK takes effect as soon as no packet is on the wire (34.16.4, INEPNE).
    fn take_nak(&mut self) {
        if self.control & epctl::NAKSTS != 0 && !self.sends {
            self.interrupts |= epint::INEPNE;
        }
    }

    /// The packet on the wire has ended.
    fn end(&mut self) {
        if std::mem::take(&mut self.sends) {
            self.take_nak();
        }
    }

    /// Returns true if a packet is ready.
    fn loaded(&self, endpoint: usize) -> bool {
        self.control & epctl::EPENA != 0
            && self.control & epctl::NAKSTS == 0
            && 4 * self.fifo.len() >= self.next(endpoint)
    }
}

impl OutEndpoint {
    fn packet(&self, endpoint: usize) -> usize {
        packet(endpoint, self.control)
    }
}

/// An endpoint's maximum packet size (34.16.4). Endpoint 0 has an encoding.
fn packet(endpoint: usize, control: u32) -> usize {
    if endpoint == 0 {
        64 >> (control & 3)
    } else {
        (control & epctl::MPSIZ) as usize
    }
}

/// The value of an endpoint's control register after a write.
fn control(endpoint: usize, old: u32, written: u32) -> u32 {
    let commands = epctl::CNAK | epctl::SNAK | epctl::SD0PID | epctl::SD1PID | epctl::EPDIS;
    // Only a SETUP clears the STALL of endpoint 0.
    let stall = if endpoint == 0 { old & epctl::STALL } else { 0 };
    let hardware = epctl::NAKSTS | epctl::DPID | epctl::EPENA;
    let mut new = written & !(commands | hardware) | old & hardware | stall;
    if endpoint == 0 {
        new |= epctl::USBAEP;
    }
    for (command, set, clear) in [
        (epctl::CNAK, 0, epctl::NAKSTS),
        (epctl::SNAK, epctl::NAKSTS, 0),
        (epctl::SD0PID, 0, epctl::DPID),
        (epctl::SD1PID, epctl::DPID, 0),
        (epctl::EPENA, epctl::EPENA, 0),
    ] {
        if written & command != 0 {
            new = new & !clear | set;
        }
    }
    new
}

/// The value of an endpoint's control register after a bus reset. An enabled endpoint stays enabled, and a stalled one
/// stalled: the manual does not list the reset among the events that clear EPENA and STALL (34.16.4).
fn after_reset(endpoint: usize, control: u32) -> u32 {
    let active = if endpoint == 0 { 0 } else { epctl::USBAEP };
    control & !active | epctl::NAKSTS
}

/// The endpoint of the register at `offset`, and the register's offset within it.
fn endpoint_register(offset: u32) -> Option<(Direction, usize, u32)> {
    [(DIEP, Direction::In), (DOEP, Direction::Out)]
        .into_iter()
        .find_map(|(base, direction)| {
            let within = offset.checked_sub(base)?;
            let endpoint = (within / ENDPOINT_SPAN) as usize;
            (endpoint < ENDPOINTS).then_some((direction, endpoint, within % ENDPOINT_SPAN))
        })
}

/// Returns true if TXFNUM stands for the transmit FIFO of an endpoint.
fn is_of(number: u32, endpoint: usize) -> bool {
    number == grstctl::ALL || number as usize == endpoint
}

fn fifo_of(offset: u32) -> usize {
    1 + ((offset - DIEPTXF1) / 4) as usize
}

#[cfg(test)]
mod tests;
