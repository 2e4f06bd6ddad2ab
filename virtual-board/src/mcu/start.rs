//! The machine of a chip, at power-on.

use super::Setup;
use super::common::mcu::{Mcu, Peripherals};
use super::stm32f405::Stm32f405;
use super::stm32g431::Stm32g431;
use crate::chip::Chip;
use crate::engine::Engine;
use crate::error::Error;
use crate::rp2040::Rp2040;
use crate::shared::lock;
use crate::soc::machine::Machine;

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
                let peripherals = Stm32f405::new(
                    self.idcode,
                    self.arm_uart,
                    self.reenabled,
                    self.otg,
                    self.seed,
                    &self.edges,
                );
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
        let mut mcu = Mcu::new(peripherals, self.unique_id, self.cycle_cost, self.seed, self.edges);
        let core = mcu.core(flash);
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
