//! The controller (RM0090, chapter 32): its registers, and its interface to the bus.
//!
//! | Behaviour | Section |
//! |---|---|
//! | Initialization, normal and sleep mode; each waits for the frame on the bus, leaving takes 11 recessive bits | 32.4 |
//! | Wake-up by software and by a start of frame | 32.4.3 |
//! | Silent and loop back mode, and both | 32.5 |
//! | Transmit mailboxes: priority by identifier or by request, abort, no automatic retransmission | 32.7.1 |
//! | Receive FIFOs: overrun, locked or not | 32.7.3 |
//! | Filters | 32.7.4, in [`filter`](super::filter) |
//! | Error counters, bus-off and its recovery by 128 times 11 recessive bits | 32.7.6, in [`confinement`](crate::can::confinement) |
//! | Bit time | 32.7.7 |
//! | Interrupts | 32.8 |
//! | Write protection of BTR, of mailboxes in use and of filters | 32.9.1 to 32.9.4 |
//!
//! Not modelled: time triggered communication (TTCM has no effect, time stamps stay 0), DBF, the sampled pin (always
//! recessive), and the bits that a controller in loop back mode drives onto the bus.

use std::collections::VecDeque;

use armwire_sim::can::{Frame, INTERMISSION_BITS, Id, OnTheWire};

use super::filter::Filters;
use super::registers::*;
use crate::can::confinement::Confinement;
use crate::can::wait::Wait;
use crate::can::{BusError, Capability, Controller, ErrorState, Fault, span};
use crate::line::SECOND;
use crate::time::Nanos;

/// The clock before the firmware configures the clock tree: the internal oscillator (7.2.2).
const RESET_HZ: u64 = 16_000_000;

/// Number of times 11 recessive bits for a recovery from bus-off (32.7.6).
const RECOVERY: u32 = 128;

/// Number of frames in a FIFO.
const FIFO_DEPTH: usize = 3;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mode {
    Initialization,
    Normal,
    #[default]
    Sleep,
}

#[derive(Clone, Copy, Debug, Default)]
struct Mailbox {
    /// TIxR, TDTxR, TDLxR and TDHxR.
    registers: [u32; 4],
    pending: bool,
    /// Its position in the order of requests, and the time of the request.
    order: u64,
    requested: Nanos,
    /// RQCP, TXOK, ALST and TERR.
    status: u32,
    aborting: bool,
}

impl Mailbox {
    fn frame(&self) -> Frame {
        let [identifier, length, low, high] = self.registers;
        let id = if identifier & identifier::IDE != 0 {
            Id::Extended(identifier >> identifier::EXID_AT)
        } else {
            Id::Standard((identifier >> identifier::STID_AT) as u16)
        };
        let mut data = [0; 8];
        for (byte, value) in data
            .iter_mut()
            .zip(low.to_le_bytes().into_iter().chain(high.to_le_bytes()))
        {
            *byte = value;
        }
        let remote = identifier & identifier::RTR != 0;
        Frame::classic(id, remote, (length & length::DLC) as u8, &data)
    }

    /// The request is complete.
    fn complete(&mut self, status: u32) {
        self.pending = false;
        self.aborting = false;
        self.registers[0] &= !identifier::TXRQ;
        self.status |= tsr::RQCP | status;
    }
}

/// RIxR of a frame.
fn identifier_of(frame: &Frame) -> u32 {
    let id = match frame.id {
        Id::Standard(id) => u32::from(id) << identifier::STID_AT,
        Id::Extended(id) => id << identifier::EXID_AT | identifier::IDE,
    };
    id | if frame.remote { identifier::RTR } else { 0 }
}

#[derive(Debug, Default)]
struct Fifo {
    /// RIxR, RDTxR, RDLxR and RDHxR of each frame.
    frames: VecDeque<[u32; 4]>,
    full: bool,
    overrun: bool,
}

/// A frame that the controller sends to itself.
#[derive(Clone, Copy, Debug)]
struct Echo {
    frame: Frame,
    valid: Nanos,
    end: Nanos,
    received: bool,
}

/// The controller.
#[derive(Debug, Default)]
pub(super) struct Core {
    /// The instant of the present event.
    pub(super) now: Nanos,
    pub(super) clock_hz: u64,
    /// True while initialization mode cannot be entered.
    out_of_reach: bool,
    mode: Mode,
    wait: Option<Wait>,
    /// True while a frame is on the bus.
    busy: bool,
    /// The end of the last frame and its intermission.
    free: Nanos,
    mcr: u32,
    /// ERRI, WKUI and SLAKI.
    flags: u32,
    ier: u32,
    btr: u32,
    last_error: u32,
    mailboxes: [Mailbox; MAILBOX_COUNT],
    requests: u64,
    /// The mailbox whose frame is on the bus.
    sending: Option<usize>,
    echo: Option<Echo>,
    fifos: [Fifo; FIFO_COUNT],
    filters: Filters,
    confinement: Confinement,
}

impl Core {
    /// The reset state of the controller: asleep (32.4.3).
    pub(super) fn new() -> Self {
        Self {
            clock_hz: RESET_HZ,
            mcr: mcr::AFTER_RESET,
            btr: btr::AFTER_RESET,
            ..Self::default()
        }
    }
}

/// The processor's interface.
impl Core {
    pub(super) fn read(&self, offset: u32) -> u32 {
        match offset {
            MCR => self.mcr,
            MSR => self.master_status(),
            TSR => self.transmit_status(),
            RF0R | RF1R => self.fifo_status(fifo_of(offset)),
            IER => self.ier,
            ESR => self.error_status(),
            BTR => self.btr,
            MAILBOXES..FIFOS => {
                let (mailbox, register) = place(offset - MAILBOXES);
                self.mailboxes[mailbox].registers[register]
            }
            FIFOS..FIFOS_END => {
                let (fifo, register) = place(offset - FIFOS);
                self.fifos[fifo].frames.front().map_or(0, |frame| frame[register])
            }
            _ => self.filters.read(offset),
        }
    }

    pub(super) fn write(&mut self, offset: u32, value: u32) {
        match offset {
            MCR => self.write_control(value),
            MSR => self.flags &= !(value & msr::CLEARABLE),
            TSR => self.write_transmit_status(value),
            RF0R | RF1R => self.write_fifo(fifo_of(offset), value),
            IER => self.ier = value & ier::WRITABLE,
            ESR => self.last_error = value >> esr::LEC_AT & esr::LEC,
            BTR if self.mode == Mode::Initialization => self.btr = value & btr::WRITABLE,
            MAILBOXES..FIFOS => self.write_mailbox(offset, value),
            _ => self.filters.write(offset, value),
        }
        self.change_mode();
    }

    /// The levels of TX, RX0, RX1 and SCE (32.8).
    pub(super) fn interrupts(&self) -> [bool; 4] {
        let enabled = |bits: u32| self.ier & bits != 0;
        let completed = self.mailboxes.iter().any(|mailbox| mailbox.status & tsr::RQCP != 0);
        let fifo = |nth: usize| {
            let fifo = &self.fifos[nth];
            let enabled = |bits: u32| enabled(bits << (3 * nth));
            enabled(ier::FMPIE) && !fifo.frames.is_empty()
                || enabled(ier::FFIE) && fifo.full
                || enabled(ier::FOVIE) && fifo.overrun
        };
        let status = |enable: u32, flag: u32| enabled(enable) && self.flags & flag != 0;
        [
            enabled(ier::TMEIE) && completed,
            fifo(0),
            fifo(1),
            status(ier::ERRIE, msr::ERRI) || status(ier::WKUIE, msr::WKUI) || status(ier::SLKIE, msr::SLAKI),
        ]
    }

    fn write_control(&mut self, value: u32) {
        if value & mcr::RESET != 0 {
            // 32.9.2: sleep mode; MCR and the FIFOs are in their reset state.
            *self = Self {
                now: self.now,
                clock_hz: self.clock_hz,
                busy: self.busy,
                free: self.free,
                btr: self.btr,
                filters: std::mem::take(&mut self.filters),
                ..Self::new()
            };
            return;
        }
        self.mcr = value & mcr::WRITABLE;
        if self.mode == Mode::Normal && self.bus_off() && self.has(mcr::ABOM) && self.wait.is_none() {
            self.wait_for(RECOVERY);
        }
    }

    fn master_status(&self) -> u32 {
        let mode = match self.mode {
            Mode::Initialization => msr::INAK,
            Mode::Sleep => msr::SLAK,
            Mode::Normal => 0,
        };
        let activity = match (self.busy, self.sending) {
            (_, Some(_)) => msr::TXM,
            (true, None) if self.takes_part() => msr::RXM,
            _ => 0,
        };
        mode | self.flags | activity | msr::RECESSIVE
    }

    fn transmit_status(&self) -> u32 {
        let mut status = 0;
        for (nth, mailbox) in self.mailboxes.iter().enumerate() {
            let abort = if mailbox.aborting { tsr::ABRQ } else { 0 };
            status |= (mailbox.status | abort) << (8 * nth);
            if !mailbox.pending {
                status |= tsr::TME << nth;
            }
        }
        let order = self.order();
        if let [_, .., last] = order[..] {
            status |= tsr::LOW << last;
        }
        // The next free mailbox, or the one that is sent last.
        let free = self.mailboxes.iter().position(|mailbox| !mailbox.pending);
        let code = free.or(order.last().copied()).unwrap_or(0);
        status | (code as u32) << tsr::CODE_AT
    }

    fn write_transmit_status(&mut self, value: u32) {
        for (nth, mailbox) in self.mailboxes.iter_mut().enumerate() {
            let value = value >> (8 * nth);
            if value & tsr::RQCP != 0 {
                mailbox.status = 0;
            }
            if value & tsr::ABRQ != 0 && mailbox.pending {
                // 32.7.1: a frame in transmission is not interrupted.
                if self.sending == Some(nth) {
                    mailbox.aborting = true;
                } else {
                    mailbox.complete(0);
                }
            }
        }
    }

    /// An occupied mailbox is write-protected (32.9.3).
    fn write_mailbox(&mut self, offset: u32, value: u32) {
        let (nth, register) = place(offset - MAILBOXES);
        let mailbox = &mut self.mailboxes[nth];
        if mailbox.pending {
            return;
        }
        mailbox.registers[register] = value;
        if offset % MAILBOX_SPAN == IDENTIFIER && value & identifier::TXRQ != 0 {
            self.requests += 1;
            mailbox.order = self.requests;
            mailbox.requested = self.now;
            mailbox.pending = true;
            mailbox.status = 0;
        }
    }

    fn fifo_status(&self, nth: usize) -> u32 {
        let fifo = &self.fifos[nth];
        let flag = |set: bool, bit: u32| if set { bit } else { 0 };
        fifo.frames.len() as u32 | flag(fifo.full, rfr::FULL) | flag(fifo.overrun, rfr::FOVR)
    }

    fn write_fifo(&mut self, nth: usize, value: u32) {
        let fifo = &mut self.fifos[nth];
        if value & rfr::FULL != 0 {
            fifo.full = false;
        }
        if value & rfr::FOVR != 0 {
            fifo.overrun = false;
        }
        if value & rfr::RFOM != 0 {
            fifo.frames.pop_front();
        }
    }

    fn error_status(&self) -> u32 {
        let flag = |set: bool, bit: u32| if set { bit } else { 0 };
        flag(self.confinement.warns(), esr::EWGF)
            | flag(self.confinement.is_passive(), esr::EPVF)
            | flag(self.bus_off(), esr::BOFF)
            | self.last_error << esr::LEC_AT
            | self.confinement.transmit() << esr::TEC_AT
            | self.confinement.receive() << esr::REC_AT
    }
}

/// Internal behaviour.
impl Core {
    fn has(&self, control: u32) -> bool {
        self.mcr & control != 0
    }

    fn loops_back(&self) -> bool {
        self.btr & btr::LBKM != 0
    }

    fn is_silent(&self) -> bool {
        self.btr & btr::SILM != 0
    }

    fn bus_off(&self) -> bool {
        self.confinement.state() == ErrorState::BusOff
    }

    /// Returns true if its wait is over: it may send and receive.
    fn takes_part(&self) -> bool {
        self.mode == Mode::Normal && !self.bus_off() && self.picoseconds() > 0
    }

    /// The bit time: a synchronization quantum, and two segments (32.7.7).
    fn picoseconds(&self) -> u64 {
        let prescaler = u64::from(self.btr & btr::BRP) + 1;
        let first = u64::from(self.btr >> btr::TS1_AT & btr::TS1) + 1;
        let second = u64::from(self.btr >> btr::TS2_AT & btr::TS2) + 1;
        (prescaler * (1 + first + second) * SECOND)
            .checked_div(self.clock_hz)
            .unwrap_or(0)
    }

    fn wait_for(&mut self, left: u32) {
        self.wait = Some(Wait::new(left, (!self.busy).then_some(self.now.max(self.free))));
    }

    /// Blocks initialization mode, or unblocks it.
    pub(super) fn keep_from_initialization(&mut self, keep: bool) {
        if std::mem::replace(&mut self.out_of_reach, keep) && !keep {
            self.change_mode();
        }
    }

    /// Applies INRQ and SLEEP (32.4), once it takes part in no frame on the bus.
    fn change_mode(&mut self) {
        let wanted = match (self.has(mcr::INRQ), self.has(mcr::SLEEP)) {
            (true, false) => Mode::Initialization,
            (false, true) => Mode::Sleep,
            (false, false) => Mode::Normal,
            (true, true) => return,
        };
        if wanted == self.mode {
            if wanted != Mode::Normal {
                self.wait = None;
            }
            return;
        }
        if wanted == Mode::Normal {
            if self.wait.is_none() {
                self.wait_for(1);
            }
            return;
        }
        let engaged = self.sending.is_some() || self.busy && self.listens();
        if engaged || wanted == Mode::Initialization && self.out_of_reach {
            return;
        }
        self.mode = wanted;
        self.wait = None;
        if wanted == Mode::Sleep && self.ier & ier::SLKIE != 0 {
            self.flags |= msr::SLAKI;
        }
    }

    /// The wait has ended.
    fn waited(&mut self) {
        if self.mode == Mode::Normal {
            self.watch_errors(|confinement| confinement.recover());
            return;
        }
        // 32.7.6: without ABOM, leaving initialization mode starts the recovery.
        let recovers = self.bus_off() && (self.mode == Mode::Initialization || self.has(mcr::ABOM));
        self.mode = Mode::Normal;
        if recovers {
            self.wait_for(RECOVERY);
        }
    }

    /// The pending mailboxes, in the order of transmission (32.7.1).
    fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..MAILBOX_COUNT).filter(|&nth| self.mailboxes[nth].pending).collect();
        if self.has(mcr::TXFP) {
            order.sort_by_key(|&nth| self.mailboxes[nth].order);
        } else {
            order.sort_by(|&a, &b| self.mailboxes[a].frame().arbitrates(&self.mailboxes[b].frame()));
        }
        order
    }

    /// Counts an error, and sets ERRI for a change that it causes (32.8).
    fn watch_errors(&mut self, count: impl FnOnce(&mut Confinement)) {
        let levels = |core: &Self| [core.confinement.warns(), core.confinement.is_passive(), core.bus_off()];
        let before = levels(self);
        count(&mut self.confinement);
        let enables = [ier::EWGIE, ier::EPVIE, ier::BOFIE];
        for ((before, after), enable) in before.into_iter().zip(levels(self)).zip(enables) {
            if !before && after && self.ier & enable != 0 {
                self.flags |= msr::ERRI;
            }
        }
    }

    fn note_error(&mut self, error: BusError) {
        self.last_error = error as u32;
        if self.ier & ier::LECIE != 0 {
            self.flags |= msr::ERRI;
        }
    }

    /// The frame of the mailbox on the bus has ended.
    fn finish(&mut self, sent: bool) {
        let Some(nth) = self.sending.take() else {
            return;
        };
        let once = self.has(mcr::NART);
        let mailbox = &mut self.mailboxes[nth];
        if sent {
            self.last_error = 0;
            mailbox.complete(tsr::TXOK);
            self.confinement.transmitted();
        } else {
            mailbox.status |= tsr::TERR;
            if once || mailbox.aborting {
                mailbox.complete(0);
            }
        }
    }

    /// A frame passes the filters into a FIFO (32.7.3).
    fn store(&mut self, frame: &Frame) {
        let identifier = identifier_of(frame);
        let Some(found) = self.filters.find(identifier) else {
            return;
        };
        let mut data = [0; 8];
        for (byte, value) in data.iter_mut().zip(frame.payload()) {
            *byte = *value;
        }
        let [low, high] = [
            [data[0], data[1], data[2], data[3]],
            [data[4], data[5], data[6], data[7]],
        ];
        let received = [
            identifier,
            u32::from(frame.dlc) | found.index << length::FMI_AT,
            u32::from_le_bytes(low),
            u32::from_le_bytes(high),
        ];
        let locked = self.has(mcr::RFLM);
        let fifo = &mut self.fifos[found.fifo];
        if fifo.frames.len() < FIFO_DEPTH {
            fifo.frames.push_back(received);
            fifo.full |= fifo.frames.len() == FIFO_DEPTH;
            return;
        }
        fifo.overrun = true;
        if !locked && let Some(last) = fifo.frames.back_mut() {
            *last = received;
        }
    }

    /// The next mailbox in loop back mode, after the end of the last frame.
    fn next_echo(&self) -> Option<usize> {
        let ready = self.takes_part() && self.loops_back() && self.echo.is_none() && self.sending.is_none();
        ready.then(|| self.order().first().copied()).flatten()
    }

    /// Loop back mode (32.5.2): the controller receives its own frame, without an acknowledge.
    fn tick_echo(&mut self) {
        let Some(mut echo) = self.echo else {
            let bit = self.picoseconds();
            self.sending = self.next_echo();
            self.echo = self.sending.map(|nth| {
                let frame = self.mailboxes[nth].frame();
                Echo {
                    frame,
                    valid: self.now + span(frame.bits_until_valid(), bit),
                    end: self.now + span(frame.bits_on_the_wire(), bit),
                    received: false,
                }
            });
            return;
        };
        if !echo.received {
            echo.received = true;
            self.echo = Some(echo);
            self.store(&echo.frame);
        } else {
            self.echo = None;
            self.finish(true);
            self.free = echo.end + span(INTERMISSION_BITS, self.picoseconds());
            self.change_mode();
        }
    }

    fn echo_due(&self) -> Option<Nanos> {
        match self.echo {
            Some(echo) if echo.received => Some(echo.end),
            Some(echo) => Some(echo.valid),
            None => self.next_echo().map(|_| self.free.max(self.now)),
        }
    }

    fn wait_due(&self) -> Option<Nanos> {
        self.wait?.due(self.picoseconds())
    }
}

/// The bus's interface.
impl Controller for Core {
    fn bit(&self) -> u64 {
        self.picoseconds()
    }

    /// It does not support FD frames (32.2).
    fn capability(&self) -> Capability {
        Capability::Classic
    }

    fn listens(&self) -> bool {
        self.takes_part() && !self.loops_back()
    }

    fn drives(&self) -> bool {
        !self.is_silent()
    }

    fn state(&self) -> ErrorState {
        self.confinement.state()
    }

    fn offer(&self) -> Option<Frame> {
        let speaks = self.listens() && self.drives() && self.sending.is_none();
        let next = speaks.then(|| self.order().first().copied()).flatten()?;
        Some(self.mailboxes[next].frame())
    }

    fn requested(&self) -> Option<Nanos> {
        self.sending.map(|nth| self.mailboxes[nth].requested)
    }

    fn sends(&self) -> bool {
        self.sending.is_some() && self.echo.is_none()
    }

    fn begin(&mut self, own: bool) {
        self.busy = true;
        if own {
            self.sending = self.order().first().copied();
        }
        if self.mode == Mode::Sleep {
            // 32.4.3: a start of frame.
            self.flags |= msr::WKUI;
            if self.has(mcr::AWUM) {
                self.mcr &= !mcr::SLEEP;
                self.change_mode();
            }
        }
        let bit = self.picoseconds();
        if let Some(wait) = &mut self.wait {
            wait.begin(self.now, bit);
        }
    }

    fn lose(&mut self) {
        let Some(nth) = self.order().first().copied() else {
            return;
        };
        let once = self.has(mcr::NART);
        let mailbox = &mut self.mailboxes[nth];
        mailbox.status |= tsr::ALST;
        if once {
            mailbox.complete(0);
        }
    }

    fn receive(&mut self, frame: &Frame) {
        self.last_error = 0;
        self.confinement.received();
        self.store(frame);
    }

    fn receive_error(&mut self, fault: Fault) {
        self.note_error(fault.error);
        self.watch_errors(|confinement| confinement.receive_fault(fault));
    }

    fn transmit_error(&mut self, fault: Fault) {
        self.note_error(fault.error);
        self.watch_errors(|confinement| confinement.transmit_error(fault.error));
    }

    fn end(&mut self, sent: bool, free: Nanos) {
        self.busy = false;
        self.free = free;
        if self.sends() {
            self.finish(sent);
        }
        if let Some(wait) = &mut self.wait {
            wait.end(free);
        } else if self.bus_off() && self.has(mcr::ABOM) {
            self.wait_for(RECOVERY);
        }
        self.change_mode();
    }

    fn due(&self) -> Option<Nanos> {
        [self.wait_due(), self.echo_due()].into_iter().flatten().min()
    }

    fn tick(&mut self) {
        if self.wait_due().is_some_and(|due| due <= self.now) {
            self.wait = None;
            self.waited();
            self.change_mode();
        } else if self.echo_due().is_some_and(|due| due <= self.now) {
            self.tick_echo();
        }
    }
}

/// The index of a mailbox or FIFO, and of its register.
fn place(offset: u32) -> (usize, usize) {
    ((offset / MAILBOX_SPAN) as usize, (offset % MAILBOX_SPAN / 4) as usize)
}

fn fifo_of(offset: u32) -> usize {
    usize::from(offset == RF1R)
}

#[cfg(test)]
mod tests;
