//! The core and a chip, run in virtual time in the thread of the board's owner.
//!
//! Each iteration of the loop executes due events, passes interrupts on to the core, and runs the core until the next
//! event. A sleeping core skips to that event.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::can::bus::Bus as CanBus;
use crate::core::{Bus, Core, FlashTiming, Memory, Register, Stop, Timing, Width};
use crate::crystal::Oscillator;
use crate::engine::{Engine, FRAMES, News, Stopped, Watched};
use crate::error::Error;
use crate::flash::Flash;
use crate::line::AnyLine;
use crate::report::{self, Crash, Report, Restart, Violation};
use crate::shared::Shared;
use crate::soc::clock::Clock;
use crate::soc::gdb::{Debugger, Target};
use crate::soc::violations::Recorder;
use crate::time::Nanos;
use crate::trace::Trace;
use crate::usb::host::Host;

/// The connections of a chip.
#[derive(Clone, Debug)]
pub(crate) struct Edges {
    pub(crate) line: AnyLine,
    /// Stops the DMA for the arm's UART.
    pub(crate) starve: Arc<AtomicBool>,
    pub(crate) host: Shared<Host>,
    pub(crate) can: Shared<CanBus>,
    pub(crate) flash: Shared<Flash>,
    pub(crate) oscillator: Shared<Oscillator>,
}

/// The cause of a chip's reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cause {
    Power,
    Software,
    Watchdog,
}

/// The chip, as seen by a machine. Calls are made at their instant, in order.
pub(crate) trait Chip: Bus + Debug + Send {
    /// The core's cycles.
    fn clock(&self) -> &Clock;

    /// Moves the origin of its clocks near `now`.
    fn come_near(&mut self, now: Nanos);

    /// The timing of the flash by its wait states and caches.
    fn flash_timing(&self) -> FlashTiming;

    /// The time of the next event, the maximum if there is none.
    fn next_event(&self) -> Nanos;

    /// The core runs until `deadline`: the chip needs attention if an event becomes due sooner.
    fn set_deadline(&mut self, deadline: Nanos);

    /// Executes the first due event.
    fn handle_event(&mut self, memory: &mut Memory);

    /// Applies changes made by the program from outside.
    fn sync(&mut self, now: Nanos, memory: &mut Memory);

    /// Takes a change of an interrupt line: its number and its level.
    fn take_interrupt(&mut self) -> Option<(u16, bool)>;

    /// Returns true if the NMI became pending since the last call.
    fn take_nmi(&mut self) -> bool;

    /// Takes a reset requested by the chip.
    fn take_reset(&mut self) -> Option<Cause>;

    /// Returns true if the core is stopped: it waits for the flash, has no power, or is in the boot loader.
    fn holds_core(&self) -> bool;

    /// Returns true if the core started the boot loader since the last reset.
    fn is_in_boot_loader(&self) -> bool;

    /// Events since the last call that a program may wait for.
    fn take_news(&mut self) -> News;

    /// Resets everything that this cause resets.
    fn restart(&mut self, cause: Cause, now: Nanos, memory: &mut Memory);

    /// The violations so far.
    fn recorder(&self) -> &Recorder;

    /// The trace of accesses and events so far.
    fn trace(&self) -> Trace;
}

/// The core, a chip, and their state.
#[derive(Debug)]
pub(crate) struct Machine<C> {
    core: Core,
    chip: C,
    now: Nanos,
    /// The time in which the core executed instructions.
    busy: Nanos,
    /// True for the cycles of a Cortex-M4 with this flash.
    exact: bool,
    /// Functions that run only in a crash of the firmware.
    crashes: BTreeMap<u32, Crash>,
    crash: Option<Crash>,
    /// The program has stopped the core until the next reset.
    held: bool,
    debugger: Option<Debugger>,
    /// The time of the next check of the debugger.
    attends: Nanos,
    /// The address of the firmware's log, if it has one.
    log: Option<u32>,
    /// The core can continue only after a reset.
    dead: bool,
    /// Unmodelled features used by the core.
    refusals: Vec<Violation>,
    restarts: Vec<Restart>,
}

impl<C: Chip> Machine<C> {
    /// A machine at power-on. It stops at a crash. An instruction takes one cycle, or with `exact` the cycles of a
    /// Cortex-M4 with the chip's flash.
    pub(crate) fn new(
        core: Core,
        chip: C,
        exact: bool,
        crashes: BTreeMap<u32, Crash>,
        log: Option<u32>,
        debugger: Option<Debugger>,
    ) -> Self {
        let mut machine = Self {
            core,
            chip,
            now: Nanos(0),
            busy: Nanos(0),
            exact,
            crashes,
            crash: None,
            held: false,
            debugger,
            attends: Nanos(0),
            log,
            dead: false,
            refusals: Vec::new(),
            restarts: Vec::new(),
        };
        for &address in machine.crashes.keys() {
            machine.core.set_breakpoint(address);
        }
        machine.core.reset(&mut machine.chip);
        machine
    }

    fn restart(&mut self, cause: Cause) {
        self.chip.restart(cause, self.now, self.core.memory_mut());
        self.core.reset(&mut self.chip);
        self.held = false;
        self.dead = false;
        self.restarts.push(Restart {
            at: self.now,
            cause: match cause {
                Cause::Power => report::Cause::Power,
                Cause::Software => report::Cause::Software,
                Cause::Watchdog => report::Cause::Watchdog,
            },
        });
    }

    /// Executes all due events, and passes interrupts on to the core.
    fn catch_up(&mut self) {
        while self.chip.next_event() <= self.now {
            self.chip.handle_event(self.core.memory_mut());
            self.pass_interrupts();
        }
        self.pass_interrupts();
        if let Some(cause) = self.chip.take_reset() {
            self.restart(cause);
        }
    }

    fn pass_interrupts(&mut self) {
        while let Some((line, high)) = self.chip.take_interrupt() {
            self.core.set_interrupt_line(line, high);
        }
        if self.chip.take_nmi() {
            self.core.pend_nmi();
        }
    }

    /// Skips time without executing until `until`.
    fn skip(&mut self, until: Nanos) {
        self.now = self.now.max(until);
        self.core.advance(self.chip.clock().tick_from(self.now));
    }

    /// Runs the core until `until` at most, and handles the reason for its stop.
    fn run_core(&mut self, until: Nanos) {
        self.chip.set_deadline(until);
        if self.exact {
            self.core.set_timing(Timing::CortexM4(self.chip.flash_timing()));
        }
        let cycle = self.chip.clock().tick_from(until);
        let stop = self.core.run(&mut self.chip, cycle);
        let at = self.chip.clock().instant(self.core.cycle()).unwrap_or(until);
        self.busy = self.busy + at.since(self.now);
        self.now = self.now.max(at);
        match stop {
            Stop::Deadline | Stop::Attention => {}
            Stop::Sleep => self.skip(until),
            Stop::Breakpoint => match (self.crashes.get(&self.core.pc()), &mut self.debugger) {
                (Some(crash), _) => self.crash = Some(*crash),
                (None, Some(debugger)) => {
                    debugger.halt();
                    self.attends = self.now;
                }
                (None, None) => {}
            },
            Stop::ResetRequest => self.restart(Cause::Software),
            Stop::Lockup => self.die(Crash::Lockup),
            Stop::Refused(refusal) => {
                self.refusals.push(Violation::Refused {
                    address: self.core.pc().into(),
                    reason: refusal.to_string(),
                });
                self.die(Crash::Unmodelled);
            }
        }
    }

    fn die(&mut self, crash: Crash) {
        self.crash = Some(crash);
        self.dead = true;
    }

    /// Runs until an instant, a watched event, or a crash of the firmware.
    fn run_until(&mut self, until: Nanos, watched: Watched) -> Result<(), Error> {
        self.chip.come_near(self.now);
        self.chip.sync(self.now, self.core.memory_mut());
        loop {
            self.catch_up();
            self.attend_debugger()?;
            let news = self.chip.take_news();
            let found = match watched {
                Watched::Nothing => false,
                Watched::Everything => news.any,
                Watched::CanReceived => news.can_received,
            };
            let cut = news.cut;
            if found || cut || self.now >= until || self.crash.is_some() {
                return Ok(());
            }
            let next = self.chip.next_event().min(until).min(self.attends);
            if self.held || self.dead || self.chip.holds_core() {
                self.skip(next);
            } else {
                self.run_core(next);
                if self.chip.is_in_boot_loader() && watched == Watched::Everything {
                    return Ok(());
                }
            }
        }
    }

    /// Serves the debugger, periodically while the core runs.
    fn attend_debugger(&mut self) -> Result<(), Error> {
        if self.now < self.attends {
            return Ok(());
        }
        let Some(mut debugger) = self.debugger.take() else {
            self.attends = Nanos(u64::MAX);
            return Ok(());
        };
        let goes_on = debugger.attend(self);
        self.debugger = Some(debugger);
        self.attends = self.now + ATTENDANCE;
        if goes_on {
            Ok(())
        } else {
            Err(Error::Ended("the run was ended".to_owned()))
        }
    }

    /// A word of memory.
    fn word(&self, address: u32) -> Option<u32> {
        self.core.memory().read(address, Width::Word)
    }

    /// Takes the content of the first up-buffer of the firmware's log.
    fn take_log(&mut self) -> Option<Vec<u8>> {
        let buffer = self.log? + rtt::UP;
        let [start, size, written, read] =
            [rtt::START, rtt::SIZE, rtt::WRITTEN, rtt::READ].map(|offset| self.word(buffer + offset));
        let (start, size, written, mut read) = (start?, size?, written?, read?);
        let mut bytes = Vec::new();
        while read != written && read < size && written < size {
            bytes.push(self.core.memory().read(start + read, Width::Byte)? as u8);
            read = (read + 1) % size;
        }
        self.core.memory_mut().write(buffer + rtt::READ, Width::Word, read)?;
        Some(bytes)
    }
}

/// Virtual time between checks of the debugger while the core runs.
const ATTENDANCE: Nanos = Nanos::from_millis(1);

/// SEGGER RTT's control block: the offset of the first up-buffer's descriptor, and its fields.
mod rtt {
    pub(super) const UP: u32 = 24;
    pub(super) const START: u32 = 4;
    pub(super) const SIZE: u32 = 8;
    pub(super) const WRITTEN: u32 = 12;
    pub(super) const READ: u32 = 16;
}

/// gdb's interface.
impl<C: Chip> Target for Machine<C> {
    fn register(&self, nth: usize) -> u32 {
        self.core.register(register(nth))
    }

    fn set_register(&mut self, nth: usize, value: u32) {
        self.core.set_register(register(nth), value);
    }

    fn read(&mut self, address: u32, length: u32) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        while (bytes.len() as u32) < length {
            let (at, left) = (address.checked_add(bytes.len() as u32)?, length - bytes.len() as u32);
            if at.is_multiple_of(4) && left >= 4 {
                let word = self.core.debug_read(&mut self.chip, at, Width::Word)?;
                bytes.extend(word.to_le_bytes());
            } else {
                bytes.push(self.core.debug_read(&mut self.chip, at, Width::Byte)? as u8);
            }
        }
        Some(bytes)
    }

    fn write(&mut self, address: u32, bytes: &[u8]) -> Option<()> {
        if let (true, &[a, b, c, d]) = (address.is_multiple_of(4), bytes) {
            let word = u32::from_le_bytes([a, b, c, d]);
            return self.core.debug_write(&mut self.chip, address, word, Width::Word);
        }
        for (at, &byte) in (address..).zip(bytes) {
            self.core.debug_write(&mut self.chip, at, byte.into(), Width::Byte)?;
        }
        Some(())
    }

    fn set_breakpoint(&mut self, address: u32, on: bool) {
        if on {
            self.core.set_breakpoint(address);
        } else if !self.crashes.contains_key(&address) {
            self.core.clear_breakpoint(address);
        }
    }

    fn step(&mut self) {
        self.catch_up();
        let next = self.chip.next_event();
        if self.held || self.dead || self.chip.holds_core() {
            self.skip(next);
        } else {
            let cycle = self.chip.clock().instant(self.core.cycle() + 1);
            self.run_core(cycle.unwrap_or(next).min(next));
        }
        self.catch_up();
    }
}

/// A register by its gdb number.
fn register(nth: usize) -> Register {
    match nth {
        0..16 => Register::R(nth as u8),
        _ => Register::Xpsr,
    }
}

impl<C: Chip> Engine for Machine<C> {
    fn run(&mut self, until: Nanos, watched: Watched) -> Result<Stopped, Error> {
        self.run_until(until, watched)?;
        Ok(Stopped {
            at: self.now,
            instructions: self.core.instructions(),
            busy: self.busy,
            trace: self.chip.trace(),
            crash: self.crash.take(),
            in_boot_loader: self.chip.is_in_boot_loader(),
        })
    }

    fn report(&self) -> Report {
        Report {
            violations: [self.chip.recorder().violations(), &self.refusals].concat(),
            restarts: self.restarts.clone(),
        }
    }

    fn profile(&mut self) -> BTreeMap<u64, u64> {
        let profile = self.core.take_profile();
        profile
            .into_iter()
            .map(|(address, count)| (address.into(), count))
            .collect()
    }

    fn read(&mut self, address: u64) -> Option<u32> {
        let address = u32::try_from(address).ok()?;
        self.core.debug_read(&mut self.chip, address, Width::Word)
    }

    fn write(&mut self, address: u64, value: u32) -> bool {
        let address = u32::try_from(address).ok();
        let written = address.and_then(|address| self.core.debug_write(&mut self.chip, address, value, Width::Word));
        written.is_some()
    }

    fn hold(&mut self, held: bool) {
        self.held = held;
    }

    fn restart_after_flashing(&mut self) {
        self.restart(Cause::Software);
    }

    fn move_stack(&mut self, to: u32) {
        let from = self.core.register(Register::R(13));
        let memory = self.core.memory_mut();
        for at in (0..FRAMES).step_by(4) {
            if let Some(word) = memory.read(from + at, Width::Word) {
                memory.write(to + at, Width::Word, word);
            }
        }
        self.core.set_register(Register::R(13), to);
    }

    fn break_flash(&mut self, offsets: Range<usize>) {
        self.core.memory_mut().break_flash(offsets);
    }

    fn write_flash(&mut self, offset: usize, bytes: &[u8]) {
        // The owner has checked the range.
        let _ = self.core.memory_mut().program(offset, bytes);
    }

    fn log(&mut self) -> Vec<u8> {
        self.take_log().unwrap_or_default()
    }
}
