//! The boot loader in the chip's ROM (AN2606).

use cortex_m::peripheral::SCB;
use embassy_stm32::pac;

/// Where the ROM lies (RM0090 table 5).
const ROM: *const u32 = 0x1FFF_0000 as *const u32;
/// The ROM instead of the flash at address 0 (RM0090 9.2.1).
const ROM_AT_0: u8 = 0b01;

/// Starts the boot loader. To be called before anything is set up, since it takes the chip to be as after a reset.
pub(crate) fn enter_boot_loader() -> ! {
    pac::RCC.apb2enr().modify(|w| w.set_syscfgen(true));
    pac::SYSCFG.memrm().modify(|w| w.set_mem_mode(ROM_AT_0));
    // SAFETY: there is a vector table at the beginning of the ROM, which address 0 shows, and no interrupt is on.
    unsafe {
        // Where interrupts look for their vectors after a reset. The firmware has had them look in the flash.
        (*SCB::PTR).vtor.write(0);
        cortex_m::asm::bootload(ROM)
    }
}
