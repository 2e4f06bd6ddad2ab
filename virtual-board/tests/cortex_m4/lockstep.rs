//! The core beside QEMU's Cortex-M4: replays the recording of `lockstep/record.py`.

use armwire_virtual_board::core::{Core, Memory, NoPeripherals, Refusal, Register, Stop, Width};

use crate::board::{CONFIG, FLASH, RAM};

const BEGIN: u32 = FLASH + 0x100;
const PAGE: usize = 0x1000;
/// Size of the RAM that streams write to.
const RAM_SIZE: u32 = 0x400;
/// The RAM for functions of an image.
const CALL_RAM_SIZE: usize = 0x1_0000;

/// Bits of CFSR (B3.2.15).
const UNDEFINED: u32 = 1 << 16;
const UNALIGNED: u32 = 1 << 24;

/// Values that registers often begin with.
const EDGES: [u32; 12] = [
    0,
    1,
    0x7f,
    0x80,
    0xff,
    0x7fff,
    0x8000,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0x8000_0001,
    0xffff_ffff,
];

/// Takes values from the front of a trace.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (bytes, rest) = self.0.split_first_chunk().expect("the trace is cut");
        self.0 = rest;
        *bytes
    }

    fn byte(&mut self) -> u8 {
        self.bytes::<1>()[0]
    }

    fn half(&mut self) -> u16 {
        u16::from_le_bytes(self.bytes())
    }

    fn word(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }
}

/// The generator of the state before a stream.
struct Xorshift(u32);

impl Xorshift {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    fn register(&mut self) -> u32 {
        let (kind, value) = (self.next() >> 16 & 3, self.next());
        match kind {
            0 => value,
            1 => value >> 8 & 0x3f,
            2 => EDGES[(value >> 8) as usize % EDGES.len()],
            _ => RAM + RAM_SIZE / 2 + (value >> 8 & 0x7c),
        }
    }
}

/// R0 to R14, xPSR, and a digest of the RAM.
#[derive(Debug, PartialEq, Eq)]
struct State {
    registers: [u32; 15],
    xpsr: u32,
    digest: u32,
}

impl State {
    fn read(reader: &mut Reader<'_>) -> Self {
        Self {
            registers: std::array::from_fn(|_| reader.word()),
            xpsr: reader.word(),
            digest: reader.word(),
        }
    }

    fn of(core: &Core) -> Self {
        Self {
            registers: std::array::from_fn(|number| core.register(Register::R(number as u8))),
            xpsr: core.register(Register::Xpsr),
            digest: adler_32(core.memory().ram()),
        }
    }
}

fn adler_32(data: &[u8]) -> u32 {
    let (a, b) = data.iter().fold((1, 0), |(a, b), byte| {
        let a = (a + u32::from(*byte)) % 65521;
        (a, (b + a) % 65521)
    });
    b << 16 | a
}

fn core(flash: Vec<u8>, ram_size: usize) -> Core {
    Core::new(CONFIG, Memory::new(FLASH, flash, RAM, ram_size))
}

/// Sets up the state that follows from a seed, with the stack pointer and the program counter.
fn begin(core: &mut Core, seed: u32, sp: u32, pc: u32) {
    core.reset(&mut NoPeripherals);
    let mut generator = Xorshift(seed);
    for number in 0..15 {
        let value = generator.register();
        core.set_register(Register::R(number), value);
    }
    core.set_register(Register::R(13), sp);
    core.set_register(Register::R(15), pc);
    core.set_register(Register::Xpsr, generator.next() & 0xf80f_0000 | 1 << 24);
    core.memory_mut().fill_ram(|| 0);
    for at in 0..RAM_SIZE / 4 {
        core.memory_mut()
            .write(RAM + 4 * at, Width::Word, generator.next())
            .unwrap();
    }
}

/// Sets up a stream: registers, RAM and code.
fn begin_stream(core: &mut Core, seed: u32, code: &[u16]) {
    begin(core, seed, RAM + RAM_SIZE / 2, BEGIN);
    let mut flash = vec![0; PAGE];
    for (at, half) in flash[0x100..].chunks_exact_mut(2).zip(code) {
        at.copy_from_slice(&half.to_le_bytes());
    }
    core.memory_mut().program(0, &flash).unwrap();
}

/// Runs to an address, instruction by instruction. Returns the reason and the address if it stops before.
fn run_to(core: &mut Core, end: u32) -> Option<(Stop, u32)> {
    while core.pc() != end {
        let at = core.pc();
        let stop = core.run(&mut NoPeripherals, core.cycle() + 1);
        let left = !(FLASH + 0x100..=end).contains(&core.pc());
        if stop != Stop::Deadline || left {
            return Some((stop, at));
        }
    }
    None
}

/// The results of a replay.
#[derive(Debug, Default)]
struct Replay {
    streams: usize,
    calls: usize,
    undefined: usize,
    /// Streams that end at an instruction that the core refuses.
    unpredictable: usize,
    /// Calls that end at an access that the emulator does not fault.
    misaligned: usize,
    differences: Vec<String>,
}

impl Replay {
    fn compare(&mut self, what: String, core: &Core, stopped: Option<(Stop, u32)>, expected: &State) {
        let [cfsr, ..] = core.fault_status();
        match stopped {
            Some((Stop::Refused(Refusal::Unpredictable), _)) => self.unpredictable += 1,
            Some(_) if cfsr == UNALIGNED => self.misaligned += 1,
            Some((stop, at)) => self
                .differences
                .push(format!("{what}: {stop:?} at {at:#x}, CFSR {cfsr:#x}")),
            None if State::of(core) == *expected => {}
            None => {
                let state = State::of(core);
                self.differences
                    .push(format!("{what}:\n    {state:x?}, expected\n    {expected:x?}"));
            }
        }
    }

    fn stream(&mut self, core: &mut Core, reader: &mut Reader<'_>) {
        let seed = reader.word();
        let code: Vec<u16> = (0..reader.byte()).map(|_| reader.half()).collect();
        let expected = State::read(reader);
        self.streams += 1;
        begin_stream(core, seed, &code);
        let stopped = run_to(core, BEGIN + 2 * code.len() as u32);
        self.compare(format!("{seed:#x} {code:04x?}"), core, stopped, &expected);
    }

    fn undefined(&mut self, core: &mut Core, reader: &mut Reader<'_>) {
        let code = [reader.half(), reader.half()];
        self.undefined += 1;
        begin_stream(core, 1, &code);
        let stopped = run_to(core, BEGIN + 4);
        // The UsageFault escalates, and the vector table is empty.
        let [cfsr, ..] = core.fault_status();
        let refused = matches!(stopped, Some((Stop::Refused(Refusal::Unpredictable), _)));
        if cfsr & UNDEFINED == 0 && !refused {
            self.differences
                .push(format!("{code:04x?} is not undefined: {stopped:?}"));
        }
    }

    fn call(&mut self, core: &mut Core, reader: &mut Reader<'_>) {
        let (seed, entry) = (reader.word(), reader.word());
        let expected = State::read(reader);
        self.calls += 1;
        let end = FLASH + core.memory().flash().len() as u32 - 0x100;
        begin(core, seed, RAM + CALL_RAM_SIZE as u32, entry);
        core.set_register(Register::R(14), end | 1);
        let stopped = run_to(core, end);
        self.compare(format!("call of {entry:#x} with {seed:#x}"), core, stopped, &expected);
    }
}

fn trace() -> Vec<u8> {
    match std::env::var_os("ARMWIRE_TRACE") {
        Some(path) => std::fs::read(path).unwrap(),
        None => include_bytes!("../../lockstep/trace.bin").to_vec(),
    }
}

#[test]
fn streams_end_as_in_the_independent_emulator() {
    let trace = trace();
    let mut reader = Reader(trace.strip_prefix(b"ARMWIRE2").expect("the trace has another format"));
    let mut replay = Replay::default();
    let mut stream_core = core(vec![0; PAGE], PAGE);
    let mut image_core = None;
    while !reader.0.is_empty() {
        match (reader.byte(), &mut image_core) {
            (b'S', _) => replay.stream(&mut stream_core, &mut reader),
            (b'U', _) => replay.undefined(&mut stream_core, &mut reader),
            (b'I', _) => {
                let flash = (0..reader.word()).map(|_| reader.byte()).collect();
                image_core = Some(core(flash, CALL_RAM_SIZE));
            }
            (b'C', Some(core)) => replay.call(core, &mut reader),
            (other, _) => panic!("a record of kind {other}"),
        }
    }
    let shown = replay
        .differences
        .iter()
        .take(20)
        .cloned()
        .collect::<Vec<_>>()
        .join("\n");
    println!("{shown}");
    let count = replay.differences.len();
    println!(
        "{:?}",
        Replay {
            differences: Vec::new(),
            ..replay
        }
    );
    assert_eq!(count, 0);
    assert!(replay.streams >= 1000 && replay.unpredictable < replay.streams / 4 && replay.undefined >= 1000);
}
