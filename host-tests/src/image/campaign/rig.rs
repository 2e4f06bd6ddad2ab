//! A board with an arm and all hosts, for fault injection.

use armwire_bridge::can::Node;
use armwire_bridge::config::Config;
use armwire_bridge::control::Request;
use armwire_bridge::{Counters, Duration};
use armwire_virtual_board::line::Direction;
use armwire_virtual_board::{Config as BoardConfig, Error, Nanos, Timing, VirtualBoard};

use super::super::{
    ArmCounts, CanHost, Hosts, MEGABAUD, Subscriber, TicketArm, Traffic, UsbHost, byte_time, counters, open, path,
    plug_in, polled,
};
use super::Result;
use super::cable::Cable;
use super::matrix::Moment;
use crate::random::Random;

/// Bits per second on the CAN bus.
const RATE: u32 = 1_000_000;

/// Polls per second.
const HERTZ: u16 = 200;

/// The arm's turnaround: long enough that the line is idle part of the time.
const TURNAROUND: Duration = Duration::from_micros(500);

/// Period of the hosts' polls, and the period during the wait for a moment.
const POLL_PERIOD: Nanos = Nanos(250_000);
const FINE_POLL_PERIOD: Nanos = Nanos(3_000);

/// Time limit of the wait for a moment or for the hosts' answers.
const STALL_TIMEOUT: Nanos = Nanos::from_millis(400);

/// A board, its hosts, and the traffic since the last [`reset_accounting`](Self::reset_accounting).
#[derive(Debug)]
pub(super) struct Rig {
    pub(super) board: VirtualBoard<Cable>,
    pub(super) hosts: Hosts,
    pub(super) random: Random,
    pub(super) traffic: Traffic,
    pub(super) before: Counters,
    pub(super) arm_counts_before: ArmCounts,
    poll_period: Nanos,
    /// The subscriber was absent for a while, and its record of frames is incomplete.
    pub(super) missed_events: bool,
    /// Upper limit of the bytes lost in the USB core when the cable was unplugged.
    pub(super) in_core: u32,
    /// Unasked frames of the arm.
    pub(super) unasked: Vec<Vec<u8>>,
    /// Answers given up by the host on CAN before the accounting.
    pub(super) given_up_before: u32,
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
                let mut config = BoardConfig::new(path(), arm);
                config.seed = random.clone().any();
                config.timing = Timing::Drawn;
                VirtualBoard::start(config)?
            }
        };
        plug_in(&mut board, MEGABAUD);
        board.can().attach(RATE);
        let hosts = Hosts {
            usb: Some(UsbHost::default()),
            can: Some(CanHost::new(Node::default())),
            subscriber: Some(Subscriber::open(&mut board)),
        };
        let mut rig = Self {
            traffic: Traffic::begin(&mut board),
            before: Counters::default(),
            arm_counts_before: ArmCounts::default(),
            board,
            hosts,
            random,
            poll_period: POLL_PERIOD,
            missed_events: false,
            in_core: 0,
            unasked: Vec::new(),
            given_up_before: 0,
            requests_damaged: false,
        };
        if let Some(can) = &mut rig.hosts.can {
            can.aborts = true;
        }
        rig.reset_accounting();
        rig.resume()?;
        Ok(rig)
    }

    /// Sets the configuration.
    pub(super) fn configure(&mut self, config: Config) -> Result {
        let subscriber = self.hosts.subscriber.as_mut().ok_or("no subscriber")?;
        subscriber.control.order(&mut self.board, Request::SetConfig(config));
        // New bus settings restart the controller, which discards earlier frames.
        self.work(Nanos::from_millis(2))
    }

    /// Restarts the accounting. Nothing may be in progress.
    pub(super) fn reset_accounting(&mut self) {
        if let Some(usb) = &mut self.hosts.usb {
            (usb.bytes, usb.noise_bytes) = (0, 0);
        }
        self.hosts.subscriber.as_mut().map(Subscriber::forget);
        self.traffic = Traffic::begin(&mut self.board);
        self.before = counters(&mut self.board);
        self.traffic = Traffic::begin(&mut self.board);
        self.arm_counts_before = self.arm_counts();
        self.missed_events = false;
        self.in_core = 0;
        self.unasked.clear();
        self.given_up_before = self.hosts.can.as_ref().map_or(0, |can| can.tracker.given_up);
        self.requests_damaged = false;
    }

    pub(super) fn arm_counts(&mut self) -> ArmCounts {
        self.board.with_arm(|cable| cable.arm().arm_counts())
    }

    /// True if the serial port is open and the device is attached.
    pub(super) fn is_open(&mut self) -> bool {
        self.board.usb().is_open()
    }

    /// Runs the load for `span`.
    pub(super) fn work(&mut self, span: Nanos) -> Result {
        self.work_until(span, &mut |_| false).map(drop)
    }

    /// Runs the load for a random time from `low` to `high` microseconds.
    pub(super) fn work_between(&mut self, low: u64, high: u64) -> Result {
        let span = Nanos::from(Duration::from_micros(self.random.between(low, high)));
        self.work(span)
    }

    /// Runs the load until `done`, for at most `limit`. Returns true if `done` was.
    pub(super) fn work_until(&mut self, limit: Nanos, done: &mut dyn FnMut(&mut Self) -> bool) -> Result<bool> {
        let end = self.board.now() + limit;
        loop {
            self.serve();
            if done(self) {
                return Ok(true);
            }
            self.traffic.count(&mut self.board);
            let left = end.since(self.board.now());
            if left == Nanos(0) {
                return Ok(false);
            }
            let news = |board: &mut VirtualBoard<Cable>| board.usb().unread() > 0 || board.can().unread() > 0;
            match self.board.run_until(self.poll_period.min(left), news) {
                // Unread data without a reader does not end the wait.
                Ok(Nanos(0)) => self.board.run_for(FINE_POLL_PERIOD.min(left))?,
                Ok(_) | Err(Error::TimedOut { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Polls each host.
    fn serve(&mut self) {
        let Self { board, hosts, .. } = self;
        if let Some(usb) = &mut hosts.usb
            && board.usb().is_open()
        {
            usb.poll(board);
        }
        if let Some(can) = &mut hosts.can {
            can.poll(board);
        }
        if let Some(subscriber) = &mut hosts.subscriber
            && board.usb().vendor().is_open()
        {
            subscriber.poll(board);
        }
    }

    /// True if no host waits for an answer.
    pub(super) fn is_done(&self) -> bool {
        let usb = self.hosts.usb.as_ref().is_none_or(|usb| usb.tracker.is_done());
        usb && self.hosts.can.as_ref().is_none_or(|can| can.tracker.is_done())
    }

    /// Stops the requests and waits until each has ended.
    pub(super) fn quiet(&mut self) -> Result {
        self.hosts.set_requesting(false);
        if !self.work_until(STALL_TIMEOUT, &mut |rig| rig.is_done())? {
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
        self.hosts.set_requesting(true);
        Ok(())
    }

    /// Runs the load until this moment.
    pub(super) fn reach(&mut self, moment: Moment) -> Result {
        self.work_between(20_000, 40_000)?;
        if moment == Moment::Idle {
            self.quiet()?;
        }
        self.poll_period = FINE_POLL_PERIOD;
        let mut quiet_since = self.board.now();
        let found = self.work_until(STALL_TIMEOUT, &mut |rig| {
            let now = rig.board.now();
            let last = rig.board.uart().bytes().last().copied();
            let moves =
                |way| last.is_some_and(|byte| byte.direction == way && now.since(byte.at) < byte_time(MEGABAUD));
            match moment {
                Moment::Idle => {
                    let talks = rig.board.with_arm(|cable| cable.arm().has_pending());
                    if talks || last.is_some() {
                        quiet_since = now;
                    }
                    now.since(quiet_since) > Nanos(700_000)
                }
                Moment::Request => moves(Direction::ToArm),
                Moment::Answer => moves(Direction::ToBoard) && rig.board.with_arm(|cable| cable.arm().has_pending()),
                Moment::IsoTp => rig.hosts.can.as_ref().is_some_and(CanHost::is_sending),
                Moment::UsbPacket => rig.board.usb().unsent() > 0,
                Moment::Any => true,
            }
        })?;
        self.poll_period = POLL_PERIOD;
        if !found {
            return Err(format!("moment not reached: {}", moment.name()).into());
        }
        let jitter = match moment {
            Moment::Any => self.random.between(0, 5_000_000),
            _ => self.random.between(0, 8_000),
        };
        self.work(Nanos(jitter))
    }

    /// The host and the subscriber lose the device.
    pub(super) fn disconnect_usb(&mut self) {
        if let Some(usb) = &mut self.hosts.usb {
            usb.reopened();
        }
        self.hosts.subscriber = self.hosts.subscriber.take().map(Subscriber::away);
        self.missed_events = true;
        self.in_core += 2 * armwire_bridge::PACKET as u32;
    }

    /// Host and subscriber find the device again.
    pub(super) fn reconnect_usb(&mut self) {
        self.board.usb().attach();
        self.open_usb();
    }

    /// Host and subscriber open the interfaces of the device.
    pub(super) fn open_usb(&mut self) {
        open(&mut self.board, MEGABAUD);
        if let Some(subscriber) = &mut self.hosts.subscriber {
            subscriber.reopen(&mut self.board);
        }
    }

    /// Reconnects and reconfigures after a restart of the board.
    pub(super) fn set_up_again(&mut self) -> Result {
        self.reconnect_usb();
        self.configure(polled(HERTZ))
    }
}
