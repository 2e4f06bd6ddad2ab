//! The board as the emulator runs it, on a thread of its own, in lock step with the program that owns it.
//!
//! The program says how far to run and waits; the emulator runs there, says so and waits. Only one of the two ever runs,
//! so nothing depends on how threads are scheduled.

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::num::{NonZeroU32, NonZeroU64};
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, Sender};
use std::sync::{Arc, Mutex};

use object::{Object, ObjectSymbol};
use rigless::cpu::armv7m::windows;
use rigless::device::ResetCause;
use rigless::emulator::{self, Access, AccessKind, CoreSpec, Driver, HitKind, Settled, Start, Stop, Watch};
use rigless::image::Image;
use rigless::machine::armv7m::{self, Fpu, MpuRegions};
use rigless::machine::{Board, Target};
use rigless::mcu::{Mcu, Operate};
use rigless::session::Session;
use rigless::snapshot::Store;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use crate::engine::{Stopped, Watched};
use crate::flash::Flash;
use crate::report::{Cause, Crash, Report, Restart, Violation};
use crate::shared::lock;
use crate::stm32f405::Stm32f405;
use crate::stm32f405::map::{BOOT_LOADER, BOOT_LOADER_START, BOOT_LOADER_STUB, FLASH_KIB, FLASH_SIZE, UNIQUE_ID};
use crate::time::Nanos;
use crate::trace::Trace;

/// The processor's clock once the firmware has set it up (RM0090, 7.2).
const CORE_HZ: NonZeroU64 = NonZeroU64::new(168_000_000).expect("not zero");

/// Priority bits of the interrupt controller (12.1), and what divides the clock of the system timer (12.1.2).
const PRIORITY_BITS: u8 = 4;
const SYSTICK_DIVIDER: NonZeroU32 = NonZeroU32::new(8).expect("not zero");

/// The crash that a function of this name stands for. Only the whole name counts for handlers: the linker may give others
/// that contain it, such as an unused `_HardFault`, the address of a function that runs.
fn crash_of(name: &str) -> Option<Crash> {
    match name {
        "HardFault" => Some(Crash::HardFault),
        "DefaultHandler" => Some(Crash::UnexpectedException),
        _ if name.contains("rust_begin_unwind") => Some(Crash::Panic),
        _ => None,
    }
}

/// The symbol of the firmware's log, if it has one.
const RTT: &str = "_SEGGER_RTT";

/// A board as the library wants it: the part, and what its maker programmed into it.
#[derive(Debug)]
pub(crate) struct Bench {
    pub(crate) part: Stm32f405,
    pub(crate) unique_id: [u8; 12],
    /// The virtual time of an instruction, in percent of a cycle.
    pub(crate) instruction_cost: NonZeroU32,
}

/// Snapshots are not supported.
impl Store for Bench {}

impl Bench {
    fn core(&self) -> CoreSpec {
        let rate = CORE_HZ.get() * 100 / u64::from(self.instruction_cost.get());
        let mut spec = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: CORE_HZ,
            interrupt_lines: NonZeroU32::new(self.part.bus().cpu().interrupt_lines.into()).expect("the part has some"),
            priority_bits: PRIORITY_BITS,
            refclk_divider: SYSTICK_DIVIDER,
            instructions_per_second: NonZeroU64::new(rate).unwrap_or(NonZeroU64::MIN),
            boot: "flash",
        }
        .spec_with_parts(&windows(self.part.bus()), Fpu::FpV4Sp, MpuRegions::Eight);
        let factory = |name: &str, bytes: &[u8], at| {
            Image::new(Path::new(name), bytes.to_vec(), Some(at)).expect("plain bytes with an address")
        };
        spec.factory_images = vec![
            factory("boot loader", &BOOT_LOADER_STUB, BOOT_LOADER),
            factory("unique id", &self.unique_id, UNIQUE_ID),
            factory("flash size", &FLASH_KIB.to_le_bytes(), FLASH_SIZE),
        ];
        spec
    }
}

impl Board for Bench {
    fn name(&self) -> &'static str {
        "virtual-board"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32f405rg"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.part)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let core = self.core();
        vec![Target::new("stm32f405rg", &mut self.part, core)]
    }
}

/// What the program asks of the emulator.
#[derive(Debug)]
pub(crate) enum Command {
    /// Run until this instant, or until what is watched for happens.
    Run { until: Nanos, watched: Watched },
    /// Say what the run has met.
    Report,
    /// Say how often the core came to each instruction since this was last asked, and count on.
    Profile,
    /// Read a word, as a debugger does.
    Read { address: u64 },
    /// Write a word, as a debugger does.
    Write { address: u64, value: u32 },
    /// Let the core stand still until the next reset, or let it go.
    Hold(bool),
}

/// What the emulator answers.
#[derive(Debug)]
pub(crate) enum Reply {
    /// It stands here.
    Stopped(Stopped),
    /// What the run has met.
    Report(Box<Report>),
    /// How often the core came to each instruction, by its address.
    Profile(BTreeMap<u64, u64>),
    /// The word, or there is nothing at its address.
    Read(Option<u32>),
    /// The word is written, or there is nothing at its address.
    Written(bool),
    /// The run is over and will not go on.
    Ended(String),
}

/// Everything a run needs that is not the board.
pub(crate) struct Run {
    pub(crate) image: Image,
    /// What the flash holds besides the image.
    pub(crate) flash_images: Vec<Image>,
    pub(crate) gdb: Option<TcpListener>,
    pub(crate) rtt: TcpListener,
    pub(crate) interrupt: Arc<AtomicBool>,
    pub(crate) flash: Arc<Mutex<Flash>>,
    pub(crate) commands: Receiver<Command>,
    pub(crate) replies: Sender<Reply>,
}

/// Runs the image until the program goes away.
pub(crate) fn run(bench: Bench, run: Run) {
    let replies = run.replies.clone();
    let ended = match attempt(bench, run) {
        Ok(()) => "the run was ended".to_owned(),
        Err(error) => error.to_string(),
    };
    // The program may be gone already.
    let _ = replies.send(Reply::Ended(ended));
}

fn attempt(bench: Bench, run: Run) -> Result<(), emulator::Error> {
    let mut session = Session::new(Box::new(bench), 0, VirtualNanos(0))?;
    let symbols = symbols(&run.image);
    let segments = run.image.segments().map(|(at, bytes)| at..at + bytes.len() as u64);
    let segments = segments.collect();
    let crashes = crashes(&symbols);
    for address in crashes.keys() {
        session.watch(Watch::Instruction(*address));
    }
    session.watch(Watch::Instruction(BOOT_LOADER_START));
    let mut images = run.flash_images;
    images.push(run.image);
    let mut start = Start::new(&images);
    start.debugger = run.gdb.as_ref();
    start.rtt = symbols.contains_key(RTT).then_some(&run.rtt);
    start.interrupt = Some(&run.interrupt);
    let driver = Lockstep {
        commands: run.commands,
        replies: run.replies,
        flash: run.flash,
        held: false,
        stuck: None,
        watched: Watched::Nothing,
        trace: Trace::default(),
        crashes,
        crash: None,
        boot_loader: None,
        segments,
        profile: None,
    };
    emulator::run(session, &start, driver).map(|_| ())
}

/// The image's symbols, each function's with the address of its first instruction.
pub(crate) fn symbols(image: &Image) -> BTreeMap<String, u64> {
    // An image that the emulator takes and this does not has no symbols worth having.
    let Ok(file) = object::File::parse(image.bytes()) else {
        return BTreeMap::new();
    };
    file.symbols()
        .filter(|symbol| symbol.is_definition())
        .filter_map(|symbol| Some((symbol.name().ok()?.to_owned(), symbol.address() & !1)))
        .collect()
}

/// Where the firmware is when it is broken.
pub(crate) fn crashes(symbols: &BTreeMap<String, u64>) -> BTreeMap<u64, Crash> {
    symbols
        .iter()
        .filter_map(|(name, address)| Some((*address, crash_of(name)?)))
        .collect()
}

/// What a session has met so far.
fn report<B: Board>(session: &Session<B>) -> Report {
    let unmapped = session.unmapped().into_iter().map(|found| Violation::Unmapped {
        address: found.address,
        program_counter: found.program_counter,
    });
    let unimplemented = session.unimplemented().values().map(|found| Violation::Unimplemented {
        instance: found.instance,
        register: found.register,
        program_counter: found.program_counter,
        reads: found.reads,
        writes: found.writes,
    });
    let refused = session.refused().iter().map(|(&address, fault)| Violation::Refused {
        address,
        reason: fault.to_string(),
    });
    let unrouted = session
        .unrouted()
        .iter()
        .map(|&(instance, line)| Violation::Unrouted { instance, line });
    let told = session.told().map(|told| Violation::Forbidden {
        instance: told.instance,
        register: told.register,
        reason: told.reason,
    });
    let restarts = session.resets().iter().map(|reset| Restart {
        at: reset.at.into(),
        cause: match reset.cause {
            ResetCause::Core => Cause::Software,
            ResetCause::Model("IWDG") => Cause::Watchdog,
            ResetCause::PowerOn => Cause::Power,
            _ => Cause::Other,
        },
    });
    Report {
        violations: unmapped
            .chain(unimplemented)
            .chain(refused)
            .chain(unrouted)
            .chain(told)
            .collect(),
        restarts: restarts.collect(),
    }
}

/// Keeps the emulator in step with the program.
#[derive(Debug)]
struct Lockstep {
    commands: Receiver<Command>,
    replies: Sender<Reply>,
    flash: Arc<Mutex<Flash>>,
    /// The core waits for the flash.
    held: bool,
    /// The core stands still until there were more resets than these.
    stuck: Option<usize>,
    watched: Watched,
    trace: Trace,
    crashes: BTreeMap<u64, Crash>,
    crash: Option<Crash>,
    /// How many resets there had been when the boot loader started.
    boot_loader: Option<usize>,
    /// Where the image lies.
    segments: Vec<Range<u64>>,
    /// How often the core came to each instruction, if that is counted.
    profile: Option<BTreeMap<u64, u64>>,
}

impl Lockstep {
    /// How often the core came to each instruction since this was last asked. The first time, it begins to count.
    fn take_profile(&mut self, session: &mut Session<Bench>) -> BTreeMap<u64, u64> {
        if self.profile.is_none() {
            // An instruction has 2 or 4 bytes. The core never comes to the middle of one, nor to what is no instruction.
            for address in self.segments.iter().cloned().flat_map(|segment| segment.step_by(2)) {
                session.watch(Watch::Instruction(address));
            }
        }
        self.profile.replace(BTreeMap::new()).unwrap_or_default()
    }
}

impl Driver<Bench> for Lockstep {
    fn on_settled(&mut self, session: &mut Session<Bench>, host: &mut dyn emulator::Host, settled: Settled) {
        let (now, cut) = match settled {
            Settled::Access { access, value } => {
                for part in [access.address, value, access.instruction_count, access.virtual_time.0] {
                    self.trace.add(part);
                }
                (access.virtual_time, false)
            }
            Settled::Stop(stop) => {
                self.trace.add(stop.at.0);
                self.trace.add(stop.instruction_count);
                // From now on nothing outside changes but by the models' own doing, until the program has its say.
                session.board_mut().part.set_looking(false);
                (stop.at, lock(&self.flash).cut == Some(stop.at.into()))
            }
            Settled::Hit(hit) => {
                if let Some(profile) = &mut self.profile {
                    *profile.entry(hit.address).or_default() += 1;
                }
                if hit.kind == HitKind::Instruction && hit.address == BOOT_LOADER_START {
                    self.boot_loader = Some(session.resets().len());
                    if self.watched == Watched::Everything {
                        session.run_until(hit.at);
                    }
                } else if hit.kind == HitKind::Instruction
                    && let Some(crash) = self.crashes.get(&hit.address)
                {
                    self.crash = Some(*crash);
                    session.run_until(hit.at);
                }
                return;
            }
            _ => return,
        };
        let part = &mut session.board_mut().part;
        let (busy, news) = (part.is_flash_busy(), part.take_news());
        let freed = self.stuck.take_if(|resets| session.resets().len() > *resets).is_some();
        if freed || busy != self.held {
            self.held = busy;
            host.hold(busy || self.stuck.is_some() || session.unpowered());
            session.pause_at(Some(now));
        }
        let found = match self.watched {
            Watched::Nothing => false,
            Watched::Everything => news.any,
            Watched::Heard => news.heard,
        };
        if cut || found {
            session.run_until(now);
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Bench>,
        stop: Stop,
        host: &mut dyn emulator::Host,
    ) -> Option<VirtualNanos> {
        let stopped = Stopped {
            at: stop.at.into(),
            instructions: stop.instruction_count,
            trace: self.trace,
            crash: self.crash.take(),
            in_boot_loader: self.boot_loader == Some(session.resets().len()),
        };
        self.replies.send(Reply::Stopped(stopped)).ok()?;
        session.board_mut().part.set_looking(true);
        loop {
            match self.commands.recv().ok()? {
                Command::Run { until, watched } => {
                    self.watched = watched;
                    return Some(until.into());
                }
                Command::Profile => {
                    let profile = self.take_profile(session);
                    self.replies.send(Reply::Profile(profile)).ok()?;
                }
                Command::Report => self.replies.send(Reply::Report(Box::new(report(session)))).ok()?,
                Command::Read { address } => {
                    let memory = host.read(address, Width::W32).ok();
                    let value = memory.or_else(|| session.mcu().peek(stop.at, address, Width::W32).ok());
                    self.replies.send(Reply::Read(value.map(|value| value as u32))).ok()?;
                }
                Command::Write { address, value } => {
                    let written = write(session, stop, host, address, value);
                    self.replies.send(Reply::Written(written)).ok()?;
                }
                Command::Hold(held) => {
                    self.stuck = held.then(|| session.resets().len());
                    host.hold(held || self.held || session.unpowered());
                }
            }
        }
    }
}

/// Writes a word to memory, or else to a register.
fn write<B: Board>(
    session: &mut Session<B>,
    stop: Stop,
    host: &mut dyn emulator::Host,
    address: u64,
    value: u32,
) -> bool {
    if host.write(address, Width::W32, value.into()).is_ok() {
        return true;
    }
    if session.mcu().bus().slot_at(address).is_none() {
        return false;
    }
    let access = Access::new(AccessKind::Write, address, Width::W32, value.into());
    session.access(access.at(stop.instruction_count, stop.at), host);
    true
}
