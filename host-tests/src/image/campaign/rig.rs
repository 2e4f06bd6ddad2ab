//! A board with everybody at it, of which anything may go wrong.

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

/// How long the arm thinks: long enough that a run is not made of exchanges alone.
const TURNAROUND: Duration = Duration::from_micros(500);

/// How long nobody looks at most, and how long when a moment is waited for.
const POLL_PERIOD: Nanos = Nanos(250_000);
const FINE_POLL_PERIOD: Nanos = Nanos(3_000);

/// How long a moment is waited for.
const STALL_TIMEOUT: Nanos = Nanos::from_millis(400);

/// A board, everybody at it, and what they have seen since the books were opened.
#[derive(Debug)]
pub(super) struct Rig {
    pub(super) board: VirtualBoard<Cable>,
    pub(super) hosts: Hosts,
    pub(super) random: Random,
    pub(super) traffic: Traffic,
    pub(super) before: Counters,
    pub(super) arm_counts_before: ArmCounts,
    poll_period: Nanos,
    /// No subscriber was there for a while, so that nobody knows of all frames.
    pub(super) missed_events: bool,
    /// Bytes that the host may have missed because they were in the USB core when its cable went.
    pub(super) in_core: u32,
    /// What the arm has said unasked in whole frames.
    pub(super) unasked: Vec<Vec<u8>>,
    /// Answers that the host on CAN had given up.
    pub(super) given_up_before: u32,
    /// What the arm heard may not be what was said to it.
    pub(super) requests_damaged: bool,
}

impl Rig {
    /// Boots a board, if there is none, and begins. On one that is there nothing may be under way.
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
        // Other settings of the bus begin with a controller that knows of nothing before.
        self.work(Nanos::from_millis(2))
    }

    /// What happens is counted from now on. Nothing may be under way.
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

    /// Whether the serial port is open and the device has not gone.
    pub(super) fn is_open(&mut self) -> bool {
        self.board.usb().is_open()
    }

    /// Lets everybody work for `span`.
    pub(super) fn work(&mut self, span: Nanos) -> Result {
        self.work_until(span, &mut |_| false).map(drop)
    }

    /// Lets everybody work for a number of microseconds from `low` to `high`.
    pub(super) fn work_between(&mut self, low: u64, high: u64) -> Result {
        let span = Nanos::from(Duration::from_micros(self.random.between(low, high)));
        self.work(span)
    }

    /// Lets everybody work until `done` says so, or for `limit`. Returns whether it did.
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
                // What nobody reads is no news.
                Ok(Nanos(0)) => self.board.run_for(FINE_POLL_PERIOD.min(left))?,
                Ok(_) | Err(Error::TimedOut { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Everybody does what they have to do now.
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

    /// Whether nobody waits for an answer.
    pub(super) fn is_done(&self) -> bool {
        let usb = self.hosts.usb.as_ref().is_none_or(|usb| usb.tracker.is_done());
        usb && self.hosts.can.as_ref().is_none_or(|can| can.tracker.is_done())
    }

    /// Nobody asks any more, and all have their answers or have given them up.
    pub(super) fn quiet(&mut self) -> Result {
        self.hosts.set_requesting(false);
        if !self.work_until(STALL_TIMEOUT, &mut |rig| rig.is_done())? {
            return Err(format!("somebody waits after {STALL_TIMEOUT} without giving up").into());
        }
        Ok(())
    }

    /// Nobody asks, there are no polls, and nothing is under way.
    pub(super) fn finish(&mut self) -> Result {
        self.configure(Config::default())?;
        self.quiet()?;
        // What an adapter has given up may still be late.
        self.work(Nanos::from_millis(120))
    }

    /// Everybody works again.
    pub(super) fn resume(&mut self) -> Result {
        self.configure(polled(HERTZ))?;
        self.hosts.set_requesting(true);
        Ok(())
    }

    /// Lets everybody work until it is this moment.
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
            return Err(format!("it was never {}", moment.name()).into());
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

    /// They find it again.
    pub(super) fn reconnect_usb(&mut self) {
        self.board.usb().attach();
        self.open_usb();
    }

    /// They open its interfaces.
    pub(super) fn open_usb(&mut self) {
        open(&mut self.board, MEGABAUD);
        if let Some(subscriber) = &mut self.hosts.subscriber {
            subscriber.reopen(&mut self.board);
        }
    }

    /// The part has started over: everything is set up anew.
    pub(super) fn set_up_again(&mut self) -> Result {
        self.reconnect_usb();
        self.configure(polled(HERTZ))
    }
}
