//! A core with a little memory, a few registers, and a handler for each exception.

use std::collections::BTreeMap;

use armwire_virtual_board::core::{Access, Bus, BusError, Config, Core, Memory, Register, Stop};

pub(crate) const FLASH: u32 = 0x0800_0000;
pub(crate) const RAM: u32 = 0x2000_0000;
pub(crate) const STACK: u32 = RAM + 0x800;
/// Start of the program.
pub(crate) const CODE: u32 = FLASH + 0x400;
/// Handlers have 32 bytes each.
const HANDLERS: u32 = FLASH + 0x800;
/// A register of a peripheral.
pub(crate) const PERIPHERAL: u32 = 0x4000_0000;
/// A write here requests attention.
pub(crate) const BELL: u32 = 0x4000_0100;

pub(crate) const CONFIG: Config = Config {
    interrupts: 40,
    priority_bits: 4,
    vector_table: FLASH,
    mpu_regions: 8,
    bit_band: true,
};

/// Registers of a page, and nothing else.
#[derive(Default)]
pub(crate) struct Registers {
    pub(crate) values: BTreeMap<u32, u32>,
    pub(crate) accesses: Vec<(Access, Option<u32>)>,
    pub(crate) attention: bool,
}

impl Bus for Registers {
    fn read(&mut self, access: Access, _: &mut Memory) -> Result<u32, BusError> {
        self.accesses.push((access, None));
        if access.address >> 12 != PERIPHERAL >> 12 {
            return Err(BusError);
        }
        Ok(self.values.get(&access.address).copied().unwrap_or(0))
    }

    fn write(&mut self, access: Access, value: u32, _: &mut Memory) -> Result<(), BusError> {
        self.accesses.push((access, Some(value)));
        if access.address >> 12 != PERIPHERAL >> 12 {
            return Err(BusError);
        }
        self.values.insert(access.address, value);
        self.attention |= access.address == BELL;
        Ok(())
    }

    fn needs_attention(&self) -> bool {
        self.attention
    }
}

pub(crate) struct Board {
    pub(crate) core: Core,
    pub(crate) bus: Registers,
}

impl Board {
    /// A board whose program is this, after its reset. Handlers are endless loops.
    pub(crate) fn new(code: &[u16]) -> Self {
        let mut flash = vec![0xff; 0x1000];
        flash[..4].copy_from_slice(&STACK.to_le_bytes());
        flash[4..8].copy_from_slice(&(CODE | 1).to_le_bytes());
        for number in 2..56 {
            let at = 4 * number as usize;
            flash[at..at + 4].copy_from_slice(&(handler(number) | 1).to_le_bytes());
        }
        let mut board = Self {
            core: Core::new(CONFIG, Memory::new(FLASH, flash, RAM, 0x1000)),
            bus: Registers::default(),
        };
        for number in 2..56 {
            // b .
            board.set_code(handler(number), &[0xe7fe]);
        }
        board.set_code(CODE, code);
        board.core.reset(&mut board.bus);
        board
    }

    pub(crate) fn set_code(&mut self, address: u32, code: &[u16]) {
        let bytes: Vec<u8> = code.iter().flat_map(|half| half.to_le_bytes()).collect();
        self.core
            .memory_mut()
            .program((address - FLASH) as usize, &bytes)
            .unwrap();
    }

    pub(crate) fn set_handler(&mut self, exception: u32, code: &[u16]) {
        self.set_code(handler(exception), code);
    }

    pub(crate) fn r(&self, number: u8) -> u32 {
        self.core.register(Register::R(number))
    }

    pub(crate) fn set(&mut self, number: u8, value: u32) {
        self.core.set_register(Register::R(number), value);
    }

    /// Condition flags, N first.
    pub(crate) fn nzcv(&self) -> u32 {
        self.core.register(Register::Xpsr) >> 28
    }

    pub(crate) fn set_nzcv(&mut self, nzcv: u32) {
        self.core.set_register(Register::Xpsr, nzcv << 28 | 1 << 24);
    }

    /// The number of the active exception.
    pub(crate) fn exception(&self) -> u32 {
        self.core.register(Register::Xpsr) & 0x1ff
    }

    pub(crate) fn word(&self, address: u32) -> u32 {
        self.core
            .memory()
            .read(address, armwire_virtual_board::core::Width::Word)
            .unwrap()
    }

    pub(crate) fn set_word(&mut self, address: u32, value: u32) {
        let width = armwire_virtual_board::core::Width::Word;
        self.core.memory_mut().write(address, width, value).unwrap();
    }

    /// Executes this many instructions. An exception is entered before its handler's first one.
    pub(crate) fn step(&mut self, instructions: u64) -> Stop {
        let until = self.core.instructions() + instructions;
        while self.core.instructions() < until {
            match self.core.run(&mut self.bus, self.core.cycle() + 1) {
                Stop::Deadline => {}
                stop => return stop,
            }
        }
        Stop::Deadline
    }

    /// Runs for this many cycles.
    pub(crate) fn run(&mut self, cycles: u64) -> Stop {
        self.core.run(&mut self.bus, self.core.cycle() + cycles)
    }
}

/// The address of an exception's handler.
pub(crate) fn handler(exception: u32) -> u32 {
    HANDLERS + 32 * exception
}
