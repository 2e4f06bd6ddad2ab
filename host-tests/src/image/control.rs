//! A program at the control interface, in virtual time.

use armwire_bridge::control::{
    Event, FromAdapter, FromHost, MAX_COBS, MAX_MESSAGE, Reader, Reply, Request, Stamp, Subscription, encode_cobs,
};
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Nanos, VirtualBoard};

/// Time limit for a reply. Requests without the arm take up to 0.5 s, for the erase of a flash sector.
const REPLY_TIMEOUT: Nanos = Nanos::from_millis(1_000);

/// A client of the control interface.
#[derive(Debug, Default)]
pub struct Control {
    reader: Reader<MAX_MESSAGE>,
    sequence: u8,
    events: Vec<(Stamp, Event)>,
}

impl Control {
    /// Opens the interface.
    ///
    /// # Panics
    ///
    /// If there is no such interface, or no cable.
    pub fn open<A: Arm>(board: &mut VirtualBoard<A>) -> Self {
        board.usb().open_vendor().unwrap();
        Self::default()
    }

    /// Sends a request and returns the reply.
    ///
    /// # Panics
    ///
    /// If there is no reply in time, or another message than an event arrives.
    pub fn call<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: Request) -> Reply {
        self.send(board, request);
        self.reply(board)
    }

    /// Waits for the reply to the last request.
    ///
    /// # Panics
    ///
    /// See [`call`](Self::call).
    pub fn reply<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Reply {
        loop {
            board
                .run_until(REPLY_TIMEOUT, |board| board.usb().vendor().unread() > 0)
                .unwrap();
            if let Some((sequence, reply)) = self.read(board) {
                assert_eq!(sequence, self.sequence, "{reply:?}");
                return reply;
            }
        }
    }

    /// Sends a request without waiting for the reply.
    ///
    /// # Panics
    ///
    /// If the interface is not open.
    pub fn send<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: Request) {
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = [0; MAX_COBS];
        let message = FromHost {
            sequence: self.sequence,
            request,
        };
        let len = encode_cobs(&message, &mut bytes).unwrap();
        board.usb().vendor().write(&bytes[..len]).unwrap();
    }

    /// Sends a request whose reply is [`Reply::Done`].
    ///
    /// # Panics
    ///
    /// See [`call`](Self::call). Also for any other reply.
    pub fn order<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: Request) {
        assert_eq!(self.call(board, request), Reply::Done, "{request:?}");
    }

    /// Subscribes to all frames and events.
    ///
    /// # Panics
    ///
    /// See [`order`](Self::order).
    pub fn subscribe<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        let all = Subscription {
            frames: true,
            events: true,
        };
        self.order(board, Request::Subscribe(all));
    }

    /// Events since the last call.
    ///
    /// # Panics
    ///
    /// If there is an unexpected reply.
    pub fn take_events<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Vec<(Stamp, Event)> {
        let reply = self.read(board);
        assert_eq!(reply, None);
        std::mem::take(&mut self.events)
    }

    /// Reads all messages. Keeps the events and returns the reply.
    fn read<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Option<(u8, Reply)> {
        let bytes = board.usb().vendor().read();
        let mut rest = &*bytes;
        let mut answer = None;
        while !rest.is_empty() {
            rest = self.reader.push(rest);
            match self.reader.next().transpose().unwrap() {
                Some(FromAdapter::Reply { sequence, reply }) => {
                    assert_eq!(answer, None, "two replies to one request");
                    answer = Some((sequence, reply));
                }
                Some(FromAdapter::Event { at, event }) => self.events.push((at, event)),
                None => {}
            }
        }
        answer
    }
}

/// Expects that each stamp is the time of the last stop bit, which ended at this instant.
///
/// # Panics
///
/// If one is off by more than 2 µs.
pub fn expect_exact(stamps: &[Stamp], instants: &[Nanos]) {
    assert_eq!(stamps.len(), instants.len());
    assert!(stamps.is_sorted());
    // The two clocks have different origins.
    let offset = |(instant, stamp): (&Nanos, &Stamp)| instant.0.abs_diff(stamp.0 * 1_000);
    let offsets: Vec<_> = instants.iter().zip(stamps).map(offset).collect();
    let (least, most) = (offsets.iter().min().unwrap(), offsets.iter().max().unwrap());
    println!("stamps differ from the last stop bits by up to {} ns", most - least);
    assert!(most - least <= 2_000, "{} ns", most - least);
}

/// Expects that the bytes on the line are frames of `len` bytes, each with an exact stamp in an event of its own.
///
/// # Panics
///
/// As of [`expect_exact`].
pub fn expect_exact_frames<A: Arm>(board: &mut VirtualBoard<A>, control: &mut Control, len: usize) {
    let bytes = board.uart().bytes();
    let ends: Vec<_> = bytes.chunks(len).map(|frame| frame[frame.len() - 1].at).collect();
    let stamps: Vec<_> = control.take_events(board).iter().map(|&(at, _)| at).collect();
    expect_exact(&stamps, &ends);
}
