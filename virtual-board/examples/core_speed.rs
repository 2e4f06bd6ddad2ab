//! Prints how many instructions a second the core executes, in functions of the firmware's image:
//!
//! ```console
//! $ cargo run -p armwire-virtual-board --example core_speed -- firmware.elf
//! ```

use std::time::{Duration, Instant};

use armwire_virtual_board::core::{Access, Bus, BusError, Config, Core, FlashTiming, Memory, Register, Stop, Timing};
use object::{Object, ObjectSegment, ObjectSymbol};

const FLASH: u32 = 0x0800_0000;
const RAM: u32 = 0x2000_0000;
const FLASH_SIZE: usize = 1024 * 1024;
const RAM_SIZE: usize = 128 * 1024;

/// Functions by the ends of their names, and what they are called with.
const FUNCTIONS: [(&str, [u32; 3]); 3] = [
    ("ling::crc::crc32", [RAM, 124, 0]),
    ("mem::memcpy", [RAM + 0x1000, RAM + 1, 1000]),
    ("__aeabi_memcpy4", [RAM + 0x1000, RAM, 1000]),
];

/// Where the functions return to: beyond the image.
const RETURN: u32 = FLASH + 0x4_0000;

/// How long each is called.
const TIME: Duration = Duration::from_millis(500);

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

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args_os().nth(1).ok_or("the path of an image is missing")?;
    let bytes = std::fs::read(path)?;
    let file = object::File::parse(&*bytes)?;
    let mut flash = vec![0xff; FLASH_SIZE];
    for segment in file.segments() {
        let at = (segment.address() as u32).wrapping_sub(FLASH) as usize;
        let data = segment.data()?;
        if let Some(part) = flash.get_mut(at..at.saturating_add(data.len())) {
            part.copy_from_slice(data);
        }
    }
    let config = Config {
        interrupts: 82,
        priority_bits: 4,
        vector_table: FLASH,
        mpu_regions: 8,
        bit_band: true,
    };
    let mut core = Core::new(config, Memory::new(FLASH, flash, RAM, RAM_SIZE));
    let silicon = FlashTiming {
        wait_states: 5,
        line_bytes: 16,
        code_lines: 64,
        data_lines: 8,
        prefetch: true,
    };
    for (name, arguments) in FUNCTIONS {
        let is_it = |symbol: &str| {
            // Without the hash.
            let plain = symbol.split("17h").next().unwrap_or(symbol);
            plain.trim_end_matches('E').ends_with(&mangled(name))
        };
        let symbols = || {
            file.symbols()
                .filter_map(|symbol| Some((symbol.name().ok()?, symbol.address() as u32)))
        };
        let Some((_, entry)) = symbols().find(|(symbol, _)| is_it(symbol)) else {
            println!("{name}: not in the image");
            continue;
        };
        for (label, timing) in [
            ("one cycle", Timing::OneCycle),
            ("Cortex-M4", Timing::CortexM4(silicon)),
        ] {
            core.set_timing(timing);
            core.reset(&mut Nothing);
            core.set_breakpoint(RETURN);
            let begin = Instant::now();
            let (used, instructions, cycles) = (cpu_time(begin), core.instructions(), core.cycle());
            while begin.elapsed() < TIME {
                for _ in 0..100 {
                    call(&mut core, entry, arguments)?;
                }
            }
            let executed = (core.instructions() - instructions) as f64;
            let seconds = (cpu_time(begin) - used).as_secs_f64();
            println!(
                "{name}, {label}: {:.0} million instructions a second, {:.2} cycles an instruction",
                executed / seconds / 1e6,
                (core.cycle() - cycles) as f64 / executed
            );
        }
    }
    Ok(())
}

/// The time that this thread has had a processor, where the system tells it; else the time since `begin`.
fn cpu_time(begin: Instant) -> Duration {
    let schedule = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanos = schedule.and_then(|line| line.split(' ').next()?.parse().ok());
    nanos.map_or_else(|| begin.elapsed(), Duration::from_nanos)
}

/// A path's last parts as a symbol has them: each with its length.
fn mangled(name: &str) -> String {
    if !name.contains("::") {
        return name.to_owned();
    }
    name.split("::").map(|part| format!("{}{part}", part.len())).collect()
}

/// Calls a function, and runs until it returns.
fn call(core: &mut Core, entry: u32, arguments: [u32; 3]) -> Result<(), String> {
    for (number, argument) in (0..).zip(arguments) {
        core.set_register(Register::R(number), argument);
    }
    core.set_register(Register::R(13), RAM + RAM_SIZE as u32);
    core.set_register(Register::R(14), RETURN | 1);
    core.set_register(Register::R(15), entry);
    match core.run(&mut Nothing, core.cycle() + 1_000_000) {
        Stop::Breakpoint => Ok(()),
        stop => Err(format!("{stop:?} at {:#x}", core.pc())),
    }
}
