//! The microcontrollers, peripheral by peripheral.

use std::collections::BTreeMap;

use self::common::mcu::{Mcu, Peripherals};
use self::stm32f405::{ArmUart, Reenabled, Stm32f405};
use self::stm32g431::{EccRegister, Stm32g431};
use crate::chip::Chip;
use crate::engine::Engine;
use crate::error::Error;
use crate::report::Crash;
use crate::rp2040::Rp2040;
use crate::shared::lock;
use crate::soc::gdb::Debugger;
use crate::soc::machine::{Edges, Machine};

pub(crate) mod common;
pub(crate) mod stm32f405;
pub(crate) mod stm32g431;

/// The properties of a microcontroller, and its connections.
#[derive(Debug)]
pub(crate) struct Setup {
    pub(crate) unique_id: [u8; 12],
    /// DBGMCU_IDCODE of the STM32F405.
    pub(crate) idcode: u32,
    /// The UART of the STM32F405 with the arm.
    pub(crate) arm_uart: ArmUart,
    pub(crate) reenabled: Reenabled,
    pub(crate) ecc_register: EccRegister,
    pub(crate) seed: u64,
    /// The virtual duration of a cycle, in percent.
    pub(crate) cycle_cost: u32,
    /// True for the cycles of a Cortex-M4 with this flash.
    pub(crate) exact: bool,
    /// Functions that run only in a crash of the firmware.
    pub(crate) crashes: BTreeMap<u32, Crash>,
    /// The address of the firmware's log, if it has one.
    pub(crate) log: Option<u32>,
    pub(crate) debugger: Option<Debugger>,
    pub(crate) edges: Edges,
}

impl Setup {
    /// The machine at power-on.
    ///
    /// This function is not generic: the models are compiled with this crate, which is optimised in tests, too, and not
    /// with the crate of the arm.
    ///
    /// # Errors
    ///
    /// If the emulator of an RP2040 cannot be started.
    pub(crate) fn engine(self, chip: Chip) -> Result<Box<dyn Engine>, Error> {
        Ok(match chip {
            Chip::Stm32f405 => {
                let peripherals = Stm32f405::new(self.idcode, self.arm_uart, self.reenabled, self.seed, &self.edges);
                self.machine(peripherals)
            }
            Chip::Stm32g431 => {
                let peripherals = Stm32g431::new(self.ecc_register, self.seed, &self.edges);
                self.machine(peripherals)
            }
            Chip::Rp2040 => Box::new(Rp2040::start(self)?),
        })
    }

    fn machine<P: Peripherals + 'static>(self, peripherals: P) -> Box<dyn Engine> {
        let flash = lock(&self.edges.flash).bytes().to_vec();
        let core = Mcu::<P>::core(flash);
        let mcu = Mcu::new(peripherals, self.unique_id, self.cycle_cost, self.edges);
        Box::new(Machine::new(
            core,
            mcu,
            self.exact,
            self.crashes,
            self.log,
            self.debugger,
        ))
    }
}
