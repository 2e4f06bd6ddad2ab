//! The core beside QEMU's Cortex-M4: replays what `lockstep/record.py` has recorded.

use armwire_virtual_board::core::{Access, Bus, BusError, Config, Core, Memory, Refusal, Register, Stop, Width};

const FLASH: u32 = 0x0800_0000;
const BEGIN: u32 = FLASH + 0x100;
const RAM: u32 = 0x2000_0000;
const PAGE: usize = 0x1000;
/// What streams write to.
const RAM_SIZE: usize = 0x400;

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

struct Nothing;

impl Bus for Nothing {
    fn read(&mut self, _: Access, _: &mut Memory) -> Result<u32, BusError> {
        Err(BusError)
    }

    fn write(&mut self, _: Access, _: u32, _: &mut Memory) -> Result<(), BusError> {
        Err(BusError)
    }

    fn needs_attention(&self) -> bool {
        false
    }
}

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
            _ => RAM + RAM_SIZE as u32 / 2 + (value >> 8 & 0x7c),
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

fn digest(data: &[u8]) -> u32 {
    data.iter().fold(0x811c_9dc5, |hash, byte| {
        (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193)
    })
}

fn core() -> Core {
    let config = Config {
        interrupts: 82,
        priority_bits: 4,
        vector_table: FLASH,
        mpu_regions: 8,
        bit_band: true,
    };
    Core::new(config, Memory::new(FLASH, vec![0; PAGE], RAM, PAGE))
}

/// Sets up the state that follows from a seed, and the code.
fn begin(core: &mut Core, seed: u32, code: &[u16]) {
    core.reset(&mut Nothing);
    let mut generator = Xorshift(seed);
    for number in 0..15 {
        let value = generator.register();
        core.set_register(Register::R(number), value);
    }
    core.set_register(Register::R(13), RAM + RAM_SIZE as u32 / 2);
    core.set_register(Register::Xpsr, generator.next() & 0xf80f_0000 | 1 << 24);
    core.set_register(Register::R(15), BEGIN);
    core.memory_mut().fill_ram(0);
    let mut flash = vec![0; PAGE];
    for (at, word) in (RAM..)
        .step_by(4)
        .zip(0..RAM_SIZE / 4)
        .map(|(at, _)| (at, generator.next()))
    {
        core.memory_mut().write(at, Width::Word, word).unwrap();
    }
    for (at, half) in flash[0x100..].chunks_exact_mut(2).zip(code) {
        at.copy_from_slice(&half.to_le_bytes());
    }
    core.memory_mut().program(0, &flash).unwrap();
}

/// Runs to an address, instruction by instruction. Why it did not come there, and where it was then.
fn run_to(core: &mut Core, end: u32) -> Option<(Stop, u32)> {
    while core.pc() != end {
        let at = core.pc();
        let stop = core.run(&mut Nothing, core.cycle() + 1);
        if stop != Stop::Deadline || !(BEGIN..=end).contains(&core.pc()) {
            return Some((stop, at));
        }
    }
    None
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
    let mut reader = Reader(trace.strip_prefix(b"ARMWIRE1").expect("the trace has another format"));
    let (mut streams, mut unpredictable, mut undefined) = (0, 0, 0);
    let mut core = core();
    let mut wrong = Vec::new();
    while !reader.0.is_empty() {
        match reader.byte() {
            b'S' => {
                let seed = reader.word();
                let code: Vec<u16> = (0..reader.byte()).map(|_| reader.half()).collect();
                let expected = State {
                    registers: std::array::from_fn(|_| reader.word()),
                    xpsr: reader.word(),
                    digest: reader.word(),
                };
                streams += 1;
                begin(&mut core, seed, &code);
                match run_to(&mut core, BEGIN + 2 * code.len() as u32) {
                    Some((Stop::Refused(Refusal::Unpredictable), _)) => unpredictable += 1,
                    Some((stop, at)) => {
                        let at = &code[(at - BEGIN) as usize / 2..];
                        wrong.push(format!(
                            "{seed:#x} {code:04x?}: {stop:?} at {at:04x?}, CFSR {:#x}",
                            core.fault_status()[0]
                        ));
                    }
                    None => {
                        let state = State {
                            registers: std::array::from_fn(|n| core.register(Register::R(n as u8))),
                            xpsr: core.register(Register::Xpsr),
                            digest: digest(&core.memory().ram()[..RAM_SIZE]),
                        };
                        if state != expected {
                            wrong.push(format!(
                                "{seed:#x} {code:04x?}:\n    {state:x?}, expected\n    {expected:x?}"
                            ));
                        }
                    }
                }
            }
            b'U' => {
                let code = [reader.half(), reader.half()];
                undefined += 1;
                begin(&mut core, 1, &code);
                let stop = run_to(&mut core, BEGIN + 4);
                // The UsageFault is escalated, and the vector table has no T bits.
                let [cfsr, ..] = core.fault_status();
                let refused = matches!(stop, Some((Stop::Refused(Refusal::Unpredictable), _)));
                if cfsr & 1 << 16 == 0 && !refused {
                    wrong.push(format!("{code:04x?} is not undefined: {stop:?}"));
                }
            }
            other => panic!("a record of kind {other}"),
        }
    }
    println!(
        "{streams} streams, {unpredictable} of them to an UNPREDICTABLE instruction; {undefined} undefined encodings"
    );
    println!(
        "{} differ:\n{}",
        wrong.len(),
        wrong.iter().take(40).cloned().collect::<Vec<_>>().join("\n")
    );
    assert!(wrong.is_empty());
    assert!(streams >= 1000 && unpredictable < streams / 4 && undefined >= 1000);
}
