//! Actions of the bridge that only firmware can take: writing the configuration to flash, and restarts.
//!
//! The F405 cannot fetch code from its flash during an erase or a write. The core stalls for 250 ms, and 500 ms at
//! worst, while a sector of 16 kB is erased. This happens once in some hundred saves: at the next start, or earlier in a
//! save while no host has the serial port open. USB and CAN do not respond meanwhile, and bytes from the arm are lost and
//! counted as an overrun of the ring. A store that crashed its load is replaced by the erase of both sectors. The
//! watchdog's timeout is longer.

use armwire_bridge::config::Config;
use armwire_bridge::control::Failure;
use armwire_bridge::store::{Error, Saved, Store};
use armwire_bridge::{Action, Erase};
use embassy_futures::block_on;
use embassy_time::Timer;

use crate::adapter::{Adapter, Work};
use crate::board::{CONFIG_FLASH, ConfigFlash, FlashError, is_supply_low};
use crate::clock::now;
use crate::progress::{Task, rest};
use crate::restart;

/// Maximum time for a reply to reach the host before a restart.
const RESTART_DELAY_MS: u64 = 100;

/// The store of the configuration.
pub(crate) fn store(flash: ConfigFlash) -> Store<ConfigFlash> {
    // It fails only for a range with partial pages.
    Store::new(flash, CONFIG_FLASH).unwrap()
}

/// The saved configuration, or the factory defaults without a readable one; and true if it was unreadable.
pub(crate) fn load(store: &mut Store<ConfigFlash>) -> (Config, bool) {
    match read(store) {
        Ok(Saved::Config(config)) => (config, false),
        Ok(Saved::Nothing) => (Config::default(), false),
        Ok(Saved::Unreadable) | Err(_) => (Config::default(), true),
    }
}

// Not inlined: second copies take 4 kB.

/// Reads the configuration in flash.
#[inline(never)]
fn read(store: &mut Store<ConfigFlash>) -> Result<Saved, Failure> {
    block_on(store.load()).map_err(failure)
}

/// Makes room for saves that may not erase.
#[inline(never)]
pub(crate) fn prepare(store: &mut Store<ConfigFlash>) {
    log("prepared", block_on(store.prepare()).map_err(failure));
}

/// Writes a configuration to flash.
#[inline(never)]
fn save(store: &mut Store<ConfigFlash>, config: &Config, allowed: Erase) -> Result<(), Failure> {
    block_on(store.save(config, now(), allowed)).map_err(failure)
}

/// Erases the flash of the configuration without reading it.
#[inline(never)]
fn erase(store: &mut Store<ConfigFlash>) -> Result<(), Failure> {
    block_on(store.erase()).map_err(failure)
}

/// The failure that is reported to the host.
fn failure(error: Error<FlashError>) -> Failure {
    match error {
        Error::Flash(error) if is_supply_low(&error) => Failure::SupplyLow,
        error => error.into(),
    }
}

/// Logs that the configuration was `done`, or the failure.
fn log(done: &str, result: Result<(), Failure>) {
    match result {
        Ok(()) => info!("configuration {=str}", done),
        Err(failure) => warning!("configuration not {=str}: {}", done, failure),
    }
}

/// Executes the bridge's actions.
#[embassy_executor::task]
pub(crate) async fn run(adapter: &'static Adapter, mut store: Store<ConfigFlash>) {
    loop {
        let resting = rest(Task::Action);
        let action = adapter.action.wait().await;
        drop(resting);
        // Another action may be pending.
        adapter.wake(Work::Dispatch);
        match action {
            Action::Save(config, allowed) => {
                let result = save(&mut store, &config, allowed);
                log("saved", result);
                adapter.with(|bridge| bridge.saved(result, now()));
            }
            Action::Reset(allowed) => {
                let result = block_on(store.reset(now(), allowed)).map_err(failure);
                log("erased", result);
                adapter.with(|bridge| bridge.saved(result, now()));
            }
            Action::Replace(config) => {
                let result = erase(&mut store).and_then(|()| save(&mut store, &config, Erase::Allowed));
                log("saved", result);
                adapter.with(|bridge| bridge.saved(result, now()));
            }
            Action::Erase => {
                let result = erase(&mut store);
                log("erased", result);
                adapter.with(|bridge| bridge.saved(result, now()));
            }
            Action::Load => {
                let result = read(&mut store);
                adapter.with(|bridge| bridge.loaded(result, now()));
            }
            Action::RestartCan(config) => adapter.can_restart.signal(config),
            Action::Restart => {
                info!("a host requested a restart");
                Timer::after_millis(RESTART_DELAY_MS).await;
                restart::restart();
            }
            Action::RestartIntoBootLoader => {
                info!("a host requested the boot loader");
                Timer::after_millis(RESTART_DELAY_MS).await;
                restart::restart_into_boot_loader();
            }
        }
    }
}
