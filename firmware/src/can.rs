//! The CAN bus: frames between the controller and the bridge.

use core::future::pending;

use armwire_bridge::config;
use armwire_bridge::{CanErrors, CanEvent};
use embassy_futures::select::{Either3, select3};
use embassy_futures::yield_now;
use embassy_time::{Duration, Instant, with_timeout};

use crate::adapter::{Adapter, Work};
use crate::board::{CAN_CAPACITY, Can};
use crate::clock::now;
use crate::progress::{Task, progress, rest};

/// Maximum time to send the controller's frames before a restart.
const DRAIN_TIMEOUT: Duration = Duration::from_millis(10);

/// Time without an error after which the bus counts as recovered. While the cause of bus-off lasts, the controller
/// returns to the bus for a moment every 2 to 15 ms.
const RECOVERY_TIME: Duration = Duration::from_millis(20);

/// Serves the bus.
#[embassy_executor::task]
pub(crate) async fn run(adapter: &'static Adapter, mut can: Can) {
    if let Some(config) = adapter.take(|bridge| bridge.can_config()) {
        start(&mut can, &config);
    }
    // The last time in bus-off, or with an error after it.
    let mut bus_off_at: Option<Instant> = None;
    loop {
        progress(Task::Can);
        // All frames up to now are handed over in this round.
        adapter.reset(Work::Can);
        if adapter.take(|bridge| bridge.can_event(CanEvent::Waiting(can.waiting()), now())) {
            adapter.wake(Work::Dispatch);
        }
        // One frame at a time: a full bus must not delay the arm. One round handles at most the frames that can be
        // queued at its start: later frames cause another event.
        for _ in 0..CAN_CAPACITY {
            if !receive(adapter, &mut can) {
                break;
            }
            yield_now().await;
        }
        let errors = can.take_errors();
        if errors != CanErrors::default() {
            adapter.with(|bridge| bridge.can_event(CanEvent::Errors(errors), now()));
        }
        if can.take_bus_off() {
            if bus_off_at.is_none() {
                adapter.with(|bridge| bridge.can_event(CanEvent::BusOff, now()));
            }
            bus_off_at = Some(Instant::now());
        } else if bus_off_at.is_some() && errors.bus > 0 {
            bus_off_at = Some(Instant::now());
        } else if bus_off_at.take_if(|at| at.elapsed() >= RECOVERY_TIME).is_some() {
            adapter.with(|bridge| bridge.can_event(CanEvent::BusOn, now()));
        }
        // Frames without room in the controller wait in the bridge, where more urgent frames overtake them.
        while transmit(adapter, &mut can) {
            yield_now().await;
        }
        let room = can.has_room();
        let frame = async {
            match room {
                true => adapter.wait(Work::Can).await,
                false => pending().await,
            }
        };
        let happened = select3(can.event(), frame, adapter.can_restart.wait());
        let resting = rest(Task::Can);
        let happened = happened.await;
        drop(resting);
        if let Either3::Third(config) = happened {
            let drained = async {
                while can.waiting() > 0 {
                    can.event().await;
                }
            };
            let _ = with_timeout(DRAIN_TIMEOUT, drained).await;
            start(&mut can, &config);
        }
    }
}

/// Starts the controller with this configuration.
fn start(can: &mut Can, config: &config::Can) {
    info!("CAN: {}", config);
    can.start(config);
}

// These two functions keep frames out of the task's state, where they would be copied byte by byte.

/// Passes a frame from the controller to the bridge. Returns false if there was none.
fn receive(adapter: &Adapter, can: &mut Can) -> bool {
    let frame = can.receive();
    if let Some(frame) = &frame {
        adapter.with(|bridge| bridge.can_received(frame, now()));
    }
    frame.is_some()
}

/// Passes a frame from the bridge to the controller. Returns false if there was none, or no room for it.
fn transmit(adapter: &Adapter, can: &mut Can) -> bool {
    if !can.has_room() {
        return false;
    }
    let Some(frame) = adapter.take(|bridge| bridge.can_transmit(now())) else {
        return false;
    };
    can.transmit(&frame);
    adapter.wake(Work::Dispatch);
    true
}
