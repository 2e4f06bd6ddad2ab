//! Saves to flash under load: no byte is lost, and the saved configuration survives a restart.

use armwire_bridge::config::{Config, HostTimeout};
use armwire_bridge::control::{Failure, Reply, Request};
use armwire_host::settings::object;
use serde_json::json;

use super::bench::{Bench, at, losses, payload, quiet, unexpected};
use super::report::{Passed, Trouble, ensure};
use super::{Checked, Plan, identify, planned};

/// Bytes echoed during each save.
const BYTES: usize = 2_000;
/// Host timeouts without torque-off, in milliseconds: a different value in each save, without any effect.
const TIMEOUT_MS: u16 = 60_000;

/// Saves other configurations during an echo, then restores the original one.
pub(super) fn under_load(bench: &mut Bench<'_>, plan: &Plan) -> Checked {
    planned(plan.saves)?;
    // An adapter starts with its saved configuration.
    bench.restart()?;
    let (identity, saved) = (identify(bench)?, bench.config()?);
    bench.open()?;
    let result = save_all(bench, &saved, plan);
    // A failed restore counts more than the reason for which the saves ended.
    restore(bench, &saved).map_err(|trouble| {
        let config = object(&saved, &identity);
        Trouble::failed(format_args!(
            "the configuration of before is not in flash: {trouble}; it was {config}"
        ))
    })?;
    result?;
    let text = format!(
        "{} under load, no byte lost, the last one survived a restart",
        plan.saves
    );
    Ok(Passed::new(text, [("saves", json!(plan.saves))]))
}

fn save_all(bench: &mut Bench<'_>, saved: &Config, plan: &Plan) -> Result<(), Trouble> {
    let mut config = *saved;
    for nth in 0..plan.saves {
        config = other(saved, nth);
        save_one(bench, &config, nth).map_err(at(format_args!("save {nth}")))?;
    }
    bench.restart()?;
    ensure(
        bench.config()? == config,
        "after a restart the configuration is not the last one saved",
    )?;
    bench.open()
}

/// A configuration that differs from the one saved last.
fn other(saved: &Config, nth: u32) -> Config {
    Config {
        host_timeout: HostTimeout {
            after_ms: TIMEOUT_MS + (nth % 100) as u16,
            torque_off: false,
        },
        ..quiet(saved)
    }
}

fn save_one(bench: &mut Bench<'_>, config: &Config, nth: u32) -> Result<(), Trouble> {
    bench.order(Request::SetConfig(*config))?;
    let before = bench.counters()?;
    let mut is_saved = false;
    bench.echo_with(&payload(nth.into(), BYTES), |bench| {
        match std::mem::replace(&mut is_saved, true) {
            true => Ok(()),
            false => save(bench),
        }
    })?;
    let after = bench.counters()?;
    match losses(&before, &after) {
        Some(losses) => Err(Trouble::failed(losses)),
        None => ensure(after.config_saves != before.config_saves, "nothing was written"),
    }
}

fn save(bench: &mut Bench<'_>) -> Result<(), Trouble> {
    match bench.call(Request::SaveConfig)? {
        Reply::Done => Ok(()),
        Reply::Failed(Failure::TooManySaves { wait_s }) => Err(Trouble::NotTried(format!(
            "the adapter has saved so often that it saves no more for {wait_s} s"
        ))),
        reply => Err(unexpected(&Request::SaveConfig, &reply)),
    }
}

/// Saves the original configuration.
fn restore(bench: &mut Bench<'_>, saved: &Config) -> Result<(), Trouble> {
    if *saved == Config::default() {
        return bench.order(Request::ResetConfig);
    }
    bench.order(Request::SetConfig(*saved))?;
    save(bench)
}
