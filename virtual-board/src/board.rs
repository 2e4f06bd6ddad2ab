//! The board's API.

mod can;
mod usb;

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::num::NonZeroU32;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use armwire_boards::{Board, Uart as BoardUart};

use crate::can::Sender as CanSender;
use crate::can::bus::Bus;
use crate::chip::Chip;
use crate::crystal::{Crystal, INTERNAL_HZ, LSI_HZ, Oscillator};
use crate::engine::{Engine, Watched};
use crate::error::Error;
use crate::flash::{self, Flash};
use crate::image::Image;
use crate::line::{Arm, Fault, FaultRates, Format, Line, LineByte, SharedLine};
use crate::mcu::Setup;
use crate::mcu::stm32f405::{ArmUart, IDENTITY, OtgVariant, Reenabled};
use crate::mcu::stm32g431::EccRegister;
use crate::report::{Report, Violation};
use crate::revision::Rp2040Revision;
use crate::shared::{Shared, lock};
use crate::soc::gdb::Debugger;
use crate::soc::machine::Edges;
use crate::time::Nanos;
use crate::timing::{Clock, Timing};
use crate::trace::Trace;
use crate::usb::cdc::Port;
use crate::usb::enumerate::Enumerated;
use crate::usb::host::Host;
use crate::usb::vendor::Vendor;

pub use self::can::Can;
pub use self::usb::{Pipe, Usb};

/// Polling period of a waiting program without events on the USB wire.
const POLL_PERIOD: Nanos = Nanos::from_millis(1);

/// The symbol of the firmware's log, if it has one.
const RTT: &str = "_SEGGER_RTT";

/// Duration without power in a power cycle.
const POWER_OFF: Nanos = Nanos::from_millis(10);

/// The parts of a virtual board.
#[derive(Clone, Debug)]
pub struct Config<A> {
    /// The firmware: an ELF file.
    pub image: PathBuf,
    /// The chip. `None`: the image's chip, from the length of its vector table.
    pub chip: Option<Chip>,
    /// The arm on the UART.
    pub arm: A,
    /// The rate of the arm's own UART, in bits per second.
    pub arm_baud: u32,
    /// The UART of an STM32F405 that has the arm.
    pub arm_uart: ArmUart,
    /// The crystal.
    pub crystal: Crystal,
    /// The frequency of the chip's internal oscillator in hertz, nominally 16 MHz. That of the STM32F405 is −8 % to
    /// +4.5 % off (DS8626, 5.3.9).
    pub internal_hz: u32,
    /// The frequency of LSI, the oscillator of an STM32's watchdog, in hertz, nominally 32 kHz. That of the STM32F405 is 17 to
    /// 47 kHz (DS8626, 5.3.9), that of the STM32G431 is 5 % off (DS12589, 1).
    pub lsi_hz: u32,
    /// The chip's DBGMCU_IDCODE: its revision (RM0090, 38.6.1).
    pub idcode: u32,
    /// The revision of an RP2040.
    pub rp2040_revision: Rp2040Revision,
    /// The chip's unique id. The flash of an RP2040 has the first eight bytes.
    pub unique_id: [u8; 12],
    /// The seed of the fault positions at given rates, of the RAM of an STM32 after power-on, of the flash content after a loss
    /// of power, and of the times drawn by [`timing`](Self::timing).
    pub seed: u64,
    /// Duration of flash operations, and of the steps of the STM32F405's USB controller.
    pub timing: Timing,
    /// The flash content outside the image, with all [bytes](Chip::flash_size): that of [`VirtualBoard::flash`] of an
    /// earlier board. `None` is erased.
    pub flash: Option<Vec<u8>>,
    /// Number of flash operations (a sector erased or a word programmed) after which the power fails in the middle of
    /// the next.
    pub power_cut_after: Option<u32>,
    /// Behaviour of a DMA stream that is enabled again.
    pub reenabled: Reenabled,
    /// Behaviour of the USB controller of an STM32F405.
    pub otg: OtgVariant,
    /// FLASH_ECCR of an STM32G431 after an interrupted flash operation.
    pub ecc_register: EccRegister,
    /// The virtual duration of a cycle, in percent of the clock's. More than 100 simulates a slower core with the same
    /// peripherals, to test firmware with too little time.
    pub instruction_cost: NonZeroU32,
    /// True for the cycles of a Cortex-M4 with the chip's flash, false for one cycle per instruction.
    pub exact_cycles: bool,
    /// The TCP port for gdb, on this machine only. An RP2040 has none.
    pub gdb: Option<u16>,
}

impl<A> Config<A> {
    /// A board with an 8 MHz crystal and a 1 Mbaud arm.
    pub fn new(image: impl Into<PathBuf>, arm: A) -> Self {
        Self {
            image: image.into(),
            chip: None,
            arm,
            arm_baud: 1_000_000,
            arm_uart: ArmUart::default(),
            crystal: Crystal::new(8_000_000),
            internal_hz: INTERNAL_HZ,
            lsi_hz: LSI_HZ,
            idcode: IDENTITY,
            rp2040_revision: Rp2040Revision::default(),
            unique_id: *b"\x20\x00\x41\x00\x0B51P\x35V03",
            seed: 0,
            timing: Timing::default(),
            flash: None,
            power_cut_after: None,
            reenabled: Reenabled::default(),
            otg: OtgVariant::default(),
            ecc_register: EccRegister::default(),
            instruction_cost: NonZeroU32::new(100).expect("not zero"),
            exact_cycles: false,
            gdb: None,
        }
    }

    /// With the crystal and the arm's UART of this board.
    #[must_use]
    pub fn on(self, board: &Board) -> Self {
        Self {
            crystal: Crystal::new(board.crystal * 1_000_000),
            arm_uart: match board.uart {
                BoardUart::Usart2 => ArmUart::Usart2,
                BoardUart::Usart3 => ArmUart::Usart3,
                // The RP2040 has one UART for the arm.
                BoardUart::Uart1 => self.arm_uart,
            },
            ..self
        }
    }
}

/// A board that runs a firmware image in virtual time, which passes only while a call runs it.
///
/// Everything is deterministic: the same calls with the same image give the same bytes at the same nanoseconds.
#[derive(Debug)]
pub struct VirtualBoard<A: Arm> {
    line: SharedLine<A>,
    host: Shared<Host>,
    can: Shared<Bus>,
    flash: Shared<Flash>,
    oscillator: Shared<Oscillator>,
    chip: Chip,
    engine: Box<dyn Engine>,
    interrupt: Arc<AtomicBool>,
    /// The address for gdb.
    gdb: Option<SocketAddr>,
    now: Nanos,
    instructions: u64,
    busy: Nanos,
    trace: Trace,
    in_boot_loader: bool,
    crashes: Vec<Violation>,
    symbols: BTreeMap<String, u64>,
    /// The device, valid for this [`epoch`](Host::epoch) of the host.
    device: Option<(u64, Enumerated)>,
    /// The program's open interfaces of the device.
    port: Option<Port>,
    vendor: Option<Vendor>,
}

impl<A: Arm> VirtualBoard<A> {
    /// Powers the board up with the image in its flash. No instruction has run yet. The USB cable is unplugged.
    ///
    /// # Errors
    ///
    /// If the image cannot be run, or a TCP port is not available.
    pub fn start(config: Config<A>) -> Result<Self, Error> {
        let image = Image::read(&config.image)?;
        Self::start_image(image, config)
    }

    fn start_image(image: Image, config: Config<A>) -> Result<Self, Error> {
        let chip = match config.chip {
            Some(chip) => chip,
            None => Chip::of(&image)?,
        };
        if chip == Chip::Rp2040 && config.gdb.is_some() {
            return Err(Error::NoDebugger);
        }
        let starve = Arc::new(AtomicBool::new(false));
        let line = Arc::new(Mutex::new(Line::new(
            config.arm,
            config.arm_baud,
            config.seed,
            starve.clone(),
        )));
        let contents = flash::around(&image, config.flash, chip)?;
        let flash = Flash::new(contents, config.power_cut_after, Clock::new(config.timing, config.seed));
        let edges = Edges {
            line: line.clone(),
            starve,
            host: Arc::default(),
            can: Arc::default(),
            flash: Arc::new(Mutex::new(flash)),
            oscillator: Arc::new(Mutex::new(Oscillator::new(
                config.crystal,
                config.internal_hz,
                config.lsi_hz,
            ))),
        };
        let interrupt = Arc::new(AtomicBool::new(false));
        let debugger = config.gdb.map(|port| debugger(port, interrupt.clone())).transpose()?;
        let gdb = debugger.as_ref().and_then(Debugger::address);
        let log = image.symbols().get(RTT).map(|&address| address as u32);
        let setup = Setup {
            unique_id: config.unique_id,
            idcode: config.idcode,
            rp2040_revision: config.rp2040_revision,
            arm_uart: config.arm_uart,
            reenabled: config.reenabled,
            otg: config.otg,
            ecc_register: config.ecc_register,
            seed: config.seed,
            cycle_cost: config.instruction_cost.get(),
            exact: config.exact_cycles,
            crashes: image.crashes(),
            log,
            debugger,
            edges: edges.clone(),
        };
        Ok(Self {
            line,
            host: edges.host,
            can: edges.can,
            flash: edges.flash,
            oscillator: edges.oscillator,
            chip,
            engine: setup.engine(chip)?,
            interrupt,
            gdb,
            now: Nanos(0),
            instructions: 0,
            busy: Nanos(0),
            trace: Trace::default(),
            in_boot_loader: false,
            crashes: Vec::new(),
            symbols: image.symbols().clone(),
            device: None,
            port: None,
            vendor: None,
        })
    }

    /// The chip.
    pub fn chip(&self) -> Chip {
        self.chip
    }

    /// The virtual time since power-on.
    pub fn now(&self) -> Nanos {
        self.now
    }

    /// The time since power-on in which the core executed instructions. It executes none while it sleeps.
    pub fn busy(&self) -> Nanos {
        self.busy
    }

    /// Number of instructions executed since power-on. The core executes none while it sleeps.
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// Runs for `span`.
    ///
    /// # Errors
    ///
    /// [`Error::Crashed`] if the firmware crashes, at that instant; the board can continue to run.
    pub fn run_for(&mut self, span: impl Into<Nanos>) -> Result<(), Error> {
        let until = self.now + span.into();
        while self.now < until {
            self.run(until, Watched::Nothing)?;
        }
        Ok(())
    }

    /// Runs until `done` returns true, and returns the duration. `done` is called at once, after every packet,
    /// connection and reset on the USB wire, after every frame on the CAN bus, at the start of the boot loader, and
    /// every millisecond.
    ///
    /// # Errors
    ///
    /// [`Error::TimedOut`] if `done` does not return true within `limit`, [`Error::Crashed`] as for
    /// [`run_for`](Self::run_for).
    pub fn run_until(
        &mut self,
        limit: impl Into<Nanos>,
        mut done: impl FnMut(&mut Self) -> bool,
    ) -> Result<Nanos, Error> {
        let (start, limit) = (self.now, limit.into());
        while !done(self) {
            let left = (start + limit).since(self.now);
            if left == Nanos(0) {
                return Err(Error::TimedOut { limit });
            }
            self.run(self.now + left.min(POLL_PERIOD), Watched::Everything)?;
        }
        Ok(self.now.since(start))
    }

    /// Runs until the nodes on the CAN bus have [unread frames](Can::unread) from the board, for at most `limit`.
    /// Returns true if they have. The check follows every frame on the bus, and nothing else stops the board: with much
    /// traffic this is faster than [`run_until`](Self::run_until).
    ///
    /// # Errors
    ///
    /// As for [`run_for`](Self::run_for).
    pub fn run_until_can_received(&mut self, limit: impl Into<Nanos>) -> Result<bool, Error> {
        let until = self.now + limit.into();
        while self.can().unread() == 0 && self.now < until {
            self.run(until, Watched::CanReceived)?;
        }
        Ok(self.can().unread() > 0)
    }

    fn run(&mut self, until: Nanos, watched: Watched) -> Result<(), Error> {
        self.powered()?;
        let stopped = self.engine.run(until, watched)?;
        self.in_boot_loader = stopped.in_boot_loader;
        self.now = stopped.at;
        self.instructions = stopped.instructions;
        self.busy = stopped.busy;
        self.trace = stopped.trace;
        if let Some(crash) = stopped.crash {
            let at = stopped.at;
            self.crashes.push(Violation::Crashed { crash, at });
            return Err(Error::Crashed { crash, at });
        }
        self.powered()
    }

    fn powered(&self) -> Result<(), Error> {
        let flash = lock(&self.flash);
        flash.cut.map_or(Ok(()), |at| {
            let operation = flash.operations();
            Err(Error::PowerCut { at, operation })
        })
    }

    /// A flag that ends the run when set, even while a debugger halts the processor.
    pub(crate) fn interrupt(&self) -> Arc<AtomicBool> {
        self.interrupt.clone()
    }

    /// The address for gdb, if enabled.
    pub(crate) fn gdb(&self) -> Option<SocketAddr> {
        self.gdb
    }

    /// Calls `use_it` with the arm. Time does not advance.
    pub fn with_arm<R>(&mut self, use_it: impl FnOnce(&mut A) -> R) -> R {
        use_it(lock(&self.line).arm_mut())
    }

    /// Returns true if the firmware has started the ROM boot loader since the last reset. The boot loader is a stub
    /// without function.
    pub fn is_in_boot_loader(&self) -> bool {
        self.in_boot_loader
    }

    /// The flash content, with all [bytes](Chip::flash_size).
    pub fn flash(&self) -> Vec<u8> {
        lock(&self.flash).bytes().to_vec()
    }

    /// Number of flash operations started: sectors erased and words programmed.
    pub fn flash_operations(&self) -> u32 {
        lock(&self.flash).operations()
    }

    /// Completes `operations` more flash operations, and cuts the power in the middle of the next one: the call that
    /// runs the board then fails with [`Error::PowerCut`].
    pub fn cut_power_after(&mut self, operations: u32) {
        lock(&self.flash).cut_after(Some(operations));
    }

    /// Changes the flash content from this offset on, as a debug probe does beside the running program. Returns false, without
    /// a change, unless all bytes are inside.
    pub fn write_flash(&mut self, offset: usize, bytes: &[u8]) -> bool {
        let is_inside = lock(&self.flash).write(offset, bytes);
        if is_inside {
            self.engine.write_flash(offset, bytes);
        }
        is_inside
    }

    /// Makes each read of these bytes of the flash, counted from its start, a bus error, until one of them changes.
    pub fn break_flash(&mut self, offsets: Range<usize>) {
        self.engine.break_flash(offsets);
    }

    /// Start and end of each sector erase.
    pub fn erases(&self) -> Vec<(Nanos, Nanos)> {
        lock(&self.flash).erases.clone()
    }

    /// Sets the supply voltage, initially 3300 mV. On the STM32F405 a flash operation below 2.7 V fails and is a
    /// [violation](crate::report::Violation::Forbidden), and the voltage detector reacts; nothing else is affected.
    pub fn set_supply(&mut self, millivolts: u32) {
        lock(&self.flash).millivolts = millivolts;
    }

    /// Switches the board's power off, if it is on, and on again 10 ms later. The flash keeps its content. The RAM of an STM32
    /// is random afterwards, that of an RP2040 keeps its content. The arm and the cables stay unchanged.
    ///
    /// # Errors
    ///
    /// As for [`run_for`](Self::run_for).
    pub fn power_cycle(&mut self) -> Result<(), Error> {
        {
            let mut flash = lock(&self.flash);
            flash.cut = None;
            flash.supply = Some(false);
        }
        self.run_for(POWER_OFF)?;
        lock(&self.flash).supply = Some(true);
        Ok(())
    }

    /// Lets the supply dip, so shortly that the RAM keeps its content: the chip then starts as at power-on.
    pub fn dip_power(&mut self) {
        lock(&self.flash).supply = Some(true);
    }

    /// Restarts the chip as that which has written its flash does: the ROM of an RP2040 by the watchdog's timer, a debugger of
    /// an STM32 by the core's reset request. The image is the same.
    pub fn restart_after_flashing(&mut self) {
        self.engine.restart_after_flashing();
    }

    /// Replaces the crystal. A running crystal stays as it was until it is switched off.
    pub fn set_crystal(&mut self, crystal: Crystal) {
        lock(&self.oscillator).crystal = crystal;
    }

    /// The UART line to the arm.
    pub fn uart(&self) -> Uart<'_, A> {
        Uart { line: &self.line }
    }

    /// The CAN bus.
    pub fn can(&self) -> Can<'_> {
        Can { bus: &self.can }
    }

    /// The address of the symbol whose mangled name contains `part`. `None` unless there is exactly one.
    pub fn symbol(&self, part: &str) -> Option<u64> {
        let mut found = self.symbols.iter().filter(|(name, _)| name.contains(part));
        let (_, &address) = found.next()?;
        found.next().is_none().then_some(address)
    }

    /// Writes a word to memory or a register, as a debugger does. Time does not advance.
    ///
    /// # Errors
    ///
    /// [`Error::Nothing`] if `address` has neither.
    pub fn write_word(&mut self, address: u64, value: u32) -> Result<(), Error> {
        if self.engine.write(address, value) {
            Ok(())
        } else {
            Err(Error::Nothing { address })
        }
    }

    /// Reads a word of memory or a register without side effects, as a debugger does. Time does not advance.
    ///
    /// # Errors
    ///
    /// [`Error::Nothing`] if `address` has neither.
    pub fn read_word(&mut self, address: u64) -> Result<u32, Error> {
        self.engine.read(address).ok_or(Error::Nothing { address })
    }

    /// Number of executions of each instruction since the last call, by address. The first call returns none and starts
    /// the count; the board is slower from then on.
    pub fn profile(&mut self) -> BTreeMap<u64, u64> {
        self.engine.profile()
    }

    /// Stops the core, as if it were stuck with interrupts masked, until the next reset or
    /// [`let_core_go`](Self::let_core_go). The peripherals continue.
    pub fn hold_core(&mut self) {
        self.engine.hold(true);
    }

    /// Ends [`hold_core`](Self::hold_core).
    pub fn let_core_go(&mut self) {
        self.engine.hold(false);
    }

    /// Moves the top of the stack to this address, with its last 512 bytes: as if functions had called each other until
    /// there. Time does not advance.
    pub fn move_stack(&mut self, to: u32) {
        self.engine.move_stack(to);
    }

    /// The firmware's RTT log since the last call, if the image has one.
    pub fn log(&mut self) -> Vec<u8> {
        self.engine.log()
    }

    /// The report of the run so far.
    pub fn report(&self) -> Report {
        let mut report = self.engine.report();
        report.violations.extend(self.crashes.iter().cloned());
        report
    }

    /// Fails if the firmware crashed, or did anything that is neither modelled nor on the
    /// [allow-list](crate::report::ALLOWED).
    ///
    /// # Errors
    ///
    /// [`Error::Violations`] with all violations.
    pub fn check(&self) -> Result<(), Error> {
        Ok(self.report().check()?)
    }

    /// A hash of every access to a peripheral, every event in the chip, and every byte on the wires, with their
    /// instants. Runs with equal hashes are equal.
    pub fn trace_hash(&self) -> u64 {
        let mut trace = self.trace;
        for byte in lock(&self.line).bytes() {
            trace.add(byte.at.0);
            trace.bytes(&[byte.sent, byte.direction as u8]);
        }
        for packet in lock(&self.host).packets() {
            trace.add(packet.end.0);
            trace.bytes(&[packet.endpoint, packet.direction as u8]);
            trace.bytes(&packet.data);
        }
        for record in lock(&self.can).records() {
            trace.add(record.start.0);
            trace.add(record.end.0);
            trace.add(record.frame.id.value().into());
            trace.bytes(&[record.frame.remote.into(), record.frame.dlc, record.outcome as u8]);
            trace.bytes(record.frame.payload());
            if let Some(flags) = record.frame.fd {
                trace.bytes(&[flags.bit_rate_switch.into(), flags.error_passive.into()]);
            }
            trace.add(match record.sender {
                CanSender::Board => 0,
                CanSender::Node(node) => 1 + u64::from(node),
                CanSender::Flood => u64::MAX,
            });
        }
        trace.value()
    }
}

/// A debugger on a TCP port of this machine.
fn debugger(port: u16, interrupt: Arc<AtomicBool>) -> Result<Debugger, Error> {
    TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .and_then(|listener| Debugger::new(listener, interrupt))
        .map_err(|error| Error::Listen {
            address: format!("TCP port {port}"),
            error,
        })
}

/// The UART line to the arm.
#[derive(Debug)]
pub struct Uart<'a, A> {
    line: &'a SharedLine<A>,
}

impl<A: Arm> Uart<'_, A> {
    /// Every byte since the beginning, in the order of their ends.
    pub fn bytes(&self) -> Vec<LineByte> {
        lock(self.line).bytes().to_vec()
    }

    /// Number of bytes that the core read before the DMA did. They are in no buffer.
    pub fn taken(&self) -> u32 {
        lock(self.line).taken()
    }

    /// Clears the record of bytes.
    pub fn forget_bytes(&self) {
        lock(self.line).forget_bytes();
    }

    /// The rate of the board's UART, in bits per second.
    pub fn baud(&self) -> Option<u64> {
        lock(self.line).board_baud()
    }

    /// Returns true if the board's UART uses one wire for both directions (30.3.10).
    pub fn is_half_duplex(&self) -> bool {
        lock(self.line).is_half_duplex()
    }

    /// Sets the rate of the arm's own UART, in bits per second. Bytes at a rate more than 5 % off are garbled.
    pub fn set_arm_baud(&self, baud: u32) {
        lock(self.line).set_arm_baud(baud);
    }

    /// The format of the board's UART.
    pub fn format(&self) -> Format {
        lock(self.line).board_format()
    }

    /// Sets the format of the arm's own UART.
    pub fn set_arm_format(&self, format: Format) {
        lock(self.line).set_arm_format(format);
    }

    /// Sets the fault rates of bytes from the arm.
    pub fn set_fault_rates(&self, rates: FaultRates) {
        lock(self.line).set_fault_rates(rates);
    }

    /// Plans a fault for the byte after `after` others from the arm.
    pub fn plan_fault(&self, after: u64, fault: Fault) {
        lock(self.line).plan_fault(after, fault);
    }
}

#[cfg(test)]
pub(crate) mod tests;
