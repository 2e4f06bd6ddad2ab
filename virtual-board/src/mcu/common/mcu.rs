//! The common flow of a microcontroller: accesses of the core, events, resets. Each chip adds its [`Peripherals`].

use std::fmt::Debug;

use super::dma::Failure;
use super::rcc::Gate;
use super::system_memory::{SystemMemory, starts_boot_loader};
use crate::core::{self, Access, Bus, BusError, Core, FlashTiming, Memory, Purpose, Width};
use crate::engine::News;
use crate::shared::lock;
use crate::soc::clock::Clock;
use crate::soc::events::Events;
use crate::soc::lines::Lines;
use crate::soc::machine::{Cause, Chip, Edges};
use crate::soc::peripheral::Refused;
use crate::soc::violations::Recorder;
use crate::time::Nanos;
use crate::trace::Trace;

/// Number of priority bits, and of MPU regions (PM0214, 4.3 and 4.2).
const PRIORITY_BITS: u8 = 4;
const MPU_REGIONS: u8 = 8;

/// A peripheral with events. The number is its order: of several events at one instant, the lowest comes first.
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
    pub(crate) system_memory: SystemMemory,
}

/// A block of registers in the memory map.
pub(crate) trait Block: Copy {
    /// The block of an address outside the memories, and the offset within it.
    fn at(address: u32) -> Option<(Self, u32)>;

    /// The name in the reference manual.
    fn name(self) -> &'static str;

    /// The bits that enable and reset it. `None` for a block that is always enabled.
    fn gate(self) -> Option<Gate>;

    /// Returns true if its registers support accesses of this width, as far as modelled.
    fn takes(self, width: Width) -> bool;
}

/// The peripherals of a chip, and the connections between them. Calls are made at [`Common::now`].
pub(crate) trait Peripherals: Debug + Send {
    type Block: Block;

    const MAP: Map;

    /// Returns true if the clock of a block is on.
    fn is_enabled(&self, gate: Gate) -> bool;

    /// Returns true if a block is held in reset.
    fn is_held(&self, gate: Gate) -> bool;

    /// Reads a register, with its side effects.
    fn read(&mut self, block: Self::Block, offset: u32, common: &mut Common) -> Result<u32, Refused>;

    /// Reads a register for the debugger, without side effects where the model can avoid them.
    fn peek(&mut self, block: Self::Block, offset: u32, common: &mut Common) -> Result<u32, Refused> {
        self.read(block, offset, common)
    }

    fn write(&mut self, block: Self::Block, offset: u32, value: u32, common: &mut Common) -> Result<(), Refused>;

    /// Handles a store of the core to the flash, at this offset.
    fn store(&mut self, offset: u32, width: Width, value: u32, now: Nanos) -> Result<(), Refused>;

    /// Handles a read of the flash that was redirected to the bus. Returns true if the NMI becomes pending.
    fn check_flash_read(&mut self, _offset: u32) -> bool {
        false
    }

    /// The timing of the flash by its wait states and caches.
    fn flash_timing(&self) -> FlashTiming;

    /// Returns true during an erase or programming of the flash: the core waits.
    fn is_flash_busy(&self) -> bool;

    /// Returns true if the power fails now.
    fn take_cut(&mut self, now: Nanos) -> bool;

    /// Updates the clock rate of each peripheral, and checks them against the supply and the flash.
    fn follow_clocks(&mut self, common: &mut Common);

    /// Applies the changes of a peripheral: its interrupt, its DMA requests, the time of its next event.
    fn settle(&mut self, slot: Slot, common: &mut Common);

    fn settle_all(&mut self, common: &mut Common) {
        for slot in SLOTS {
            self.settle(slot, common);
        }
    }

    /// Executes the due events of a peripheral.
    fn advance(&mut self, slot: Slot, common: &mut Common, memory: &mut Memory);

    /// Checks for changes made by the program.
    fn look(&mut self, common: &mut Common);

    /// Events since the last call that a program may wait for.
    fn take_news(&mut self) -> News;

    /// Resets everything that a system reset resets, except the clocks.
    fn reset(&mut self, common: &mut Common, memory: &mut Memory);

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
    /// No event is due before this time, as known by the core.
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
                .refused(address, 0, "a DMA transfer that the bus does not take"),
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
}

impl<P: Peripherals> Mcu<P> {
    /// A chip before its first reset. A cycle has this virtual duration, in percent.
    pub(crate) fn new(peripherals: P, unique_id: [u8; 12], cycle_cost: u32, edges: Edges) -> Self {
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
        };
        mcu.peripherals.follow_clocks(&mut mcu.common);
        mcu
    }

    /// Core and memory of the chip, with this flash content.
    pub(crate) fn core(flash: Vec<u8>) -> Core {
        let config = core::Config {
            interrupts: P::MAP.interrupts,
            priority_bits: PRIORITY_BITS,
            vector_table: P::MAP.flash,
            mpu_regions: MPU_REGIONS,
            bit_band: true,
        };
        core::Core::new(config, Memory::new(P::MAP.flash, flash, P::MAP.ram, P::MAP.ram_size))
    }

    /// The offset of an address in the flash.
    #[inline]
    fn flash_offset(address: u32) -> Option<u32> {
        let offset = address.wrapping_sub(P::MAP.flash);
        ((offset as usize) < P::MAP.flash_size).then_some(offset)
    }

    /// The block at an address and the offset within it, if it supports the access.
    #[inline]
    fn block(&mut self, access: Access) -> Result<Option<(P::Block, u32)>, BusError> {
        let Some((block, offset)) = P::Block::at(access.address) else {
            self.common.recorder.unmapped(access.address, access.pc);
            return Err(BusError);
        };
        let gate = block.gate();
        let reason = if !block.takes(access.width) {
            "not an access of this width"
        } else if gate.is_some_and(|gate| !self.peripherals.is_enabled(gate)) {
            "its clock is off"
        } else if gate.is_some_and(|gate| self.peripherals.is_held(gate)) {
            "it is held in reset"
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
        let (block, offset) = P::Block::at(access.address).ok_or(BusError)?;
        let value = self.peripherals.peek(block, offset, &mut self.common);
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

    /// Resets everything that a system reset resets, except the clocks.
    fn reset(&mut self, memory: &mut Memory) {
        self.peripherals.reset(&mut self.common, memory);
        self.common.in_boot_loader = false;
        self.common.reset = None;
        self.common.nmi = false;
        self.common.events = Events::default();
        self.common.lines = Lines::default();
    }

    fn power_off(&mut self, memory: &mut Memory) {
        self.common.powered = false;
        self.reset(memory);
        self.peripherals.settle_all(&mut self.common);
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
            self.common.nmi |= self.peripherals.check_flash_read(offset);
            return memory.read(access.address, access.width).ok_or(BusError);
        }
        if is_system_memory(access) {
            return self.read_system_memory(access);
        }
        let Some((block, offset)) = self.block(access)? else {
            return Ok(0);
        };
        let read = self.peripherals.read(block, offset, &mut self.common);
        let value = read.unwrap_or_else(|refused| {
            self.common
                .recorder
                .register(block.name(), refused, access.address, access.pc, false);
            0
        });
        self.common.trace(access, value);
        Ok(value)
    }

    fn write(&mut self, access: Access, value: u32, _: &mut Memory) -> Result<(), BusError> {
        self.common.come_to(access);
        self.common.trace(access, value);
        let (name, written) = if let Some(offset) = Self::flash_offset(access.address) {
            let stored = self.peripherals.store(offset, access.width, value, self.common.now);
            self.peripherals.settle(Slot::Flash, &mut self.common);
            ("FLASH", stored)
        } else {
            let Some((block, offset)) = self.block(access)? else {
                return Ok(());
            };
            let written = self.peripherals.write(block, offset, value, &mut self.common);
            (block.name(), written)
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
            || self.peripherals.is_flash_busy()
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
        self.peripherals.flash_timing()
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
        if slot == Slot::Flash && self.peripherals.take_cut(self.common.now) {
            lock(&self.common.edges.flash).cut = Some(self.common.now);
            self.common.was_cut = true;
            self.power_off(memory);
        } else {
            self.peripherals.advance(slot, &mut self.common, memory);
        }
        self.peripherals.settle(slot, &mut self.common);
    }

    fn look(&mut self, now: Nanos, memory: &mut Memory) {
        self.common.now = self.common.now.max(now);
        self.peripherals.look(&mut self.common);
        for slot in [Slot::Usart, Slot::Usb, Slot::Can, Slot::Rcc] {
            self.peripherals.settle(slot, &mut self.common);
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
        !self.common.powered || self.common.in_boot_loader || self.peripherals.is_flash_busy()
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
        self.peripherals.follow_clocks(&mut self.common);
        self.peripherals.settle_all(&mut self.common);
    }

    fn recorder(&self) -> &Recorder {
        &self.common.recorder
    }

    fn trace(&self) -> Trace {
        self.common.trace
    }
}
