//! DMA1 (RM0090, chapter 10): the library's controller, with two switches.
//!
//! * What a stream that is enabled again does with its counter and its addresses. The manual has it start over (10.5.6:
//!   NDTR is "reloaded automatically with the value previously programmed" when the stream is enabled again); some
//!   silicon is reported to go on where it stopped. Firmware that does not set the stream up again survives only one of
//!   the two.
//! * It can be kept from serving the arm's UART, as when other streams or the processor have the bus: that is how an
//!   overrun comes about.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::Layout;
use rigless::soc::st::dma::{Reach, Requests, Span};
use rigless::soc::stm32f427::generated::dma2::{Register, s0cr};
use rigless::soc::stm32f427::peripherals::CONTROLLERS;
use rigless::soc::stm32f427::peripherals::dma::{Dma, STREAMS};
use rigless::soc::stm32f427::peripherals::usart::RECEIVE_REQUEST;
use rigless::time::{EventId, VirtualNanos};

use super::map;
use crate::mcu::stm32f405::Reenabled;

/// The first stream's registers, and how many each has (10.5.11).
const FIRST: usize = Register::S0cr as usize;
const EACH: usize = 6;

/// A transfer-complete flag of each stream within its half of the flag registers (10.5.1): streams 0 to 3, 4 to 7.
const COMPLETE: [u32; 4] = [5, 11, 21, 27];

/// A DMA controller.
pub(super) fn controller(nth: usize) -> Dma {
    let wiring = &CONTROLLERS[nth];
    Dma::wired(
        Requests::Channels {
            wiring: wiring.wiring,
            last_data: wiring.last_data,
            select: s0cr::CHSEL,
        },
        Reach {
            memory_to_memory: wiring.reaches_memory,
            // The core-coupled memory is on no bus but the processor's (RM0090, 2.3.1).
            unreachable: &[Span {
                base: map::CCM.base,
                bytes: map::CCM.size,
            }],
        },
    )
}

/// The DMA controller that serves the arm's UART.
#[derive(Debug)]
pub(super) struct Dma1 {
    dma: Dma,
    reenabled: Reenabled,
    /// Streams that the firmware believes stopped and that keep their place.
    parked: [bool; STREAMS],
    /// Keeps it from serving the arm's UART.
    starve: Arc<AtomicBool>,
    /// The last level of each request that was held back: from the arm's UART, or for a parked stream.
    held: Vec<RequestChange>,
}

impl Dma1 {
    pub(super) fn new(reenabled: Reenabled, starve: Arc<AtomicBool>) -> Self {
        Self {
            dma: controller(0),
            reenabled,
            parked: [false; STREAMS],
            starve,
            held: Vec::new(),
        }
    }

    /// Whether a request must wait.
    fn holds(&self, change: RequestChange) -> bool {
        let starved = change.instance == map::ARM_PORT
            && change.request == RECEIVE_REQUEST
            && self.starve.load(Ordering::Relaxed);
        let parked = CONTROLLERS[0]
            .wiring
            .iter()
            .filter(|wire| wire.instance == change.instance && wire.request == change.request)
            .any(|wire| wire.streams.iter().any(|&stream| self.parked[stream]));
        starved || parked
    }

    /// Hands on what was held back and need not be any more.
    fn release(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        for change in std::mem::take(&mut self.held) {
            self.on_request(change, registers, context);
        }
    }

    /// Stops a parked stream for good.
    fn unpark(&mut self, stream: usize, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.parked[stream] = false;
        let control = row(FIRST + stream * EACH);
        let value = s0cr::EN.set(registers.get(control), 0);
        registers.set(control, value);
        self.dma.write(control, value, registers, context);
        self.release(registers, context);
    }
}

fn row(index: usize) -> Register {
    Register::from_index(index).expect("a register of the controller")
}

impl Device for Dma1 {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.dma.read(register, registers, context)
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        self.dma.peek(register, registers, now)
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let stream = register.index().checked_sub(FIRST).map(|row| row / EACH);
        let (Some(stream), Reenabled::Resumes) = (stream, self.reenabled) else {
            return self.dma.write(register, value, registers, context);
        };
        let control = register.index() == FIRST + stream * EACH;
        let enable = s0cr::EN.is_set(value);
        let running = self.dma.remaining(stream).0 > 0;
        match (control, self.parked[stream]) {
            (true, false) if !enable && running && s0cr::CIRC.is_set(value) => {
                // 10.3.14: a stream that is switched off says that its transfer is complete.
                self.parked[stream] = true;
                let flags = if stream < 4 { Register::Lisr } else { Register::Hisr };
                registers.set(flags, registers.get(flags) | 1 << COMPLETE[stream % 4]);
            }
            (true, true) if enable => {
                self.parked[stream] = false;
                self.release(registers, context);
            }
            (true, true) => {}
            (false, true) => {
                self.unpark(stream, registers, context);
                registers.set(register, value);
                self.dma.write(register, value, registers, context);
            }
            (_, false) => self.dma.write(register, value, registers, context),
        }
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.dma.on_event(event, registers, context);
    }

    fn on_request(&mut self, change: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.held
            .retain(|held| (held.instance, held.request) != (change.instance, change.request));
        if change.level == Level::High && self.holds(change) {
            self.held.push(change);
        } else {
            self.dma.on_request(change, registers, context);
        }
    }

    fn on_access(&mut self, token: u64, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.dma.on_access(token, value, registers, context);
    }

    fn on_refused(&mut self, token: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.dma.on_refused(token, registers, context);
    }

    fn poll(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.release(registers, context);
    }

    fn reset(&mut self) {
        *self = Self::new(self.reenabled, self.starve.clone());
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.parked = [false; STREAMS];
        self.dma.reset_line(registers, context);
        self.release(registers, context);
    }
}
