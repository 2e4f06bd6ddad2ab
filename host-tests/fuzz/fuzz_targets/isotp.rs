//! A PDU between two endpoints arrives whole or not at all, even if frames are lost or duplicated. Received PDUs are the
//! sent ones, in their order. Without lost frames all arrive. No frames make a received PDU longer than the buffer.
#![no_main]

use armwire_bridge::can::Id;
use armwire_bridge::isotp::{Config, Endpoint, Event, Link, SendError, SeparationTime};
use armwire_bridge::{Duration, Instant};
use armwire_fuzz::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // A short input is skipped.
    let _ = check(&mut Unstructured::new(input));
});

/// The longest PDU that is received: at most 16 frames, whose numbers are unique.
const RX: usize = 100;

/// The longest PDU that is sent: more than the receiver has room for.
const TX: usize = 110;

type End = Endpoint<RX, TX>;

fn any_side(u: &mut Unstructured<'_>) -> Result<usize> {
    Ok(u.arbitrary::<bool>()?.into())
}

fn any_end(u: &mut Unstructured<'_>, id: u16) -> Result<End> {
    let mut config = Config::new(*u.choose(&[Link::Classic, Link::Fd])?, Id::new(id).expect("in range"));
    config.block_size = *u.choose(&[0, 0, 1, 2, 8, 255])?;
    config.st_min = SeparationTime::from_byte(u.arbitrary()?);
    config.max_waits = u.int_in_range(0..=3)?;
    Ok(End::new(config))
}

/// One side: its endpoint, its sent PDUs, and the number of the other side's PDUs up to the last received.
struct Side {
    end: End,
    sent: Vec<Vec<u8>>,
    received: usize,
}

struct Bus {
    sides: [Side; 2],
    now: Instant,
    /// No frame was lost so far, and no other error occurred.
    flawless: bool,
    /// A frame arrived that no endpoint sent.
    foreign: bool,
}

fn check(u: &mut Unstructured<'_>) -> Result<()> {
    let side = |end| Side {
        end,
        sent: Vec::new(),
        received: 0,
    };
    let mut bus = Bus {
        sides: [side(any_end(u, 0x600)?), side(any_end(u, 0x610)?)],
        now: Instant::ZERO,
        flawless: true,
        foreign: false,
    };
    while !u.is_empty() {
        match u.int_in_range(0..=6)? {
            0 => bus.send(any_side(u)?, u.arbitrary::<u8>()?.into()),
            1 => {
                // A CAN bus has checksums, keeps frames in order, and repeats a frame whose acknowledgement failed.
                let (from, copies) = (any_side(u)?, *u.choose(&[1, 2, 0])?);
                bus.transmit(from, copies);
            }
            2 => bus.sides[any_side(u)?].end.release(),
            3 => bus.wait(bus.now + Duration::from_micros(u.arbitrary::<u16>()?.into())),
            4 => {
                let due = bus.sides.iter().filter_map(|side| side.end.timeout()).min();
                bus.wait(due.unwrap_or(bus.now));
            }
            5 => {
                bus.foreign = true;
                bus.receive(any_side(u)?, u.arbitrary()?);
            }
            _ => bus.off(),
        }
    }
    bus.end();
    Ok(())
}

impl Bus {
    fn send(&mut self, from: usize, len: usize) {
        let side = &mut self.sides[from];
        let number = side.sent.len() as u8;
        // Different PDUs have different bytes at the same place.
        let pdu: Vec<u8> = (0..len)
            .map(|i| number.wrapping_mul(37) ^ (i as u8).wrapping_mul(3))
            .collect();
        let busy = side.end.is_sending();
        match side.end.send(&pdu) {
            Ok(()) => {
                assert!(!busy && (1..=TX).contains(&len));
                // The receiver refuses a PDU without room for it.
                self.flawless &= len <= RX && side.sent.len() < 200;
                side.sent.push(pdu);
            }
            Err(error) => {
                assert!(!error.to_string().is_empty());
                let expected = match len {
                    _ if busy => SendError::Busy,
                    0 => SendError::Empty,
                    got => SendError::TooLong { max: TX, got },
                };
                assert_eq!(error, expected);
            }
        }
    }

    /// Moves a frame over the bus, and delivers it this number of times. Returns true if there was one.
    fn transmit(&mut self, from: usize, copies: usize) -> bool {
        let now = self.now;
        let end = &mut self.sides[from].end;
        let due = end.transmit_at().is_some_and(|at| at <= now);
        let frame = end.transmit(now);
        assert_eq!(frame.is_some(), due);
        let Some(frame) = frame else { return false };
        end.transmitted(now);
        self.flawless &= copies == 1;
        for _ in 0..copies {
            self.receive(1 - from, frame.data());
        }
        true
    }

    fn receive(&mut self, at: usize, frame: &[u8]) {
        let now = self.now;
        let occupied = self.sides[at].end.received().is_some();
        for event in self.sides[at].end.receive(frame, now) {
            self.on_event(at, event, occupied);
        }
    }

    fn on_event(&mut self, at: usize, event: Event, occupied: bool) {
        match event {
            Event::Received => {
                assert!(!occupied, "one that was not taken is lost");
                self.check_received(at);
            }
            Event::Refused(refused) => {
                assert!(!refused.to_string().is_empty());
                self.flawless = false;
            }
            Event::Failed(error) => {
                assert!(!error.to_string().is_empty());
                self.flawless = false;
            }
            Event::Ignored(ignored) => {
                assert!(!ignored.to_string().is_empty());
                assert!(!self.flawless || self.foreign, "{ignored}, and nothing went wrong");
            }
        }
    }

    fn check_received(&mut self, at: usize) {
        let (here, there) = (at, 1 - at);
        let pdu = self.sides[here].end.received().expect("it was received");
        assert!((1..=RX).contains(&pdu.len()));
        if self.foreign {
            return;
        }
        // A single frame that comes twice is the last one again.
        let from = self.sides[here].received.saturating_sub(1);
        let sent = &self.sides[there].sent;
        let place = sent[from..].iter().position(|sent| sent == pdu);
        let place = from + place.unwrap_or_else(|| panic!("{pdu:02X?} was not sent, of {sent:02X?}"));
        assert!(!self.flawless || place == self.sides[here].received, "one is missing");
        self.sides[here].received = place + 1;
    }

    fn off(&mut self) {
        self.flawless = false;
        for side in &mut self.sides {
            let (busy, aborted) = (side.end.is_sending(), side.end.abort());
            assert!((usize::from(busy)..=2).contains(&aborted));
        }
    }

    fn wait(&mut self, until: Instant) {
        self.now = self.now.max(until);
        for at in 0..2 {
            for event in self.sides[at].end.tick(self.now) {
                self.on_event(at, event, false);
            }
            let timeout = self.sides[at].end.timeout();
            assert!(
                timeout.is_none_or(|at| at > self.now),
                "a tick leaves nothing that is late"
            );
        }
    }

    /// No more frames are lost: both endpoints end. If none was lost before, all PDUs have arrived.
    fn end(mut self) {
        for _ in 0..1_000 {
            let mut moved = false;
            for from in 0..2 {
                self.sides[from].end.release();
                moved |= self.transmit(from, 1);
            }
            if moved {
                continue;
            }
            let next = |side: &Side| [side.end.transmit_at(), side.end.timeout()].into_iter().flatten().min();
            match self.sides.iter().filter_map(next).min() {
                Some(at) => self.wait(at),
                None => break,
            }
        }
        for (here, there) in [(0, 1), (1, 0)] {
            let end = &self.sides[here].end;
            assert!(!end.is_sending() && end.timeout().is_none(), "{end:?} does not end");
            if self.flawless && !self.foreign {
                assert_eq!(self.sides[here].received, self.sides[there].sent.len());
            }
        }
    }
}
