//! The sleep of the core while no task runs.

use embassy_stm32::Config;

/// The configuration of the HAL, which stops the core's clock in sleep. With the clock kept for a debugger, a wrong instruction
/// may follow the sleep (ES0182, "Debugging Sleep/Stop mode with WFE/WFI entry"). A probe that reads a log needs it.
pub(super) fn hal_config() -> Config {
    let mut config = Config::default();
    config.enable_debug_during_sleep = cfg!(feature = "defmt");
    config
}
