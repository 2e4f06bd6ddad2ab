//! What the bridge decides and only firmware can do: keep the configuration in flash, and start again.
//!
//! The F405 can fetch no code from its flash while that is erased or written, so the core stands still: for 250 ms, and
//! 500 ms at worst, when a sector of 16 kB is erased, which is once in some hundred times that a configuration is saved.
//! Meanwhile USB and CAN answer nothing, and bytes from the arm are lost and counted as an overrun of the ring. The
//! watchdog waits longer.

use armwire_bridge::Action;
use armwire_bridge::config::Config;
use armwire_bridge::control::Failure;
use armwire_bridge::store::{Error, Saved, Store};
use embassy_futures::block_on;
use embassy_time::Timer;

use crate::adapter::{Adapter, Work, now};
use crate::board::{CONFIG_FLASH, ConfigFlash, FlashError, is_supply_low};
use crate::restart;
use crate::watchdog::{Task, rest};

/// How long a reply may take to reach the host before its adapter starts again.
const PARTING_MS: u64 = 100;

/// Where the configuration is kept.
pub(crate) fn store(flash: ConfigFlash) -> Store<ConfigFlash> {
    // It fails only for a range that is not of whole pages.
    Store::new(flash, CONFIG_FLASH).unwrap()
}

/// The configuration that was saved, or as from the factory if there is none, or none that can be read; and whether
/// that is so.
pub(crate) fn load(store: &mut Store<ConfigFlash>) -> (Config, bool) {
    match block_on(store.load()) {
        Ok(Saved::Config(config)) => (config, false),
        Ok(Saved::Nothing) => (Config::default(), false),
        Ok(Saved::Unreadable) | Err(_) => (Config::default(), true),
    }
}

/// What the host hears of it.
fn failure(error: Error<FlashError>) -> Failure {
    match error {
        Error::Flash(error) if is_supply_low(&error) => Failure::SupplyLow,
        error => error.into(),
    }
}

/// Does what the bridge asks for.
#[embassy_executor::task]
pub(crate) async fn run(adapter: &'static Adapter, mut store: Store<ConfigFlash>) {
    loop {
        let resting = rest(Task::Action);
        let action = adapter.action.wait().await;
        drop(resting);
        // There may be another.
        adapter.wake(Work::Dispatch);
        match action {
            Action::Save(config) => {
                let result = block_on(store.save(&config, now())).map_err(failure);
                adapter.with(|bridge| bridge.saved(result, now()));
            }
            Action::Reset => {
                let result = block_on(store.reset(now())).map_err(failure);
                adapter.with(|bridge| bridge.saved(result, now()));
            }
            Action::RestartCan(config) => adapter.can_restart.signal(config),
            Action::Restart => {
                Timer::after_millis(PARTING_MS).await;
                restart::restart();
            }
            Action::RestartIntoBootLoader => {
                Timer::after_millis(PARTING_MS).await;
                restart::restart_into_boot_loader();
            }
        }
    }
}
