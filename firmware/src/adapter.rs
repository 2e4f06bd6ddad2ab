//! State shared by the tasks and the service: the bridge, and the signals for work.

use armwire_bridge::config::{self, Config};
use armwire_bridge::control::Identity;
use armwire_bridge::{Action, Bridge, Start, Status, UartConfig, UartEvent};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

use crate::ceiling::{Ceiling, SERVICE};
use crate::clock::now;
use crate::restart;
use crate::uart::{Reader, Sender, wait};

/// A signal to a task, from another or from the service.
type Notice<T = ()> = Signal<CriticalSectionRawMutex, T>;

/// A kind of work, for which a task waits.
#[derive(Clone, Copy)]
pub(crate) enum Work {
    /// A packet for the host on the serial port.
    Port,
    /// Room for a packet from that host.
    PortRoom,
    /// A new session of that host, or a port that was opened or closed.
    PortSession,
    /// A packet for the host on the control interface.
    Control,
    /// Room for a packet from that host.
    ControlRoom,
    /// A new session of that host.
    ControlSession,
    /// A frame for the CAN bus.
    Can,
    /// A check of all other kinds.
    Dispatch,
}

/// Number of kinds.
const WORKS: usize = Work::Dispatch as usize + 1;

/// The bridge, and a signal for each kind of work.
pub(crate) struct Adapter {
    pub(crate) shared: Ceiling<Shared>,
    works: [Notice; WORKS],
    /// The next action of the bridge.
    pub(crate) action: Notice<Action>,
    /// A new configuration for the CAN controller.
    pub(crate) can_restart: Notice<config::Can>,
}

/// State of which the service has a part.
pub(crate) struct Shared {
    pub(crate) bridge: Bridge,
    pub(crate) reader: Reader,
    pub(crate) sender: Sender,
    /// The status at the last dispatch.
    status: Status,
    /// An event of the receiver has not been served.
    pub(crate) is_behind: bool,
}

impl Adapter {
    /// An adapter without a USB host.
    pub(crate) fn new(identity: Identity, config: Config, start: Start) -> Self {
        Self {
            shared: Ceiling::new(
                SERVICE,
                Shared {
                    bridge: Bridge::new(identity, config, start),
                    reader: Reader::new(),
                    sender: Sender::new(),
                    status: Status::default(),
                    is_behind: false,
                },
            ),
            works: [const { Notice::new() }; WORKS],
            action: Notice::new(),
            can_restart: Notice::new(),
        }
    }

    /// Calls the bridge without waking a task.
    pub(crate) fn take<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        self.shared.with(|shared| f(&mut shared.bridge))
    }

    /// Calls the bridge, and starts what it has for the arm, where microseconds count. The dispatch to the tasks
    /// follows.
    ///
    /// A task that is woken without work waits again.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        let result = self.shared.with(|shared| {
            let result = f(&mut shared.bridge);
            shared.sender.transmit(&mut shared.bridge);
            result
        });
        self.wake(Work::Dispatch);
        result
    }

    /// The line uses this configuration.
    pub(crate) fn line_changed(&self, uart: UartConfig) {
        self.shared.with(|shared| {
            shared.bridge.uart_event(UartEvent::Configured(uart), now());
            shared.sender.changed();
            // A read ends at a frame: more may wait.
            while shared.reader.read(&mut shared.bridge) {
                wait(shared.bridge.rx_wait());
            }
        });
    }

    /// The status at the last dispatch.
    pub(crate) fn status(&self) -> Status {
        self.shared.with(|shared| shared.status)
    }

    /// Wakes the task that waits for this work.
    // One copy, not one for each call: 0.6 kB.
    #[inline(never)]
    pub(crate) fn wake(&self, work: Work) {
        self.works[work as usize].signal(());
    }

    pub(crate) async fn wait(&self, work: Work) {
        self.works[work as usize].wait().await;
    }

    /// Clears the signal for this work.
    pub(crate) fn reset(&self, work: Work) {
        self.works[work as usize].reset();
    }

    /// Passes the bridge's next action to its task.
    pub(crate) fn act(&self) {
        // One at a time: the next is fetched after this one was taken.
        if !self.action.signaled()
            && let Some(action) = self.take(|bridge| bridge.action(now()))
        {
            self.action.signal(action);
            self.wake(Work::Dispatch);
        }
    }

    /// Starts what the bridge has for the arm, and wakes all tasks that have work.
    pub(crate) fn dispatch(&self) {
        self.shared.with(|shared| {
            let Shared { bridge, sender, .. } = shared;
            let status = bridge.update(now());
            if status.uart_cut {
                sender.cut();
            }
            let is_started = status.uart && sender.transmit(bridge);
            shared.status = status;
            restart::armed(status.is_armed);
            for (is_due, work) in [
                (is_started, Work::Dispatch),
                (status.usb, Work::Port),
                (status.usb_room, Work::PortRoom),
                (status.can, Work::Can),
                (status.control, Work::Control),
                (status.control_room, Work::ControlRoom),
            ] {
                if is_due {
                    self.wake(work);
                }
            }
        });
    }
}
