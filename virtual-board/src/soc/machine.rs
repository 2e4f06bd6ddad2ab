//! The core and a chip, run in virtual time by whoever owns the board, in the same thread.
//!
//! A turn of the loop does what is due, tells the core of its interrupts, and lets the core run until the next event. A
//! core that sleeps skips to that.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::board::Error;
use crate::can::bus::Bus as CanBus;
use crate::core::{Bus, Core, FlashTiming, Memory, Register, Stop, Timing, Width};
use crate::crystal::Oscillator;
use crate::engine::{Engine, News, Stopped, Watched};
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

/// What is connected to a chip.
#[derive(Clone, Debug)]
pub(crate) struct Edges {
    pub(crate) line: AnyLine,
    /// Keeps the DMA from serving the arm's UART.
    pub(crate) starve: Arc<AtomicBool>,
    pub(crate) host: Shared<Host>,
    pub(crate) can: Shared<CanBus>,
    pub(crate) flash: Shared<Flash>,
    pub(crate) oscillator: Shared<Oscillator>,
}

/// Why a chip is reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cause {
    Power,
    Software,
    Watchdog,
}

/// What a machine needs to know of its chip. Every call happens at its instant, in order.
pub(crate) trait Chip: Bus + Debug + Send {
    /// The core's cycles.
    fn clock(&self) -> &Clock;

    /// Moves the origin of its clocks near `now`.
    fn come_near(&mut self, now: Nanos);

    /// The flash as its wait states and caches are set.
    fn flash_timing(&self) -> FlashTiming;

    /// When the next event is due. The end of time if none is.
    fn next_event(&self) -> Nanos;

    /// The core runs until `deadline`: the chip needs attention if an event is due sooner.
    fn set_deadline(&mut self, deadline: Nanos);

    /// Does what is due first.
    fn handle_event(&mut self, memory: &mut Memory);

    /// Looks at what the program may have changed outside.
    fn look(&mut self, now: Nanos, memory: &mut Memory);

    /// Takes a change of an interrupt line: its number and its level.
    fn take_interrupt(&mut self) -> Option<(u16, bool)>;

    /// Whether the NMI became pending since this was last asked.
    fn take_nmi(&mut self) -> bool;

    /// Takes a reset that the chip asks for.
    fn take_reset(&mut self) -> Option<Cause>;

    /// Whether the core stands still: it waits for the flash, has no power, or is in the boot loader.
    fn holds_core(&self) -> bool;

    /// Whether the core started the boot loader since the last reset.
    fn is_in_boot_loader(&self) -> bool;

    /// What happened since this was last asked that a program may wait for.
    fn take_news(&mut self) -> News;

    /// Resets everything that this cause resets.
    fn restart(&mut self, cause: Cause, now: Nanos, memory: &mut Memory);

    /// The violations so far.
    fn recorder(&self) -> &Recorder;

    /// The trace of accesses and events so far.
    fn trace(&self) -> Trace;
}

/// The core, a chip, and where the two are.
#[derive(Debug)]
pub(crate) struct Machine<C> {
    core: Core,
    chip: C,
    now: Nanos,
    /// The time in which the core executed instructions.
    busy: Nanos,
    /// Whether cycles are counted as a Cortex-M4 with this flash does.
    exact: bool,
    /// Functions that run only when the firmware is broken.
    crashes: BTreeMap<u32, Crash>,
    crash: Option<Crash>,
    /// The program lets the core stand still until the next reset.
    held: bool,
    debugger: Option<Debugger>,
    /// When the debugger is attended next.
    attends: Nanos,
    /// Where the firmware's log is, if it has one.
    log: Option<u32>,
    /// The core can go on only after a reset.
    dead: bool,
    /// What the core has no model of.
    refusals: Vec<Violation>,
    restarts: Vec<Restart>,
}

impl<C: Chip> Machine<C> {
    /// A machine at power-on. It stops where a crash shows. An instruction takes a cycle, or with `exact` what it takes a
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

    /// Does everything that is due, and tells the core.
    fn catch_up(&mut self) {
        while self.chip.next_event() <= self.now {
            self.chip.handle_event(self.core.memory_mut());
            self.tell_core();
        }
        self.tell_core();
        if let Some(cause) = self.chip.take_reset() {
            self.restart(cause);
        }
    }

    fn tell_core(&mut self) {
        while let Some((line, high)) = self.chip.take_interrupt() {
            self.core.set_interrupt_line(line, high);
        }
        if self.chip.take_nmi() {
            self.core.pend_nmi();
        }
    }

    /// Lets the core stand still until `until`.
    fn skip(&mut self, until: Nanos) {
        self.now = self.now.max(until);
        self.core.advance(self.chip.clock().tick_from(self.now));
    }

    /// Lets the core run until `until` at most, and deals with why it stopped.
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

    /// Runs until an instant, until what is watched for happens, or until the firmware crashes.
    fn run_until(&mut self, until: Nanos, watched: Watched) -> Result<(), Error> {
        self.chip.come_near(self.now);
        self.chip.look(self.now, self.core.memory_mut());
        loop {
            self.catch_up();
            self.attend_debugger()?;
            let news = self.chip.take_news();
            let found = match watched {
                Watched::Nothing => false,
                Watched::Everything => news.any,
                Watched::Heard => news.heard,
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

    /// Lets the debugger do what it wants to, now and then while the core runs.
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

    /// What there is in the first up-buffer of the firmware's log, which is taken out.
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

/// Virtual time from one look at the debugger to the next while the core runs.
const ATTENDANCE: Nanos = Nanos::from_millis(1);

/// SEGGER RTT's control block: where the first up-buffer is described, and the fields of that.
mod rtt {
    pub(super) const UP: u32 = 24;
    pub(super) const START: u32 = 4;
    pub(super) const SIZE: u32 = 8;
    pub(super) const WRITTEN: u32 = 12;
    pub(super) const READ: u32 = 16;
}

/// What gdb sees.
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

/// A register as gdb numbers it.
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

    fn report(&mut self) -> Result<Report, Error> {
        Ok(Report {
            violations: [self.chip.recorder().violations(), &self.refusals].concat(),
            restarts: self.restarts.clone(),
        })
    }

    fn profile(&mut self) -> Result<BTreeMap<u64, u64>, Error> {
        let profile = self.core.take_profile();
        Ok(profile
            .into_iter()
            .map(|(address, count)| (address.into(), count))
            .collect())
    }

    fn read(&mut self, address: u64) -> Result<Option<u32>, Error> {
        let address = u32::try_from(address).ok();
        Ok(address.and_then(|address| self.core.debug_read(&mut self.chip, address, Width::Word)))
    }

    fn write(&mut self, address: u64, value: u32) -> Result<bool, Error> {
        let address = u32::try_from(address).ok();
        let written = address.and_then(|address| self.core.debug_write(&mut self.chip, address, value, Width::Word));
        Ok(written.is_some())
    }

    fn hold(&mut self, held: bool) -> Result<(), Error> {
        self.held = held;
        Ok(())
    }

    fn log(&mut self) -> Vec<u8> {
        self.take_log().unwrap_or_default()
    }
}
