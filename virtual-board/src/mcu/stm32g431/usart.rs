//! USART2, the UART of the arm (RM0440, chapter 37).
//!
//! | Behaviour | Section |
//! |---|---|
//! | Bit rate from BRR, PRESC and OVER8 | 37.5.8 |
//! | Transmit data register and shift register; TXE, TC | 37.5.5 |
//! | Receive data register; RXNE, ORE; RXFRQ | 37.5.6 |
//! | IDLE after an idle frame | 37.5.6 |
//! | Parity with 9 bits; PE | 37.5.11 |
//! | Framing and noise errors | 37.5.6 |
//! | Half-duplex mode: the receiver gets the transmitted bytes | 37.5.16 |
//! | DMA requests; DDRE: a byte with an error and the DMA | 37.5.19, 37.8.4 |
//! | Bits that are writable only while UE is clear | 37.8.1 to 37.8.5 |
//!
//! FIFO mode may be on while no byte is written or read. Refused with their name: bytes in FIFO mode, 7 data bits, half
//! stop bits, and all modes except asynchronous.

use crate::line::{Arrival, SECOND};
use crate::mcu::common::shifter::Uart;
use crate::mcu::common::usart;
use crate::soc::peripheral::{Peripheral, Refused, check_modelled, forbidden};
use crate::time::Nanos;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const CR3: u32 = 0x08;
const BRR: u32 = 0x0C;
const GTPR: u32 = 0x10;
const RTOR: u32 = 0x14;
const RQR: u32 = 0x18;
const ISR: u32 = 0x1C;
const ICR: u32 = 0x20;
pub(super) const RDR: u32 = 0x24;
pub(super) const TDR: u32 = 0x28;
const PRESC: u32 = 0x2C;

/// Bits of CR1 (37.8.2, FIFO mode disabled).
mod cr1 {
    pub(super) use super::usart::cr1::*;
    pub(super) const UE: u32 = 1;
    pub(super) const FIFOEN: u32 = 1 << 29;
    /// Bits that are writable only while UE is clear.
    pub(super) const HELD: u32 = PS | PCE | M | OVER8 | FIFOEN;
    pub(super) const MODELLED: u32 = UE | RE | TE | INTERRUPTS | HELD;
}

/// Bits of CR3 (37.8.4).
mod cr3 {
    pub(super) use super::usart::cr3::*;
    pub(super) const OVRDIS: u32 = 1 << 12;
    pub(super) const DDRE: u32 = 1 << 13;
    /// Bits that are writable only while UE is clear.
    pub(super) const HELD: u32 = HDSEL | ONEBIT | OVRDIS | DDRE;
    pub(super) const MODELLED: u32 = EIE | DMAR | DMAT | HELD;
}

/// Bits of RQR (37.8.8).
mod rqr {
    pub(super) const RXFRQ: u32 = 1 << 3;
    pub(super) const TXFRQ: u32 = 1 << 4;
}

/// Bits of ISR (37.8.10, FIFO mode disabled), and those of ICR that clear them (37.8.11).
mod isr {
    pub(super) use super::usart::flag::*;
    pub(super) const BUSY: u32 = 1 << 16;
    pub(super) const TEACK: u32 = 1 << 21;
    pub(super) const REACK: u32 = 1 << 22;
    /// The error flags of a byte.
    pub(super) const BYTE_ERRORS: u32 = PE | FE | NE;
    pub(super) const CLEARABLE: u32 = BYTE_ERRORS | ORE | IDLE | TC;
}

/// Dividers of PRESC (37.8.14).
const PRESCALERS: [u64; 12] = [1, 2, 4, 6, 8, 10, 12, 16, 32, 64, 128, 256];

/// The state that only this chip has.
#[derive(Debug, Default)]
pub(crate) struct Chip {
    presc: u32,
    rtor: u32,
}

pub(super) type Usart = usart::Usart<Chip>;

impl usart::Chip for Chip {
    const UE: u32 = cr1::UE;

    /// See 37.5.8.
    fn bit(usart: &Usart) -> u64 {
        let divider = if usart.cr1 & cr1::OVER8 != 0 {
            (usart.brr & 0xFFF0 | (usart.brr & 0b111) << 1) / 2
        } else {
            usart.brr
        };
        let prescaler = PRESCALERS[usart.chip.presc as usize % PRESCALERS.len()];
        (u64::from(divider) * prescaler * SECOND)
            .checked_div(usart.clock_hz)
            .unwrap_or(0)
    }
}

impl Usart {
    /// The level of the interrupt line (37.6).
    pub(super) fn interrupts(&self) -> bool {
        let status = self.status();
        usart::interrupts(self.cr1, status) || self.cr3 & cr3::EIE != 0 && status & isr::ERRORS != 0
    }

    fn status(&self) -> u32 {
        let when = |set, bit| if set { bit } else { 0 };
        self.data_status()
            | when(self.shifter.is_receiving(), isr::BUSY)
            | when(self.is_on(cr1::TE), isr::TEACK)
            | when(self.is_on(cr1::RE), isr::REACK)
    }

    /// Handles a received byte.
    fn receive(&mut self, arrival: Arrival) {
        let flag = |set, bit| if set { bit } else { 0 };
        let errors = flag(arrival.parity, isr::PE) | flag(arrival.framing, isr::FE) | flag(arrival.noise, isr::NE);
        if self.received.is_some() && self.cr3 & cr3::OVRDIS == 0 {
            self.flags |= isr::ORE;
            return;
        }
        self.flags |= errors;
        // 37.8.4 DDRE: without it, the DMA does not get a byte with an error, and RXNE stays clear.
        if errors != 0 && self.cr3 & cr3::DMAR != 0 && self.cr3 & cr3::DDRE == 0 {
            return;
        }
        self.received = Some(arrival.value);
        self.last = arrival.value;
    }

    fn write_cr1(&mut self, value: u32) -> Result<(), Refused> {
        usart::check_cr1(value, cr1::MODELLED)?;
        let changed = value ^ self.cr1;
        if value & self.cr1 & cr1::UE != 0 && changed & cr1::HELD != 0 {
            return Err(forbidden(
                "CR1",
                "37.8.2: format or oversampling written while UE is set",
            ));
        }
        if value & cr1::UE != 0 && changed & !value & cr1::TE != 0 && self.shifter.is_sending() {
            return Err(forbidden("CR1", "37.5.5: TE cleared while a byte is sent"));
        }
        self.cr1 = value;
        if value & cr1::UE == 0 {
            // 37.8.2: all flags are reset, and transfers are discarded.
            self.flags = isr::TC;
            self.received = None;
            self.transmit = None;
            self.shifter.stop();
        }
        Ok(())
    }

    /// A register that is writable only while UE is clear.
    fn while_disabled(&self, register: &'static str) -> Result<(), Refused> {
        if self.cr1 & cr1::UE == 0 {
            Ok(())
        } else {
            Err(forbidden(register, "37.8: written while UE is set"))
        }
    }

    fn write_cr2(&mut self, value: u32) -> Result<(), Refused> {
        usart::check_cr2(value)?;
        if value != self.cr2 {
            self.while_disabled("CR2")?;
        }
        self.cr2 = value;
        Ok(())
    }

    fn write_cr3(&mut self, value: u32) -> Result<(), Refused> {
        check_modelled("CR3", value, cr3::MODELLED)?;
        if (value ^ self.cr3) & cr3::HELD != 0 {
            self.while_disabled("CR3")?;
        }
        self.cr3 = value;
        Ok(())
    }
}

impl Uart for Usart {
    /// Returns true if the receiver requests a DMA transfer. With DDRE, a byte with an error holds the request back until
    /// the error flag is cleared.
    fn requests_receive(&self) -> bool {
        let held = self.cr3 & cr3::DDRE != 0 && self.flags & isr::BYTE_ERRORS != 0;
        self.cr3 & cr3::DMAR != 0 && self.received.is_some() && !held
    }

    fn requests_transmit(&self) -> bool {
        self.cr3 & cr3::DMAT != 0 && self.transmit.is_none() && self.is_on(cr1::TE)
    }

    fn transmits(&self) -> bool {
        self.is_on(cr1::TE)
    }
}

impl Peripheral for Usart {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            CR1 => Ok(self.cr1),
            CR2 => Ok(self.cr2),
            CR3 => Ok(self.cr3),
            BRR => Ok(self.brr),
            GTPR => Ok(self.gtpr),
            RTOR => Ok(self.chip.rtor),
            RQR | ICR => Ok(0),
            ISR => Ok(self.status()),
            RDR if self.cr1 & cr1::FIFOEN != 0 => Err(Refused::Unimplemented("RDR in FIFO mode")),
            RDR => Ok(self.received.take().unwrap_or(self.last).into()),
            TDR => Ok(self.transmit.unwrap_or(0).into()),
            PRESC => Ok(self.chip.presc),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        match offset {
            CR1 => self.write_cr1(value)?,
            CR2 => self.write_cr2(value)?,
            CR3 => self.write_cr3(value)?,
            BRR => {
                self.while_disabled("BRR")?;
                self.brr = value & 0xFFFF;
            }
            PRESC => {
                self.while_disabled("PRESC")?;
                self.chip.presc = value & 0xF;
            }
            // Both have no effect in asynchronous mode without a receiver timeout.
            GTPR => self.gtpr = value,
            RTOR => self.chip.rtor = value,
            RQR => {
                if value & rqr::RXFRQ != 0 {
                    self.received = None;
                }
                if value & !(rqr::RXFRQ | rqr::TXFRQ) != 0 {
                    return Err(Refused::Unimplemented("RQR"));
                }
                return Ok(());
            }
            ICR => {
                self.flags &= !(value & isr::CLEARABLE);
                return Ok(());
            }
            TDR if self.cr1 & cr1::FIFOEN != 0 => return Err(Refused::Unimplemented("TDR in FIFO mode")),
            TDR => {
                self.transmit = Some(value as u8);
                self.flags &= !isr::TC;
            }
            ISR | RDR => return Ok(()),
            _ => return Err(Refused::NoRegister),
        }
        if offset != TDR {
            self.settle(now);
        }
        self.shifter.start_to_send(now, &mut self.transmit);
        Ok(())
    }

    fn advance(&mut self, now: Nanos) {
        let progress = self.shifter.advance(now, &mut self.transmit);
        if progress.complete {
            self.flags |= isr::TC;
        }
        if progress.idle {
            self.flags |= isr::IDLE;
        }
        if let Some(arrival) = progress.arrived {
            self.receive(arrival);
            self.shifter.expect_idle(now);
        }
    }

    fn due(&self) -> Option<Nanos> {
        self.shifter.due()
    }

    fn reset(&mut self, now: Nanos) {
        self.restart(now);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::line::tests::ScriptedArm;
    use crate::line::{Direction, Fault, Line};

    struct Bench {
        usart: Usart,
        line: Arc<Mutex<Line<ScriptedArm>>>,
        now: Nanos,
    }

    impl Bench {
        /// A USART at 1 Mbaud from 160 MHz.
        fn new() -> Self {
            let line = Arc::new(Mutex::new(Line::new(
                ScriptedArm::default(),
                1_000_000,
                0,
                Arc::default(),
            )));
            let mut usart = Usart::new(line.clone());
            usart.set_clock(160_000_000, Nanos(0));
            usart.write(BRR, 160, Nanos(0)).unwrap();
            Self {
                usart,
                line,
                now: Nanos(0),
            }
        }

        /// Makes the arm send these bytes.
        fn arm_sends(&mut self, bytes: &[u8]) {
            self.line.lock().unwrap().arm_mut().output.extend(bytes);
        }

        fn write(&mut self, offset: u32, value: u32) -> Result<(), Refused> {
            self.usart.write(offset, value, self.now)
        }

        fn read(&mut self, offset: u32) -> u32 {
            self.usart.read(offset, self.now).unwrap()
        }

        fn status(&mut self) -> u32 {
            self.read(ISR)
        }

        /// Runs until this many microseconds.
        fn run(&mut self, micros: u64) {
            let until = Nanos(micros * 1_000);
            self.usart.sync(self.now);
            while let Some(due) = self.usart.due().filter(|&due| due <= until) {
                self.now = due;
                self.usart.advance(due);
            }
            self.now = until;
        }
    }

    const ON: u32 = cr1::UE | cr1::RE | cr1::TE;

    #[test]
    fn byte_takes_ten_bits_then_transmission_completes() {
        let mut bench = Bench::new();
        bench.write(CR1, ON).unwrap();
        bench.write(TDR, 0x55).unwrap();
        assert_eq!(
            bench.status() & (isr::TXE | isr::TC),
            isr::TXE,
            "the shift register has it"
        );
        bench.write(TDR, 0xAA).unwrap();
        assert_eq!(bench.status() & isr::TXE, 0);
        bench.run(19);
        assert_eq!(bench.status() & (isr::TXE | isr::TC), isr::TXE);
        bench.run(20);
        assert_eq!(bench.status() & (isr::TXE | isr::TC), isr::TXE | isr::TC);
        assert_eq!(bench.line.lock().unwrap().arm_mut().received, [0x55, 0xAA]);
    }

    #[test]
    fn byte_then_frame_of_silence_is_idle() {
        let mut bench = Bench::new();
        bench.write(CR1, ON | cr1::IDLEIE).unwrap();
        bench.arm_sends(&[0x31]);
        bench.run(10);
        assert_eq!(bench.status() & (isr::RXNE | isr::IDLE), isr::RXNE);
        bench.run(20);
        assert!(bench.usart.interrupts());
        assert_eq!(bench.read(RDR), 0x31);
        bench.write(ICR, isr::IDLE).unwrap();
        assert_eq!(bench.status() & (isr::RXNE | isr::IDLE), 0);
        bench.run(100);
        assert_eq!(bench.status() & isr::IDLE, 0, "it is set once");
    }

    #[test]
    fn unread_byte_makes_the_next_an_overrun() {
        let mut bench = Bench::new();
        bench.write(CR1, ON).unwrap();
        bench.arm_sends(&[1, 2, 3]);
        bench.run(30);
        assert_eq!(bench.status() & isr::ORE, isr::ORE);
        assert_eq!(bench.read(RDR), 1);
    }

    #[test]
    fn faulty_byte_needs_ddre_to_be_kept() {
        for (ddre, received) in [(cr3::DDRE, isr::RXNE), (0, 0)] {
            let mut bench = Bench::new();
            bench.line.lock().unwrap().plan_fault(0, Fault::Noise);
            bench.write(CR3, cr3::DMAR | cr3::EIE | ddre).unwrap();
            bench.write(CR1, ON).unwrap();
            bench.arm_sends(&[0x31]);
            bench.run(10);
            assert!(bench.usart.interrupts());
            assert_eq!(bench.status() & (isr::RXNE | isr::NE), received | isr::NE);
            assert!(!bench.usart.requests_receive());
            bench.write(ICR, isr::NE).unwrap();
            assert_eq!(bench.usart.requests_receive(), received != 0);
        }
    }

    #[test]
    fn parity_makes_a_byte_of_eleven_bits() {
        let mut bench = Bench::new();
        bench.write(CR1, ON | cr1::PCE | cr1::M).unwrap();
        bench.write(TDR, 0x01).unwrap();
        bench.run(100);
        let line = bench.line.lock().unwrap();
        assert_eq!(
            (line.bytes()[0].at, line.bytes()[0].direction),
            (Nanos(11_000), Direction::ToArm)
        );
    }

    #[test]
    fn half_duplex_receiver_receives_own_transmitter() {
        let mut bench = Bench::new();
        bench.write(CR3, cr3::HDSEL).unwrap();
        bench.write(CR1, ON).unwrap();
        bench.write(TDR, 0x42).unwrap();
        bench.run(10);
        assert_eq!((bench.status() & isr::RXNE, bench.read(RDR)), (isr::RXNE, 0x42));
    }

    #[test]
    fn oversampling_and_prescaler_determine_the_rate() {
        let mut bench = Bench::new();
        bench.write(CR1, cr1::OVER8).unwrap();
        // 160 MHz / 2 / 10 = 8 MBaud.
        bench.write(BRR, 0x10 | 2).unwrap();
        bench.write(PRESC, 1).unwrap();
        assert_eq!(<Chip as usart::Chip>::bit(&bench.usart), 125_000);
    }

    #[test]
    fn format_and_rate_are_held_while_enabled() {
        let mut bench = Bench::new();
        bench.write(CR1, ON).unwrap();
        assert!(bench.write(BRR, 80).is_err());
        assert!(bench.write(CR1, ON | cr1::PCE | cr1::M).is_err());
        assert!(bench.write(CR3, cr3::DDRE).is_err());
        assert!(bench.write(CR2, usart::cr2::TWO << usart::cr2::STOP_AT).is_err());
        bench.write(CR3, cr3::DMAR | cr3::DMAT).unwrap();
    }

    #[test]
    fn disabled_usart_discards_everything() {
        let mut bench = Bench::new();
        bench.write(CR1, ON).unwrap();
        bench.arm_sends(&[1]);
        bench.run(10);
        bench.write(TDR, 1).unwrap();
        bench.write(CR1, 0).unwrap();
        assert_eq!((bench.status(), bench.usart.due()), (isr::TC | isr::TXE, None));
    }
}
