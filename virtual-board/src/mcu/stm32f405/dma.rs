//! DMA1 and DMA2 (RM0090, chapter 10).
//!
//! Modelled are peripheral to memory and memory to peripheral in direct mode, by bytes, circular or not; a stream that
//! is disabled completes the transfer in progress, and sets its flag (10.3.14). A stream to a peripheral reads its first
//! byte as soon as it is enabled, and each other one after the write of the one before (10.3.6); a byte that was read and
//! not requested is lost as the stream is disabled. Refused with their name: wider transfers, memory to memory, FIFO mode,
//! double buffers, bursts, the peripheral as flow controller.

use crate::mcu::common::dma::{self as common, Count, Requests, Step, Steps, Transfer};
use crate::soc::peripheral::{Peripheral, Refused, check_modelled, field, forbidden};
use crate::time::Nanos;

/// Number of streams of a controller (10.2), and of both.
pub(super) const STREAMS: usize = 8;
pub(super) const ALL_STREAMS: usize = 2 * STREAMS;

/// The bytes of a controller's registers: DMA2 follows DMA1.
const SIZE: u32 = 0x400;

const LISR: u32 = 0x00;
const HISR: u32 = 0x04;
const LIFCR: u32 = 0x08;
const HIFCR: u32 = 0x0C;
/// The first stream's registers, and the registers of each stream (10.5.5 to 10.5.10).
const FIRST: u32 = 0x10;
const EACH: u32 = 0x18;
const LAST: u32 = FIRST + EACH * STREAMS as u32;
const CR: u32 = 0x00;
const NDTR: u32 = 0x04;
const PAR: u32 = 0x08;
const M0AR: u32 = 0x0C;
const M1AR: u32 = 0x10;
const FCR: u32 = 0x14;

/// Flags of a stream (10.5.1), and their positions in LISR or HISR: streams 0 to 3, 4 to 7.
mod flag {
    pub(super) const ERROR: u32 = 1 << 3;
    pub(super) const HALF: u32 = 1 << 4;
    pub(super) const COMPLETE: u32 = 1 << 5;
    pub(super) const ALL: u32 = 0x3D;
    pub(super) const AT: [u32; 4] = [0, 6, 16, 22];
}

/// Bits of CR (10.5.5). The interrupt enables are one bit below the flags.
mod cr {
    pub(super) const EN: u32 = 1;
    pub(super) const INTERRUPTS: u32 = (super::flag::ERROR | super::flag::HALF | super::flag::COMPLETE) >> 1;
    pub(super) const DMEIE: u32 = 1 << 1;
    pub(super) const DIR: u32 = 0b11 << 6;
    pub(super) const FROM_MEMORY: u32 = 1 << 6;
    pub(super) const TO_PERIPHERAL_OR_BACK: u32 = 0b01 << 6;
    pub(super) const CIRC: u32 = 1 << 8;
    pub(super) const MINC: u32 = 1 << 10;
    pub(super) const PL: u32 = 0b11 << 16;
    pub(super) const CHSEL_AT: u32 = 25;
    pub(super) const CHSEL: u32 = 0b111;
    pub(super) const MODELLED: u32 =
        EN | DMEIE | INTERRUPTS | TO_PERIPHERAL_OR_BACK | CIRC | MINC | PL | CHSEL << CHSEL_AT;
}

/// The reset value of FCR: direct mode, the FIFO empty (10.5.10). FTH has no meaning in direct mode.
const FCR_AT_RESET: u32 = 0x21;
const FTH: u32 = 0b11;
const FS: u32 = 0b111 << 3;

const NDT: u32 = 0xFFFF;

/// Behaviour of the counter and the addresses of a DMA stream that is enabled again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reenabled {
    /// It restarts, as in the manual (10.5.6).
    #[default]
    Restarts,
    /// It continues unless it was reconfigured, as reported for some silicon.
    Resumes,
}

/// A request line: the controller, 0 or 1, the stream and the channel (10.3.3, tables 42 and 43).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Request {
    controller: usize,
    stream: usize,
    channel: u32,
}

impl Request {
    /// A request line of DMA1.
    pub(super) const fn of_dma1(stream: usize, channel: u32) -> Self {
        Self {
            controller: 0,
            stream,
            channel,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Stream {
    cr: u32,
    /// NDTR.
    count: Count,
    par: u32,
    m0ar: u32,
    m1ar: u32,
    fcr: u32,
    /// The stream was disabled, and completes the transfer in progress.
    stopping: bool,
}

impl Stream {
    const OFF: Self = Self {
        cr: 0,
        count: Count { left: 0, programmed: 0 },
        par: 0,
        m0ar: 0,
        m1ar: 0,
        fcr: FCR_AT_RESET,
        stopping: false,
    };

    fn is_on(&self) -> bool {
        self.cr & cr::EN != 0
    }

    fn channel(&self) -> u32 {
        field(self.cr, cr::CHSEL_AT, cr::CHSEL)
    }

    /// The present transfer.
    fn transfer(&self) -> Transfer {
        let done = if self.cr & cr::MINC != 0 { self.count.done() } else { 0 };
        Transfer {
            peripheral: self.par,
            memory: self.m0ar.wrapping_add(done),
            from_memory: self.cr & cr::DIR == cr::FROM_MEMORY,
        }
    }
}

/// Both controllers.
#[derive(Debug)]
pub(super) struct Dma {
    streams: [Stream; ALL_STREAMS],
    flags: [u32; ALL_STREAMS],
    reenabled: Reenabled,
    steps: Steps<ALL_STREAMS>,
    /// The requests of the UART's receiver and transmitter.
    uart: [Request; 2],
}

impl Dma {
    /// Both controllers, which serve a UART with these requests of its receiver and its transmitter.
    pub(super) fn new(reenabled: Reenabled, seed: u64, uart: [Request; 2]) -> Self {
        Self {
            streams: [Stream::OFF; ALL_STREAMS],
            flags: [0; ALL_STREAMS],
            reenabled,
            steps: Steps::new(seed),
            uart,
        }
    }

    #[cfg(test)]
    pub(super) fn set_delays(&mut self, delays: crate::mcu::common::dma::Delays) {
        self.steps.set_delays(delays);
    }

    /// Resets a controller, 0 or 1.
    pub(super) fn reset_controller(&mut self, controller: usize) {
        for stream in controller * STREAMS..(controller + 1) * STREAMS {
            self.streams[stream] = Stream::OFF;
            self.flags[stream] = 0;
            self.steps.stop(stream);
        }
    }

    /// The level of a stream's interrupt line.
    #[inline]
    pub(super) fn interrupts(&self, stream: usize) -> bool {
        (self.flags[stream] >> 1) & self.streams[stream].cr & cr::INTERRUPTS != 0
    }

    /// Starts a transfer for a request that is high, if its stream waits for one.
    #[inline]
    fn request(&mut self, request: Request, now: Nanos) {
        let number = request.controller * STREAMS + request.stream;
        let stream = &self.streams[number];
        let can = stream.is_on() && !stream.stopping && stream.count.left > 0 && self.steps.waits(number);
        if can && stream.channel() == request.channel {
            self.steps.start(number, now);
        }
    }

    /// Returns true if the line of a request is high.
    fn is_high(&self, requests: Requests, request: Request) -> bool {
        let [receive, transmit] = self.uart;
        request == receive && requests.receive || request == transmit && requests.transmit
    }

    fn count(&mut self, number: usize, now: Nanos) {
        let stream = &mut self.streams[number];
        let circular = stream.cr & cr::CIRC != 0;
        let reached = stream.count.count(circular);
        let stopped = std::mem::take(&mut stream.stopping);
        if stopped || reached.complete && !circular {
            stream.cr &= !cr::EN;
        }
        if reached.half {
            self.flags[number] |= flag::HALF;
        }
        if reached.complete || stopped {
            self.flags[number] |= flag::COMPLETE;
        }
        self.load(number, now);
    }

    /// Reads the next byte of a stream to a peripheral ahead of its request (10.3.6, 10.3.12).
    fn load(&mut self, number: usize, now: Nanos) {
        let stream = &self.streams[number];
        if stream.is_on() && stream.count.left > 0 && stream.transfer().from_memory {
            self.steps.load(number, now);
        }
    }

    /// The flags of four streams from this one.
    fn status(&self, first: usize) -> u32 {
        let flags = self.flags[first..].iter().zip(flag::AT);
        flags.fold(0, |status, (flags, at)| status | flags << at)
    }

    fn clear(&mut self, first: usize, value: u32) {
        for (flags, at) in self.flags[first..].iter_mut().zip(flag::AT) {
            *flags &= !(value >> at & flag::ALL);
        }
    }

    fn write_stream(&mut self, number: usize, register: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        if register == CR {
            return self.write_control(number, value, now);
        }
        let stream = &mut self.streams[number];
        if stream.is_on() {
            return Err(forbidden(
                "NDTR/PAR/M0AR/M1AR/FCR",
                "10.5.6 to 10.5.10: written while EN is set",
            ));
        }
        match register {
            NDTR => stream.count.programmed = value & NDT,
            PAR => stream.par = value,
            M0AR => stream.m0ar = value,
            M1AR => stream.m1ar = value,
            FCR if value & !(FTH | FS) != 0 => return Err(Refused::Unimplemented("FCR: FIFO mode")),
            FCR => stream.fcr = FCR_AT_RESET & !FTH | value & FTH,
            _ => return Err(Refused::NoRegister),
        }
        // A reconfigured stream restarts.
        stream.count.left = stream.count.programmed;
        Ok(())
    }

    fn write_control(&mut self, number: usize, value: u32, now: Nanos) -> Result<(), Refused> {
        let refused = "CR: wide, memory to memory, peripheral increment, bursts, double buffers or flow control";
        check_modelled(refused, value, cr::MODELLED)?;
        let stream = &mut self.streams[number];
        let (was_on, on) = (stream.is_on(), value & cr::EN != 0);
        let free = cr::EN | cr::INTERRUPTS | cr::DMEIE;
        if was_on && on && (value ^ stream.cr) & !free != 0 {
            return Err(forbidden("CR", "10.5.5: written while EN is set"));
        }
        match (was_on, on) {
            (true, false) => {
                // 10.3.14: the transfer in progress ends first, and then sets its complete flag.
                let moves = self.steps.moves(number);
                stream.stopping = moves;
                if moves {
                    stream.cr = value | cr::EN;
                } else {
                    stream.cr = value;
                    self.steps.stop(number);
                    self.flags[number] |= flag::COMPLETE;
                }
            }
            (false, true) => {
                stream.cr = value;
                if self.reenabled == Reenabled::Restarts || stream.count.left == 0 {
                    stream.count.left = stream.count.programmed;
                }
                self.load(number, now);
            }
            _ => stream.cr = value,
        }
        Ok(())
    }
}

impl Peripheral for Dma {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        let (controller, offset) = (offset / SIZE, offset % SIZE);
        let first = controller as usize * STREAMS;
        match offset {
            LISR => Ok(self.status(first)),
            HISR => Ok(self.status(first + 4)),
            LIFCR | HIFCR => Ok(0),
            FIRST..LAST => {
                let (number, register) = place(first, offset);
                let stream = &self.streams[number];
                match register {
                    CR => Ok(stream.cr),
                    NDTR => Ok(stream.count.left),
                    PAR => Ok(stream.par),
                    M0AR => Ok(stream.m0ar),
                    M1AR => Ok(stream.m1ar),
                    FCR => Ok(stream.fcr),
                    _ => Err(Refused::NoRegister),
                }
            }
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        let (controller, offset) = (offset / SIZE, offset % SIZE);
        let first = controller as usize * STREAMS;
        match offset {
            LISR | HISR => Ok(()),
            LIFCR => {
                self.clear(first, value);
                Ok(())
            }
            HIFCR => {
                self.clear(first + 4, value);
                Ok(())
            }
            FIRST..LAST => {
                let (number, register) = place(first, offset);
                self.write_stream(number, register, value, now)
            }
            _ => Err(Refused::NoRegister),
        }
    }

    #[inline]
    fn due(&self) -> Option<Nanos> {
        self.steps.due()
    }
}

impl common::Dma for Dma {
    fn follow_requests(&mut self, requests: Requests, now: Nanos) {
        for request in self.uart {
            if self.is_high(requests, request) {
                self.request(request, now);
            }
        }
    }

    fn step(&mut self, requests: Requests, now: Nanos) -> Option<(usize, Step)> {
        let number = self.steps.first_due(now)?;
        let stream = &self.streams[number];
        let request = Request {
            controller: number / STREAMS,
            stream: number % STREAMS,
            channel: stream.channel(),
        };
        let is_high = self.is_high(requests, request);
        let step = self.steps.take(number, is_high, stream.transfer(), now);
        if step == Step::Count {
            self.count(number, now);
        }
        Some((number, step))
    }

    fn fetched(&mut self, stream: usize, value: u8, now: Nanos) {
        self.steps.fetched(stream, value, now);
    }

    /// The stream stops (10.3.18).
    fn fail(&mut self, stream: usize) {
        self.flags[stream] |= flag::ERROR;
        self.steps.stop(stream);
        let stream = &mut self.streams[stream];
        stream.cr &= !cr::EN;
        stream.stopping = false;
    }
}

/// The stream of a register, and the register's offset within the stream. `first` is the controller's first stream.
fn place(first: usize, offset: u32) -> (usize, u32) {
    let offset = offset - FIRST;
    (first + (offset / EACH) as usize, offset % EACH)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mcu::common::dma::Dma as _;
    use crate::mcu::common::dma::tests::{RECEIVE, check_steps, check_withdrawal};
    use crate::mcu::stm32f405::ArmUart;

    const STREAM_5: u32 = FIRST + 5 * EACH;
    const CHANNEL_4: u32 = 4 << cr::CHSEL_AT;

    /// A controller with stream 5 configured for `count` bytes and a request.
    fn dma(count: u32, control: u32) -> Dma {
        let mut dma = Dma::new(Reenabled::Restarts, 0, ArmUart::Usart2.requests());
        dma.write(STREAM_5 + NDTR, count, Nanos(0)).unwrap();
        dma.write(STREAM_5 + PAR, 0x4000_4404, Nanos(0)).unwrap();
        dma.write(STREAM_5 + M0AR, 0x2000_0000, Nanos(0)).unwrap();
        dma.write(STREAM_5 + CR, control | CHANNEL_4 | cr::EN | cr::MINC, Nanos(0))
            .unwrap();
        dma
    }

    #[test]
    fn read_write_and_count_are_steps_apart() {
        let mut dma = dma(4, 0);
        check_steps(&mut dma, 0x4000_4404);
        assert_eq!(dma.read(STREAM_5 + NDTR, Nanos(0)), Ok(3));
    }

    const TRANSMIT: Requests = Requests {
        receive: false,
        transmit: true,
    };
    const QUIET: Requests = Requests {
        receive: false,
        transmit: false,
    };
    const STREAM_6: u32 = FIRST + 6 * EACH;

    /// A controller with stream 6 enabled from memory for this number of bytes. Its request is low.
    fn sender(count: u32) -> Dma {
        let mut dma = Dma::new(Reenabled::Restarts, 0, ArmUart::Usart2.requests());
        for (register, value) in [
            (NDTR, count),
            (PAR, 0x4000_4404),
            (M0AR, 0x2000_0000),
            (CR, cr::FROM_MEMORY | CHANNEL_4 | cr::MINC | cr::EN),
        ] {
            dma.write(STREAM_6 + register, value, Nanos(0)).unwrap();
        }
        dma
    }

    /// Takes the next step, and passes this byte to a read.
    fn step(dma: &mut Dma, requests: Requests, byte: u8) -> Step {
        let due = dma.due().unwrap();
        let (stream, step) = dma.step(requests, due).unwrap();
        if matches!(step, Step::ReadMemory(_)) {
            dma.fetched(stream, byte, due);
        }
        step
    }

    #[test]
    fn stream_to_peripheral_reads_a_byte_ahead() {
        let mut dma = sender(2);
        assert_eq!(step(&mut dma, QUIET, 1), Step::ReadMemory(0x2000_0000));
        assert_eq!((dma.due(), dma.read(STREAM_6 + NDTR, Nanos(0))), (None, Ok(2)));
        dma.follow_requests(TRANSMIT, Nanos(1_000));
        assert_eq!(step(&mut dma, TRANSMIT, 0), Step::WritePeripheral(0x4000_4404, 1));
        assert_eq!(step(&mut dma, QUIET, 0), Step::Count);
        assert_eq!(dma.read(STREAM_6 + NDTR, Nanos(0)), Ok(1));
        assert_eq!(step(&mut dma, QUIET, 2), Step::ReadMemory(0x2000_0001));
        dma.follow_requests(TRANSMIT, Nanos(2_000));
        assert_eq!(step(&mut dma, TRANSMIT, 0), Step::WritePeripheral(0x4000_4404, 2));
        assert_eq!(step(&mut dma, QUIET, 0), Step::Count);
        assert_eq!((dma.due(), dma.read(STREAM_6 + NDTR, Nanos(0))), (None, Ok(0)));
    }

    #[test]
    fn disabled_stream_drops_the_byte_it_read_ahead() {
        let mut dma = sender(2);
        step(&mut dma, QUIET, 1);
        dma.write(STREAM_6 + CR, cr::FROM_MEMORY | CHANNEL_4 | cr::MINC, Nanos(0))
            .unwrap();
        dma.follow_requests(TRANSMIT, Nanos(1_000));
        assert_eq!((dma.due(), dma.read(STREAM_6 + NDTR, Nanos(0))), (None, Ok(2)));
        assert_eq!(dma.read(STREAM_6 + CR, Nanos(0)).unwrap() & cr::EN, 0);
    }

    #[test]
    fn request_that_went_away_leaves_the_byte_for_the_next() {
        let mut dma = sender(1);
        step(&mut dma, QUIET, 1);
        dma.follow_requests(TRANSMIT, Nanos(1_000));
        assert_eq!(step(&mut dma, QUIET, 0), Step::Nothing);
        dma.follow_requests(TRANSMIT, Nanos(2_000));
        assert_eq!(step(&mut dma, TRANSMIT, 0), Step::WritePeripheral(0x4000_4404, 1));
    }

    #[test]
    fn disabled_stream_completes_its_transfer_first() {
        let mut dma = dma(4, 0);
        dma.follow_requests(RECEIVE, Nanos(0));
        let due = dma.due().unwrap();
        let (stream, _) = dma.step(RECEIVE, due).unwrap();
        dma.fetched(stream, 0x42, due);
        dma.write(STREAM_5 + CR, CHANNEL_4 | cr::MINC, Nanos(0)).unwrap();
        assert_eq!(dma.read(STREAM_5 + CR, Nanos(0)).unwrap() & cr::EN, cr::EN);
        while let Some(due) = dma.due() {
            dma.step(RECEIVE, due).unwrap();
        }
        assert_eq!(dma.read(STREAM_5 + CR, Nanos(0)).unwrap() & cr::EN, 0);
        assert_eq!(dma.read(STREAM_5 + NDTR, Nanos(0)), Ok(3));
        assert_eq!(dma.read(HISR, Nanos(0)), Ok(flag::COMPLETE << flag::AT[1]));
    }

    #[test]
    fn request_that_went_away_gets_nothing() {
        let mut dma = dma(4, 0);
        check_withdrawal(&mut dma, 5);
        assert_eq!(dma.read(STREAM_5 + NDTR, Nanos(0)), Ok(4));
    }
}
