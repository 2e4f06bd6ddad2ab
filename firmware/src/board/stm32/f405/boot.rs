//! The boot loader in the chip's ROM (AN2606).

use cortex_m::peripheral::SCB;
use embassy_stm32::pac;

use super::super::rcc::enable_clocks;

/// The address of the ROM (RM0090 table 5).
const ROM: *const u32 = 0x1FFF_0000 as *const u32;
/// Maps the ROM instead of the flash at address 0 (RM0090 9.2.1).
const ROM_AT_0: u8 = 0b01;

/// Starts the boot loader. Call this before any initialisation: it expects the chip's reset state.
pub(crate) fn enter_boot_loader() -> ! {
    enable_clocks(pac::RCC.apb2enr(), |w| w.set_syscfgen(true));
    pac::SYSCFG.memrm().modify(|w| w.set_mem_mode(ROM_AT_0));
    // SAFETY: the ROM, now mapped at address 0, begins with a vector table, and no interrupt is enabled.
    unsafe {
        // The reset value of the vector table's address. The firmware's table is in flash.
        (*SCB::PTR).vtor.write(0);
        cortex_m::asm::bootload(ROM)
    }
}
