//! Loads, stores and fetches: alignment, protection, and address decoding (ARM DDI 0403E, A3.2, B3.1, B2.3).
//!
//! Aligned accesses to RAM, and loads from flash without wait states, take a fast path. All bus errors are precise: the
//! write buffer is not modelled.

use super::bus::{Access, Bus, Purpose};
use super::fault::{Fault, Trap};
use super::memory::Width;
use super::mpu::AccessKind;
use super::state::{Cpu, ccr};
use super::system::private_page;
use super::timing::Clock;

impl Cpu {
    /// Loads a byte, halfword or word.
    #[inline(always)]
    pub(super) fn load<const BYTES: usize>(&mut self, bus: &mut dyn Bus, address: u32) -> Result<u32, Trap> {
        if address.is_multiple_of(BYTES as u32) && self.mpu.is_open(address) {
            if let Some(value) = self.memory.ram.read::<BYTES>(address) {
                return Ok(value);
            }
            if !self.clock.flash_waits
                && !self.memory.flash_loads_on_bus
                && let Some(value) = self.memory.flash.read::<BYTES>(address)
            {
                return Ok(value);
            }
        }
        self.load_elsewhere(bus, address, width(BYTES), self.is_privileged())
    }

    /// Stores a byte, halfword or word, from the lowest bits of the value.
    #[inline(always)]
    pub(super) fn store<const BYTES: usize>(
        &mut self,
        bus: &mut dyn Bus,
        address: u32,
        value: u32,
    ) -> Result<(), Trap> {
        if address.is_multiple_of(BYTES as u32)
            && self.mpu.is_open(address)
            && let Some(is_code) = self.memory.ram.write::<BYTES>(address, value)
        {
            if is_code {
                self.request_service();
            }
            return Ok(());
        }
        self.store_elsewhere(bus, address, value, width(BYTES), self.is_privileged())
    }

    /// A load of an instruction with two or more words, which must be aligned.
    #[inline(always)]
    pub(super) fn load_aligned(&mut self, bus: &mut dyn Bus, address: u32) -> Result<u32, Trap> {
        if !address.is_multiple_of(4) {
            return Err(Fault::Unaligned.into());
        }
        self.load::<4>(bus, address)
    }

    /// A store of an instruction with two or more words, which must be aligned.
    #[inline(always)]
    pub(super) fn store_aligned(&mut self, bus: &mut dyn Bus, address: u32, value: u32) -> Result<(), Trap> {
        if !address.is_multiple_of(4) {
            return Err(Fault::Unaligned.into());
        }
        self.store::<4>(bus, address, value)
    }

    /// MemU[] and MemU_unpriv[] for reads (B2.3.4).
    #[inline(never)]
    pub(super) fn load_elsewhere(
        &mut self,
        bus: &mut dyn Bus,
        address: u32,
        width: Width,
        privileged: bool,
    ) -> Result<u32, Trap> {
        if address.is_multiple_of(width.bytes()) {
            return self.load_one(bus, address, width, privileged);
        }
        self.check_unaligned(address, width)?;
        let mut value = 0;
        for byte in (0..width.bytes()).rev() {
            value = value << 8 | self.load_one(bus, address.wrapping_add(byte), Width::Byte, privileged)?;
        }
        Ok(value)
    }

    /// MemU[] and MemU_unpriv[] for writes (B2.3.4).
    #[inline(never)]
    pub(super) fn store_elsewhere(
        &mut self,
        bus: &mut dyn Bus,
        address: u32,
        value: u32,
        width: Width,
        privileged: bool,
    ) -> Result<(), Trap> {
        if address.is_multiple_of(width.bytes()) {
            return self.store_one(bus, address, value & width.mask(), width, privileged);
        }
        self.check_unaligned(address, width)?;
        for byte in 0..width.bytes() {
            let part = value >> (8 * byte) & 0xff;
            self.store_one(bus, address.wrapping_add(byte), part, Width::Byte, privileged)?;
        }
        Ok(())
    }

    /// Faults an unaligned access where alignment is required (A3.2.1, CCR.UNALIGN_TRP). Counts its extra cycles.
    fn check_unaligned(&mut self, address: u32, width: Width) -> Result<(), Fault> {
        let is_device = matches!(address >> 29, 2 | 5 | 6 | 7);
        if self.scb.ccr & ccr::UNALIGN_TRP != 0 || is_device {
            return Err(Fault::Unaligned);
        }
        if self.clock.exact {
            // Two halfwords, or a byte, a halfword and a byte.
            self.cycle += if width == Width::Word && address & 1 != 0 { 2 } else { 1 };
        }
        Ok(())
    }

    /// MemA_with_priv[] for a read (B2.3.4). The address is aligned.
    fn load_one(&mut self, bus: &mut dyn Bus, address: u32, width: Width, privileged: bool) -> Result<u32, Trap> {
        self.check_protection(address, AccessKind::Read, privileged)?;
        if !self.memory.flash_loads_on_bus
            && let Some(value) = self.memory.read(address, width)
        {
            if self.clock.flash_waits && self.memory.ram.read::<1>(address).is_none() {
                self.cycle += self.clock.load_wait(address.wrapping_sub(self.memory.flash.base()));
            }
            return Ok(value);
        }
        if let Some(value) = self.memory.read_ram(address, width) {
            return Ok(value);
        }
        if let Some(page) = private_page(address) {
            if !privileged {
                return Err(Fault::DataBus(address).into());
            }
            let word = self.read_system(page, address & !3)?;
            return Ok(word >> (8 * (address & 3)) & width.mask());
        }
        if let Some((target, bit)) = self.bit_band(address, width) {
            return Ok(self.load_one(bus, target, width, privileged)? >> bit & 1);
        }
        let access = self.transfer(bus, address, width, privileged);
        let value = bus.read(access, &mut self.memory);
        self.end_transfer(bus);
        value
            .map(|value| value & width.mask())
            .map_err(|_| Fault::DataBus(address).into())
    }

    /// MemA_with_priv[] for a write (B2.3.4). The address is aligned.
    fn store_one(
        &mut self,
        bus: &mut dyn Bus,
        address: u32,
        value: u32,
        width: Width,
        privileged: bool,
    ) -> Result<(), Trap> {
        self.check_protection(address, AccessKind::Write, privileged)?;
        if self.memory.write(address, width, value).is_some() {
            if self.memory.has_changed() {
                self.request_service();
            }
            return Ok(());
        }
        if let Some(page) = private_page(address) {
            if !privileged && !self.may_pend_unprivileged(address) {
                return Err(Fault::DataBus(address).into());
            }
            return self.write_system(page, address, value, width);
        }
        if let Some((target, bit)) = self.bit_band(address, width) {
            let old = self.load_one(bus, target, width, privileged)?;
            return self.store_one(bus, target, old & !(1 << bit) | (value & 1) << bit, width, privileged);
        }
        let access = self.transfer(bus, address, width, privileged);
        let written = bus.write(access, value, &mut self.memory);
        self.end_transfer(bus);
        written.map_err(|_| Fault::DataBus(address).into())
    }

    /// Returns true if an unprivileged write to the Software Trigger Interrupt Register is permitted (B3.2.26).
    fn may_pend_unprivileged(&self, address: u32) -> bool {
        self.scb.ccr & ccr::USERSETMPEND != 0 && address == 0xe000_ef00
    }

    fn check_protection(&self, address: u32, kind: AccessKind, privileged: bool) -> Result<(), Fault> {
        let open = self.mpu.is_open(address) && privileged == self.is_privileged();
        if open || self.mpu.permits(address, kind, privileged, self.handles_fault()) {
            return Ok(());
        }
        Err(Fault::DataProtection(address))
    }

    fn transfer(&mut self, bus: &mut dyn Bus, address: u32, width: Width, privileged: bool) -> Access {
        let access = Access {
            address,
            width,
            cycle: self.cycle,
            pc: self.r[15],
            purpose: Purpose::Data,
            privileged,
        };
        if self.clock.exact {
            self.cycle += u64::from(bus.wait_cycles(access));
        }
        access
    }

    fn end_transfer(&mut self, bus: &mut dyn Bus) {
        if bus.needs_attention() || self.memory.has_changed() {
            self.request_service();
        }
    }

    /// The address and bit of a bit-band alias (Cortex-M4 TRM, 3.7).
    fn bit_band(&self, address: u32, width: Width) -> Option<(u32, u32)> {
        if !self.config.bit_band || !matches!(address >> 24, 0x22 | 0x23 | 0x42 | 0x43) {
            return None;
        }
        let number = (address & 0x01ff_ffff) / 4;
        let bits = 8 * width.bytes();
        Some(((address & 0xf000_0000) + number / bits * width.bytes(), number % bits))
    }

    /// Counts the wait cycles of an instruction fetch from flash.
    #[inline(always)]
    pub(super) fn wait_for_fetch(&mut self, pc: u32, length: u8) {
        let offset = pc.wrapping_sub(self.memory.flash.base());
        if !self.clock.is_fetched(offset, length) {
            self.cycle += self.clock.fetch_wait(offset, length, self.cycle);
        }
    }

    /// Fetches a halfword of an instruction.
    pub(super) fn fetch(&mut self, bus: &mut dyn Bus, address: u32) -> Result<u32, Trap> {
        // Execution is never permitted from peripherals, devices and the system's own addresses (B3.1, Table B3-1).
        let never = matches!(address >> 29, 2 | 5 | 6 | 7);
        let privileged = self.is_privileged();
        if never
            || !self
                .mpu
                .permits(address, AccessKind::Execute, privileged, self.handles_fault())
        {
            return Err(Fault::FetchProtection.into());
        }
        let stored = if self.memory.flash_fetches_on_bus {
            self.memory.read_ram(address, Width::Half)
        } else {
            self.memory.read(address, Width::Half)
        };
        if let Some(halfword) = stored {
            return Ok(halfword);
        }
        let access = Access {
            purpose: Purpose::Fetch,
            ..self.transfer(bus, address, Width::Half, privileged)
        };
        let halfword = bus.read(access, &mut self.memory);
        self.end_transfer(bus);
        halfword.map(|value| value & 0xffff).map_err(|_| Fault::FetchBus.into())
    }

    /// Reads for the debugger: without faults, protection, and cycles. The address is aligned.
    pub(super) fn debug_read(&mut self, bus: &mut dyn Bus, address: u32, width: Width) -> Option<u32> {
        if let Some(value) = self.memory.read(address, width) {
            return Some(value);
        }
        let value = match private_page(address) {
            Some(page) => self.read_system(page, address & !3).ok()? >> (8 * (address & 3)),
            None => bus.read(self.debug_access(address, width), &mut self.memory).ok()?,
        };
        Some(value & width.mask())
    }

    /// Writes for the debugger: without faults, protection, and cycles. The address is aligned.
    pub(super) fn debug_write(&mut self, bus: &mut dyn Bus, address: u32, value: u32, width: Width) -> Option<()> {
        if self.memory.write(address, width, value).is_some() {
            return Some(());
        }
        let written = match private_page(address) {
            Some(page) => self.write_system(page, address, value, width).ok(),
            None => bus
                .write(
                    self.debug_access(address, width),
                    value & width.mask(),
                    &mut self.memory,
                )
                .ok(),
        };
        self.request_service();
        written
    }

    fn debug_access(&self, address: u32, width: Width) -> Access {
        Access {
            address,
            width,
            cycle: self.cycle,
            pc: self.r[15],
            purpose: Purpose::Debug,
            privileged: true,
        }
    }

    /// SDIV and UDIV: counts the cycles that depend on the operands, and takes the trap if enabled (A7.7.127).
    #[inline(always)]
    pub(super) fn begin_division(&mut self, dividend: u32, divisor: u32) -> Result<(), Trap> {
        if divisor == 0 && self.scb.ccr & ccr::DIV_0_TRP != 0 {
            return Err(Fault::DivideByZero.into());
        }
        if self.clock.exact {
            self.cycle += Clock::divide(dividend, divisor);
        }
        Ok(())
    }
}

fn width(bytes: usize) -> Width {
    match bytes {
        1 => Width::Byte,
        2 => Width::Half,
        _ => Width::Word,
    }
}
