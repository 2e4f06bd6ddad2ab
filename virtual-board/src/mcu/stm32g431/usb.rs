//! The USB full-speed device with its packet memory (RM0440, chapter 45).
//!
//! | Behaviour | Section |
//! |---|---|
//! | Reset, power-down, start of frame, suspend, wake-up, interrupts | 45.5.2, 45.5.5, 45.6.1 |
//! | Pull-up by DPPU | 45.6.1 BCDR |
//! | Buffer descriptors and packets in the packet memory; the size of a receive buffer | 45.5.3, 45.6.3 |
//! | Endpoints: bits that toggle or only clear, STAT, DTOG, CTR | 45.6.2 |
//! | A bus reset clears the endpoint registers except CTR, and the address | 45.5.2, 45.6.2 |
//! | SETUP: accepted unless disabled, sets both toggles and both NAKs | 45.5.3, 45.6.2 |
//! | STATUS_OUT | 45.6.2 EP_KIND |
//! | Endpoints are found by their address and direction | 45.6.2 EA |
//!
//! Not modelled: isochronous and double-buffered endpoints, expected start of frame and errors, link power management,
//! battery charging, remote wake-up. Their registers and bits are refused with their name; their interrupts are never
//! raised.

use crate::shared::{Shared, lock};
use crate::soc::peripheral::{Peripheral, Refused, field, merge};
use crate::time::Nanos;
use crate::usb::host::Host;
use crate::usb::{Direction, Function, Handshake, Reply};

const ENDPOINTS: usize = 8;
const EP7R: u32 = 0x1C;
const CNTR: u32 = 0x40;
const ISTR: u32 = 0x44;
const FNR: u32 = 0x48;
const DADDR: u32 = 0x4C;
const BTABLE: u32 = 0x50;
const LPMCSR: u32 = 0x54;
const BCDR: u32 = 0x58;

/// The offset of the packet memory from the first register.
pub(super) const PACKET_MEMORY_AT: u32 = 0x400;

/// Bytes of the packet memory.
const PACKET_MEMORY: usize = 1024;

/// Bits of USB_EPnR (45.6.2).
mod epr {
    pub(super) const EA: u32 = 0xF;
    pub(super) const STAT_TX_AT: u32 = 4;
    pub(super) const DTOG_TX: u32 = 1 << 6;
    pub(super) const CTR_TX: u32 = 1 << 7;
    pub(super) const EP_KIND: u32 = 1 << 8;
    pub(super) const EP_TYPE_AT: u32 = 9;
    pub(super) const SETUP: u32 = 1 << 11;
    pub(super) const STAT_RX_AT: u32 = 12;
    pub(super) const DTOG_RX: u32 = 1 << 14;
    pub(super) const CTR_RX: u32 = 1 << 15;
    pub(super) const STAT: u32 = 0b11;
    pub(super) const STAT_TX: u32 = STAT << STAT_TX_AT;
    pub(super) const STAT_RX: u32 = STAT << STAT_RX_AT;
    /// Bits that a 0 clears; a 1 has no effect.
    pub(super) const CTR: u32 = CTR_RX | CTR_TX;
    /// Bits that a 1 toggles; a 0 has no effect.
    pub(super) const TOGGLES: u32 = STAT_RX | STAT_TX | DTOG_RX | DTOG_TX;
    /// Bits that are written directly.
    pub(super) const PLAIN: u32 = EA | EP_KIND | EP_TYPE << EP_TYPE_AT;
    pub(super) const EP_TYPE: u32 = 0b11;
    pub(super) const CONTROL: u32 = 0b01;
    pub(super) const ISOCHRONOUS: u32 = 0b10;
}

/// Values of STAT_RX and STAT_TX.
const DISABLED: u32 = 0b00;
const STALL: u32 = 0b01;
const NAK: u32 = 0b10;
const VALID: u32 = 0b11;

/// Bits of CNTR (45.6.1).
mod cntr {
    pub(super) const FRES: u32 = 1;
    pub(super) const PDWN: u32 = 1 << 1;
    pub(super) const LPMODE: u32 = 1 << 2;
    pub(super) const FSUSP: u32 = 1 << 3;
    pub(super) const INTERRUPTS: u32 = 0xFF00;
    pub(super) const MODELLED: u32 = FRES | PDWN | LPMODE | FSUSP | INTERRUPTS;
}

/// Flags of ISTR (45.6.1). Their enables in CNTR are at the same places.
mod istr {
    pub(super) const DIR: u32 = 1 << 4;
    pub(super) const SOF: u32 = 1 << 9;
    pub(super) const RESET: u32 = 1 << 10;
    pub(super) const SUSP: u32 = 1 << 11;
    pub(super) const WKUP: u32 = 1 << 12;
    pub(super) const CTR: u32 = 1 << 15;
}

/// ADD and EF of DADDR, DPPU of BCDR, the alignment of BTABLE (45.6.1).
const ADD: u32 = 0x7F;
const EF: u32 = 1 << 7;
const DPPU: u32 = 1 << 15;
const TABLE: u32 = 0xFFF8;

/// Halfwords of a buffer descriptor (45.6.3), and the fields of its count for reception.
const ADDR_TX: usize = 0;
const COUNT_TX: usize = 1;
const ADDR_RX: usize = 2;
const COUNT_RX: usize = 3;
const COUNT: usize = 0x3FF;
const NUM_BLOCK_AT: usize = 10;
const NUM_BLOCK: usize = 0x1F;
const BL_SIZE: usize = 1 << 15;

/// The clock of the controller, and its tolerance: 0.25 % (USB 2.0, 7.1.11).
const CLOCK_HZ: u64 = 48_000_000;
const TOLERANCE_HZ: u64 = CLOCK_HZ / 400;

/// The controller, as seen by the bus and the wire.
#[derive(Debug)]
pub(super) struct Device {
    now: Nanos,
    clocked: bool,
    endpoints: [u32; ENDPOINTS],
    /// Time at which each endpoint's IN packet became ready.
    armed: [Option<Nanos>; ENDPOINTS],
    /// The endpoint whose packet is on the wire, until the end of that packet.
    sending: Option<usize>,
    cntr: u32,
    /// The flags of ISTR except CTR.
    flags: u32,
    daddr: u32,
    btable: u32,
    bcdr: u32,
    frame: u16,
    started_frame: bool,
    memory: [u8; PACKET_MEMORY],
}

impl Default for Device {
    fn default() -> Self {
        Self {
            now: Nanos(0),
            clocked: false,
            endpoints: [0; ENDPOINTS],
            armed: [None; ENDPOINTS],
            sending: None,
            cntr: cntr::PDWN | cntr::FRES,
            flags: 0,
            daddr: 0,
            btable: 0,
            bcdr: 0,
            frame: 0,
            started_frame: false,
            memory: [0; PACKET_MEMORY],
        }
    }
}

impl Device {
    fn interrupt_status(&self) -> u32 {
        let served = |value: &&u32| **value & epr::CTR != 0;
        let Some(number) = self.endpoints.iter().position(|value| served(&value)) else {
            return self.flags;
        };
        let direction = if self.endpoints[number] & epr::CTR_RX != 0 {
            istr::DIR
        } else {
            0
        };
        self.flags | istr::CTR | direction | number as u32
    }

    fn is_on(&self) -> bool {
        self.clocked && self.cntr & (cntr::PDWN | cntr::FRES) == 0
    }

    fn is_addressed(&self, address: u8) -> bool {
        self.is_on() && self.daddr == EF | u32::from(address)
    }

    fn status(&self, endpoint: usize, direction: Direction) -> u32 {
        let at = if direction == Direction::In {
            epr::STAT_TX_AT
        } else {
            epr::STAT_RX_AT
        };
        field(self.endpoints[endpoint], at, epr::STAT)
    }

    /// The enabled endpoint with this address and direction.
    fn find(&self, address: u8, direction: Direction) -> Option<usize> {
        (0..ENDPOINTS).find(|&number| {
            self.endpoints[number] & epr::EA == u32::from(address) && self.status(number, direction) != DISABLED
        })
    }

    /// Writes an endpoint's register, as the processor does.
    fn write_endpoint(&mut self, number: usize, value: u32) -> Result<(), Refused> {
        let kind = field(value, epr::EP_TYPE_AT, epr::EP_TYPE);
        if kind == epr::ISOCHRONOUS || kind != epr::CONTROL && value & epr::EP_KIND != 0 {
            return Err(Refused::Unimplemented("EPnR: isochronous or double-buffered"));
        }
        if self.cntr & cntr::FRES != 0 {
            return Ok(());
        }
        let old = self.endpoints[number];
        let cleared = old & (value | !epr::CTR);
        let toggled = cleared ^ value & epr::TOGGLES;
        self.set_endpoint(number, merge(toggled, value, epr::PLAIN));
        Ok(())
    }

    fn set_endpoint(&mut self, number: usize, value: u32) {
        self.endpoints[number] = value;
        let is_armed = self.status(number, Direction::In) == VALID;
        let armed = &mut self.armed[number];
        *armed = is_armed.then(|| armed.unwrap_or(self.now));
    }

    fn reset_endpoints(&mut self) {
        for number in 0..ENDPOINTS {
            self.set_endpoint(number, self.endpoints[number] & epr::CTR);
        }
    }

    fn descriptor(&self, endpoint: usize, halfword: usize) -> usize {
        (self.btable as usize + 8 * endpoint + 2 * halfword) % PACKET_MEMORY
    }

    fn halfword(&self, at: usize) -> usize {
        usize::from(u16::from_le_bytes([self.memory[at], self.memory[at + 1]]))
    }

    /// Stores a received packet. Returns false if the buffer is too small.
    fn store(&mut self, endpoint: usize, data: &[u8]) -> bool {
        let count_at = self.descriptor(endpoint, COUNT_RX);
        let count = self.halfword(count_at);
        let blocks = count >> NUM_BLOCK_AT & NUM_BLOCK;
        let room = if count & BL_SIZE != 0 {
            32 * (blocks + 1)
        } else {
            2 * blocks
        };
        if data.len() > room {
            return false;
        }
        let buffer = self.halfword(self.descriptor(endpoint, ADDR_RX));
        for (at, &byte) in (buffer..).zip(data) {
            self.memory[at % PACKET_MEMORY] = byte;
        }
        let count = count & !COUNT | data.len();
        self.memory[count_at..count_at + 2].copy_from_slice(&(count as u16).to_le_bytes());
        true
    }

    fn packet(&self, endpoint: usize) -> Vec<u8> {
        let buffer = self.halfword(self.descriptor(endpoint, ADDR_TX));
        let count = self.halfword(self.descriptor(endpoint, COUNT_TX)) & COUNT;
        (buffer..buffer + count)
            .map(|at| self.memory[at % PACKET_MEMORY])
            .collect()
    }

    fn read(&self, offset: u32) -> Result<u32, Refused> {
        match offset {
            0..=EP7R => Ok(self.endpoints[(offset / 4) as usize]),
            CNTR => Ok(self.cntr),
            ISTR => Ok(self.interrupt_status()),
            FNR => Ok(self.frame.into()),
            DADDR => Ok(self.daddr),
            BTABLE => Ok(self.btable),
            LPMCSR => Err(Refused::Unimplemented("LPMCSR")),
            BCDR => Ok(self.bcdr),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32) -> Result<(), Refused> {
        match offset {
            0..=EP7R => self.write_endpoint((offset / 4) as usize, value)?,
            CNTR if value & !cntr::MODELLED != 0 => return Err(Refused::Unimplemented("CNTR")),
            CNTR => {
                self.cntr = value;
                if value & cntr::FRES != 0 {
                    self.endpoints = [0; ENDPOINTS];
                    self.armed = [None; ENDPOINTS];
                    self.flags = 0;
                    self.daddr = 0;
                }
            }
            ISTR => self.flags &= value,
            FNR => {}
            DADDR => self.daddr = value & (ADD | EF),
            BTABLE => self.btable = value & TABLE,
            LPMCSR => return Err(Refused::Unimplemented("LPMCSR")),
            BCDR if value & !DPPU != 0 => return Err(Refused::Unimplemented("BCDR")),
            BCDR => self.bcdr = value,
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }
}

impl Function for Device {
    fn pulls_up(&self) -> bool {
        self.clocked && self.bcdr & DPPU != 0 && self.cntr & cntr::PDWN == 0
    }

    /// The chip does not see the bus voltage.
    fn power(&mut self, _: bool) {}

    fn reset(&mut self) {
        if self.pulls_up() {
            self.flags |= istr::RESET;
            self.daddr = 0;
            self.sending = None;
            self.reset_endpoints();
        }
    }

    fn reset_done(&mut self) {}

    fn start_of_frame(&mut self, number: u16) {
        self.frame = number;
        self.started_frame = true;
        if self.is_on() {
            self.flags |= istr::SOF;
        }
    }

    fn suspend(&mut self) {
        if self.is_on() {
            self.flags |= istr::SUSP;
        }
    }

    fn resume(&mut self) {
        if self.is_on() && self.cntr & cntr::FSUSP != 0 {
            self.flags |= istr::WKUP;
        }
    }

    fn ready(&self, endpoint: u8, direction: Direction) -> bool {
        self.find(endpoint, direction)
            .is_none_or(|number| self.status(number, direction) != NAK)
    }

    fn setup(&mut self, address: u8, request: [u8; 8]) -> bool {
        if !self.is_addressed(address) {
            return false;
        }
        let Some(number) = self.find(0, Direction::Out) else {
            return false;
        };
        let register = self.endpoints[number];
        if field(register, epr::EP_TYPE_AT, epr::EP_TYPE) != epr::CONTROL || !self.store(number, &request) {
            return false;
        }
        let statuses = NAK << epr::STAT_RX_AT | NAK << epr::STAT_TX_AT;
        let set = epr::CTR_RX | epr::SETUP | epr::DTOG_RX | epr::DTOG_TX;
        self.set_endpoint(number, register & !(epr::STAT_RX | epr::STAT_TX) | statuses | set);
        true
    }

    fn output(&mut self, address: u8, endpoint: u8, toggle: bool, data: &[u8]) -> Handshake {
        if !self.is_addressed(address) {
            return Handshake::NoResponse;
        }
        let Some(number) = self.find(endpoint, Direction::Out) else {
            return Handshake::NoResponse;
        };
        let register = self.endpoints[number];
        match self.status(number, Direction::Out) {
            STALL => Handshake::Stall,
            NAK => Handshake::Nak,
            // A packet received before.
            _ if (register & epr::DTOG_RX != 0) != toggle => Handshake::Ack,
            // STATUS_OUT: only an empty packet ends a read request.
            _ if register & epr::EP_KIND != 0 && !data.is_empty() => Handshake::Stall,
            _ if !self.store(number, data) => Handshake::NoResponse,
            _ => {
                let register = register & !(epr::STAT_RX | epr::SETUP) | NAK << epr::STAT_RX_AT;
                self.set_endpoint(number, (register | epr::CTR_RX) ^ epr::DTOG_RX);
                Handshake::Ack
            }
        }
    }

    fn input(&mut self, address: u8, endpoint: u8) -> Reply {
        if !self.is_addressed(address) {
            return Reply::NoResponse;
        }
        let Some(number) = self.find(endpoint, Direction::In) else {
            return Reply::NoResponse;
        };
        match self.status(number, Direction::In) {
            STALL => Reply::Stall,
            NAK => Reply::Nak,
            _ => {
                self.sending = Some(number);
                Reply::Data {
                    toggle: self.endpoints[number] & epr::DTOG_TX != 0,
                    bytes: self.packet(number),
                    armed: self.armed[number].unwrap_or(self.now),
                }
            }
        }
    }

    fn acknowledged(&mut self, _: u8) {
        if let Some(number) = self.sending.take() {
            let register = self.endpoints[number] & !epr::STAT_TX | NAK << epr::STAT_TX_AT;
            self.set_endpoint(number, (register | epr::CTR_TX) ^ epr::DTOG_TX);
        }
    }
}

/// The controller, with a host at the other end of the cable.
#[derive(Debug)]
pub(super) struct Usb {
    device: Device,
    host: Shared<Host>,
    /// The time of the host's next event.
    wake: Option<Nanos>,
    progress: bool,
}

impl Usb {
    pub(super) fn new(host: Shared<Host>) -> Self {
        Self {
            device: Device::default(),
            host,
            wake: None,
            progress: false,
        }
    }

    pub(super) fn set_clock(&mut self, hz: u64, now: Nanos) {
        let clocked = hz.abs_diff(CLOCK_HZ) <= TOLERANCE_HZ;
        if clocked != self.device.clocked {
            self.device.clocked = clocked;
            self.settle(now);
        }
    }

    /// The level of the interrupt line.
    pub(super) fn interrupts(&self) -> bool {
        self.device.interrupt_status() & self.device.cntr & cntr::INTERRUPTS != 0
    }

    /// Returns true if an event occurred on the wire since the last call.
    pub(super) fn take_progress(&mut self) -> bool {
        std::mem::take(&mut self.progress)
    }

    /// Returns true if a frame has started since the last call.
    pub(super) fn take_start_of_frame(&mut self) -> bool {
        std::mem::take(&mut self.device.started_frame)
    }

    /// Passes changes on to the host.
    pub(super) fn settle(&mut self, now: Nanos) {
        self.device.now = now;
        let mut host = lock(&self.host);
        self.wake = host.poll(now, &mut self.device);
        self.progress |= host.take_progress();
    }
}

impl Peripheral for Usb {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset.checked_sub(PACKET_MEMORY_AT) {
            Some(offset) => Ok(self.device.halfword(offset as usize % PACKET_MEMORY) as u32),
            None => self.device.read(offset),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        if let Some(offset) = offset.checked_sub(PACKET_MEMORY_AT) {
            let at = offset as usize % PACKET_MEMORY;
            self.device.memory[at..at + 2].copy_from_slice(&(value as u16).to_le_bytes());
            return Ok(());
        }
        self.device.now = now;
        let written = self.device.write(offset, value);
        self.settle(now);
        written
    }

    fn advance(&mut self, now: Nanos) {
        self.settle(now);
    }

    fn due(&self) -> Option<Nanos> {
        self.wake
    }

    /// Resets the controller, but not the packet memory, the clock and the cable.
    fn reset(&mut self, now: Nanos) {
        self.device = Device {
            clocked: self.device.clocked,
            memory: self.device.memory,
            ..Device::default()
        };
        self.settle(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ADDRESS: u8 = 5;
    const BUFFER: usize = 0x100;

    /// A controller with an address, endpoint 0 for control and endpoint 1 for bulk in both directions, and buffers of
    /// 64 bytes.
    fn device() -> Device {
        let mut device = Device {
            clocked: true,
            ..Device::default()
        };
        device.write(CNTR, cntr::INTERRUPTS & !istr::SOF).unwrap();
        device.write(DADDR, EF | u32::from(ADDRESS)).unwrap();
        device.write(BCDR, DPPU).unwrap();
        for endpoint in 0..2 {
            let receive = BUFFER + 0x80 * endpoint;
            for (halfword, value) in [
                (ADDR_TX, receive + 0x40),
                (COUNT_TX, 3),
                (ADDR_RX, receive),
                (COUNT_RX, BL_SIZE | 1 << NUM_BLOCK_AT),
            ] {
                let at = device.descriptor(endpoint, halfword);
                device.memory[at..at + 2].copy_from_slice(&(value as u16).to_le_bytes());
            }
        }
        device
            .write(0, epr::CONTROL << epr::EP_TYPE_AT | VALID << epr::STAT_RX_AT)
            .unwrap();
        device
            .write(4, 1 | VALID << epr::STAT_RX_AT | NAK << epr::STAT_TX_AT)
            .unwrap();
        device
    }

    /// The value whose write leaves the register unchanged.
    fn unchanged(value: u32) -> u32 {
        value & !epr::TOGGLES | epr::CTR
    }

    #[test]
    fn bits_toggle_or_clear_as_documented() {
        let mut device = device();
        let before = device.endpoints[1];
        device.write(4, unchanged(before)).unwrap();
        assert_eq!(device.endpoints[1], before);
        device
            .write(4, unchanged(before) | epr::DTOG_TX | (NAK ^ VALID) << epr::STAT_TX_AT)
            .unwrap();
        assert_eq!(
            device.endpoints[1],
            before ^ epr::DTOG_TX ^ (NAK ^ VALID) << epr::STAT_TX_AT
        );
        device.endpoints[1] |= epr::CTR;
        device.write(4, unchanged(before) & !epr::CTR_RX).unwrap();
        assert_eq!(device.endpoints[1] & epr::CTR, epr::CTR_TX);
    }

    #[test]
    fn host_packet_reaches_buffer_and_leaves_nak() {
        let mut device = device();
        assert_eq!(device.output(ADDRESS, 1, false, &[7, 8, 9]), Handshake::Ack);
        assert_eq!(device.memory[BUFFER + 0x80..][..3], [7, 8, 9]);
        let count = device.halfword(device.descriptor(1, COUNT_RX));
        assert_eq!(count, BL_SIZE | 1 << NUM_BLOCK_AT | 3);
        assert_eq!(device.interrupt_status(), istr::CTR | istr::DIR | 1);
        assert_eq!(device.output(ADDRESS, 1, true, &[1]), Handshake::Nak);
    }

    #[test]
    fn repeated_packet_is_acknowledged_and_dropped() {
        let mut device = device();
        assert_eq!(device.output(ADDRESS, 1, true, &[7]), Handshake::Ack);
        assert_eq!(device.interrupt_status(), 0);
    }

    #[test]
    fn oversized_packet_is_not_acknowledged() {
        let mut device = device();
        assert_eq!(device.output(ADDRESS, 1, false, &[0; 64]), Handshake::Ack);
        device
            .write(4, unchanged(device.endpoints[1]) | (NAK ^ VALID) << epr::STAT_RX_AT)
            .unwrap();
        assert_eq!(device.output(ADDRESS, 1, true, &[0; 65]), Handshake::NoResponse);
    }

    #[test]
    fn valid_packet_is_sent_once_toggling_on_acknowledge() {
        let mut device = device();
        device.now = Nanos(17);
        device.memory[BUFFER + 0xC0..][..3].copy_from_slice(&[4, 5, 6]);
        assert_eq!(device.input(ADDRESS, 1), Reply::Nak);
        device
            .write(4, unchanged(device.endpoints[1]) | (NAK ^ VALID) << epr::STAT_TX_AT)
            .unwrap();
        let packet = Reply::Data {
            toggle: false,
            bytes: vec![4, 5, 6],
            armed: Nanos(17),
        };
        assert_eq!(device.input(ADDRESS, 1), packet);
        device.acknowledged(1);
        assert_eq!(device.interrupt_status(), istr::CTR | 1);
        assert_eq!(
            (device.input(ADDRESS, 1), device.endpoints[1] & epr::DTOG_TX),
            (Reply::Nak, epr::DTOG_TX)
        );
    }

    #[test]
    fn packet_on_wire_continues_at_any_status() {
        let mut device = device();
        device
            .write(4, unchanged(device.endpoints[1]) | (NAK ^ VALID) << epr::STAT_TX_AT)
            .unwrap();
        assert!(matches!(device.input(ADDRESS, 1), Reply::Data { .. }));
        device
            .write(
                4,
                unchanged(device.endpoints[1]) | (VALID ^ DISABLED) << epr::STAT_TX_AT,
            )
            .unwrap();
        device.acknowledged(1);
        assert_eq!(
            device.endpoints[1] & (epr::CTR_TX | epr::STAT_TX),
            epr::CTR_TX | NAK << epr::STAT_TX_AT
        );
    }

    #[test]
    fn setup_overrides_stall_and_sets_toggles_and_naks() {
        let mut device = device();
        device
            .write(0, unchanged(device.endpoints[0]) | (VALID ^ STALL) << epr::STAT_RX_AT)
            .unwrap();
        assert!(device.setup(ADDRESS, [1, 2, 3, 4, 5, 6, 7, 8]));
        let register = device.endpoints[0];
        assert_eq!(
            register & (epr::STAT_RX | epr::STAT_TX),
            NAK << epr::STAT_RX_AT | NAK << epr::STAT_TX_AT
        );
        assert_eq!(
            register & (epr::DTOG_RX | epr::DTOG_TX | epr::SETUP),
            epr::DTOG_RX | epr::DTOG_TX | epr::SETUP
        );
        assert!(!device.setup(ADDRESS + 1, [0; 8]), "another address");
    }

    #[test]
    fn status_out_endpoint_stalls_data_packet() {
        let mut device = device();
        device.write(0, unchanged(device.endpoints[0]) | epr::EP_KIND).unwrap();
        assert_eq!(device.output(ADDRESS, 0, false, &[1]), Handshake::Stall);
        assert_eq!(device.output(ADDRESS, 0, false, &[]), Handshake::Ack);
    }

    #[test]
    fn bus_reset_disables_endpoints_keeps_transferred_data() {
        let mut device = device();
        device.output(ADDRESS, 1, false, &[7]);
        device.reset();
        assert_eq!(device.endpoints[1], epr::CTR_RX);
        assert_eq!((device.daddr, device.flags & istr::RESET), (0, istr::RESET));
        assert_eq!(device.input(0, 0), Reply::NoResponse);
    }

    #[test]
    fn unclocked_or_unpowered_device_is_absent() {
        let mut device = device();
        assert!(device.pulls_up());
        device.clocked = false;
        assert!(!device.pulls_up());
        device.clocked = true;
        device.write(CNTR, cntr::PDWN).unwrap();
        assert!(!device.pulls_up());
    }
}
