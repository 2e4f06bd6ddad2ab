//! The boot loader in the chip's ROM: a drive on USB that takes UF2 files (2.8.4).

/// Starts the boot loader. It resets the chip's peripherals itself.
pub(crate) fn enter_boot_loader() -> ! {
    // No pin shows activity, and both interfaces, the drive and PICOBOOT, are on.
    embassy_rp::rom_data::reset_to_usb_boot(0, 0);
    loop {
        cortex_m::asm::nop();
    }
}
