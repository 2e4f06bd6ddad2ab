//! DMA1, DMA2 and the request multiplexer DMAMUX1 (RM0440, chapters 12 and 13).
//!
//! Modelled are peripheral to memory and memory to peripheral, by bytes, circular or not. Refused with their name:
//! wider transfers, memory to memory, synchronization, request generators.

use crate::mcu::common::dma::{Count, Step, Steps, Transfer};
use crate::soc::peripheral::{Refused, field, forbidden};
use crate::time::Nanos;

/// Number of channels of a controller (12.3.1, category 2), and of both.
pub(super) const CHANNELS: usize = 6;
pub(super) const ALL_CHANNELS: usize = 2 * CHANNELS;

const ISR: u32 = 0x00;
const IFCR: u32 = 0x04;
/// The first channel's registers, and the registers of each channel (12.6.3 to 12.6.6).
const FIRST: u32 = 0x08;
const EACH: u32 = 20;
const LAST: u32 = FIRST + EACH * CHANNELS as u32;
const CCR: u32 = 0;
const CNDTR: u32 = 4;
const CPAR: u32 = 8;
const CMAR: u32 = 12;

/// Flags of a channel in ISR and IFCR (12.6.1, 12.6.2), four for each.
mod flag {
    pub(super) const GLOBAL: u32 = 1;
    pub(super) const COMPLETE: u32 = 1 << 1;
    pub(super) const HALF: u32 = 1 << 2;
    pub(super) const ERROR: u32 = 1 << 3;
    pub(super) const ALL: u32 = 0xF;
    pub(super) const BITS: u32 = 4;
}

/// Bits of CCR (12.6.3). The interrupt enables have the positions of the flags.
mod ccr {
    pub(super) const EN: u32 = 1;
    pub(super) const INTERRUPTS: u32 = super::flag::COMPLETE | super::flag::HALF | super::flag::ERROR;
    pub(super) const DIR: u32 = 1 << 4;
    pub(super) const CIRC: u32 = 1 << 5;
    pub(super) const PINC: u32 = 1 << 6;
    pub(super) const MINC: u32 = 1 << 7;
    pub(super) const SIZES: u32 = 0xF << 8;
    pub(super) const PL: u32 = 0b11 << 12;
    pub(super) const MEM2MEM: u32 = 1 << 14;
    pub(super) const NO_MODEL: u32 = PINC | SIZES | MEM2MEM;
    pub(super) const WRITABLE: u32 = EN | INTERRUPTS | DIR | CIRC | MINC | PL;
}

const NDT: u32 = 0xFFFF;

/// Registers of the multiplexer (13.6), and DMAREQ_ID and EGE of a channel. The events enabled by EGE are unconnected.
const MUX_CHANNELS_END: u32 = 4 * ALL_CHANNELS as u32;
const MUX_CSR: u32 = 0x80;
const MUX_CFR: u32 = 0x84;
const REQUEST_ID: u32 = 0x7F;
const EGE: u32 = 1 << 9;

#[derive(Clone, Copy, Debug)]
struct Channel {
    ccr: u32,
    /// CNDTR.
    count: Count,
    cpar: u32,
    cmar: u32,
}

impl Channel {
    const OFF: Self = Self {
        ccr: 0,
        count: Count { left: 0, programmed: 0 },
        cpar: 0,
        cmar: 0,
    };

    fn is_on(&self) -> bool {
        self.ccr & ccr::EN != 0
    }

    /// The present transfer.
    fn transfer(&self) -> Transfer {
        let done = if self.ccr & ccr::MINC != 0 {
            self.count.done()
        } else {
            0
        };
        Transfer {
            peripheral: self.cpar,
            memory: self.cmar.wrapping_add(done),
            from_memory: self.ccr & ccr::DIR != 0,
        }
    }
}

/// Both controllers and the multiplexer.
#[derive(Debug)]
pub(super) struct Dma {
    channels: [Channel; ALL_CHANNELS],
    /// ISR of each controller.
    flags: [u32; 2],
    requests: [u32; ALL_CHANNELS],
    steps: Steps<ALL_CHANNELS>,
}

impl Dma {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            channels: [Channel::OFF; ALL_CHANNELS],
            flags: [0; 2],
            requests: [0; ALL_CHANNELS],
            steps: Steps::new(seed),
        }
    }

    /// Resets a controller, 0 or 1.
    pub(super) fn reset(&mut self, controller: usize) {
        self.flags[controller] = 0;
        for channel in controller * CHANNELS..(controller + 1) * CHANNELS {
            self.channels[channel] = Channel::OFF;
            self.steps.stop(channel);
        }
    }

    /// Resets the multiplexer.
    pub(super) fn reset_multiplexer(&mut self) {
        self.requests = [0; ALL_CHANNELS];
    }

    /// The level of a channel's interrupt line.
    pub(super) fn interrupts(&self, channel: usize) -> bool {
        let flags = self.flags[channel / CHANNELS] >> (flag::BITS * (channel % CHANNELS) as u32);
        flags & self.channels[channel].ccr & ccr::INTERRUPTS != 0
    }

    /// Starts transfers for the requests that are high.
    pub(super) fn follow_requests(&mut self, is_high: impl Fn(u32) -> bool, now: Nanos) {
        for (number, (channel, request)) in self.channels.iter().zip(self.requests).enumerate() {
            let can = channel.is_on() && channel.count.left > 0 && self.steps.waits(number);
            if can && is_high(request & REQUEST_ID) {
                self.steps.start(number, now);
            }
        }
    }

    /// Takes the next step that is due at `now`, with its channel. A request that is no longer high gets nothing.
    pub(super) fn step(&mut self, is_high: impl Fn(u32) -> bool, now: Nanos) -> Option<(usize, Step)> {
        let number = self.steps.first_due(now)?;
        let is_high = is_high(self.requests[number] & REQUEST_ID);
        let step = self.steps.take(number, is_high, self.channels[number].transfer(), now);
        if step == Step::Count {
            self.count(number);
        }
        Some((number, step))
    }

    /// Passes the byte of a read.
    pub(super) fn fetched(&mut self, channel: usize, value: u8, now: Nanos) {
        self.steps.fetched(channel, value, now);
    }

    /// The last step failed on the bus: the channel stops (12.4.6).
    pub(super) fn fail(&mut self, channel: usize) {
        self.channels[channel].ccr &= !ccr::EN;
        self.steps.stop(channel);
        self.raise(channel, flag::ERROR);
    }

    fn count(&mut self, number: usize) {
        let channel = &mut self.channels[number];
        let reached = channel.count.count(channel.ccr & ccr::CIRC != 0);
        if reached.half {
            self.raise(number, flag::HALF);
        }
        if reached.complete {
            self.raise(number, flag::COMPLETE);
        }
    }

    fn raise(&mut self, channel: usize, flags: u32) {
        self.flags[channel / CHANNELS] |= (flags | flag::GLOBAL) << (flag::BITS * (channel % CHANNELS) as u32);
    }

    /// The time of a channel's next step.
    pub(super) fn due(&self) -> Option<Nanos> {
        self.steps.due()
    }

    /// Reads a register of a controller, 0 or 1.
    pub(super) fn read(&self, controller: usize, offset: u32) -> Result<u32, Refused> {
        match offset {
            ISR => Ok(self.flags[controller]),
            IFCR => Ok(0),
            FIRST..LAST => {
                let (number, register) = place(controller, offset);
                let channel = &self.channels[number];
                match register {
                    CCR => Ok(channel.ccr),
                    CNDTR => Ok(channel.count.left),
                    CPAR => Ok(channel.cpar),
                    CMAR => Ok(channel.cmar),
                    _ => Err(Refused::NoRegister),
                }
            }
            _ => Err(Refused::NoRegister),
        }
    }

    /// Writes a register of a controller, 0 or 1.
    pub(super) fn write(&mut self, controller: usize, offset: u32, value: u32) -> Result<(), Refused> {
        match offset {
            ISR => Ok(()),
            IFCR => {
                self.flags[controller] &= !cleared(value);
                Ok(())
            }
            FIRST..LAST => {
                let (number, register) = place(controller, offset);
                self.write_channel(number, register, value)
            }
            _ => Err(Refused::NoRegister),
        }
    }

    fn write_channel(&mut self, number: usize, register: u32, value: u32) -> Result<(), Refused> {
        let channel = &mut self.channels[number];
        let on = channel.is_on();
        match register {
            CCR => {
                if value & ccr::NO_MODEL != 0 {
                    return Err(Refused::Unimplemented(
                        "CCR: wide, memory to memory or peripheral increment",
                    ));
                }
                let value = value & ccr::WRITABLE;
                let free = ccr::EN | ccr::INTERRUPTS;
                if on && value & ccr::EN != 0 && (value ^ channel.ccr) & !free != 0 {
                    return Err(forbidden("CCR", "12.6.3: written while EN is set"));
                }
                channel.ccr = value;
                if !on {
                    // 12.4.3: the channel starts at the address in CMAR.
                    channel.count.programmed = channel.count.left;
                }
                if value & ccr::EN == 0 {
                    self.steps.stop(number);
                }
            }
            CNDTR | CPAR | CMAR if on => {
                return Err(forbidden(
                    "CNDTR/CPAR/CMAR",
                    "12.6.4 to 12.6.6: written while EN is set",
                ));
            }
            CNDTR => {
                channel.count.left = value & NDT;
                channel.count.programmed = channel.count.left;
            }
            CPAR => channel.cpar = value,
            CMAR => channel.cmar = value,
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    /// Reads a register of the multiplexer.
    pub(super) fn read_multiplexer(&self, offset: u32) -> Result<u32, Refused> {
        match offset {
            0..MUX_CHANNELS_END => Ok(self.requests[(offset / 4) as usize]),
            // There are no synchronization overruns.
            MUX_CSR | MUX_CFR => Ok(0),
            0x100..=0x148 => Err(Refused::Unimplemented("RGxCR")),
            _ => Err(Refused::NoRegister),
        }
    }

    /// Writes a register of the multiplexer.
    pub(super) fn write_multiplexer(&mut self, offset: u32, value: u32) -> Result<(), Refused> {
        match offset {
            0..MUX_CHANNELS_END if value & !(REQUEST_ID | EGE) != 0 => {
                Err(Refused::Unimplemented("CxCR: synchronization"))
            }
            0..MUX_CHANNELS_END => {
                self.requests[(offset / 4) as usize] = value;
                Ok(())
            }
            MUX_CSR | MUX_CFR => Ok(()),
            0x100..=0x148 => Err(Refused::Unimplemented("RGxCR")),
            _ => Err(Refused::NoRegister),
        }
    }
}

/// The channel, and the index of its register.
fn place(controller: usize, offset: u32) -> (usize, u32) {
    let offset = offset - FIRST;
    (controller * CHANNELS + (offset / EACH) as usize, offset % EACH)
}

/// The flags cleared by a write to IFCR: a channel's global flag clears all of its flags (12.6.2).
fn cleared(value: u32) -> u32 {
    (0..CHANNELS as u32)
        .map(|channel| flag::BITS * channel)
        .fold(value, |cleared, at| {
            if field(value, at, flag::GLOBAL) != 0 {
                cleared | flag::ALL << at
            } else {
                cleared
            }
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    const REQUEST: u32 = 26;
    const CHANNEL_1: u32 = FIRST;

    /// A controller with channel 1 configured for `count` bytes and a request.
    fn dma(count: u32, control: u32) -> Dma {
        let mut dma = Dma::new(0);
        dma.write_multiplexer(0, REQUEST).unwrap();
        dma.write(0, CHANNEL_1 + CNDTR, count).unwrap();
        dma.write(0, CHANNEL_1 + CPAR, 0x4000_4424).unwrap();
        dma.write(0, CHANNEL_1 + CMAR, 0x2000_0000).unwrap();
        dma.write(0, CHANNEL_1 + CCR, control | ccr::EN | ccr::MINC).unwrap();
        dma
    }

    /// Raises the request for one transfer, and returns the steps with their instants.
    fn transfer(dma: &mut Dma, now: Nanos) -> Vec<(Nanos, Step)> {
        dma.follow_requests(|request| request == REQUEST, now);
        let mut steps = Vec::new();
        while let Some(due) = dma.due() {
            let (channel, step) = dma.step(|_| true, due).unwrap();
            if matches!(step, Step::ReadPeripheral(_) | Step::ReadMemory(_)) {
                dma.fetched(channel, 0x42, due);
            }
            steps.push((due, step));
        }
        steps
    }

    #[test]
    fn read_write_and_count_are_steps_apart() {
        let mut dma = dma(4, 0);
        let steps = transfer(&mut dma, Nanos(1_000));
        let kinds: Vec<Step> = steps.iter().map(|&(_, step)| step).collect();
        assert_eq!(
            kinds,
            [
                Step::ReadPeripheral(0x4000_4424),
                Step::WriteMemory(0x2000_0000, 0x42),
                Step::Count
            ]
        );
        let instants: Vec<u64> = steps.iter().map(|(at, _)| at.0).collect();
        assert!(1_000 < instants[0] && instants[0] < instants[1] && instants[1] < instants[2]);
        assert_eq!(dma.read(0, CHANNEL_1 + CNDTR), Ok(3));
    }

    #[test]
    fn half_and_all_of_it_raise_their_flags() {
        let mut dma = dma(4, flag::COMPLETE);
        let flags: Vec<u32> = (0..4)
            .map(|_| {
                transfer(&mut dma, Nanos(0));
                dma.read(0, ISR).unwrap()
            })
            .collect();
        let half = flag::GLOBAL | flag::HALF;
        assert_eq!(flags, [0, half, half, half | flag::COMPLETE]);
        assert!(dma.interrupts(0));
        dma.write(0, IFCR, flag::GLOBAL).unwrap();
        assert!(!dma.interrupts(0));
        assert!(transfer(&mut dma, Nanos(0)).is_empty(), "it is over");
    }

    #[test]
    fn a_circular_channel_begins_again() {
        let mut dma = dma(2, ccr::CIRC);
        let addresses: Vec<Step> = (0..3).map(|_| transfer(&mut dma, Nanos(0))[1].1).collect();
        let expected = [0x2000_0000, 0x2000_0001, 0x2000_0000].map(|address| Step::WriteMemory(address, 0x42));
        assert_eq!(addresses, expected);
    }

    #[test]
    fn a_request_that_went_away_gets_nothing() {
        let mut dma = dma(4, 0);
        dma.follow_requests(|_| true, Nanos(0));
        let due = dma.due().unwrap();
        assert_eq!(dma.step(|_| false, due), Some((0, Step::Nothing)));
        assert_eq!((dma.due(), dma.read(0, CHANNEL_1 + CNDTR)), (None, Ok(4)));
    }

    #[test]
    fn a_channel_that_is_switched_off_stops_in_mid_transfer() {
        let mut dma = dma(4, 0);
        dma.follow_requests(|_| true, Nanos(0));
        dma.write(0, CHANNEL_1 + CCR, ccr::MINC).unwrap();
        assert_eq!(dma.due(), None);
        assert_eq!(dma.read(0, CHANNEL_1 + CNDTR), Ok(4));
    }

    #[test]
    fn registers_are_held_while_enabled() {
        let mut dma = dma(4, 0);
        for register in [CNDTR, CPAR, CMAR] {
            assert!(dma.write(0, CHANNEL_1 + register, 0).is_err());
        }
        assert!(dma.write(0, CHANNEL_1 + CCR, ccr::EN | ccr::MINC | ccr::CIRC).is_err());
        assert!(dma.write(0, CHANNEL_1 + CCR, ccr::EN | 1 << 8).is_err());
    }
}
