//! The status LED.
//!
//! | Pattern | Meaning |
//! |---|---|
//! | short flash each second | running, no host |
//! | on | a host has found the adapter |
//! | flickering | bytes are passing |
//! | two short flashes each second | factory settings after crashed starts |
//!
//! Before the tasks run, the board may show that its crystal does not start.

use embassy_time::Timer;

use crate::adapter::{Adapter, Work};
use crate::board::Led;

/// One step of a pattern.
const STEP_MS: u64 = 50;

/// Shows the adapter's state.
#[embassy_executor::task]
pub(crate) async fn show(adapter: &'static Adapter, mut led: Led) {
    let mut passed = 0;
    for step in (0..20_u32).cycle() {
        // Bytes outside of frames cause no dispatch.
        adapter.wake(Work::Dispatch);
        let status = adapter.status();
        let on = match (status.is_attached, status.passed_bytes != passed) {
            _ if status.is_in_recovery => matches!(step, 0 | 4),
            (_, true) => step % 2 == 0,
            (true, false) => true,
            (false, false) => step == 0,
        };
        led.set(on);
        passed = status.passed_bytes;
        Timer::after_millis(STEP_MS).await;
    }
}
