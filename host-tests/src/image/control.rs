//! A program at the control interface, in virtual time.

use armwire_bridge::control::{
    Event, FromAdapter, FromHost, MAX_COBS, MAX_MESSAGE, Reader, Reply, Request, Stamp, Subscription, encode_cobs,
};
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Nanos, VirtualBoard};

/// Longer than any request takes that needs no arm: half a second where a sector of flash is erased.
const REPLY_TIMEOUT: Nanos = Nanos::from_millis(1_000);

/// A program that talks to the adapter itself.
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
    /// If there is none, or no cable.
    pub fn open<A: Arm>(board: &mut VirtualBoard<A>) -> Self {
        board.usb().open_vendor().unwrap();
        Self {
            reader: Reader::new(),
            sequence: 0,
            events: Vec::new(),
        }
    }

    /// Sends a request and returns the reply.
    ///
    /// # Panics
    ///
    /// If there is none in time, or something else comes that is no event.
    pub fn call<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: Request) -> Reply {
        self.send(board, request);
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

    /// Sends a request, and waits for nothing.
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

    /// The same for a request that is only done or not.
    ///
    /// # Panics
    ///
    /// As [`call`](Self::call), and if it is not done.
    pub fn order<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: Request) {
        assert_eq!(self.call(board, request), Reply::Done, "{request:?}");
    }

    /// Asks to be told of every frame and everything else.
    ///
    /// # Panics
    ///
    /// As [`order`](Self::order).
    pub fn subscribe<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        let all = Subscription {
            frames: true,
            events: true,
        };
        self.order(board, Request::Subscribe(all));
    }

    /// What the adapter told of since this was last asked.
    ///
    /// # Panics
    ///
    /// If there is a reply that nobody waits for.
    pub fn take_events<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Vec<(Stamp, Event)> {
        let reply = self.read(board);
        assert_eq!(reply, None);
        std::mem::take(&mut self.events)
    }

    /// Reads what there is: events are kept, the reply is returned.
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
