//! The CAN bus: frames between the controller and the bridge.

use core::future::pending;

use armwire_bridge::CanErrors;
use embassy_futures::select::{Either3, select3};
use embassy_futures::yield_now;
use embassy_time::{Duration, with_timeout};

use crate::adapter::{Adapter, now};
use crate::board::Can;
use crate::watchdog::{Task, progress, rest};

/// How long frames that the controller has may take to leave before it is set up anew.
const PARTING: Duration = Duration::from_millis(10);

/// Serves the bus.
#[embassy_executor::task]
pub(crate) async fn run(adapter: &'static Adapter, mut can: Can) {
    can.start(&adapter.look(|bridge| bridge.can_config()));
    let mut was_off = false;
    loop {
        progress(Task::Can);
        // One frame at a time: a full bus must not keep the arm waiting.
        while let Some(frame) = can.receive() {
            adapter.with(|bridge| bridge.can_received(&frame, now()));
            yield_now().await;
        }
        let errors = can.take_errors();
        if errors != CanErrors::default() {
            adapter.with(|bridge| bridge.can_errors(errors));
        }
        let is_off = can.is_bus_off();
        if is_off != was_off {
            was_off = is_off;
            adapter.with(|bridge| bridge.can_bus_off(is_off, now()));
        }
        // What the controller has no room for waits in the bridge, where what is more urgent overtakes it.
        while can.has_room()
            && adapter.look(|bridge| bridge.can_due(now()))
            && let Some(frame) = adapter.with(|bridge| bridge.can_transmit(now()))
        {
            can.transmit(&frame);
            yield_now().await;
        }
        let room = can.has_room();
        let frame = async {
            match room {
                true => adapter.frame.wait().await,
                false => pending().await,
            }
        };
        let happened = select3(can.event(), frame, adapter.can_restart.wait());
        let resting = rest(Task::Can);
        let happened = happened.await;
        drop(resting);
        if let Either3::Third(config) = happened {
            let parted = async {
                while !can.is_idle() {
                    can.event().await;
                }
            };
            let _ = with_timeout(PARTING, parted).await;
            can.start(&config);
        }
    }
}
