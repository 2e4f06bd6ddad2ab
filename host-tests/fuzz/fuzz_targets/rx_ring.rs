//! The receive ring hands out each byte once and in order, whatever the interrupts and the task do in between. Its events
//! are among the unread bytes, in order, and none is reported that cannot be taken.
#![no_main]

use arbitrary::Arbitrary;
use armwire::framing::Length;
use armwire_bridge::{Instant, RxRing, RxThreshold, RxWait};
use libfuzzer_sys::fuzz_target;

const SIZE: usize = 32;

#[derive(Arbitrary, Debug)]
enum Step {
    Byte { byte: u8, is_late: bool },
    Idle,
    Wait(Wait),
    Take { max: u8 },
    Restart,
    Overrun,
}

#[derive(Arbitrary, Clone, Copy, Debug)]
struct Wait {
    max: u8,
    min: u8,
    terminator: Option<u8>,
    length: Option<(u8, u8, u8)>,
    idle: bool,
}

impl From<Wait> for RxWait {
    fn from(wait: Wait) -> Self {
        let (max, min) = (usize::from(wait.max) % SIZE, usize::from(wait.min) % SIZE);
        Self {
            threshold: RxThreshold {
                max: max.max(1),
                min: min.clamp(1, max.max(1)),
                terminator: wait.terminator,
            },
            length: wait.length.map(|(header, at, max)| Length {
                header,
                at: usize::from(at) % 4,
                max,
                overhead: 6,
            }),
            idle: wait.idle,
        }
    }
}

/// The bytes in the ring, and those that are unread.
#[derive(Default)]
struct Line {
    content: [u8; SIZE],
    end: usize,
    unread: Vec<u8>,
}

impl Line {
    fn push(&mut self, byte: u8) {
        self.content[self.end] = byte;
        self.end = (self.end + 1) % SIZE;
        self.unread.push(byte);
    }

    fn read(&mut self, ring: &mut RxRing<SIZE>, end: usize, max: usize) -> usize {
        let taken: Vec<u8> = ring
            .take(end, max)
            .into_iter()
            .flat_map(|part| &self.content[part])
            .copied()
            .collect();
        assert!(self.unread.starts_with(&taken) && taken.len() <= max);
        self.unread.drain(..taken.len());
        taken.len()
    }
}

fuzz_target!(|steps: Vec<Step>| {
    let (mut ring, mut line, mut now) = (RxRing::<SIZE>::new(), Line::default(), 0);
    for step in steps {
        now += 10;
        let at = Instant::from_micros(now);
        match step {
            Step::Byte { byte, is_late } => {
                if line.unread.len() == SIZE - 1 {
                    continue;
                }
                line.push(byte);
                let content = line.content;
                if !is_late && ring.quiet(line.end, |at| content[at]) == 0 && ring.arrived(line.end, byte, || at) {
                    assert!(ring.has_mark());
                }
            }
            Step::Idle => {
                if ring.idle(line.end, at) {
                    assert!(ring.has_mark());
                }
            }
            Step::Wait(wait) => {
                ring.set(wait.into());
                assert!(ring.is_waiting());
            }
            Step::Take { max } => {
                let mut last = 0;
                while let Some(mark) = ring.take_mark(line.end) {
                    assert!(last <= mark.at.as_micros() && mark.at <= at);
                    last = mark.at.as_micros();
                    while ring.unread(mark.end) <= ring.unread(line.end) && line.read(&mut ring, mark.end, 5) > 0 {}
                }
                assert!(!ring.has_mark());
                line.read(&mut ring, line.end, usize::from(max));
            }
            Step::Restart => {
                ring.restart();
                assert!(!ring.has_mark() && !ring.is_waiting());
                line = Line::default();
            }
            Step::Overrun => {
                ring.discard(line.end);
                assert!(!ring.has_mark() && !ring.is_waiting());
                line.unread.clear();
            }
        }
        assert_eq!(ring.unread(line.end), line.unread.len());
    }
});
