//! The CAN bus: frames between the controller and the bridge.

use core::future::pending;

use armwire_bridge::{CanErrors, CanEvent};
use embassy_futures::select::{Either3, select3};
use embassy_futures::yield_now;
use embassy_time::{Duration, Instant, with_timeout};

use crate::adapter::{Adapter, Work, now};
use crate::board::{CAN_CAPACITY, Can};
use crate::watchdog::{Task, progress, rest};

/// How long frames that the controller has may take to leave before it is set up anew.
const PARTING: Duration = Duration::from_millis(10);

/// For how long the bus must be without an error to count as back. As long as what took it away lasts, the controller
/// comes back for a moment and goes again, every 2 to 15 ms.
const CALM: Duration = Duration::from_millis(20);

/// Serves the bus.
#[embassy_executor::task]
pub(crate) async fn run(adapter: &'static Adapter, mut can: Can) {
    can.start(&adapter.take(|bridge| bridge.config().can));
    // When the bus was last seen lost, or in trouble after that.
    let mut lost: Option<Instant> = None;
    loop {
        progress(Task::Can);
        if adapter.take(|bridge| bridge.can_event(CanEvent::Waiting(can.waiting()), now())) {
            adapter.wake(Work::Dispatch);
        }
        // One frame at a time: a full bus must not keep the arm waiting. No more in one round than there can be at its
        // start: of those that come later there is an event.
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
            if lost.is_none() {
                adapter.with(|bridge| bridge.can_event(CanEvent::BusOff, now()));
            }
            lost = Some(Instant::now());
        } else if lost.is_some() && errors.bus > 0 {
            lost = Some(Instant::now());
        } else if lost.take_if(|lost| lost.elapsed() >= CALM).is_some() {
            adapter.with(|bridge| bridge.can_event(CanEvent::BusOn, now()));
        }
        // What the controller has no room for waits in the bridge, where what is more urgent overtakes it.
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
            let parted = async {
                while can.waiting() > 0 {
                    can.event().await;
                }
            };
            let _ = with_timeout(PARTING, parted).await;
            can.start(&config);
        }
    }
}

// A frame that lives in a task is copied there byte by byte: these two are no part of it.

/// Passes a frame from the controller to the bridge, and returns whether there was one.
fn receive(adapter: &Adapter, can: &mut Can) -> bool {
    let frame = can.receive();
    if let Some(frame) = &frame {
        adapter.with(|bridge| bridge.can_received(frame, now()));
    }
    frame.is_some()
}

/// Passes a frame from the bridge to the controller, and returns whether there was one, and room for it.
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
