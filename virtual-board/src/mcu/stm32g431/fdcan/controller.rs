//! The controller: its registers, and its interface to the bus.
//!
//! | Behaviour | Section |
//! |---|---|
//! | Software initialization: INIT, CCE, protected registers, resets by CCE; joining after 11 recessive bits | 44.3.2 |
//! | CAN FD: FDOE, BRSE, FDF and BRS of a buffer | 44.3.2 |
//! | Bit times of both phases, clock divider | 44.4.3, 44.4.7, 44.4.37 |
//! | Bus monitoring, no automatic retransmission, clock stop | 44.3.2 |
//! | Filters for 11 bits, global filter | 44.3.5 |
//! | Receive FIFOs: full, message lost, blocking or overwriting | 44.3.5 |
//! | Transmit FIFO and queue, cancellation | 44.3.6 |
//! | Error counters, warning, passive, bus-off; recovery by 129 times 11 recessive bits | 44.4.12, 44.4.13 |
//! | Interrupts in groups on two lines | 44.4.15 to 44.4.18 |
//!
//! DBTP.TDC and TDCR are stored; the bus has no transceiver delay. Refused with their name: test modes, restricted
//! operation, time stamps, timeouts, filters for 29 bits, transmit events, transmit pause.

use std::collections::VecDeque;

use armwire_sim::can::{Frame, Id};

use super::ram::{Action, DEPTH, Ram, STANDARD_FILTER_COUNT};
use super::registers::*;
use crate::can::confinement::Confinement;
use crate::can::wait::Wait;
use crate::can::{self, Capability, Controller as _, ErrorState, Fault};
use crate::line::SECOND;
use crate::soc::peripheral::{Refused, check_modelled, check_reserved, field, forbidden, merge};
use crate::time::Nanos;

/// Number of times 11 recessive bits to join the bus, and to recover from bus-off (44.4.13).
const JOINING: u32 = 1;
const RECOVERY: u32 = 129;

/// A receive FIFO.
#[derive(Clone, Copy, Debug, Default)]
struct Fifo {
    level: usize,
    get: usize,
    lost: bool,
}

/// A buffer with a pending frame.
#[derive(Clone, Copy, Debug)]
struct Pending {
    buffer: usize,
    requested: Nanos,
}

#[derive(Debug, Default)]
pub(super) struct Controller {
    now: Nanos,
    clock_hz: u64,
    ram: Ram,
    cccr: u32,
    dbtp: u32,
    nbtp: u32,
    tdcr: u32,
    divider: u32,
    ir: u32,
    ie: u32,
    ils: u32,
    ile: u32,
    rxgfc: u32,
    xidam: u32,
    txbc: u32,
    txbtie: u32,
    txbcie: u32,
    /// TXBTO and TXBCF.
    transmitted: u32,
    cancelled: u32,
    fifos: [Fifo; 2],
    /// Requests in their order.
    pending: VecDeque<Pending>,
    /// The buffer for the next frame.
    put: usize,
    /// The buffer whose frame is on the bus, and true if this is the last attempt.
    sending: Option<usize>,
    cancelling: u32,
    wait: Option<Wait>,
    /// True while a frame is on the bus, and the end of the last one.
    busy: bool,
    free: Nanos,
    confinement: Confinement,
    /// LEC, DLEC, and RESI, RBRS and REDL of PSR.
    last_error: u32,
    last_data_error: u32,
    received_flags: u32,
}

impl Controller {
    /// The reset state of the controller.
    pub(super) fn new() -> Self {
        Self {
            cccr: cccr::INIT,
            dbtp: dbtp::AT_RESET,
            nbtp: nbtp::AT_RESET,
            xidam: Id::MAX_EXTENDED,
            last_error: psr::UNCHANGED,
            last_data_error: psr::UNCHANGED,
            ..Self::default()
        }
    }
}

/// The processor's interface.
impl Controller {
    /// Resets the controller. A frame on the bus continues.
    pub(super) fn reset(&mut self) {
        *self = Self {
            now: self.now,
            clock_hz: self.clock_hz,
            ram: self.ram.clone(),
            busy: self.busy,
            free: self.free,
            ..Self::new()
        };
    }

    /// Sets the rate of the clock. Returns true if it changed.
    pub(super) fn set_clock(&mut self, hz: u64) -> bool {
        std::mem::replace(&mut self.clock_hz, hz) != hz
    }

    pub(super) fn come_to(&mut self, now: Nanos) {
        self.now = now;
    }

    pub(super) fn ram(&self) -> &Ram {
        &self.ram
    }

    pub(super) fn ram_mut(&mut self) -> &mut Ram {
        &mut self.ram
    }

    /// The levels of the interrupt lines (44.4.17, 44.4.18).
    pub(super) fn interrupts(&self) -> [bool; 2] {
        let raised = self.ir & self.ie;
        let mut lines = [0; 2];
        for (group, flags) in ir::GROUPS.iter().enumerate() {
            lines[(self.ils >> group & 1) as usize] |= raised & flags;
        }
        [0, 1].map(|line| lines[line] != 0 && self.ile >> line & 1 != 0)
    }

    fn has(&self, bit: u32) -> bool {
        self.cccr & bit != 0
    }

    /// Returns true if protected registers may be written.
    fn is_open(&self) -> bool {
        self.has(cccr::INIT) && self.has(cccr::CCE)
    }

    pub(super) fn read(&mut self, offset: u32) -> Result<u32, Refused> {
        Ok(match offset {
            CREL => RELEASE,
            ENDN => ENDIANNESS,
            DBTP => self.dbtp,
            CCCR => self.cccr & !cccr::CSA | if self.has(cccr::CSR) { cccr::CSA } else { 0 },
            NBTP => self.nbtp,
            ECR => self.error_counters(),
            PSR => self.take_protocol_status(),
            TDCR => self.tdcr,
            IR => self.ir,
            IE => self.ie,
            ILS => self.ils,
            ILE => self.ile,
            RXGFC => self.rxgfc,
            XIDAM => self.xidam,
            RXF0S => self.fifo_status(0),
            RXF1S => self.fifo_status(1),
            RXF0A | RXF1A | TXBAR | TXBCR => 0,
            TXBC => self.txbc,
            TXFQS => self.transmit_status(),
            TXBRP => self.requests(),
            TXBTO => self.transmitted,
            TXBCF => self.cancelled,
            TXBTIE => self.txbtie,
            TXBCIE => self.txbcie,
            // The transmit event FIFO is always empty.
            TXEFS => 0,
            CKDIV => self.divider,
            TEST | RWD | TSCC | TSCV | TOCC | TOCV | HPMS | TXEFA => {
                return Err(Refused::Unimplemented("TEST, RWD, TSCx, TOCx, HPMS, TXEFA"));
            }
            _ => return Err(Refused::NoRegister),
        })
    }

    pub(super) fn write(&mut self, offset: u32, value: u32) -> Result<(), Refused> {
        if let Some((register, bits)) = bits(offset) {
            check_reserved(register, value, bits)?;
        }
        match offset {
            CCCR => return self.write_control(value),
            DBTP | NBTP | TDCR | RXGFC | XIDAM | TXBC | CKDIV if !self.is_open() => {
                return Err(forbidden(
                    "DBTP/NBTP/TDCR/RXGFC/XIDAM/TXBC/CKDIV",
                    "44.3.2: a protected register written without CCE and INIT",
                ));
            }
            DBTP => self.dbtp = value,
            NBTP => self.nbtp = value,
            TDCR => self.tdcr = value,
            IR => self.ir &= !value,
            IE => self.ie = value,
            ILS => self.ils = value,
            ILE => self.ile = value,
            RXGFC if field(value, rxgfc::LSE_AT, rxgfc::LSE) != 0 => {
                return Err(Refused::Unimplemented("RXGFC.LSE: filters for 29 bits"));
            }
            RXGFC => self.rxgfc = value,
            XIDAM => self.xidam = value,
            RXF0A => self.acknowledge(0, value),
            RXF1A => self.acknowledge(1, value),
            TXBC => self.txbc = value,
            TXBAR => return self.request(value),
            TXBCR => self.cancel(value),
            TXBTIE => self.txbtie = value,
            TXBCIE => self.txbcie = value,
            CKDIV => self.divider = value,
            CREL | ENDN | ECR | PSR | RXF0S | RXF1S | TXFQS | TXBRP | TXBTO | TXBCF | TXEFS => {}
            TEST | RWD | TSCC | TSCV | TOCC | TOCV | HPMS | TXEFA => {
                return Err(Refused::Unimplemented("TEST, RWD, TSCx, TOCx, HPMS, TXEFA"));
            }
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    fn write_control(&mut self, value: u32) -> Result<(), Refused> {
        check_modelled("CCCR: TEST, ASM, TXP, EFBI or NISO", value, cccr::MODELLED)?;
        let was_open = self.is_open();
        if !was_open && (value ^ self.cccr) & cccr::HELD != 0 {
            return Err(forbidden(
                "CCCR",
                "44.3.2: a protected bit written without CCE and INIT",
            ));
        }
        let had_init = self.has(cccr::INIT);
        // CCE can be set while INIT is set, and is cleared with it.
        let open = if had_init && value & cccr::INIT != 0 {
            value & cccr::CCE
        } else {
            0
        };
        self.cccr = merge(value, open, cccr::CCE);
        if self.is_open() && !was_open {
            self.clear_fifos();
        }
        match (had_init, self.has(cccr::INIT)) {
            (false, true) => {
                self.wait = None;
                self.sending = None;
            }
            (true, false) => {
                let times = if self.state() == ErrorState::BusOff {
                    RECOVERY
                } else {
                    JOINING
                };
                let since = (!self.busy).then_some(self.now.max(self.free));
                self.wait = Some(Wait::new(times, since));
            }
            _ => {}
        }
        Ok(())
    }

    /// Resets by CCE (44.3.2): RXFnS, TXFQS, TXBRP, TXBTO, TXBCF.
    fn clear_fifos(&mut self) {
        self.fifos = [Fifo::default(); 2];
        self.pending.clear();
        self.sending = None;
        self.cancelling = 0;
        self.put = 0;
        self.transmitted = 0;
        self.cancelled = 0;
    }

    fn error_counters(&self) -> u32 {
        let passive = if self.confinement.receive() > ecr::REC {
            ecr::RP
        } else {
            0
        };
        self.confinement.transmit() | self.confinement.receive().min(ecr::REC) << ecr::REC_AT | passive
    }

    /// PSR. A read resets LEC and DLEC, and RESI, RBRS and REDL.
    fn take_protocol_status(&mut self) -> u32 {
        let when = |set, bit| if set { bit } else { 0 };
        let activity = match (self.sending, self.busy) {
            _ if !self.takes_part() => psr::SYNCHRONIZING,
            (Some(_), _) => psr::TRANSMITTER,
            (None, true) => psr::RECEIVER,
            (None, false) => psr::IDLE,
        };
        let status = self.last_error
            | activity << psr::ACT_AT
            | when(self.confinement.is_passive(), psr::EP)
            | when(self.confinement.warns(), psr::EW)
            | when(self.state() == ErrorState::BusOff, psr::BO)
            | self.last_data_error << psr::DLEC_AT
            | self.received_flags;
        self.last_error = psr::UNCHANGED;
        self.last_data_error = psr::UNCHANGED;
        self.received_flags = 0;
        status
    }

    fn fifo_status(&self, number: usize) -> u32 {
        let fifo = self.fifos[number];
        let put = (fifo.get + fifo.level) % DEPTH;
        let when = |set, bit| if set { bit } else { 0 };
        fifo.level as u32
            | (fifo.get as u32) << rxfs::FGI_AT
            | (put as u32) << rxfs::FPI_AT
            | when(fifo.level == DEPTH, rxfs::FF)
            | when(fifo.lost, rxfs::RFL)
    }

    /// The processor acknowledges all elements up to this index.
    fn acknowledge(&mut self, number: usize, place: u32) {
        let fifo = &mut self.fifos[number];
        let taken = (place as usize % DEPTH + DEPTH - fifo.get) % DEPTH + 1;
        if taken <= fifo.level {
            fifo.level -= taken;
            fifo.get = (fifo.get + taken) % DEPTH;
            fifo.lost = false;
        }
    }

    fn requests(&self) -> u32 {
        self.pending.iter().fold(0, |bits, pending| bits | 1 << pending.buffer)
    }

    fn is_queue(&self) -> bool {
        self.txbc & TFQM != 0
    }

    /// TXFQS. In a queue, free level and get index read 0, and the put index is the first free buffer.
    fn transmit_status(&self) -> u32 {
        let requests = self.requests();
        let full = if requests.count_ones() as usize == DEPTH {
            txfqs::TFQF
        } else {
            0
        };
        if self.is_queue() {
            return requests.trailing_ones().min(DEPTH as u32 - 1) << txfqs::TFQPI_AT | full;
        }
        let get = self.pending.front().map_or(self.put, |pending| pending.buffer);
        let free = DEPTH - self.pending.len();
        free as u32 | (get as u32) << txfqs::TFGI_AT | (self.put as u32) << txfqs::TFQPI_AT | full
    }

    fn request(&mut self, buffers: u32) -> Result<(), Refused> {
        if self.has(cccr::CCE) {
            return Err(forbidden("TXBAR", "44.4.29: written with CCE"));
        }
        for buffer in (0..DEPTH).filter(|buffer| buffers >> buffer & 1 != 0) {
            if self.requests() >> buffer & 1 != 0 {
                continue;
            }
            if self.ram.wants_event(buffer) {
                return Err(Refused::Unimplemented("EFC of a transmit buffer: transmit events"));
            }
            if !self.is_queue() && buffer != self.put {
                return Err(forbidden("TXBAR", "44.3.6: a buffer of the transmit FIFO out of turn"));
            }
            self.transmitted &= !(1 << buffer);
            self.cancelled &= !(1 << buffer);
            self.put = (buffer + 1) % DEPTH;
            let requested = self.now;
            self.pending.push_back(Pending { buffer, requested });
        }
        Ok(())
    }

    /// Cancels requests. A frame on the bus is not retransmitted (44.3.6).
    fn cancel(&mut self, buffers: u32) {
        for buffer in (0..DEPTH).filter(|buffer| buffers >> buffer & 1 != 0) {
            if self.sending == Some(buffer) {
                self.cancelling |= 1 << buffer;
            } else if self.requests() >> buffer & 1 != 0 {
                self.finish_cancellation(buffer);
            }
        }
    }

    fn finish_cancellation(&mut self, buffer: usize) {
        self.pending.retain(|pending| pending.buffer != buffer);
        self.cancelling &= !(1 << buffer);
        self.cancelled |= 1 << buffer;
        if self.txbcie >> buffer & 1 != 0 {
            self.ir |= ir::TCF;
        }
    }

    /// The next request: the oldest of a FIFO, the lowest identifier of a queue.
    fn next(&self) -> Option<Pending> {
        if self.is_queue() {
            let id = |pending: &&Pending| {
                let frame = self.frame(pending.buffer);
                match frame.id {
                    Id::Standard(id) => (u32::from(id) << 18, pending.buffer),
                    Id::Extended(id) => (id, pending.buffer),
                }
            };
            return self.pending.iter().min_by_key(id).copied();
        }
        self.pending.front().copied()
    }

    fn frame(&self, buffer: usize) -> Frame {
        let mut frame = self
            .ram
            .frame_to_send(buffer, self.has(cccr::FDOE), self.has(cccr::BRSE));
        if let Some(flags) = &mut frame.fd {
            flags.error_passive |= self.confinement.is_passive();
        }
        frame
    }
}

/// The bus's interface.
impl Controller {
    /// Clock divided by CKDIV.
    fn kernel_hz(&self) -> u64 {
        let divider = if self.divider == 0 {
            1
        } else {
            2 * u64::from(self.divider)
        };
        self.clock_hz / divider
    }

    /// A bit time of `1 + before + behind` quanta in picoseconds.
    fn bit_of(&self, prescaler: u32, before: u32, behind: u32) -> u64 {
        let ticks = u64::from(prescaler + 1) * u64::from(1 + (before + 1) + (behind + 1));
        (ticks * SECOND).checked_div(self.kernel_hz()).unwrap_or(0)
    }

    fn data_bit(&self) -> u64 {
        self.bit_of(
            field(self.dbtp, dbtp::DBRP_AT, dbtp::DBRP),
            field(self.dbtp, dbtp::DTSEG1_AT, dbtp::DTSEG1),
            field(self.dbtp, dbtp::DTSEG2_AT, dbtp::DTSEG2),
        )
    }

    fn takes_part(&self) -> bool {
        !self.has(cccr::INIT) && self.wait.is_none() && self.state() != ErrorState::BusOff && self.bit() > 0
    }

    /// The FIFO of a frame, and the filter that selected it.
    fn filter(&self, frame: &Frame) -> Option<(usize, Option<u32>)> {
        let (id, rejects_remote, not_matching_at) = match frame.id {
            Id::Standard(id) => (u32::from(id), rxgfc::RRFS, rxgfc::ANFS_AT),
            Id::Extended(id) => (id, rxgfc::RRFE, rxgfc::ANFE_AT),
        };
        if frame.remote && self.rxgfc & rejects_remote != 0 {
            return None;
        }
        if matches!(frame.id, Id::Standard(_)) {
            let count = field(self.rxgfc, rxgfc::LSS_AT, rxgfc::LSS).min(STANDARD_FILTER_COUNT);
            for number in 0..count {
                let filter = self.ram.standard_filter(number);
                match filter.action() {
                    Action::Store(fifo) if filter.matches(id) => return Some((fifo, Some(number))),
                    Action::Reject if filter.matches(id) => return None,
                    _ => {}
                }
            }
        }
        match field(self.rxgfc, not_matching_at, 0b11) {
            0b00 => Some((0, None)),
            0b01 => Some((1, None)),
            _ => None,
        }
    }

    fn store(&mut self, number: usize, frame: &Frame, filter: Option<u32>) {
        let overwrites = self.rxgfc & [rxgfc::F0OM, rxgfc::F1OM][number] != 0;
        let fifo = &mut self.fifos[number];
        let mut flags = ir::RFN;
        if fifo.level == DEPTH {
            if !overwrites {
                fifo.lost = true;
                self.ir |= ir::RFL << (ir::FIFO_BITS * number);
                return;
            }
            fifo.get = (fifo.get + 1) % DEPTH;
            fifo.level -= 1;
        }
        let place = (fifo.get + fifo.level) % DEPTH;
        fifo.level += 1;
        if fifo.level == DEPTH {
            flags |= ir::RFF;
        }
        self.ram.store(number, place, frame, filter);
        self.ir |= flags << (ir::FIFO_BITS * number);
    }

    /// Changes the error counters, and sets the interrupts of that change (44.4.15).
    fn confine(&mut self, change: impl FnOnce(&mut Confinement)) {
        let levels = |confinement: Confinement| {
            let bus_off = confinement.state() == ErrorState::BusOff;
            [
                (ir::EW, confinement.warns()),
                (ir::EP, confinement.is_passive()),
                (ir::BO, bus_off),
            ]
        };
        let before = levels(self.confinement);
        change(&mut self.confinement);
        for ((flag, before), (_, after)) in before.into_iter().zip(levels(self.confinement)) {
            if before != after {
                self.ir |= flag;
            }
        }
        if self.confinement.state() == ErrorState::BusOff {
            // 44.3.2: bus-off sets INIT.
            self.cccr |= cccr::INIT;
            self.sending = None;
        }
    }

    fn note(&mut self, fault: Fault) {
        let code = fault.error as u32;
        if fault.in_data_phase {
            self.last_data_error = code;
            self.ir |= ir::PED;
        } else {
            self.last_error = code;
            self.ir |= ir::PEA;
        }
    }
}

impl can::Controller for Controller {
    fn bit(&self) -> u64 {
        self.bit_of(
            field(self.nbtp, nbtp::NBRP_AT, nbtp::NBRP),
            field(self.nbtp, nbtp::NTSEG1_AT, nbtp::NTSEG1),
            field(self.nbtp, 0, nbtp::NTSEG2),
        )
    }

    fn capability(&self) -> Capability {
        if self.has(cccr::FDOE) {
            let data_bit = self.data_bit();
            Capability::Fd { data_bit }
        } else {
            Capability::Classic
        }
    }

    fn listens(&self) -> bool {
        self.takes_part()
    }

    fn drives(&self) -> bool {
        !self.has(cccr::MON)
    }

    fn state(&self) -> ErrorState {
        self.confinement.state()
    }

    fn offer(&self) -> Option<Frame> {
        if !self.takes_part() || self.sending.is_some() || self.has(cccr::MON) {
            return None;
        }
        Some(self.frame(self.next()?.buffer))
    }

    fn requested(&self) -> Option<Nanos> {
        let sending = self.sending?;
        let pending = self.pending.iter().find(|pending| pending.buffer == sending)?;
        Some(pending.requested)
    }

    fn sends(&self) -> bool {
        self.sending.is_some()
    }

    fn begin(&mut self, own: bool) {
        self.busy = true;
        if own {
            self.sending = self.next().map(|pending| pending.buffer);
        }
        let bit = self.bit();
        if let Some(wait) = &mut self.wait {
            wait.begin(self.now, bit);
        }
    }

    fn lose(&mut self) {
        // 44.3.2 DAR: a frame that lost arbitration is not retransmitted either.
        if self.has(cccr::DAR)
            && let Some(pending) = self.next()
        {
            self.finish_cancellation(pending.buffer);
        }
    }

    fn receive(&mut self, frame: &Frame) {
        self.last_error = psr::NONE;
        if let Some(flags) = frame.fd {
            let when = |set, bit| if set { bit } else { 0 };
            self.received_flags |=
                psr::REDL | when(flags.bit_rate_switch, psr::RBRS) | when(flags.error_passive, psr::RESI);
            if flags.bit_rate_switch {
                self.last_data_error = psr::NONE;
            }
        }
        self.confine(Confinement::received);
        if let Some((fifo, filter)) = self.filter(frame) {
            self.store(fifo, frame, filter);
        }
    }

    fn receive_error(&mut self, fault: Fault) {
        self.note(fault);
        self.confine(|confinement| confinement.receive_fault(fault));
    }

    fn transmit_error(&mut self, fault: Fault) {
        self.note(fault);
        self.confine(|confinement| confinement.transmit_error(fault.error));
    }

    fn end(&mut self, sent: bool, free: Nanos) {
        self.busy = false;
        self.free = free;
        if let Some(buffer) = self.sending.take() {
            if sent {
                self.last_error = psr::NONE;
                self.pending.retain(|pending| pending.buffer != buffer);
                self.cancelling &= !(1 << buffer);
                self.transmitted |= 1 << buffer;
                if self.txbtie >> buffer & 1 != 0 {
                    self.ir |= ir::TC;
                }
                if self.pending.is_empty() {
                    self.ir |= ir::TFE;
                }
                self.confine(Confinement::transmitted);
            } else if self.has(cccr::DAR) || self.cancelling >> buffer & 1 != 0 {
                self.finish_cancellation(buffer);
            }
        }
        if let Some(wait) = &mut self.wait {
            wait.end(free);
        }
    }

    fn due(&self) -> Option<Nanos> {
        self.wait.as_ref()?.due(self.bit())
    }

    fn tick(&mut self) {
        if self.due().is_some_and(|due| due <= self.now) {
            self.wait = None;
            if self.state() == ErrorState::BusOff {
                self.confine(Confinement::recover);
            }
        }
    }
}
