//! The board as a program uses it.

mod can;
mod usb;

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use crate::can::Sender as CanSender;
use crate::can::bus::Bus;
use crate::chip::Chip;
use crate::crystal::{Crystal, INTERNAL_HZ, Oscillator};
use crate::engine::{Engine, Watched};
use crate::flash::{self, Flash};
use crate::image::Image;
use crate::line::{Arm, Fault, FaultRates, Format, Line, LineByte, SharedLine};
use crate::mcu::Setup;
use crate::mcu::stm32f405::{IDENTITY, Reenabled};
use crate::report::{Crash, Report, Violation, Violations};
use crate::shared::{Shared, lock};
use crate::soc::gdb::Debugger;
use crate::soc::machine::Edges;
use crate::time::Nanos;
use crate::timing::{Clock, Timing};
use crate::trace::Trace;
use crate::usb::cdc::Port;
use crate::usb::enumerate::{EnumerateError, Enumerated};
use crate::usb::host::{Host, TransferError};
use crate::usb::vendor::Vendor;

pub use self::can::Can;
pub use self::usb::{Pipe, Usb};

/// How often a waiting program looks even if nothing happens on the USB wire.
const GLANCE: Nanos = Nanos::from_millis(1);

/// The symbol of the firmware's log, if it has one.
const RTT: &str = "_SEGGER_RTT";

/// How long a power cycle leaves the board without power.
const POWER_OFF: Nanos = Nanos::from_millis(10);

/// What a virtual board is made of.
#[derive(Clone, Debug)]
pub struct Config<A> {
    /// The firmware: an ELF file.
    pub image: PathBuf,
    /// The chip. `None` is the one that the image is for, which the length of its vector table tells.
    pub chip: Option<Chip>,
    /// The arm on the UART.
    pub arm: A,
    /// The rate of the arm's own UART, in bits per second.
    pub arm_baud: u32,
    /// The crystal.
    pub crystal: Crystal,
    /// The frequency of the part's internal oscillator in hertz, nominally 16 MHz. The STM32F405's is up to 8 % slower and
    /// 4.5 % faster (DS8626, 5.3.9).
    pub internal_hz: u32,
    /// The part's DBGMCU_IDCODE: its revision (RM0090, 38.6.1).
    pub idcode: u32,
    /// The part's unique id.
    pub unique_id: [u8; 12],
    /// Which bytes meet faults, where rates say how many do, what a power cut leaves in the flash, and the times that
    /// [`timing`](Self::timing) draws.
    pub seed: u64,
    /// How long flash operations take, and the steps of the STM32F405's USB controller.
    pub timing: Timing,
    /// What the flash holds where the image has nothing, all [its bytes](Chip::flash_size): what [`VirtualBoard::flash`] of an
    /// earlier board gave. `None` is erased.
    pub flash: Option<Vec<u8>>,
    /// After how many flash operations, each a sector erased or a word programmed, the power goes in the middle of the
    /// next one.
    pub power_cut_after: Option<u32>,
    /// What a DMA stream does that is enabled again.
    pub reenabled: Reenabled,
    /// The virtual time that a cycle takes, in percent of the clock's. More than 100 is a slower core beside the same
    /// peripherals, to see what firmware does that has too little time.
    pub instruction_cost: NonZeroU32,
    /// Whether an instruction takes the cycles that it takes a Cortex-M4 with the chip's flash, rather than one.
    pub exact_cycles: bool,
    /// The TCP port on which gdb may attach, on this machine only.
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
            crystal: Crystal::new(8_000_000),
            internal_hz: INTERNAL_HZ,
            idcode: IDENTITY,
            unique_id: *b"\x20\x00\x41\x00\x0B51P\x35V03",
            seed: 0,
            timing: Timing::default(),
            flash: None,
            power_cut_after: None,
            reenabled: Reenabled::default(),
            instruction_cost: NonZeroU32::new(100).expect("not zero"),
            exact_cycles: false,
            gdb: None,
        }
    }
}

/// Why a board does not do what was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The image cannot be run.
    #[error("{}: {reason}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A port for gdb cannot be had.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// Where.
        address: String,
        /// Why not.
        error: io::Error,
    },
    /// The run ended by itself.
    #[error("the virtual board stopped: {0}")]
    Ended(String),
    /// The firmware is broken.
    #[error("the firmware crashed at {at}: {crash}")]
    Crashed {
        /// How.
        crash: Crash,
        /// When.
        at: Nanos,
    },
    /// The power was cut in the middle of a flash operation.
    #[error("the power was cut at {at}, in flash operation {operation}")]
    PowerCut {
        /// When.
        at: Nanos,
        /// Which operation, from 1.
        operation: u32,
    },
    /// There is neither memory nor a register at an address that was to be read or written.
    #[error("nothing at {address:#010x}")]
    Nothing {
        /// The address.
        address: u64,
    },
    /// The contents for the flash do not fit it.
    #[error("{got} bytes for the flash, which has {size}")]
    FlashSize {
        /// How many there were.
        got: usize,
        /// How many the flash has.
        size: usize,
    },
    /// The image is for no chip that the board can have.
    #[error("no chip has {interrupts} interrupts, as the image's vector table")]
    UnknownChip {
        /// Interrupts in the image's vector table.
        interrupts: u64,
    },
    /// What the program waited for did not happen in time.
    #[error("it did not happen within {limit}")]
    TimedOut {
        /// How long the program wanted to wait.
        limit: Nanos,
    },
    /// No device pulled D+ up.
    #[error("no USB device appeared within {limit}")]
    NoDevice {
        /// How long the host waited.
        limit: Nanos,
    },
    /// The device could not be enumerated.
    #[error("USB enumeration: {0}")]
    Enumerate(#[from] EnumerateError),
    /// A request failed.
    #[error("USB request: {0}")]
    Transfer(#[from] TransferError),
    /// The device has no such serial port.
    #[error("the device has {count} serial ports, not number {nth}")]
    NoPort {
        /// Which was asked for, from 0.
        nth: usize,
        /// How many there are.
        count: usize,
    },
    /// The device has no vendor-specific interface with a pair of bulk endpoints.
    #[error("the device has no vendor-specific interface")]
    NoVendor,
    /// The interface is not open.
    #[error("the interface of the device is not open")]
    NotOpen,
    /// The node knows no FD frames, or only listens.
    #[error("the CAN node cannot send this frame: it knows no FD frames, or only listens")]
    FdFrame,
    /// The pty that stands in for the serial port fails.
    #[error("pty: {0}")]
    Serve(io::Error),
    /// The run did what it should not.
    #[error(transparent)]
    Violations(#[from] Violations),
}

/// A board that runs a firmware image in virtual time, which passes only while a call runs it.
///
/// Everything is deterministic: the same calls on the same image give the same bytes at the same nanoseconds.
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
    /// Where gdb may attach.
    gdb: Option<SocketAddr>,
    now: Nanos,
    instructions: u64,
    busy: Nanos,
    trace: Trace,
    in_boot_loader: bool,
    crashes: Vec<Violation>,
    symbols: BTreeMap<String, u64>,
    /// The device, as long as the host's [`epoch`](Host::epoch) is this.
    device: Option<(u64, Enumerated)>,
    /// What the program has open on the device.
    port: Option<Port>,
    vendor: Option<Vendor>,
}

impl<A: Arm> VirtualBoard<A> {
    /// Powers the board up: the image is in its flash, and nothing has run yet. The USB cable is not in.
    ///
    /// # Errors
    ///
    /// When the image cannot be run, or a TCP port cannot be had.
    pub fn start(config: Config<A>) -> Result<Self, Error> {
        let image = Image::read(&config.image)?;
        Self::start_image(image, config)
    }

    fn start_image(image: Image, config: Config<A>) -> Result<Self, Error> {
        let chip = match config.chip {
            Some(chip) => chip,
            None => Chip::of(&image)?,
        };
        let starve = Arc::new(AtomicBool::new(false));
        let line = Arc::new(Mutex::new(Line::new(
            config.arm,
            config.arm_baud,
            config.seed,
            starve.clone(),
        )));
        let contents = flash::around(&image, config.flash, chip.flash_size())?;
        let flash = Flash::new(contents, config.power_cut_after, Clock::new(config.timing, config.seed));
        let edges = Edges {
            line: line.clone(),
            starve,
            host: Arc::default(),
            can: Arc::default(),
            flash: Arc::new(Mutex::new(flash)),
            oscillator: Arc::new(Mutex::new(Oscillator::new(config.crystal, config.internal_hz))),
        };
        let interrupt = Arc::new(AtomicBool::new(false));
        let debugger = config.gdb.map(|port| debugger(port, interrupt.clone())).transpose()?;
        let gdb = debugger.as_ref().and_then(Debugger::address);
        let log = image.symbols().get(RTT).map(|&address| address as u32);
        let setup = Setup {
            unique_id: config.unique_id,
            idcode: config.idcode,
            reenabled: config.reenabled,
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
            engine: setup.engine(chip),
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

    /// How much virtual time has passed since power-on.
    pub fn now(&self) -> Nanos {
        self.now
    }

    /// The time since power-on in which the core executed instructions. It executes none while it sleeps.
    pub fn busy(&self) -> Nanos {
        self.busy
    }

    /// How many instructions the core has executed since power-on. It executes none while it sleeps.
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// Runs for `span`.
    ///
    /// # Errors
    ///
    /// [`Error::Crashed`] if the firmware crashes meanwhile, at that instant; it can be run on.
    pub fn run_for(&mut self, span: impl Into<Nanos>) -> Result<(), Error> {
        let until = self.now + span.into();
        while self.now < until {
            self.run(until, Watched::Nothing)?;
        }
        Ok(())
    }

    /// Runs until `done` says so, and returns how long that took. It is asked at once, after every packet, connection and
    /// reset on the USB wire, after every frame on the CAN bus, at the start of the boot
    /// loader, and every millisecond.
    ///
    /// # Errors
    ///
    /// [`Error::TimedOut`] if it does not come to that within `limit`, [`Error::Crashed`] as for
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
            self.run(self.now + left.min(GLANCE), Watched::Everything)?;
        }
        Ok(self.now.since(start))
    }

    /// Runs until the nodes on the CAN bus have [received](Can::unread) something from the board that was not read yet, for
    /// `limit` at most, and returns whether they have. It looks after every frame on the bus, and nothing else stops the
    /// board: where much happens, this is faster than [`run_until`](Self::run_until).
    ///
    /// # Errors
    ///
    /// As for [`run_for`](Self::run_for).
    pub fn run_until_heard(&mut self, limit: impl Into<Nanos>) -> Result<bool, Error> {
        let until = self.now + limit.into();
        while self.can().unread() == 0 && self.now < until {
            self.run(until, Watched::Heard)?;
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

    /// A flag that ends the run once it is set, even while a debugger holds the processor.
    pub(crate) fn interrupt(&self) -> Arc<AtomicBool> {
        self.interrupt.clone()
    }

    /// Where gdb may attach, if it may.
    pub(crate) fn gdb(&self) -> Option<SocketAddr> {
        self.gdb
    }

    /// Gives the arm to `use_it`, while time stands still.
    pub fn with_arm<R>(&mut self, use_it: impl FnOnce(&mut A) -> R) -> R {
        use_it(lock(&self.line).arm_mut())
    }

    /// Whether the firmware started the boot loader in the part's ROM, and no reset came since. What stands in its place
    /// does nothing.
    pub fn is_in_boot_loader(&self) -> bool {
        self.in_boot_loader
    }

    /// What the flash holds, all [its bytes](Chip::flash_size).
    pub fn flash(&self) -> Vec<u8> {
        lock(&self.flash).bytes().to_vec()
    }

    /// How many flash operations were started: sectors erased and words programmed.
    pub fn flash_operations(&self) -> u32 {
        lock(&self.flash).operations()
    }

    /// Lets `operations` more flash operations end, and cuts the power in the middle of the next one: the call that runs
    /// the board then fails with [`Error::PowerCut`].
    pub fn cut_power_after(&mut self, operations: u32) {
        lock(&self.flash).cut_after(Some(operations));
    }

    /// When each erase of a sector began and ended.
    pub fn erases(&self) -> Vec<(Nanos, Nanos)> {
        lock(&self.flash).erases.clone()
    }

    /// Sets the supply's voltage, 3300 mV at first. On the STM32F405 a flash operation below 2.7 V fails and is a
    /// [violation](crate::report::Violation::Forbidden), and the voltage detector sees it; nothing else is affected.
    pub fn set_supply(&mut self, millivolts: u32) {
        lock(&self.flash).millivolts = millivolts;
    }

    /// Takes the board's power away, if it still has it, and gives it back 10 ms later. The flash keeps what it held,
    /// and so does the memory, which a real board's may or may not. The arm and the cables stay as they are.
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

    /// Puts another crystal on the board. One that runs goes on as it was until it is switched off.
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

    /// The USB host.
    pub fn usb(&mut self) -> Usb<'_, A> {
        Usb { board: self }
    }

    /// Where the image has the symbol whose mangled name contains `part`. `None` if there is none, or more than one.
    pub fn symbol(&self, part: &str) -> Option<u64> {
        let mut found = self.symbols.iter().filter(|(name, _)| name.contains(part));
        let (_, &address) = found.next()?;
        found.next().is_none().then_some(address)
    }

    /// Writes a word to memory or to a register, as a debugger does while time stands still.
    ///
    /// # Errors
    ///
    /// [`Error::Nothing`] if there is nothing at `address`.
    pub fn write_word(&mut self, address: u64, value: u32) -> Result<(), Error> {
        if self.engine.write(address, value)? {
            Ok(())
        } else {
            Err(Error::Nothing { address })
        }
    }

    /// Reads a word of memory or of a register, as a debugger does while time stands still: nothing is changed by it.
    ///
    /// # Errors
    ///
    /// [`Error::Nothing`] if there is nothing at `address`.
    pub fn read_word(&mut self, address: u64) -> Result<u32, Error> {
        self.engine.read(address)?.ok_or(Error::Nothing { address })
    }

    /// How often the core came to each instruction since this was last asked, by its address. The first time nothing was
    /// counted, and the count begins; the board is slower from then on.
    ///
    /// # Errors
    ///
    /// There is none so far.
    pub fn profile(&mut self) -> Result<BTreeMap<u64, u64>, Error> {
        self.engine.profile()
    }

    /// Lets the core stand still, as one does that is stuck with its interrupts masked, until the next reset or until it
    /// is [let go](Self::let_core_go). All else in the part goes on.
    ///
    /// # Errors
    ///
    /// There is none so far.
    pub fn hold_core(&mut self) -> Result<(), Error> {
        self.engine.hold(true)
    }

    /// Ends [`hold_core`](Self::hold_core).
    ///
    /// # Errors
    ///
    /// There is none so far.
    pub fn let_core_go(&mut self) -> Result<(), Error> {
        self.engine.hold(false)
    }

    /// What the firmware logged over RTT since this was last asked, for an image that has it.
    pub fn log(&mut self) -> Vec<u8> {
        self.engine.log()
    }

    /// What the run has met so far.
    ///
    /// # Errors
    ///
    /// There is none so far.
    pub fn report(&mut self) -> Result<Report, Error> {
        let mut report = self.engine.report()?;
        report.violations.extend(self.crashes.iter().cloned());
        Ok(report)
    }

    /// Fails if the firmware did anything that is not modelled and not on the [allow-list](crate::report::ALLOWED), or
    /// crashed.
    ///
    /// # Errors
    ///
    /// [`Error::Violations`] with all of it.
    pub fn check(&mut self) -> Result<(), Error> {
        Ok(self.report()?.check()?)
    }

    /// A digest of every access to a peripheral, every event in the chip, and every byte on the wires, with their
    /// instants. Two runs with equal digests were the same.
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
    /// Every byte since the beginning, in the order in which they ended.
    pub fn bytes(&self) -> Vec<LineByte> {
        lock(self.line).bytes().to_vec()
    }

    /// The number of bytes that the core read before the DMA did, so that they are in no buffer.
    pub fn taken(&self) -> u32 {
        lock(self.line).taken()
    }

    /// Forgets the bytes so far.
    pub fn forget_bytes(&self) {
        lock(self.line).forget_bytes();
    }

    /// The rate at which the board's UART runs, in bits per second.
    pub fn baud(&self) -> Option<u64> {
        lock(self.line).board_baud()
    }

    /// Whether the board's UART uses one wire both ways (30.3.10).
    pub fn is_half_duplex(&self) -> bool {
        lock(self.line).is_half_duplex()
    }

    /// Sets the rate of the arm's own UART, in bits per second. An arm that is more than 5 % off is not understood.
    pub fn set_arm_baud(&self, baud: u32) {
        lock(self.line).set_arm_baud(baud);
    }

    /// What the board's UART puts around the bits of a byte.
    pub fn format(&self) -> Format {
        lock(self.line).board_format()
    }

    /// Sets what the arm's own UART puts around the bits of a byte.
    pub fn set_arm_format(&self, format: Format) {
        lock(self.line).set_arm_format(format);
    }

    /// Sets how often bytes from the arm meet faults.
    pub fn set_fault_rates(&self, rates: FaultRates) {
        lock(self.line).set_fault_rates(rates);
    }

    /// Lets the byte that the arm sends after `after` others meet a fault.
    pub fn plan_fault(&self, after: u64, fault: Fault) {
        lock(self.line).plan_fault(after, fault);
    }
}

#[cfg(test)]
pub(crate) mod tests;
