//! The RP2040, run by an emulator of another project, rp2040js, in a process of its own.
//!
//! | Here | In the process |
//! |---|---|
//! | the line to the arm with the UART's shift registers, the USB host with the controller's view of its endpoints, the time of flash operations, resets | the core, memories, DMA, timers, and the registers of all peripherals |
//!
//! One exchange of messages runs the chip until the next event here, or until an event in the chip that concerns this
//! side. `rp2040/` beside this folder has the program, and corrections of the emulator.

mod flash;
mod messages;
mod process;
mod uart;
mod usb;

use std::collections::BTreeMap;
use std::ops::Range;

use self::flash::Array;
use self::messages::{Commands, Event};
use self::process::Process;
use self::uart::Uart;
use self::usb::Usb;
use crate::engine::{Engine, FRAMES, Stopped, Watched};
use crate::error::Error;
use crate::mcu::Setup;
use crate::report::{Cause, Crash, Report, Restart};
use crate::shared::lock;
use crate::time::Nanos;

/// Duration of a cycle of the core at 125 MHz, in nanoseconds.
const CYCLE_NANOS: f64 = 8.0;

/// Bytes of the flash's unique id.
const ID: usize = 8;

/// The values of the watchdog's REASON (4.7.6) after power-on and after a timeout. Any other is a request of the image.
const POWER: u8 = 0;
const TIMEOUT: u8 = 1;

/// The chip.
#[derive(Debug)]
pub(crate) struct Rp2040 {
    process: Process,
    /// For the process, at the start of its next run.
    commands: Commands,
    uart: Uart,
    usb: Usb,
    flash: Array,
    now: Nanos,
    instructions: u64,
    busy: Nanos,
    crashes: BTreeMap<u32, Crash>,
    crash: Option<Crash>,
    in_boot_loader: bool,
    /// The boot loader started, or the power failed, since the last check.
    has_news: bool,
    restarts: Vec<Restart>,
}

impl Rp2040 {
    /// The chip at power-on.
    ///
    /// # Errors
    ///
    /// [`Error::NoEmulator`], or if the emulator fails.
    pub(crate) fn start(setup: Setup) -> Result<Self, Error> {
        let mut commands = Commands::default();
        commands.start(
            CYCLE_NANOS * f64::from(setup.cycle_cost) / 100.0,
            setup.rp2040_revision.number(),
            setup.unique_id.get(..ID).unwrap_or_default(),
            setup.crashes.keys().copied(),
            lock(&setup.edges.flash).bytes(),
        );
        Ok(Self {
            process: Process::start()?,
            commands,
            uart: Uart::new(setup.edges.line, setup.edges.starve),
            usb: Usb::new(setup.edges.host, setup.rp2040_revision),
            flash: Array::new(setup.edges.flash),
            now: Nanos(0),
            instructions: 0,
            busy: Nanos(0),
            crashes: setup.crashes,
            crash: None,
            in_boot_loader: false,
            has_news: false,
            restarts: Vec::new(),
        })
    }

    /// Applies changes made by the program from outside.
    fn sync(&mut self) {
        match self.flash.take_supply() {
            Some(true) => self.restart(POWER),
            Some(false) => self.power_off(),
            None => {}
        }
        self.uart.sync(self.now, &mut self.commands);
    }

    fn power_off(&mut self) {
        self.flash.power_off(&mut self.commands);
        self.commands.hold(true);
        self.reset();
    }

    fn restart(&mut self, reason: u8) {
        self.restart_by(reason, false);
    }

    /// Restarts the chip for this reason. The ROM clears SCRATCH4 before.
    fn restart_by(&mut self, reason: u8, rom: bool) {
        self.flash.restart(&mut self.commands);
        self.commands.hold(false);
        self.commands.reset(reason, rom);
        self.reset();
        self.restarts.push(Restart {
            at: self.now,
            cause: match reason {
                POWER => Cause::Power,
                TIMEOUT => Cause::Watchdog,
                _ => Cause::Software,
            },
        });
    }

    /// Resets what is here.
    fn reset(&mut self) {
        self.uart.reset(self.now);
        self.usb.reset();
        self.in_boot_loader = false;
    }

    /// Executes all due events, each at its time.
    fn catch_up(&mut self) {
        while let Some(due) = self.due().filter(|&due| due <= self.now) {
            if self.uart.due() == Some(due) {
                self.uart.advance(due, &mut self.commands);
            }
            if self.usb.due() == Some(due) {
                self.usb.poll(due, &mut self.commands);
            }
            if self.flash.due() == Some(due) {
                self.has_news |= self.flash.advance(due, &mut self.commands);
            }
        }
        self.usb.poll(self.now, &mut self.commands);
    }

    fn due(&self) -> Option<Nanos> {
        [self.uart.due(), self.usb.due(), self.flash.due()]
            .into_iter()
            .flatten()
            .min()
    }

    /// Runs the chip until this time at most.
    fn run_chip(&mut self, until: Nanos) -> Result<(), Error> {
        self.commands.run(until);
        let events = self.process.execute(&mut self.commands)?;
        // The others occurred at this time, except bytes behind another one.
        if let Some(&Event::Stopped { at, instructions, busy }) = events.last() {
            self.now = at;
            self.instructions = instructions;
            self.busy = busy;
        }
        events.into_iter().for_each(|event| self.handle(event));
        Ok(())
    }

    fn handle(&mut self, event: Event) {
        let (now, commands) = (self.now, &mut self.commands);
        match event {
            Event::Byte(byte) => self.uart.write(byte, now, commands),
            Event::Uart {
                divisor,
                clock,
                format,
                control,
                one_wire,
            } => self
                .uart
                .configure(uart::bit(divisor, clock), format, control, one_wire, now),
            Event::Usb(register, value) => self.usb.write(register, value, now),
            Event::Buffer { index, control, packet } => self.usb.write_buffer(index, control, packet, now),
            Event::Endpoint { index, control } => self.usb.write_endpoint(index, control),
            Event::Erase { from, length } => self.flash.erase(from, length, now, commands),
            Event::Program { to, bytes } => self.flash.program(to, &bytes, now, commands),
            Event::Reset { reason } => self.restart(reason),
            Event::BootLoader => {
                // It resets the USB controller.
                self.usb.reset();
                self.in_boot_loader = true;
                self.has_news = true;
            }
            Event::Crash { address } => self.crash = self.crashes.get(&address).copied(),
            Event::Stopped { .. } | Event::Value(_) | Event::Failed(_) => {}
        }
    }

    /// Executes an access of a debugger, the last command.
    fn access(&mut self) -> Option<u32> {
        let mut found = None;
        for event in self.process.execute(&mut self.commands).ok()? {
            match event {
                Event::Value(value) => found = value,
                // A write to a register acts as that of the program.
                other => self.handle(other),
            }
        }
        found
    }
}

impl Engine for Rp2040 {
    fn run(&mut self, until: Nanos, watched: Watched) -> Result<Stopped, Error> {
        self.sync();
        loop {
            self.catch_up();
            let is_watched = self.usb.take_progress() && watched == Watched::Everything;
            let has_news = std::mem::take(&mut self.has_news);
            if is_watched || has_news || self.now >= until || self.crash.is_some() {
                break;
            }
            let next = self.due().map_or(until, |due| due.min(until));
            self.run_chip(next)?;
        }
        Ok(Stopped {
            at: self.now,
            instructions: self.instructions,
            busy: self.busy,
            trace: self.process.trace(),
            crash: self.crash.take(),
            in_boot_loader: self.in_boot_loader,
        })
    }

    fn report(&self) -> Report {
        Report {
            violations: Vec::new(),
            restarts: self.restarts.clone(),
        }
    }

    /// The emulator does not count.
    fn profile(&mut self) -> BTreeMap<u64, u64> {
        BTreeMap::new()
    }

    fn read(&mut self, address: u64) -> Option<u32> {
        self.commands.read(u32::try_from(address).ok()?);
        self.access()
    }

    fn write(&mut self, address: u64, value: u32) -> bool {
        let Ok(address) = u32::try_from(address) else {
            return false;
        };
        self.commands.write(address, value);
        self.access().is_some()
    }

    fn hold(&mut self, held: bool) {
        self.commands.hold(held);
    }

    fn restart_after_flashing(&mut self) {
        self.restart_by(TIMEOUT, true);
    }

    fn move_stack(&mut self, to: u32) {
        self.commands.move_stack(to, FRAMES);
    }

    /// The flash reports no errors.
    fn break_flash(&mut self, _: Range<usize>) {}

    fn write_flash(&mut self, offset: usize, bytes: &[u8]) {
        self.commands.flash(offset, bytes);
    }

    fn log(&mut self) -> Vec<u8> {
        Vec::new()
    }
}
