//! The board as a program uses it.

use std::io::{self, Read};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use armwire_bridge::can::Frame;
use rigless::image::Image;

use crate::can::bus::{Bus, Record};
use crate::can::{self, BusFrame};
use crate::flash::{self, Flash};
use crate::line::{Arm, Fault, FaultRates, Line, LineByte};
use crate::machine::{self, Bench, Command, Reply, Run};
use crate::report::{Crash, Report, Violation, Violations};
use crate::stm32f405::port::{Shared, lock};
use crate::stm32f405::{Reenabled, Stm32f405};
use crate::time::Nanos;
use crate::trace::Trace;
use crate::usb::cdc::{LineCoding, Port};
use crate::usb::enumerate::{self, EnumerateError, Enumerated};
use crate::usb::host::{Host, Packet, Request, TransferError};
use crate::usb::{Direction, descriptor};

/// How long a control transfer may take: a device that needs longer is broken (USB 2.0, 9.2.6.1).
const CONTROL_LIMIT: Nanos = Nanos::from_millis(5_000);

/// How long a device may take from power to its pull-up.
const CONNECT_LIMIT: Nanos = Nanos::from_millis(2_000);

/// How often a waiting program looks even if nothing happens on the USB wire.
const GLANCE: Nanos = Nanos::from_millis(1);

/// How long a power cycle leaves the board without power.
const POWER_OFF: Nanos = Nanos::from_millis(10);

/// The address that the host gives the device.
const ADDRESS: u8 = 1;

/// What a virtual board is made of.
#[derive(Clone, Debug)]
pub struct Config<A> {
    /// The firmware: an ELF file.
    pub image: PathBuf,
    /// The arm on the UART.
    pub arm: A,
    /// The rate of the arm's own UART, in bits per second.
    pub arm_baud: u32,
    /// The crystal, in hertz.
    pub crystal_hz: u32,
    /// The part's unique id.
    pub unique_id: [u8; 12],
    /// Which bytes meet faults, where rates say how many do, and what a power cut leaves in the flash.
    pub seed: u64,
    /// What the flash holds where the image has nothing, [`SIZE`](flash::SIZE) bytes: what
    /// [`VirtualBoard::flash`] of an earlier board gave. `None` is erased.
    pub flash: Option<Vec<u8>>,
    /// After how many flash operations, each a sector erased or a word programmed, the power goes in the middle of the
    /// next one.
    pub power_cut_after: Option<u32>,
    /// What a DMA stream does that is enabled again.
    pub reenabled: Reenabled,
    /// The virtual time that an instruction takes, in percent of a cycle at 168 MHz. A real core takes more than a cycle
    /// for some, and waits for its flash: sweep this to see how much a latency depends on it.
    pub instruction_cost: NonZeroU32,
    /// The TCP port on which gdb may attach, on this machine only.
    pub gdb: Option<u16>,
}

impl<A> Config<A> {
    /// A board with an 8 MHz crystal and a 1 Mbaud arm.
    pub fn new(image: impl Into<PathBuf>, arm: A) -> Self {
        Self {
            image: image.into(),
            arm,
            arm_baud: 1_000_000,
            crystal_hz: 8_000_000,
            unique_id: *b"\x20\x00\x41\x00\x0B51P\x35V03",
            seed: 0,
            flash: None,
            power_cut_after: None,
            reenabled: Reenabled::default(),
            instruction_cost: NonZeroU32::new(100).expect("not zero"),
            gdb: None,
        }
    }
}

/// Why a board does not do what was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The image cannot be run.
    #[error(transparent)]
    Image(#[from] rigless::image::Error),
    /// The model of the part contradicts itself.
    #[error("the model of the part: {0}")]
    Part(#[from] rigless::soc::Error),
    /// A port for gdb or for the firmware's log cannot be had.
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
    /// The contents for the flash do not fit it.
    #[error("{got} bytes for the flash, which has {}", flash::SIZE)]
    FlashSize {
        /// How many there were.
        got: usize,
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
    /// The serial port is not open.
    #[error("the serial port is not open")]
    NotOpen,
    /// A classic CAN bus carries no FD frames.
    #[error("an FD frame, the bus is a classic one")]
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
    line: Shared<A>,
    host: Arc<Mutex<Host>>,
    can: Arc<Mutex<Bus>>,
    flash: Arc<Mutex<Flash>>,
    commands: Option<Sender<Command>>,
    replies: Receiver<Reply>,
    interrupt: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    log: TcpStream,
    now: Nanos,
    trace: Trace,
    crashes: Vec<Violation>,
    /// The device, as long as the host's [`epoch`](Host::epoch) is this.
    device: Option<(u64, Enumerated)>,
    port: Option<Port>,
}

impl<A: Arm> VirtualBoard<A> {
    /// Powers the board up: the image is in its flash, and nothing has run yet. The USB cable is not in.
    ///
    /// # Errors
    ///
    /// When the image cannot be run, or a TCP port cannot be had.
    pub fn start(config: Config<A>) -> Result<Self, Error> {
        let image = Image::read(&config.image, None)?;
        Self::start_image(image, config)
    }

    fn start_image(image: Image, config: Config<A>) -> Result<Self, Error> {
        let starve = Arc::new(AtomicBool::new(false));
        let line = Arc::new(Mutex::new(Line::new(
            config.arm,
            config.arm_baud,
            config.seed,
            starve.clone(),
        )));
        let host = Arc::new(Mutex::new(Host::default()));
        let (contents, flash_images) = flash::around(&image, config.flash)?;
        let flash = Arc::new(Mutex::new(Flash::new(contents, config.power_cut_after, config.seed)));
        let can = Arc::new(Mutex::new(Bus::default()));
        let part = Stm32f405::new(
            config.crystal_hz,
            line.clone(),
            starve,
            config.reenabled,
            host.clone(),
            can.clone(),
            flash.clone(),
        )?;
        let bench = Bench {
            part,
            unique_id: config.unique_id,
            instruction_cost: config.instruction_cost,
        };

        let gdb = config.gdb.map(listen).transpose()?;
        let rtt = listen(0)?;
        let log = rtt.local_addr().and_then(TcpStream::connect).and_then(|log| {
            log.set_nonblocking(true)?;
            Ok(log)
        });
        let log = log.map_err(|error| Error::Listen {
            address: "the firmware's log".to_owned(),
            error,
        })?;

        let (commands, command) = channel();
        let (reply, replies) = channel();
        let interrupt = Arc::new(AtomicBool::new(false));
        let run = Run {
            image,
            flash_images,
            gdb,
            rtt,
            interrupt: interrupt.clone(),
            host: host.clone(),
            can: can.clone(),
            flash: flash.clone(),
            commands: command,
            replies: reply,
        };
        let thread = thread::Builder::new()
            .name("virtual-board".to_owned())
            .spawn(move || machine::run(bench, run))
            .map_err(|error| Error::Ended(error.to_string()))?;

        let mut board = Self {
            line,
            host,
            can,
            flash,
            commands: Some(commands),
            replies,
            interrupt,
            thread: Some(thread),
            log,
            now: Nanos(0),
            trace: Trace::default(),
            crashes: Vec::new(),
            device: None,
            port: None,
        };
        board.stopped()?;
        Ok(board)
    }

    /// How much virtual time has passed since power-on.
    pub fn now(&self) -> Nanos {
        self.now
    }

    /// Runs for `span`.
    ///
    /// # Errors
    ///
    /// [`Error::Crashed`] if the firmware crashes meanwhile, at that instant; it can be run on.
    pub fn run_for(&mut self, span: impl Into<Nanos>) -> Result<(), Error> {
        let until = self.now + span.into();
        while self.now < until {
            self.run(until, false)?;
        }
        Ok(())
    }

    /// Runs until `done` says so, and returns how long that took. It is asked at once, after every packet, connection and
    /// reset on the USB wire, after every frame on the CAN bus, and every millisecond.
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
            self.run(self.now + left.min(GLANCE), true)?;
        }
        Ok(self.now.since(start))
    }

    fn run(&mut self, until: Nanos, watchful: bool) -> Result<(), Error> {
        self.powered()?;
        self.send(Command::Run { until, watchful })?;
        self.stopped()?;
        self.powered()
    }

    fn powered(&self) -> Result<(), Error> {
        let flash = lock(&self.flash);
        flash.cut.map_or(Ok(()), |at| {
            let operation = flash.operations();
            Err(Error::PowerCut { at, operation })
        })
    }

    fn send(&mut self, command: Command) -> Result<(), Error> {
        let sent = self
            .commands
            .as_ref()
            .is_some_and(|commands| commands.send(command).is_ok());
        if sent { Ok(()) } else { Err(self.ended()) }
    }

    /// Waits for the emulator to stand still.
    fn stopped(&mut self) -> Result<(), Error> {
        match self.replies.recv() {
            Ok(Reply::Stopped { at, trace, crash }) => {
                self.now = at;
                self.trace = trace;
                match crash {
                    Some(crash) => {
                        self.crashes.push(Violation::Crashed { crash, at });
                        Err(Error::Crashed { crash, at })
                    }
                    None => Ok(()),
                }
            }
            Ok(Reply::Ended(why)) => Err(Error::Ended(why)),
            Ok(Reply::Report(_)) | Err(_) => Err(self.ended()),
        }
    }

    fn ended(&mut self) -> Error {
        match self.replies.try_recv() {
            Ok(Reply::Ended(why)) => Error::Ended(why),
            _ => Error::Ended("the emulator is gone".to_owned()),
        }
    }

    /// A flag that ends the run once it is set, even while a debugger holds the processor.
    pub(crate) fn interrupt(&self) -> Arc<AtomicBool> {
        self.interrupt.clone()
    }

    /// Gives the arm to `use_it`, while time stands still.
    pub fn with_arm<R>(&mut self, use_it: impl FnOnce(&mut A) -> R) -> R {
        use_it(lock(&self.line).arm_mut())
    }

    /// What the flash holds, [`SIZE`](flash::SIZE) bytes.
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

    /// What the firmware logged over RTT since this was last asked, for an image that has it.
    pub fn log(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        // It ends with an error when there is no more for now.
        let _ = self.log.read_to_end(&mut bytes);
        bytes
    }

    /// What the run has met so far.
    ///
    /// # Errors
    ///
    /// When the emulator is gone.
    pub fn report(&mut self) -> Result<Report, Error> {
        self.send(Command::Report)?;
        match self.replies.recv() {
            Ok(Reply::Report(mut report)) => {
                report.violations.extend(self.crashes.iter().cloned());
                Ok(*report)
            }
            Ok(Reply::Ended(why)) => Err(Error::Ended(why)),
            _ => Err(Error::Ended("the emulator is gone".to_owned())),
        }
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

    /// A digest of every access to a peripheral, every stop of the emulator, and every byte on the wires, with their
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
            trace.bytes(format!("{record:?}").as_bytes());
        }
        trace.value()
    }
}

impl<A: Arm> Drop for VirtualBoard<A> {
    fn drop(&mut self) {
        // Without anyone to command it, the emulator ends its run; a debugger that holds it must not keep it.
        self.commands = None;
        self.interrupt.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // What it died of, it has said in its last reply.
            let _ = thread.join();
        }
    }
}

fn listen(port: u16) -> Result<TcpListener, Error> {
    TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(|error| Error::Listen {
        address: format!("TCP port {port}"),
        error,
    })
}

/// The UART line to the arm.
#[derive(Debug)]
pub struct Uart<'a, A> {
    line: &'a Shared<A>,
}

impl<A: Arm> Uart<'_, A> {
    /// Every byte since the beginning, in the order in which they ended.
    pub fn bytes(&self) -> Vec<LineByte> {
        lock(self.line).bytes().to_vec()
    }

    /// Forgets the bytes so far.
    pub fn forget_bytes(&self) {
        lock(self.line).forget_bytes();
    }

    /// The rate at which the board's UART runs, in bits per second.
    pub fn baud(&self) -> Option<u64> {
        lock(self.line).board_baud()
    }

    /// Sets the rate of the arm's own UART, in bits per second. An arm that is more than 5 % off is not understood.
    pub fn set_arm_baud(&self, baud: u32) {
        lock(self.line).set_arm_baud(baud);
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

/// The CAN bus and the other nodes on it.
///
/// Nobody is on it until nodes are [attached](Can::attach). What is changed here takes effect when the board next runs.
#[derive(Debug)]
pub struct Can<'a> {
    bus: &'a Mutex<Bus>,
}

impl Can<'_> {
    /// Puts nodes on the bus that run at `rate` bits per second and acknowledge what they understand.
    pub fn attach(&self, rate: u32) {
        lock(self.bus).attach(rate);
    }

    /// Takes the nodes off the bus: nobody acknowledges any more, and what they wanted to send is gone.
    pub fn detach(&self) {
        lock(self.bus).detach();
    }

    /// Whether there are nodes.
    pub fn is_attached(&self) -> bool {
        lock(self.bus).is_attached()
    }

    /// Queues a frame of node 0. It goes when the bus is free and no lower identifier wants it, and again until it got
    /// through.
    ///
    /// # Errors
    ///
    /// [`Error::FdFrame`] for one that a classic bus does not carry.
    pub fn send(&self, frame: &Frame) -> Result<(), Error> {
        self.send_from(0, frame)
    }

    /// Queues a frame of `node`. Each node has a queue of its own; the fronts of the queues arbitrate.
    ///
    /// # Errors
    ///
    /// As for [`send`](Self::send).
    pub fn send_from(&self, node: u8, frame: &Frame) -> Result<(), Error> {
        let frame = can::to_wire(frame).ok_or(Error::FdFrame)?;
        lock(self.bus).send(node, frame);
        Ok(())
    }

    /// How many frames of the nodes have not gone yet.
    pub fn unsent(&self) -> usize {
        lock(self.bus).unsent()
    }

    /// Takes the frames that the nodes received from the board, but remote frames and those with 29-bit identifiers.
    pub fn read(&self) -> Vec<Frame> {
        lock(self.bus).take_heard().iter().filter_map(can::from_wire).collect()
    }

    /// How many frames the nodes received from the board that were not read yet.
    pub fn unread(&self) -> usize {
        lock(self.bus).unread()
    }

    /// Every frame since the beginning, in the order in which they ended, once for each attempt.
    pub fn frames(&self) -> Vec<BusFrame> {
        let public = |record: &Record| BusFrame {
            start: record.start,
            end: record.end,
            sender: record.sender,
            frame: can::from_wire(&record.frame),
            outcome: record.outcome,
        };
        lock(self.bus).records().iter().map(public).collect()
    }

    /// Forgets the frames so far.
    pub fn forget_frames(&self) {
        lock(self.bus).forget_records();
    }

    /// Lets a node destroy the next `count` frames of the board with an error flag, each attempt counted.
    pub fn destroy_next(&self, count: u32) {
        lock(self.bus).destroy(count);
    }

    /// Whether nodes acknowledge the board's frames. They do until told otherwise.
    pub fn set_acknowledging(&self, acknowledging: bool) {
        lock(self.bus).set_acknowledging(acknowledging);
    }

    /// Shorts the bus: it is recessive whoever sends, until [released](Self::release). A controller that sends goes to
    /// bus-off.
    pub fn short(&self) {
        lock(self.bus).set_shorted(true);
    }

    /// Ends the short.
    pub fn release(&self) {
        lock(self.bus).set_shorted(false);
    }

    /// Lets another node send `frame` again and again, whenever it wins the bus. `None` ends it.
    ///
    /// # Errors
    ///
    /// As for [`send`](Self::send).
    pub fn flood(&self, frame: Option<&Frame>) -> Result<(), Error> {
        let frame = frame
            .map(|frame| can::to_wire(frame).ok_or(Error::FdFrame))
            .transpose()?;
        lock(self.bus).set_flood(frame);
        Ok(())
    }
}

/// The USB host and the serial port that it has open.
#[derive(Debug)]
pub struct Usb<'a, A: Arm> {
    board: &'a mut VirtualBoard<A>,
}

impl<A: Arm> Usb<'_, A> {
    /// Puts the cable in.
    pub fn attach(&mut self) {
        self.host(|host| host.set_cable(true));
    }

    /// Pulls the cable out. The serial port closes.
    pub fn detach(&mut self) {
        self.host(|host| host.set_cable(false));
        self.board.device = None;
        self.board.port = None;
    }

    /// Whether a device is there.
    pub fn connected(&self) -> bool {
        self.host(|host| host.connected())
    }

    /// Waits for a device and brings it to its first configuration: bus reset, descriptors, address.
    ///
    /// # Errors
    ///
    /// [`Error::NoDevice`], or as the device fails to answer.
    pub fn enumerate(&mut self) -> Result<&Enumerated, Error> {
        self.board.port = None;
        let appeared = self
            .board
            .run_until(CONNECT_LIMIT, |board| lock(&board.host).connected());
        appeared.map_err(|error| match error {
            Error::TimedOut { limit } => Error::NoDevice { limit },
            other => other,
        })?;
        let mut bus = Wire {
            board: self.board,
            failed: None,
        };
        let device = enumerate::enumerate(&mut bus, ADDRESS);
        if let Some(error) = bus.failed {
            return Err(error);
        }
        let epoch = self.host(|host| host.epoch());
        Ok(&self.board.device.insert((epoch, device?)).1)
    }

    /// Opens the device's serial port number `nth`, from 0, as a program does: at `coding`, with DTR and RTS on. The
    /// device is enumerated first if it was not yet.
    ///
    /// # Errors
    ///
    /// As for [`enumerate`](Self::enumerate), and when there is no such port.
    pub fn open(&mut self, nth: usize, coding: LineCoding) -> Result<(), Error> {
        if self.device().is_none() {
            self.enumerate()?;
        }
        let ports = self
            .device()
            .map_or_else(Vec::new, |device| Port::find(&device.configuration));
        let port = *ports.get(nth).ok_or(Error::NoPort {
            nth,
            count: ports.len(),
        })?;
        self.host(|host| {
            for endpoint in [Some(port.output), Some(port.input), port.notify].into_iter().flatten() {
                if !host.is_open(endpoint.number, endpoint.direction) {
                    host.open(ADDRESS, endpoint);
                }
            }
        });
        self.board.port = Some(port);
        self.set_line_coding(coding)?;
        self.set_control_lines(true, true)
    }

    /// The device, once it was enumerated and while it stays connected.
    pub fn device(&self) -> Option<&Enumerated> {
        let epoch = self.host(|host| host.epoch());
        let (enumerated, device) = self.board.device.as_ref()?;
        (*enumerated == epoch).then_some(device)
    }

    /// Whether a serial port is open: the device has not gone since.
    pub fn is_open(&self) -> bool {
        let port = self.board.port;
        port.is_some_and(|port| self.host(|host| host.is_open(port.output.number, Direction::Out)))
    }

    /// Runs one control transfer with the device, on endpoint 0.
    ///
    /// # Errors
    ///
    /// As the transfer ends.
    pub fn control(&mut self, request: Request) -> Result<Vec<u8>, Error> {
        let packet = self.device().map_or(64, |device| device.device.packet);
        Ok(self.board.control(ADDRESS, packet, request)??)
    }

    /// Sets the line coding of the open port.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or as the request ends.
    pub fn set_line_coding(&mut self, coding: LineCoding) -> Result<(), Error> {
        let request = self.port()?.set_line_coding(coding);
        self.control(request).map(|_| ())
    }

    /// Asks the open port for its line coding, `None` if it answers with something else.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or as the request ends.
    pub fn line_coding(&mut self) -> Result<Option<LineCoding>, Error> {
        let request = self.port()?.get_line_coding();
        Ok(LineCoding::decode(&self.control(request)?))
    }

    /// Drives DTR and RTS of the open port.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or as the request ends.
    pub fn set_control_lines(&mut self, dtr: bool, rts: bool) -> Result<(), Error> {
        let request = self.port()?.set_control_lines(dtr, rts);
        self.control(request).map(|_| ())
    }

    /// Queues bytes for the open port, in packets as large as it takes. They go while the board runs.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let endpoint = self.port()?.output.number;
        let open = self.host(|host| host.write(endpoint, bytes));
        if open { Ok(()) } else { Err(Error::NotOpen) }
    }

    /// How many bytes are queued and have not gone yet.
    pub fn unsent(&self) -> usize {
        self.board
            .port
            .map_or(0, |port| self.host(|host| host.unsent(port.output.number)))
    }

    /// Takes the bytes that came from the open port.
    pub fn read(&mut self) -> Vec<u8> {
        self.board
            .port
            .map_or_else(Vec::new, |port| self.host(|host| host.read(port.input.number)))
    }

    /// How many bytes came from the open port and were not read yet.
    pub fn unread(&self) -> usize {
        self.board
            .port
            .map_or(0, |port| self.host(|host| host.unread(port.input.number)))
    }

    /// Whether the host asks the open port for bytes. It stops when a program does not read for long.
    pub fn set_reading(&mut self, reading: bool) {
        if let Some(port) = self.board.port {
            self.host(|host| host.set_reading(port.input.number, reading));
        }
    }

    /// Lets the next `count` data transactions with the open port end in a NAK, whatever the device would say.
    pub fn inject_naks(&mut self, direction: Direction, count: u32) {
        if let Some(port) = self.board.port {
            let endpoint: descriptor::Endpoint = match direction {
                Direction::Out => port.output,
                Direction::In => port.input,
            };
            self.host(|host| host.inject_naks(endpoint.number, direction, count));
        }
    }

    /// Resets the bus, as a host does that lost its way. The serial port closes.
    pub fn reset_bus(&mut self) {
        self.host(Host::reset);
        self.board.device = None;
        self.board.port = None;
    }

    /// Suspends the bus.
    pub fn suspend(&mut self) {
        self.host(Host::suspend);
    }

    /// Wakes the bus.
    pub fn resume(&mut self) {
        self.host(Host::resume);
    }

    /// Sets how often an endpoint that has nothing to say is asked again, [`Host::poll_interval`].
    pub fn set_poll_interval(&mut self, interval: impl Into<Nanos>) {
        self.host(|host| host.poll_interval = interval.into());
    }

    /// Every data packet since the beginning, on any endpoint but 0, in order.
    pub fn packets(&self) -> Vec<Packet> {
        self.host(|host| host.packets().to_vec())
    }

    /// Forgets the packets so far.
    pub fn forget_packets(&mut self) {
        self.host(Host::forget_packets);
    }

    fn port(&self) -> Result<Port, Error> {
        self.board.port.ok_or(Error::NotOpen)
    }

    fn host<R>(&self, use_it: impl FnOnce(&mut Host) -> R) -> R {
        use_it(&mut lock(&self.board.host))
    }
}

impl<A: Arm> VirtualBoard<A> {
    fn control(&mut self, address: u8, packet: u8, request: Request) -> Result<Result<Vec<u8>, TransferError>, Error> {
        lock(&self.host).start_control(address, packet, request);
        let mut result = None;
        let ended = self.run_until(CONTROL_LIMIT, |board| {
            result = lock(&board.host).take_control();
            result.is_some()
        });
        match (ended, result) {
            (_, Some(result)) => Ok(result),
            (Err(Error::TimedOut { .. }) | Ok(_), None) => {
                lock(&self.host).abandon_control();
                Ok(Err(TransferError::TimedOut))
            }
            (Err(error), None) => Err(error),
        }
    }
}

/// The wire as enumeration wants it. If the run fails, so does every transfer from then on.
struct Wire<'a, A: Arm> {
    board: &'a mut VirtualBoard<A>,
    failed: Option<Error>,
}

impl<A: Arm> enumerate::Bus for Wire<'_, A> {
    fn wait(&mut self, span: Nanos) {
        if self.failed.is_none() {
            self.failed = self.board.run_for(span).err();
        }
    }

    fn reset(&mut self) {
        if self.failed.is_none() {
            lock(&self.board.host).reset();
            // The reset lasts, then frames pass.
            let over = self.board.run_until(CONTROL_LIMIT, |board| lock(&board.host).running());
            self.failed = over.err();
        }
    }

    fn control(&mut self, address: u8, packet: u8, request: Request) -> Result<Vec<u8>, TransferError> {
        if self.failed.is_some() {
            return Err(TransferError::Disconnected);
        }
        self.board.control(address, packet, request).unwrap_or_else(|error| {
            self.failed = Some(error);
            Err(TransferError::Disconnected)
        })
    }
}

#[cfg(test)]
mod tests;
