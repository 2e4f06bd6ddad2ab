//! A line with an exchange, and an oracle written from the exchange's rules. Shared with the fuzz target `exchange`.

use armwire::correlation::{Correlation, Effect, RequestInfo, ResponseTiming};
use armwire::exchange::{Exchange, FirstByte, Handover, Match};
use armwire::framing::{Framing, Reason, Scan};
use armwire::time::{Duration, Instant};

/// A frame is two bytes: its key, and any byte. Its expectation is the key divided by ten.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes<const NUMBERED: bool>;

pub type Plain = Bytes<false>;
pub type Numbered = Bytes<true>;

impl<const NUMBERED: bool> Framing for Bytes<NUMBERED> {
    type Expect = u8;

    fn scan(&self, window: &[u8], _expect: u8) -> Scan {
        match window.len() {
            0 | 1 => Scan::Noise(1, Reason::Stray),
            _ => Scan::Frame(2),
        }
    }

    fn terminator(&self, _expect: u8) -> Option<u8> {
        None
    }

    fn shortest(&self, _expect: u8) -> usize {
        2
    }

    fn requests(&self) -> u8 {
        u8::MAX
    }

    fn unsolicited(&self) -> u8 {
        u8::MAX
    }
}

impl<const NUMBERED: bool> Correlation for Bytes<NUMBERED> {
    const HAS_TRANSACTION_ID: bool = NUMBERED;
    type Key = u8;

    fn keeps_order(&self) -> bool {
        !NUMBERED
    }

    fn request(&self, frame: &[u8]) -> Option<RequestInfo<u8, u8>> {
        frame.first().map(|key| info(*key))
    }

    fn is_response_to(&self, key: u8, frame: &[u8]) -> bool {
        frame.first() == Some(&key)
    }
}

pub const fn info(key: u8) -> RequestInfo<u8, u8> {
    RequestInfo {
        key,
        expect: key / 10,
        response: Some(ResponseTiming {
            longest: 2,
            turnaround: TURNAROUND,
        }),
        effect: Effect::Read,
    }
}

pub const UNANSWERED: RequestInfo<u8, u8> = RequestInfo {
    response: None,
    ..info(0)
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Who {
    Usb,
    Can,
    Poll,
}

pub const TURNAROUND: Duration = Duration::from_micros(100);
pub const WINDOW: Duration = Duration::from_micros(50);

/// A line with an exchange of four sends.
pub struct Line<D: Correlation<Key = u8, Expect = u8>, I = Who> {
    pub correlation: D,
    pub exchange: Exchange<D, I, 4>,
    pub offset: u64,
}

impl<D: Correlation<Key = u8, Expect = u8>, I: Copy + Eq> Line<D, I> {
    pub fn new(correlation: D) -> Self {
        Self {
            correlation,
            exchange: Exchange::new(WINDOW),
            offset: 0,
        }
    }

    pub fn can_send(&self, key: u8, who: I) -> bool {
        self.exchange.can_send(&info(key), who)
    }

    /// Hands over a request at this time. Returns true if it is tracked.
    pub fn send(&mut self, key: u8, who: I, at: u64) -> bool {
        self.exchange.begin(info(key), who, self.handover(at))
    }

    pub fn can_follow(&self, key: u8, who: I) -> bool {
        self.exchange.can_follow(&info(key), who)
    }

    pub fn can_overtake(&self, key: u8, who: I) -> bool {
        self.exchange.can_overtake(&info(key), who)
    }

    /// Hands over a reading at this time, which overtakes those before it.
    pub fn overtake(&mut self, key: u8, who: I, at: u64) {
        self.exchange.overtake(info(key), who, self.handover(at));
    }

    pub fn handover(&self, at: u64) -> Handover {
        let at = Instant::from_micros(at);
        Handover {
            offset: self.offset,
            at,
            due: at + TURNAROUND,
        }
    }

    /// A frame of this key arrives at this time, its first byte with it.
    pub fn frame(&mut self, key: u8, now: u64) -> Match<I> {
        self.frame_from(key, self.offset, Some(now), now)
    }

    pub fn frame_from(&mut self, key: u8, offset: u64, at: Option<u64>, now: u64) -> Match<I> {
        self.offset = self.offset.max(offset + 2);
        let first = FirstByte {
            offset,
            at: at.map(Instant::from_micros),
        };
        let frame = [key, 0];
        let is_last = |who: &I| self.exchange.is_last_answer(&self.correlation, *who, &frame, first);
        let last = self.exchange.open_initiator().filter(is_last);
        let matched = self
            .exchange
            .on_frame(&self.correlation, &frame, first, Instant::from_micros(now));
        let ended = match matched {
            Match::Answer { who, .. } if self.exchange.is_idle() => Some(who),
            _ => None,
        };
        assert!(last.is_none() || last == ended, "the last answer is known before");
        matched
    }

    /// The initiators whose answers are missing at this time.
    pub fn missing(&mut self, now: u64) -> Vec<I> {
        std::iter::from_fn(|| self.exchange.on_timeout(Instant::from_micros(now))).collect()
    }

    pub fn timeout(&self) -> Option<u64> {
        self.exchange.timeout().map(Instant::as_micros)
    }
}

pub fn plain() -> Line<Plain> {
    Line::new(Bytes)
}

pub fn late<I>(who: I, sent: u64) -> Match<I> {
    let sent = Instant::from_micros(sent);
    Match::Late { who, sent }
}

pub fn answer(who: Who, sent: u64) -> Match<Who> {
    Match::Answer {
        who,
        sent: Instant::from_micros(sent),
    }
}

/// A step on the line.
#[derive(Clone, Debug)]
pub enum Step {
    /// An initiator sends a request, if allowed. USB also exceeds the tracked number while no other has sends.
    Send(u8, Who),
    /// An initiator sends a reading that follows or overtakes those before, if allowed.
    Follow(u8, Who),
    Overtake(u8, Who),
    /// An initiator repeats its newest unresolved request of this key, if it has one.
    Repeat(u8, Who),
    /// An initiator gives up its pending answers.
    GiveUp(Who),
    /// The arm answers its nth pending request.
    Answer(usize),
    /// A frame of this key ends. Its first byte arrived this many bytes and microseconds ago.
    Frame(u8, u64, u64),
    Wait(u64),
}

/// A send in the oracle, which keeps all of them.
#[derive(Clone, Debug)]
struct Fact {
    key: u8,
    who: Who,
    offset: u64,
    /// The handovers that may be answered.
    handovers: Vec<u64>,
    /// No answer to an earlier one is possible.
    at: u64,
    due: u64,
    stale: bool,
    resolved: bool,
    counted: bool,
}

impl Fact {
    fn new(key: u8, who: Who, offset: u64, now: u64, counted: bool) -> Self {
        Self {
            key,
            who,
            offset,
            handovers: vec![now],
            at: now,
            due: now + 100,
            stale: false,
            resolved: false,
            counted,
        }
    }

    fn is_open(&self) -> bool {
        self.counted && !self.resolved
    }

    /// Returns true if no request of `who` with this key waits for it.
    fn lets_pass(&self, key: u8, who: Who) -> bool {
        self.key / 10 == key / 10 && (self.key != key || self.who == who && !self.stale)
    }
}

/// Compares the exchange with an oracle that keeps every send and evaluates each rule.
pub fn check(steps: impl IntoIterator<Item = Step>) {
    let mut line = plain();
    let mut facts: Vec<Fact> = Vec::new();
    let (mut now, mut saturated_until) = (0_u64, None::<u64>);
    // The key of the last send that order has resolved, and the time by which its answer would have come.
    let (mut lost, mut out_of_order) = (None::<(u8, u64)>, false);
    for step in steps {
        match step {
            Step::Wait(micros) => now += micros,
            Step::GiveUp(who) => {
                line.exchange.give_up(who);
                for fact in facts.iter_mut().filter(|fact| fact.is_open()) {
                    fact.stale |= fact.who == who;
                }
            }
            Step::Repeat(key, who) => {
                let matches = |fact: &&mut Fact| fact.is_open() && (fact.key, fact.who) == (key, who);
                let Some(fact) = facts.iter_mut().rfind(matches) else {
                    continue;
                };
                line.exchange.repeat(info(key), who, line.handover(now));
                fact.handovers.push(now);
                (fact.due, fact.stale) = (now + 100, false);
            }
            Step::Send(key, who) => {
                let open: Vec<_> = facts.iter().filter(|fact| fact.is_open()).collect();
                let counted = saturated_until.is_none() && open.len() < 4;
                let free = open.iter().all(|fact| fact.lets_pass(key, who));
                assert_eq!(line.can_send(key, who), counted && free, "{key:?} {who:?} {facts:?}");
                let exceeds = who == Who::Usb && open.iter().all(|fact| fact.who == who);
                if !(free && (counted || exceeds)) {
                    continue;
                }
                if !counted {
                    saturated_until = saturated_until.max(Some(now + 150));
                }
                assert_eq!(line.send(key, who, now), counted);
                facts.push(Fact::new(key, who, line.offset, now, counted));
            }
            Step::Overtake(key, who) => {
                let is_overtaken = |fact: &Fact| fact.is_open() && fact.stale && (fact.key, fact.who) == (key, who);
                let (overtaken, rest): (Vec<_>, Vec<_>) = facts.iter().cloned().partition(is_overtaken);
                let open: Vec<_> = rest.iter().filter(|fact| fact.is_open()).collect();
                let has_room = open.len() + overtaken.len().min(1) < 4;
                let free = open.iter().all(|fact| fact.lets_pass(key, who));
                let may = saturated_until.is_none() && has_room && free;
                assert_eq!(line.can_overtake(key, who), may, "{key:?} {who:?} {facts:?}");
                if !may {
                    continue;
                }
                line.overtake(key, who, now);
                facts = rest;
                facts.push(Fact::new(key, who, line.offset, now, true));
                // One send with all their answers. The last of these may be that to the reading.
                if let Some(first) = overtaken.first() {
                    let mut handovers: Vec<_> = overtaken.iter().flat_map(|fact| fact.handovers.clone()).collect();
                    *handovers.last_mut().expect("each has one") = now;
                    facts.push(Fact {
                        handovers,
                        due: now + 100,
                        ..first.clone()
                    });
                }
            }
            Step::Follow(key, who) => {
                let open: Vec<_> = facts.iter().filter(|fact| fact.is_open()).collect();
                let is_own = |fact: &Fact| (fact.key, fact.who) == (key, who);
                let free = open.iter().all(|fact| is_own(fact) || fact.lets_pass(key, who));
                let may = saturated_until.is_none() && open.len() < 4 && free;
                assert_eq!(line.can_follow(key, who), may, "{key:?} {who:?} {facts:?}");
                if may {
                    assert!(line.send(key, who, now));
                    facts.push(Fact::new(key, who, line.offset, now, true));
                }
            }
            Step::Answer(_) | Step::Frame(..) => {
                let (key, bytes, micros) = match step {
                    Step::Answer(nth) => {
                        let open: Vec<_> = facts.iter().filter(|fact| !fact.resolved).collect();
                        match open.get(nth) {
                            Some(fact) => (fact.key, 0, 0),
                            None => continue,
                        }
                    }
                    Step::Frame(key, bytes, micros) => (key, bytes, micros),
                    _ => unreachable!(),
                };
                let (offset, began) = (line.offset.saturating_sub(bytes), now.saturating_sub(micros));
                let of = facts.iter().position(|fact| {
                    fact.is_open()
                        && fact.key == key
                        && fact.offset <= offset
                        && fact.at <= began
                        && (!fact.stale || now < fact.due + 50)
                });
                let expected = match of {
                    None => Match::Unsolicited,
                    Some(index) if facts[index].stale => late(facts[index].who, facts[index].at),
                    Some(index) => answer(facts[index].who, facts[index].at),
                };
                assert_eq!(line.frame_from(key, offset, Some(began), now), expected);
                let is_answer = |(lost, until)| lost == key && now <= until && saturated_until.is_none();
                out_of_order |= of.is_none() && lost.is_some_and(is_answer);
                assert_eq!(line.exchange.out_of_order() > 0, out_of_order);
                if let Some(index) = of {
                    let at = facts[index].at;
                    // The first that is left, or any of several.
                    facts[index].handovers.remove(0);
                    if let [left] = facts[index].handovers[..] {
                        facts[index].at = left;
                    }
                    facts[index].resolved = facts[index].handovers.is_empty();
                    for fact in facts
                        .iter_mut()
                        .filter(|fact| fact.is_open() && fact.stale && !out_of_order)
                    {
                        if fact.handovers.iter().all(|handover| *handover < at) {
                            (fact.resolved, lost) = (true, Some((fact.key, now + 100)));
                        }
                    }
                    for fact in &mut facts {
                        if fact.is_open() && !fact.stale && fact.at >= at {
                            fact.due = fact.due.max(now + 100);
                        }
                    }
                    saturated_until = saturated_until.map(|until| until.max(now + 150));
                }
            }
        }
        // Time passes to the next timeouts.
        let mut missing = Vec::new();
        for fact in facts.iter_mut().filter(|fact| fact.is_open()) {
            if !fact.stale && fact.due <= now {
                fact.stale = true;
                missing.push(fact.who);
            }
            fact.resolved = fact.stale && fact.due + 50 <= now;
        }
        saturated_until = saturated_until.filter(|until| now < *until);
        assert_eq!(line.missing(now), missing);
        // No overdue send is left, and the rest is bounded.
        let open: Vec<_> = facts.iter().filter(|fact| fact.is_open()).collect();
        assert!(open.len() <= 4);
        let next = open
            .iter()
            .map(|fact| if fact.stale { fact.due + 50 } else { fact.due });
        assert_eq!(line.timeout(), next.chain(saturated_until).min());
        let expect = open.first().map_or(u8::MAX, |fact| fact.key / 10);
        assert_eq!(line.exchange.expect(&Bytes), expect);
        assert_eq!(line.exchange.is_idle(), open.is_empty() && saturated_until.is_none());
    }
}
