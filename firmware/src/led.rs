//! The status LED.
//!
//! | Pattern | Meaning |
//! |---|---|
//! | short flash each second | running, no host |
//! | on | a host has found the adapter |
//! | flickering | bytes are passing |
//!
//! Before the tasks run, the board may show that its crystal does not.

use embassy_stm32::gpio::Output;
use embassy_time::Timer;

use crate::adapter::{Adapter, now};

/// One step of a pattern.
const STEP_MS: u64 = 50;

/// Shows the adapter's state.
#[embassy_executor::task]
pub(crate) async fn show(adapter: &'static Adapter, mut led: Output<'static>) {
    let mut passed = 0;
    for step in (0..20_u32).cycle() {
        let (attached, total) = adapter.take(|bridge| {
            let is_attached = bridge.status(now()).is_attached;
            let counters = bridge.counters();
            let total = counters.arm_to_host_bytes.wrapping_add(counters.host_to_arm_bytes);
            (is_attached, total)
        });
        let on = match (attached, total != passed) {
            (_, true) => step % 2 == 0,
            (true, false) => true,
            (false, false) => step == 0,
        };
        led.set_level(on.into());
        passed = total;
        Timer::after_millis(STEP_MS).await;
    }
}
