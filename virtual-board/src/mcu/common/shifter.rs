//! The shift registers of a USART, with the line at its pins. Registers, flags and their clearing are chip-specific.

use crate::line::{AnyLine, Arm, Arrival, Format, Line};
use crate::shared::lock;
use crate::soc::peripheral::Peripheral;
use crate::time::Nanos;

/// The register settings that concern the line.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Settings {
    /// The bit time in picoseconds, 0 without a divider.
    pub(crate) bit: u64,
    pub(crate) format: Format,
    pub(crate) half_duplex: bool,
    /// True if the transmitter is enabled.
    pub(crate) transmits: bool,
    /// True if the receiver is enabled.
    pub(crate) receives: bool,
    /// True if a receiver that is switched off completes its byte before.
    pub(crate) completes: bool,
}

impl Settings {
    /// Duration of a byte.
    fn byte(&self) -> Nanos {
        Nanos(self.format.bits() * self.bit / 1_000)
    }

    fn listens(&self) -> bool {
        self.receives && self.bit > 0
    }

    fn sends(&self) -> bool {
        self.transmits && self.bit > 0
    }
}

/// The events of an instant.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Progress {
    /// A byte was sent, and the data register is empty.
    pub(crate) complete: bool,
    /// A byte has arrived.
    pub(crate) arrived: Option<Arrival>,
    /// The line has been idle for one frame, as requested by [`Shifter::expect_idle`].
    pub(crate) idle: bool,
}

/// The UART of a chip.
pub(crate) trait Uart: Peripheral {
    /// Returns true if the receiver requests a DMA transfer.
    fn requests_receive(&self) -> bool;

    /// Returns true if the transmitter requests a DMA transfer.
    fn requests_transmit(&self) -> bool;

    /// Returns true if it and its transmitter are enabled: it drives its pin.
    fn transmits(&self) -> bool;
}

/// The shift registers of the transmitter and of the receiver.
#[derive(Debug)]
pub(crate) struct Shifter {
    line: AnyLine,
    settings: Settings,
    /// The frame in transmission, and the end of its last stop bit. `None` is an idle frame.
    sending: Option<(Nanos, Option<u8>)>,
    /// The byte in reception, and the end of its last stop bit.
    arriving: Option<(Nanos, Arrival)>,
    /// The time at which the line has been idle for one frame.
    idle_at: Option<Nanos>,
    /// The time of the arm's next byte.
    arm_due: Option<Nanos>,
}

impl Shifter {
    pub(crate) fn new(line: AnyLine) -> Self {
        Self {
            line,
            settings: Settings::default(),
            sending: None,
            arriving: None,
            idle_at: None,
            arm_due: None,
        }
    }

    pub(crate) fn line(&self) -> &AnyLine {
        &self.line
    }

    /// Applies the settings to the line, and updates the time of the arm's next byte.
    pub(crate) fn set(&mut self, settings: Settings, now: Nanos) {
        self.settings = settings;
        let mut line = lock(&self.line);
        line.set_board_bit(settings.bit);
        line.set_board_format(settings.format);
        line.set_half_duplex(settings.half_duplex);
        let completes = settings.completes && self.arriving.is_some();
        if !settings.listens() && !completes {
            self.arriving = None;
            line.nobody_receives(now);
        }
        self.arm_due = line.due();
    }

    /// Returns true while a frame is being sent.
    pub(crate) fn is_sending(&self) -> bool {
        self.sending.is_some()
    }

    /// Returns true while a byte is being received.
    #[inline]
    pub(crate) fn is_receiving(&self) -> bool {
        self.arriving.is_some()
    }

    /// Sends an idle frame, if no frame is being sent.
    pub(crate) fn send_idle_frame(&mut self, now: Nanos) {
        if self.sending.is_none() && self.settings.sends() {
            self.sending = Some((now + self.settings.byte(), None));
        }
    }

    /// Aborts the frame in transmission. Returns true if it was a byte.
    pub(crate) fn cut(&mut self) -> bool {
        self.sending.take().is_some_and(|(_, sent)| sent.is_some())
    }

    /// Garbles the byte in reception.
    pub(crate) fn garble(&mut self) {
        if let Some((_, arrival)) = &mut self.arriving {
            arrival.garble();
            lock(&self.line).board_garbles();
        }
    }

    /// Aborts transmission and reception.
    pub(crate) fn stop(&mut self) {
        self.sending = None;
        self.arriving = None;
        self.idle_at = None;
    }

    /// Takes the byte from the data register, if no frame is being sent.
    pub(crate) fn start_to_send(&mut self, now: Nanos, data: &mut Option<u8>) {
        let line = self.line.clone();
        self.take_data(now, data, &mut lock(&line));
    }

    fn take_data(&mut self, now: Nanos, data: &mut Option<u8>, line: &mut Line<dyn Arm>) {
        if self.sending.is_some() || !self.settings.sends() {
            return;
        }
        let Some(byte) = data.take() else {
            return;
        };
        self.sending = Some((now + self.settings.byte(), Some(byte)));
        if line.is_half_duplex() {
            line.board_starts(now, byte);
            self.find_start_bit(now, line);
        }
    }

    /// Looks for a start bit, if no byte is being received.
    pub(crate) fn listen(&mut self, now: Nanos) {
        let line = self.line.clone();
        self.find_start_bit(now, &mut lock(&line));
    }

    fn find_start_bit(&mut self, now: Nanos, line: &mut Line<dyn Arm>) {
        if self.arriving.is_some() || !self.settings.listens() {
            return;
        }
        if let Some(arrival) = line.board_receives(now) {
            self.arriving = Some((now + self.settings.byte(), arrival));
            self.idle_at = None;
        }
    }

    /// Executes due events, with the byte in the transmitter's data register.
    pub(crate) fn advance(&mut self, now: Nanos, data: &mut Option<u8>) -> Progress {
        let line = self.line.clone();
        let mut line = lock(&line);
        let mut progress = Progress::default();
        line.collide(now);
        if let Some((_, sent)) = self.sending.take_if(|(ends, _)| *ends <= now) {
            if let Some(byte) = sent {
                line.board_sent(now, byte);
                progress.complete = data.is_none();
            }
            self.take_data(now, data, &mut line);
        }
        if let Some((_, mut arrival)) = self.arriving.take_if(|(ends, _)| *ends <= now) {
            if line.has_collided() {
                arrival.garble();
            }
            progress.arrived = Some(arrival);
            match self.settings.listens() {
                true => self.find_start_bit(now, &mut line),
                false => line.last_arrived(now),
            }
        }
        progress.idle = self.idle_at.take_if(|at| *at <= now).is_some();
        self.arm_due = line.due();
        if self.arriving.is_none() && self.arm_due.is_some_and(|due| due <= now) {
            if self.settings.listens() {
                self.find_start_bit(now, &mut line);
            } else {
                line.nobody_receives(now);
            }
            self.arm_due = line.due();
        }
        progress
    }

    /// Waits for an idle frame after the last byte, unless another follows at once.
    pub(crate) fn expect_idle(&mut self, now: Nanos) {
        if self.arriving.is_none() {
            self.idle_at = Some(now + self.settings.byte());
        }
    }

    /// The time of the next event.
    pub(crate) fn due(&self) -> Option<Nanos> {
        let sending = self.sending.map(|(ends, _)| ends);
        let arriving = self.arriving.map(|(ends, _)| ends);
        let arm = self.arm_due.filter(|_| self.arriving.is_none());
        [sending, arriving, self.idle_at, arm].into_iter().flatten().min()
    }
}
