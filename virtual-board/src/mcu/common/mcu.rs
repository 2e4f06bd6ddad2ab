//! The flow of a microcontroller: accesses of the core, events, resets, and the wires between peripherals. Each chip adds its
//! [`Peripherals`].

use std::fmt::Debug;
use std::sync::atomic::Ordering;

use super::dma::{Dma, Failure, Requests};
use super::flash::FlashInterface;
use super::iwdg::Iwdg;
use super::rcc::{Gate, Gates};
use super::shifter::Uart;
use super::system_memory::{SystemMemory, starts_boot_loader};
use crate::core::{self, Access, Bus, BusError, Core, FlashTiming, Memory, Purpose, Width};
use crate::engine::News;
use crate::line::{LOW, Pin};
use crate::shared::lock;
use crate::soc::chance::Chance;
use crate::soc::clock::Clock;
use crate::soc::events::Events;
use crate::soc::lines::Lines;
use crate::soc::machine::{Cause, Chip, Edges};
use crate::soc::peripheral::{Peripheral, Refused, forbidden};
use crate::soc::violations::Recorder;
use crate::time::Nanos;
use crate::trace::Trace;

/// Number of priority bits, and of MPU regions (PM0214, 4.3 and 4.2).
const PRIORITY_BITS: u8 = 4;
const MPU_REGIONS: u8 = 8;

/// A peripheral with events. Of several events at the same instant, that of the first slot is executed first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Slot {
    Rcc,
    Flash,
    Iwdg,
    /// The timer of the firmware's clock.
    Tim,
    Usart,
    Dma,
    Usb,
    Can,
}

const SLOTS: [Slot; 8] = [
    Slot::Rcc,
    Slot::Flash,
    Slot::Iwdg,
    Slot::Tim,
    Slot::Usart,
    Slot::Dma,
    Slot::Usb,
    Slot::Can,
];

/// The memories, and the number of interrupts.
#[derive(Debug)]
pub(crate) struct Map {
    pub(crate) flash: u32,
    pub(crate) flash_size: usize,
    pub(crate) ram: u32,
    pub(crate) ram_size: usize,
    pub(crate) interrupts: u16,
    /// Offsets of the UART's data registers, which the DMA reads and writes.
    pub(crate) uart_receive: u32,
    pub(crate) uart_transmit: u32,
    pub(crate) system_memory: SystemMemory,
}

/// A block of registers in the memory map. A peripheral may have several.
#[derive(Debug)]
pub(crate) struct Block<K> {
    /// The peripheral.
    pub(crate) kind: K,
    /// The address of its first register, and its length in bytes.
    pub(crate) address: u32,
    pub(crate) size: u32,
    /// The offset of its first register among all of the peripheral.
    pub(crate) offset: u32,
    /// The name in the reference manual.
    pub(crate) name: &'static str,
    /// The bits that enable and reset it. `None` for a block that is always there.
    pub(crate) gate: Option<Gate>,
}

impl<K> Block<K> {
    /// The length of most blocks.
    const SIZE: u32 = 0x400;

    /// The first block of a peripheral.
    pub(crate) const fn new(kind: K, address: u32, name: &'static str, gate: Option<Gate>) -> Self {
        Self {
            kind,
            address,
            size: Self::SIZE,
            offset: 0,
            name,
            gate,
        }
    }
}

/// A block, and an offset among the registers of its peripheral.
type Place<P> = (&'static Block<<P as Peripherals>::Kind>, u32);

/// The peripherals of a chip. Every call happens at [`Common::now`].
pub(crate) trait Peripherals: Debug + Send {
    /// The kinds of peripherals.
    type Kind: Copy + PartialEq + 'static;
    type Flash: FlashInterface;

    const MAP: Map;

    /// The blocks of registers.
    fn blocks(&self) -> &'static [Block<Self::Kind>];

    /// The peripherals with events, by their [`Slot`].
    const EVENTS: [Self::Kind; SLOTS.len()];

    /// The peripheral whose registers bound the clocks.
    const POWER: Self::Kind;

    fn peripheral(&mut self, kind: Self::Kind) -> &mut dyn Peripheral;

    /// Returns true if the registers of a block accept accesses of this width, as far as modelled.
    fn takes(block: &Block<Self::Kind>, width: Width) -> bool;

    /// The enable and reset bits in RCC.
    fn gates(&self) -> &Gates;

    fn gates_mut(&mut self) -> &mut Gates;

    fn flash(&self) -> &Self::Flash;

    fn flash_mut(&mut self) -> &mut Self::Flash;

    /// The UART to the arm.
    fn uart(&self) -> &dyn Uart;

    /// The address of its registers.
    fn uart_address(&self) -> u32;

    /// The driver of its TX pin.
    fn uart_pin(&self) -> Pin;

    /// The DMA, and the UART that it serves.
    fn dma_and_uart(&mut self) -> (&mut dyn Dma, &mut dyn Uart);

    fn iwdg(&mut self) -> &mut Iwdg;

    /// Switches the low-speed oscillator on.
    fn keep_lsi_on(&mut self, now: Nanos);

    /// Checks a write against the state of other peripherals.
    fn check_write(&self, _kind: Self::Kind, _offset: u32, _value: u32) -> Result<(), Refused> {
        Ok(())
    }

    /// Sets each peripheral's clock rate, and checks the limits of supply and flash. Returns true if a rate changed.
    fn follow_clocks(&mut self, common: &mut Common) -> bool;

    /// Sets the interrupt lines of a peripheral, and its wires to others.
    fn set_lines(&mut self, slot: Slot, lines: &mut Lines);

    /// Applies changes made by the program from outside.
    fn sync(&mut self, now: Nanos);

    /// Events since the last call that a program may wait for.
    fn take_news(&mut self) -> News;

    /// Resets a block, unless it outlives a reset of the chip.
    fn reset_block(&mut self, block: &Block<Self::Kind>, now: Nanos);

    /// Resets the clocks, and everything else that only this cause resets.
    fn reset_clocks(&mut self, cause: Cause);
}

/// The state of a microcontroller besides its peripherals.
#[derive(Debug)]
pub(crate) struct Common {
    pub(crate) now: Nanos,
    pub(crate) edges: Edges,
    pub(crate) events: Events<{ SLOTS.len() }>,
    pub(crate) lines: Lines,
    /// A reset requested by the chip.
    pub(crate) reset: Option<Cause>,
    pub(crate) recorder: Recorder,
    /// Cycles of the core.
    pub(crate) clock: Clock,
    /// The virtual duration of a cycle, in percent.
    cycle_cost: u64,
    clock_changed: bool,
    /// The deadline of the core: no event is due before it.
    deadline: Nanos,
    powered: bool,
    /// The power failed since the last check.
    was_cut: bool,
    in_boot_loader: bool,
    nmi: bool,
    trace: Trace,
}

impl Common {
    /// Changes the rate of HCLK, in hertz.
    pub(crate) fn set_core_clock(&mut self, ahb: u64) {
        let hz = ahb * 100 / self.cycle_cost;
        if hz != self.clock.hz() {
            self.clock.set_hz(hz, self.now);
            self.clock_changed = true;
        }
    }

    /// Records a forbidden state, if there is one.
    pub(crate) fn check(&mut self, instance: &'static str, fault: Option<Refused>) {
        if let Some(Refused::Forbidden { register, reason }) = fault {
            self.recorder.forbidden(instance, register, reason);
        }
    }

    /// Records a failed step of the DMA. `instance` is the peripheral that the DMA serves.
    pub(crate) fn record_dma(&mut self, instance: &'static str, failure: Failure) {
        let address = failure.address;
        match failure.refused {
            Some(refused) => self.recorder.register(instance, refused, address, 0, false),
            None => self
                .recorder
                .refused(address, 0, "a DMA transfer to an address without memory or register"),
        }
    }

    /// Sets the time of the next event of `slot`.
    #[inline]
    pub(crate) fn set_due(&mut self, slot: Slot, due: Option<Nanos>) {
        self.events.set(slot as usize, due);
    }

    /// Advances to the instant of an access.
    #[inline]
    fn come_to(&mut self, access: Access) {
        if let Some(at) = self.clock.instant(access.cycle) {
            self.now = self.now.max(at);
        }
    }

    #[inline]
    fn trace(&mut self, access: Access, value: u32) {
        let (address, value) = (u64::from(access.address), u64::from(value));
        self.trace.add(address << 32 | value);
        self.trace.add(access.cycle);
    }
}

/// A microcontroller, with an arm, a USB host and a CAN bus at its pins.
#[derive(Debug)]
pub(crate) struct Mcu<P> {
    pub(crate) common: Common,
    pub(crate) peripherals: P,
    unique_id: [u8; 12],
    /// The content of the RAM after each loss of power.
    ram: Chance,
}

impl<P: Peripherals> Mcu<P> {
    /// A chip before its first reset. A cycle has this virtual duration, in percent.
    pub(crate) fn new(peripherals: P, unique_id: [u8; 12], cycle_cost: u32, seed: u64, edges: Edges) -> Self {
        let common = Common {
            now: Nanos(0),
            edges,
            events: Events::default(),
            lines: Lines::default(),
            reset: None,
            recorder: Recorder::default(),
            clock: Clock::new(0, Nanos(0), 0),
            cycle_cost: cycle_cost.into(),
            clock_changed: false,
            deadline: Nanos(u64::MAX),
            powered: true,
            was_cut: false,
            in_boot_loader: false,
            nmi: false,
            trace: Trace::default(),
        };
        let mut mcu = Self {
            common,
            peripherals,
            unique_id,
            ram: Chance::new(seed, "RAM"),
        };
        mcu.follow_clocks();
        mcu
    }

    /// Core and memory of the chip at power-on, with this flash content.
    pub(crate) fn core(&mut self, flash: Vec<u8>) -> Core {
        let config = core::Config {
            interrupts: P::MAP.interrupts,
            priority_bits: PRIORITY_BITS,
            vector_table: P::MAP.flash,
            mpu_regions: MPU_REGIONS,
            bit_band: true,
        };
        let mut memory = Memory::new(P::MAP.flash, flash, P::MAP.ram, P::MAP.ram_size);
        self.randomize_ram(&mut memory);
        core::Core::new(config, memory)
    }

    fn randomize_ram(&mut self, memory: &mut Memory) {
        memory.fill_ram(|| self.ram.next() as u8);
    }

    #[inline]
    fn flash_offset(address: u32) -> Option<u32> {
        let offset = address.wrapping_sub(P::MAP.flash);
        ((offset as usize) < P::MAP.flash_size).then_some(offset)
    }

    /// The block that an address outside the memories is in, and the offset among the registers of its peripheral.
    #[inline]
    fn find(&self, address: u32) -> Option<Place<P>> {
        let mut blocks = self.peripherals.blocks().iter();
        let block = blocks.find(|block| address.wrapping_sub(block.address) < block.size)?;
        Some((block, address - block.address + block.offset))
    }

    /// The place of a peripheral among those with events.
    #[inline]
    fn slot(kind: P::Kind) -> Option<Slot> {
        let place = P::EVENTS.iter().position(|&other| other == kind)?;
        Some(SLOTS[place])
    }

    /// The block at an address and the offset within its peripheral, if it takes the access.
    #[inline]
    fn block(&mut self, access: Access) -> Result<Option<Place<P>>, BusError> {
        let Some((block, offset)) = self.find(access.address) else {
            self.common.recorder.unmapped(access.address, access.pc);
            return Err(BusError);
        };
        let gate = block.gate;
        let reason = if !P::takes(block, access.width) {
            "not an access of this width"
        } else if gate.is_some_and(|gate| !self.peripherals.gates().is_enabled(gate)) {
            "its clock is off"
        } else if gate.is_some_and(|gate| self.peripherals.gates().is_held(gate)) {
            "it is held in reset"
        } else if gate.is_some_and(|gate| self.peripherals.gates().is_starting(gate, access.cycle)) {
            "its clock does not run yet, so soon after it was enabled"
        } else {
            return Ok(Some((block, offset)));
        };
        self.common.recorder.refused(access.address, access.pc, reason);
        Ok(None)
    }

    /// Reads a register without a trace or a violation.
    fn read_for_debugger(&mut self, access: Access) -> Result<u32, BusError> {
        if is_system_memory(access) {
            return P::MAP.system_memory.read(access, &self.unique_id).ok_or(BusError);
        }
        let (block, offset) = self.find(access.address).ok_or(BusError)?;
        let value = self.peripherals.peripheral(block.kind).peek(offset, self.common.now);
        value.map_err(|_| BusError)
    }

    fn read_system_memory(&mut self, access: Access) -> Result<u32, BusError> {
        if starts_boot_loader(access) {
            self.common.in_boot_loader = true;
        }
        let value = P::MAP.system_memory.read(access, &self.unique_id);
        value.ok_or_else(|| {
            self.common.recorder.unmapped(access.address, access.pc);
            BusError
        })
    }

    /// The levels of the DMA requests of the UART.
    fn requests(&self) -> Requests {
        let uart = self.peripherals.uart();
        Requests {
            receive: uart.requests_receive() && !self.common.edges.starve.load(Ordering::Relaxed),
            transmit: uart.requests_transmit(),
        }
    }

    /// Propagates changes of a peripheral: its interrupts, its DMA requests, the time of its next event.
    #[inline]
    fn settle(&mut self, slot: Slot) {
        self.peripherals.set_lines(slot, &mut self.common.lines);
        if matches!(slot, Slot::Usart | Slot::Dma) {
            let requests = self.requests();
            let (dma, _) = self.peripherals.dma_and_uart();
            dma.follow_requests(requests, self.common.now);
            self.common.set_due(Slot::Dma, dma.due());
        }
        let due = self.peripherals.peripheral(P::EVENTS[slot as usize]).due();
        self.common.set_due(slot, due);
    }

    fn settle_all(&mut self) {
        for slot in SLOTS {
            self.settle(slot);
        }
    }

    fn follow_clocks(&mut self) {
        if self.peripherals.follow_clocks(&mut self.common) {
            self.settle_all();
        }
    }

    /// Lets the chip answer the core's loads from flash while its data cache differs from the flash.
    fn follow_cache(&self, memory: &mut Memory) {
        memory.set_flash_loads_on_bus(self.peripherals.flash().array().is_stale());
    }

    /// Applies the reset bits of RCC after a write.
    fn follow_resets(&mut self) {
        if !self.peripherals.gates().holds_any() {
            return;
        }
        for block in self.peripherals.blocks() {
            if block.gate.is_some_and(|gate| self.peripherals.gates().is_held(gate)) {
                self.peripherals.reset_block(block, self.common.now);
            }
        }
        self.follow_pin();
        self.settle_all();
    }

    /// Passes the driver of the UART's TX pin to the line. Returns true if the pin went low.
    fn follow_pin(&mut self) -> bool {
        let mut line = lock(&self.common.edges.line);
        let was_low = line.is_pin_low();
        line.set_pin(self.peripherals.uart_pin());
        line.set_transmits(self.peripherals.uart().transmits());
        line.is_pin_low() && !was_low
    }

    fn read_register(&mut self, kind: P::Kind, offset: u32) -> Result<u32, Refused> {
        let slot = Self::slot(kind);
        if slot == Some(Slot::Usart) && offset == P::MAP.uart_receive && self.peripherals.uart().requests_receive() {
            lock(&self.common.edges.line).take_byte();
        }
        let value = self.peripherals.peripheral(kind).read(offset, self.common.now);
        if let Some(slot) = slot {
            self.settle(slot);
        }
        value
    }

    fn write_register(&mut self, kind: P::Kind, offset: u32, value: u32) -> Result<(), Refused> {
        self.peripherals.check_write(kind, offset, value)?;
        let now = self.common.now;
        let written = self.peripherals.peripheral(kind).write(offset, value, now);
        let slot = Self::slot(kind);
        if let Some(slot) = slot {
            self.settle(slot);
        }
        match slot {
            Some(Slot::Rcc) => {
                self.follow_resets();
                self.follow_clocks();
            }
            Some(Slot::Flash) => self.follow_clocks(),
            Some(Slot::Iwdg) if self.peripherals.iwdg().runs() => {
                self.peripherals.keep_lsi_on(now);
                self.settle(Slot::Rcc);
            }
            Some(Slot::Usart) if self.follow_pin() => return written.and(Err(forbidden("CR1", LOW))),
            None if kind == P::POWER => self.follow_clocks(),
            None if self.follow_pin() => return written.and(Err(forbidden("MODER/ODR/BSRR", LOW))),
            _ => {}
        }
        written
    }

    /// Executes the due events of a peripheral.
    fn advance(&mut self, slot: Slot, memory: &mut Memory) {
        let now = self.common.now;
        match slot {
            Slot::Flash => {
                self.peripherals.flash_mut().finish(now, memory);
                self.follow_cache(memory);
            }
            Slot::Dma => self.step_dma(memory),
            _ => self.peripherals.peripheral(P::EVENTS[slot as usize]).advance(now),
        }
        match slot {
            Slot::Rcc => self.follow_clocks(),
            Slot::Iwdg if self.peripherals.iwdg().take_expired() => self.common.reset = Some(Cause::Watchdog),
            _ => {}
        }
    }

    /// A step of a DMA stream.
    fn step_dma(&mut self, memory: &mut Memory) {
        let now = self.common.now;
        let requests = self.requests();
        let registers = self.peripherals.uart_address();
        let (dma, uart) = self.peripherals.dma_and_uart();
        let Some((stream, step)) = dma.step(requests, now) else {
            return;
        };
        let done = step.run(memory, |address, value| {
            let offset = address.wrapping_sub(registers);
            match value {
                None if offset == P::MAP.uart_receive => Some(uart.read(offset, now).map(|value| value as u8)),
                Some(value) if offset == P::MAP.uart_transmit => {
                    Some(uart.write(offset, value.into(), now).map(|()| value))
                }
                _ => None,
            }
        });
        match done {
            Ok(Some(value)) => dma.fetched(stream, value, now),
            Ok(None) => {}
            Err(failure) => {
                dma.fail(stream);
                self.common.record_dma("UART", failure);
            }
        }
        self.settle(Slot::Usart);
    }

    /// Resets everything that a system reset resets, except the clocks.
    fn reset(&mut self, memory: &mut Memory) {
        self.peripherals.flash_mut().restart(memory);
        self.follow_cache(memory);
        for block in self.peripherals.blocks() {
            self.peripherals.reset_block(block, self.common.now);
        }
        self.follow_pin();
        self.common.in_boot_loader = false;
        self.common.reset = None;
        self.common.nmi = false;
        self.common.events = Events::default();
        self.common.lines = Lines::default();
    }

    fn power_off(&mut self, memory: &mut Memory) {
        self.common.powered = false;
        self.reset(memory);
        self.randomize_ram(memory);
        self.settle_all();
    }
}

/// Returns true for an access to the system memory or the area after it, up to the option bytes.
#[inline]
fn is_system_memory(access: Access) -> bool {
    access.address >> 16 == 0x1FFF
}

impl<P: Peripherals> Bus for Mcu<P> {
    fn read(&mut self, access: Access, memory: &mut Memory) -> Result<u32, BusError> {
        if access.purpose == Purpose::Debug {
            return self.read_for_debugger(access);
        }
        self.common.come_to(access);
        if let Some(offset) = Self::flash_offset(access.address) {
            self.common.nmi |= self.peripherals.flash_mut().check_read(offset);
            let cached = match access.purpose {
                Purpose::Data => self.peripherals.flash().array().cached(offset, access.width),
                Purpose::Fetch | Purpose::Debug => None,
            };
            return cached
                .or_else(|| memory.read(access.address, access.width))
                .ok_or(BusError);
        }
        if is_system_memory(access) {
            return self.read_system_memory(access);
        }
        let Some((block, offset)) = self.block(access)? else {
            return Ok(0);
        };
        let read = self.read_register(block.kind, offset);
        if Self::slot(block.kind) == Some(Slot::Rcc) {
            self.peripherals.gates_mut().finish_starting();
        }
        let value = read.unwrap_or_else(|refused| {
            self.common
                .recorder
                .register(block.name, refused, access.address, access.pc, false);
            0
        });
        self.common.trace(access, value);
        Ok(value)
    }

    fn write(&mut self, access: Access, value: u32, memory: &mut Memory) -> Result<(), BusError> {
        self.common.come_to(access);
        self.common.trace(access, value);
        let (name, written) = if let Some(offset) = Self::flash_offset(access.address) {
            let flash = self.peripherals.flash_mut();
            let stored = flash.store(offset, access.width, value, self.common.now);
            self.settle(Slot::Flash);
            ("FLASH", stored)
        } else {
            let Some((block, offset)) = self.block(access)? else {
                return Ok(());
            };
            let written = self.write_register(block.kind, offset, value);
            match Self::slot(block.kind) {
                Some(Slot::Rcc) => self.peripherals.gates_mut().start(access.cycle),
                Some(Slot::Flash) => self.follow_cache(memory),
                _ => {}
            }
            (block.name, written)
        };
        if let Err(refused) = written {
            self.common
                .recorder
                .register(name, refused, access.address, access.pc, true);
        }
        Ok(())
    }

    #[inline]
    fn needs_attention(&self) -> bool {
        self.common.lines.changed()
            || self.common.events.next() < self.common.deadline
            || self.common.clock_changed
            || self.common.nmi
            || self.common.in_boot_loader
            || self.peripherals.flash().is_busy()
    }
}

impl<P: Peripherals> Chip for Mcu<P> {
    fn clock(&self) -> &Clock {
        &self.common.clock
    }

    fn come_near(&mut self, now: Nanos) {
        self.common.clock.come_near(now);
    }

    fn flash_timing(&self) -> FlashTiming {
        self.peripherals.flash().timing()
    }

    fn next_event(&self) -> Nanos {
        self.common.events.next()
    }

    fn set_deadline(&mut self, deadline: Nanos) {
        self.common.deadline = deadline;
        self.common.clock_changed = false;
    }

    fn handle_event(&mut self, memory: &mut Memory) {
        let due = self.common.events.next();
        let Some(slot) = self.common.events.take(due) else {
            return;
        };
        self.common.now = self.common.now.max(due);
        self.common.trace.add(self.common.now.0);
        self.common.trace.add(slot as u64);
        let slot = SLOTS[slot];
        if slot == Slot::Flash && self.peripherals.flash_mut().take_cut(self.common.now) {
            lock(&self.common.edges.flash).cut = Some(self.common.now);
            self.common.was_cut = true;
            self.power_off(memory);
        } else {
            self.advance(slot, memory);
        }
        self.settle(slot);
    }

    fn sync(&mut self, now: Nanos, memory: &mut Memory) {
        self.common.now = self.common.now.max(now);
        self.peripherals.sync(self.common.now);
        for slot in [Slot::Usart, Slot::Usb, Slot::Can, Slot::Rcc] {
            self.settle(slot);
        }
        let supply = lock(&self.common.edges.flash).supply.take();
        match supply {
            Some(true) => self.common.reset = Some(Cause::Power),
            Some(false) => self.power_off(memory),
            None => {}
        }
    }

    fn take_interrupt(&mut self) -> Option<(u16, bool)> {
        self.common.lines.take_change()
    }

    fn take_nmi(&mut self) -> bool {
        std::mem::take(&mut self.common.nmi)
    }

    fn take_reset(&mut self) -> Option<Cause> {
        self.common.reset.take()
    }

    fn holds_core(&self) -> bool {
        !self.common.powered || self.common.in_boot_loader || self.peripherals.flash().is_busy()
    }

    fn is_in_boot_loader(&self) -> bool {
        self.common.in_boot_loader
    }

    fn take_news(&mut self) -> News {
        News {
            cut: std::mem::take(&mut self.common.was_cut),
            ..self.peripherals.take_news()
        }
    }

    fn restart(&mut self, cause: Cause, now: Nanos, memory: &mut Memory) {
        self.common.now = self.common.now.max(now);
        self.reset(memory);
        self.common.powered = true;
        self.peripherals.reset_clocks(cause);
        self.follow_clocks();
        self.settle_all();
    }

    fn recorder(&self) -> &Recorder {
        &self.common.recorder
    }

    fn trace(&self) -> Trace {
        self.common.trace
    }
}
