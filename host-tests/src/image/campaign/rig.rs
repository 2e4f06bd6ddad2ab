//! A board with an arm and all hosts, for fault injection.

use armwire_bridge::config::Config;
use armwire_bridge::control::Request;
use armwire_bridge::{Counters, Duration, PACKET};
use armwire_virtual_board::line::Direction;
use armwire_virtual_board::{Nanos, Timing, VirtualBoard};

use super::super::hosts::{FINE_POLL_PERIOD, POLL_PERIOD};
use super::super::{
    ArmCounts, Hosts, MEGABAUD, TicketArm, Traffic, board_config, byte_time, counters, open, polled, run_until_unread,
};
use super::Result;
use super::cable::Cable;
use super::matrix::Moment;
use crate::random::Random;

/// Polls per second.
const HERTZ: u16 = 200;

/// The arm's turnaround: long enough that the line is idle part of the time.
const TURNAROUND: Duration = Duration::from_micros(500);

/// Time limit of the wait for a moment or for the hosts' answers.
const STALL_TIMEOUT: Nanos = Nanos::from_millis(400);

/// A board, its hosts, and the traffic since the last [`reset_accounting`](Self::reset_accounting).
#[derive(Debug)]
pub(super) struct Rig {
    pub(super) board: VirtualBoard<Cable>,
    pub(super) hosts: Hosts,
    pub(super) random: Random,
    pub(super) traffic: Traffic,
    pub(super) account: Account,
    poll_period: Nanos,
}

/// Counts at the start of the accounting, and events since then that the invariants take into account.
#[derive(Debug, Default)]
pub(super) struct Account {
    /// The adapter's counters at the start.
    pub(super) counters: Counters,
    /// The arm's counts at the start.
    pub(super) arm_counts: ArmCounts,
    /// Answers given up by the host on CAN before the start.
    pub(super) given_up_on_can: u32,
    /// The subscriber was absent for a while, and its record of frames is incomplete.
    pub(super) missed_events: bool,
    /// Upper limit of the bytes lost in the USB core when the cable was unplugged.
    pub(super) in_core: u32,
    /// Unsolicited frames of the arm.
    pub(super) unsolicited: Vec<Vec<u8>>,
    /// Requests may have been damaged on the way to the arm.
    pub(super) requests_damaged: bool,
}

impl Rig {
    /// Boots a board unless one is given, and starts the load. A given board must be idle.
    pub(super) fn start(board: Option<VirtualBoard<Cable>>, random: Random) -> Result<Self> {
        let arm = Cable::new(TicketArm::new(TURNAROUND));
        let mut board = match board {
            Some(mut board) => {
                board.with_arm(|cable| *cable = arm);
                board
            }
            None => {
                let mut config = board_config(arm);
                config.seed = random.clone().any();
                config.timing = Timing::Drawn;
                VirtualBoard::start(config)?
            }
        };
        let mut hosts = Hosts::connect(&mut board);
        hosts.can.aborts = true;
        let mut rig = Self {
            board,
            hosts,
            random,
            traffic: Traffic::default(),
            account: Account::default(),
            poll_period: POLL_PERIOD,
        };
        rig.reset_accounting();
        rig.resume()?;
        Ok(rig)
    }

    /// Sets the configuration.
    pub(super) fn configure(&mut self, config: Config) -> Result {
        self.order(Request::SetConfig(config));
        // New bus settings restart the controller, which discards earlier frames.
        self.work(Nanos::from_millis(2))
    }

    /// Makes a request at the control interface whose reply has no content.
    pub(super) fn order(&mut self, request: Request) {
        self.hosts.subscriber.control.order(&mut self.board, request);
    }

    /// Restarts the accounting. Nothing may be in progress.
    fn reset_accounting(&mut self) {
        self.hosts.usb.bytes = 0;
        self.hosts.subscriber.forget();
        self.account = Account {
            counters: counters(&mut self.board),
            arm_counts: self.arm_counts(),
            given_up_on_can: self.hosts.can.tracker.given_up,
            ..Account::default()
        };
        self.traffic = Traffic::begin(&mut self.board);
    }

    /// Restarts the accounting after a restart of the board, which resets the counters.
    pub(super) fn restart_accounting(&mut self) -> Result {
        self.finish()?;
        self.reset_accounting();
        self.resume()
    }

    pub(super) fn arm_counts(&mut self) -> ArmCounts {
        self.board.with_arm(|cable| cable.arm.counts)
    }

    /// Runs the load for `span`.
    pub(super) fn work(&mut self, span: Nanos) -> Result {
        self.work_until(span, |_| false).map(drop)
    }

    /// Runs the load for a random time from `low` to `high` microseconds.
    pub(super) fn work_between(&mut self, low: u64, high: u64) -> Result {
        let span = Duration::from_micros(self.random.between(low, high));
        self.work(span.into())
    }

    /// Runs the load until `done`, for at most `limit`. Returns true if `done` was.
    pub(super) fn work_until(&mut self, limit: Nanos, mut done: impl FnMut(&mut Self) -> bool) -> Result<bool> {
        let end = self.board.now() + limit;
        loop {
            self.hosts.poll(&mut self.board);
            if done(self) {
                return Ok(true);
            }
            self.traffic.count(&mut self.board);
            let left = end.since(self.board.now());
            if left == Nanos(0) {
                return Ok(false);
            }
            run_until_unread(&mut self.board, self.poll_period.min(left))?;
        }
    }

    /// Stops the requests and waits until each has ended.
    fn quiet(&mut self) -> Result {
        self.hosts.set_paused(true);
        if !self.work_until(STALL_TIMEOUT, |rig| rig.hosts.is_done())? {
            return Err(format!("a host still waits after {STALL_TIMEOUT}").into());
        }
        Ok(())
    }

    /// Stops requests and polls, and waits until the line is idle.
    pub(super) fn finish(&mut self) -> Result {
        self.configure(Config::default())?;
        self.quiet()?;
        // Answers to given-up requests may still be late.
        self.work(Nanos::from_millis(120))
    }

    /// Restarts polls and requests.
    pub(super) fn resume(&mut self) -> Result {
        self.configure(polled(HERTZ))?;
        self.hosts.set_paused(false);
        Ok(())
    }

    /// Runs the load until this moment.
    pub(super) fn reach(&mut self, moment: Moment) -> Result {
        self.work_between(20_000, 40_000)?;
        if moment == Moment::Idle {
            self.quiet()?;
        }
        self.poll_period = FINE_POLL_PERIOD;
        let mut idle_since = self.board.now();
        let found = self.work_until(STALL_TIMEOUT, |rig| {
            let now = rig.board.now();
            let last = rig.board.uart().bytes().last().copied();
            let is_moving = |direction| {
                last.is_some_and(|byte| byte.direction == direction && now.since(byte.at) < byte_time(MEGABAUD))
            };
            let has_pending = rig.board.with_arm(|cable| cable.arm.has_pending());
            match moment {
                Moment::Idle => {
                    if has_pending || last.is_some() {
                        idle_since = now;
                    }
                    now.since(idle_since) > Nanos(700_000)
                }
                Moment::Request => is_moving(Direction::ToArm),
                Moment::Answer => is_moving(Direction::ToBoard) && has_pending,
                Moment::IsoTp => rig.hosts.can.is_sending(),
                Moment::UsbPacket => rig.board.usb().unsent() > 0,
                Moment::Any => true,
            }
        })?;
        self.poll_period = POLL_PERIOD;
        if !found {
            return Err(format!("moment not reached: {moment}").into());
        }
        let jitter = match moment {
            Moment::Any => self.random.between(0, 5_000_000),
            _ => self.random.between(0, 8_000),
        };
        self.work(Nanos(jitter))
    }

    /// Records that the host on USB and the subscriber lost the device.
    pub(super) fn disconnect_usb(&mut self) {
        self.hosts.usb.on_closed();
        self.account.missed_events = true;
        self.account.in_core += 2 * PACKET as u32;
    }

    /// Attaches the device again and opens its interfaces. Returns the time before.
    pub(super) fn reconnect_usb(&mut self) -> Nanos {
        let now = self.board.now();
        self.board.usb().attach();
        self.open_usb();
        now
    }

    /// Opens the interfaces of the device.
    pub(super) fn open_usb(&mut self) {
        open(&mut self.board, MEGABAUD);
        self.hosts.subscriber.open(&mut self.board);
    }
}
