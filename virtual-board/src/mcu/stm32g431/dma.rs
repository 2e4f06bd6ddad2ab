//! DMA1, DMA2 and the request multiplexer DMAMUX1 (RM0440, chapters 12 and 13).
//!
//! Modelled are peripheral to memory and memory to peripheral, by bytes, circular or not. Refused with their name:
//! wider transfers, memory to memory, synchronization, request generators.

use crate::mcu::common::dma::{self as common, Count, Requests, Step, Steps, Transfer};
use crate::soc::peripheral::{Peripheral, Refused, field, forbidden};
use crate::time::Nanos;

/// Number of channels of a controller (12.3.1, category 2), and of both.
pub(super) const CHANNELS: usize = 6;
pub(super) const ALL_CHANNELS: usize = 2 * CHANNELS;

/// The bytes of a controller's registers: DMA2 follows DMA1, and the multiplexer both.
const SIZE: u32 = 0x400;
const MULTIPLEXER: u32 = 2 * SIZE;

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

/// Requests of USART2 (13.3.2, table 91).
const USART2_RX: u32 = 26;
const USART2_TX: u32 = 27;

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

    /// Resets a controller or the multiplexer, by the offset of its registers.
    pub(super) fn reset_block(&mut self, offset: u32) {
        if offset == MULTIPLEXER {
            self.requests = [0; ALL_CHANNELS];
            return;
        }
        let controller = (offset / SIZE) as usize;
        self.flags[controller] = 0;
        for channel in controller * CHANNELS..(controller + 1) * CHANNELS {
            self.channels[channel] = Channel::OFF;
            self.steps.stop(channel);
        }
    }

    /// The level of a channel's interrupt line.
    pub(super) fn interrupts(&self, channel: usize) -> bool {
        let flags = self.flags[channel / CHANNELS] >> (flag::BITS * (channel % CHANNELS) as u32);
        flags & self.channels[channel].ccr & ccr::INTERRUPTS != 0
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
    fn read_multiplexer(&self, offset: u32) -> Result<u32, Refused> {
        match offset {
            0..MUX_CHANNELS_END => Ok(self.requests[(offset / 4) as usize]),
            // There are no synchronization overruns.
            MUX_CSR | MUX_CFR => Ok(0),
            0x100..=0x148 => Err(Refused::Unimplemented("RGxCR")),
            _ => Err(Refused::NoRegister),
        }
    }

    /// Writes a register of the multiplexer.
    fn write_multiplexer(&mut self, offset: u32, value: u32) -> Result<(), Refused> {
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

fn is_high(requests: Requests, request: u32) -> bool {
    match request & REQUEST_ID {
        USART2_RX => requests.receive,
        USART2_TX => requests.transmit,
        _ => false,
    }
}

impl Peripheral for Dma {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        if offset >= MULTIPLEXER {
            return self.read_multiplexer(offset - MULTIPLEXER);
        }
        let (controller, offset) = ((offset / SIZE) as usize, offset % SIZE);
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

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        if offset >= MULTIPLEXER {
            return self.write_multiplexer(offset - MULTIPLEXER, value);
        }
        let (controller, offset) = ((offset / SIZE) as usize, offset % SIZE);
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

    fn due(&self) -> Option<Nanos> {
        self.steps.due()
    }
}

impl common::Dma for Dma {
    fn follow_requests(&mut self, requests: Requests, now: Nanos) {
        for (number, (channel, request)) in self.channels.iter().zip(self.requests).enumerate() {
            let can = channel.is_on() && channel.count.left > 0 && self.steps.waits(number);
            if can && is_high(requests, request) {
                self.steps.start(number, now);
            }
        }
    }

    fn step(&mut self, requests: Requests, now: Nanos) -> Option<(usize, Step)> {
        let number = self.steps.first_due(now)?;
        let is_high = is_high(requests, self.requests[number]);
        let step = self.steps.take(number, is_high, self.channels[number].transfer(), now);
        if step == Step::Count {
            self.count(number);
        }
        Some((number, step))
    }

    fn fetched(&mut self, channel: usize, value: u8, now: Nanos) {
        self.steps.fetched(channel, value, now);
    }

    /// The channel stops (12.4.6).
    fn fail(&mut self, channel: usize) {
        self.channels[channel].ccr &= !ccr::EN;
        self.steps.stop(channel);
        self.raise(channel, flag::ERROR);
    }
}

/// The channel of a register, and the register's offset within the channel.
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
    use crate::mcu::common::dma::Dma as _;
    use crate::mcu::common::dma::tests::{RECEIVE, check_steps, check_withdrawal, transfer};

    const CHANNEL_1: u32 = FIRST;

    /// A controller with channel 1 configured for `count` bytes and a request.
    fn dma(count: u32, control: u32) -> Dma {
        let mut dma = Dma::new(0);
        dma.write_multiplexer(0, USART2_RX).unwrap();
        dma.write(CHANNEL_1 + CNDTR, count, Nanos(0)).unwrap();
        dma.write(CHANNEL_1 + CPAR, 0x4000_4424, Nanos(0)).unwrap();
        dma.write(CHANNEL_1 + CMAR, 0x2000_0000, Nanos(0)).unwrap();
        dma.write(CHANNEL_1 + CCR, control | ccr::EN | ccr::MINC, Nanos(0))
            .unwrap();
        dma
    }

    #[test]
    fn read_write_and_count_are_steps_apart() {
        let mut dma = dma(4, 0);
        check_steps(&mut dma, 0x4000_4424);
        assert_eq!(dma.read(CHANNEL_1 + CNDTR, Nanos(0)), Ok(3));
    }

    #[test]
    fn half_and_all_of_it_raise_their_flags() {
        let mut dma = dma(4, flag::COMPLETE);
        let flags: Vec<u32> = (0..4)
            .map(|_| {
                transfer(&mut dma, Nanos(0));
                dma.read(ISR, Nanos(0)).unwrap()
            })
            .collect();
        let half = flag::GLOBAL | flag::HALF;
        assert_eq!(flags, [0, half, half, half | flag::COMPLETE]);
        assert!(dma.interrupts(0));
        dma.write(IFCR, flag::GLOBAL, Nanos(0)).unwrap();
        assert!(!dma.interrupts(0));
        assert!(transfer(&mut dma, Nanos(0)).is_empty(), "it is over");
    }

    #[test]
    fn circular_channel_begins_again() {
        let mut dma = dma(2, ccr::CIRC);
        let addresses: Vec<Step> = (0..3).map(|_| transfer(&mut dma, Nanos(0))[1].1).collect();
        let expected = [0x2000_0000, 0x2000_0001, 0x2000_0000].map(|address| Step::WriteMemory(address, 0x42));
        assert_eq!(addresses, expected);
    }

    #[test]
    fn request_that_went_away_gets_nothing() {
        let mut dma = dma(4, 0);
        check_withdrawal(&mut dma, 0);
        assert_eq!(dma.read(CHANNEL_1 + CNDTR, Nanos(0)), Ok(4));
    }

    #[test]
    fn disabled_channel_stops_midtransfer() {
        let mut dma = dma(4, 0);
        dma.follow_requests(RECEIVE, Nanos(0));
        dma.write(CHANNEL_1 + CCR, ccr::MINC, Nanos(0)).unwrap();
        assert_eq!(dma.due(), None);
        assert_eq!(dma.read(CHANNEL_1 + CNDTR, Nanos(0)), Ok(4));
    }

    #[test]
    fn registers_are_held_while_enabled() {
        let mut dma = dma(4, 0);
        for register in [CNDTR, CPAR, CMAR] {
            assert!(dma.write(CHANNEL_1 + register, 0, Nanos(0)).is_err());
        }
        assert!(
            dma.write(CHANNEL_1 + CCR, ccr::EN | ccr::MINC | ccr::CIRC, Nanos(0))
                .is_err()
        );
        assert!(dma.write(CHANNEL_1 + CCR, ccr::EN | 1 << 8, Nanos(0)).is_err());
    }
}
