//! The rules of the exchange, one test each, and an oracle written from them.

use armwire::engine::dialect::{Dialect, Effect, RequestInfo, ResponseTiming};
use armwire::engine::exchange::{Exchange, FirstByte, Handover, Initiator, Match};
use armwire::engine::framing::{Framing, Reason, Scan};
use armwire::time::{Duration, Instant};
use proptest::collection::vec;
use proptest::prelude::*;

/// A frame is two bytes: its key, and whatever. What must be expected is the key divided by ten.
#[derive(Clone, Copy, Debug)]
struct Bytes<const NUMBERED: bool>;

type Plain = Bytes<false>;
type Numbered = Bytes<true>;

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

impl<const NUMBERED: bool> Dialect for Bytes<NUMBERED> {
    const HAS_TRANSACTION_ID: bool = NUMBERED;
    type Key = u8;

    fn request(&self, frame: &[u8]) -> Option<RequestInfo<u8, u8>> {
        frame.first().map(|key| info(*key))
    }

    fn is_response_to(&self, key: u8, frame: &[u8]) -> bool {
        frame.first() == Some(&key)
    }
}

const fn info(key: u8) -> RequestInfo<u8, u8> {
    RequestInfo {
        key,
        expect: key / 10,
        response: Some(ResponseTiming {
            longest: 2,
            turnaround: PATIENCE,
        }),
        effect: Effect::Read,
    }
}

const UNANSWERED: RequestInfo<u8, u8> = RequestInfo {
    response: None,
    ..info(0)
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Who {
    Usb,
    Can,
    Poll,
}

impl Initiator for Who {
    fn may_exceed(self) -> bool {
        self == Self::Usb
    }
}

use Who::{Can, Poll, Usb};

const PATIENCE: Duration = Duration::from_micros(100);
const WINDOW: Duration = Duration::from_micros(50);

/// A line with an exchange of four sends.
struct Line<D: Dialect<Key = u8, Expect = u8>, I: Initiator = Who> {
    dialect: D,
    exchange: Exchange<D, I, 4>,
    offset: u64,
}

impl<D: Dialect<Key = u8, Expect = u8>, I: Initiator> Line<D, I> {
    fn new(dialect: D) -> Self {
        Self {
            dialect,
            exchange: Exchange::new(WINDOW),
            offset: 0,
        }
    }

    fn may(&mut self, key: u8, who: I) -> bool {
        self.exchange.may_send(&info(key), who)
    }

    /// Hands a request over at this time.
    fn send(&mut self, key: u8, who: I, at: u64) {
        self.exchange.begin(info(key), who, self.handover(at));
    }

    fn handover(&self, at: u64) -> Handover {
        let at = Instant::from_micros(at);
        Handover {
            offset: self.offset,
            at,
            due: at + PATIENCE,
        }
    }

    /// A frame of this key arrives at this time, its first byte with it.
    fn frame(&mut self, key: u8, now: u64) -> Match<I> {
        self.frame_from(key, self.offset, Some(now), now)
    }

    fn frame_from(&mut self, key: u8, offset: u64, at: Option<u64>, now: u64) -> Match<I> {
        self.offset = self.offset.max(offset + 2);
        let first = FirstByte {
            offset,
            at: at.map(Instant::from_micros),
        };
        self.exchange
            .on_frame(&self.dialect, &[key, 0], first, Instant::from_micros(now))
    }

    /// Whose answers are missing at this time.
    fn missing(&mut self, now: u64) -> Vec<I> {
        std::iter::from_fn(|| self.exchange.on_timeout(Instant::from_micros(now))).collect()
    }

    fn timeout(&self) -> Option<u64> {
        self.exchange.timeout().map(Instant::as_micros)
    }
}

fn plain() -> Line<Plain> {
    Line::new(Bytes)
}

fn answer(who: Who, sent: u64) -> Match<Who> {
    Match::Answer {
        who,
        sent: Instant::from_micros(sent),
    }
}

#[test]
fn an_answer_belongs_to_the_oldest_send_of_its_key() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Can, 5);
    line.send(1, Usb, 10);
    assert_eq!(line.frame(1, 20), answer(Usb, 0));
    assert_eq!(line.frame(1, 21), answer(Usb, 10));
    assert_eq!(line.frame(1, 22), Match::Unsolicited);
    assert_eq!(line.frame(2, 23), answer(Can, 5));
}

#[test]
fn an_answer_that_began_before_the_handover_is_none() {
    let mut line = plain();
    line.offset = 10;
    line.send(1, Usb, 100);
    assert_eq!(line.frame_from(1, 9, None, 101), Match::Unsolicited);
    assert_eq!(
        line.frame_from(1, 10, Some(99), 101),
        Match::Unsolicited,
        "by its stamp"
    );
    assert_eq!(line.frame_from(1, 10, Some(100), 101), answer(Usb, 100));
}

#[test]
fn bytes_without_stamps_go_by_their_offset() {
    let mut line = plain();
    line.send(1, Usb, 100);
    assert_eq!(line.frame_from(1, 0, None, 50), answer(Usb, 100));
}

#[test]
fn a_send_is_resolved_when_it_is_due_plus_the_stale_window() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert_eq!(line.timeout(), Some(100));
    assert_eq!(line.missing(99), []);
    assert_eq!(line.missing(100), [Usb]);
    assert_eq!(line.timeout(), Some(150));
    assert!(!line.may(1, Usb));
    assert_eq!(line.frame(1, 149), Match::Late(Usb));
    assert!(line.exchange.is_idle());

    line.send(1, Usb, 200);
    assert_eq!(line.missing(300), [Usb]);
    assert_eq!(line.frame(1, 350), Match::Unsolicited, "the window is over");
    assert_eq!(line.missing(350), []);
    assert!(line.exchange.is_idle() && line.may(1, Usb));
}

#[test]
fn a_late_answer_is_late_once_and_only_for_its_own_request() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Usb, 0);
    assert_eq!(line.missing(100), [Usb, Usb]);
    assert_eq!(line.frame(1, 110), Match::Late(Usb));
    assert_eq!(line.frame(1, 111), Match::Unsolicited);
    assert_eq!(line.frame(2, 112), Match::Late(Usb));
}

#[test]
fn a_request_waits_for_a_stale_send_of_its_key() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert_eq!(line.missing(100), [Usb]);
    assert!(!line.may(1, Usb) && !line.may(1, Can), "whoever asks");
    assert!(line.may(2, Poll), "another key");
    assert_eq!(line.frame(1, 120), Match::Late(Usb));
    assert!(line.may(1, Usb));
}

#[test]
fn a_request_waits_for_a_send_of_its_key_by_another() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert!(line.may(1, Usb), "its own");
    assert!(!line.may(1, Can));
    assert!(line.may(2, Poll));
    assert_eq!(line.frame(1, 10), answer(Usb, 0));
    assert!(line.may(1, Can));
}

#[test]
fn a_request_waits_for_sends_with_another_expectation() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert!(!line.may(11, Usb), "even its own");
    assert_eq!(line.missing(100), [Usb]);
    assert!(!line.may(11, Usb), "stale ones too");
    assert_eq!(line.missing(150), []);
    assert!(line.may(11, Usb));
    line.send(11, Usb, 160);
    assert_eq!(line.exchange.expect(&Bytes), 1);
}

#[test]
fn no_newer_request_passes_one_that_waits_for_its_key() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert!(!line.may(1, Can));
    assert!(!line.may(1, Usb), "USB's included");
    assert!(line.may(2, Usb), "another key passes");
    assert_eq!(line.frame(1, 10), answer(Usb, 0));
    assert!(!line.may(1, Usb) && line.may(1, Can));
    line.send(1, Can, 11);
    assert_eq!(line.frame(1, 12), answer(Can, 11));
    assert!(line.may(1, Usb));
}

#[test]
fn who_waits_longer_goes_first() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert!(!line.may(1, Can) && !line.may(1, Poll));
    assert_eq!(line.frame(1, 10), answer(Usb, 0));
    assert!(!line.may(1, Poll) && line.may(1, Can));
    line.exchange.withdraw(Can);
    assert!(line.may(1, Poll));
}

#[test]
fn requests_without_an_answer_wait_for_nothing() {
    let mut line = plain();
    for n in 0..9 {
        line.send(1, Usb, n);
    }
    assert!(!line.may(11, Can));
    assert!(line.exchange.may_send(&UNANSWERED, Poll));
    let timeout = line.timeout();
    line.exchange.begin(UNANSWERED, Poll, line.handover(5));
    assert_eq!(line.timeout(), timeout, "nor does anything wait for them");
}

#[test]
fn the_initiator_that_may_exceed_does_so_only_alone() {
    let mut line = plain();
    for n in 0..4 {
        assert!(line.may(1, Usb));
        line.send(1, Usb, n);
    }
    assert!(line.may(1, Usb) && !line.exchange.is_saturated());
    line.send(1, Usb, 4);
    assert!(line.exchange.is_saturated() && line.may(1, Usb));
    assert!(!line.may(2, Can), "others wait");
    assert!(!line.may(1, Usb) && !line.may(2, Usb), "and it sends nothing new then");
    line.exchange.withdraw(Can);
    assert!(line.may(1, Usb));
}

#[test]
fn others_may_not_exceed() {
    let mut line = plain();
    for n in 0..4 {
        assert!(line.may(1, Can));
        line.send(1, Can, n);
    }
    assert!(!line.may(1, Can) && !line.may(2, Usb));
    assert_eq!(line.frame(1, 10), answer(Can, 0));
    assert!(line.may(2, Usb) || line.may(1, Can), "one of both");
}

#[test]
fn a_free_place_is_for_who_waits_for_it() {
    let mut line = plain();
    for n in 0..4 {
        line.send(n as u8, Usb, n);
    }
    assert!(!line.may(4, Can));
    assert_eq!(line.frame(0, 10), answer(Usb, 0));
    assert!(!line.may(5, Usb), "the place is taken");
    assert!(line.may(4, Can));
}

#[test]
fn nothing_is_evicted_by_more_than_is_counted() {
    let mut line = plain();
    for n in 0..4 {
        line.send(n as u8, Usb, n);
    }
    for n in 4..9 {
        line.send(9, Usb, n);
    }
    for n in 0..4 {
        assert_eq!(line.frame(n as u8, 50), answer(Usb, n));
    }
    assert_eq!(line.frame(9, 51), Match::Unsolicited, "not counted");
}

#[test]
fn saturation_ends_with_the_stale_window_of_the_last() {
    let mut line = plain();
    for n in 0..4 {
        line.send(n as u8, Usb, 0);
    }
    line.send(9, Usb, 10);
    for n in 0..4 {
        assert_eq!(line.frame(n, 0), answer(Usb, 0));
    }
    assert_eq!(line.timeout(), Some(160));
    assert_eq!(line.missing(159), []);
    assert!(line.exchange.is_saturated() && !line.may(2, Can));
    line.send(1, Usb, 159);
    assert_eq!(line.missing(160), []);
    assert!(
        line.exchange.is_saturated(),
        "what is sent meanwhile is not counted either"
    );
    assert_eq!(line.missing(159 + 150), []);
    assert!(line.exchange.is_idle() && line.may(2, Can));
}

#[test]
fn with_transaction_ids_nothing_waits() {
    let mut line = Line::<Numbered>::new(Bytes);
    for key in 0..20 {
        assert!(line.may(key, Can));
        line.send(key, Can, key.into());
        line.exchange.give_up(Can);
    }
    assert!(line.may(3, Usb));
    line.send(3, Usb, 30);
    assert_eq!(line.frame(19, 40), Match::Late(Can));
    assert_eq!(line.frame(3, 40), answer(Usb, 30));
}

#[test]
fn only_an_answer_moves_a_deadline() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Usb, 0);
    for now in 1..100 {
        assert_eq!(line.frame(7, now), Match::Unsolicited);
    }
    assert_eq!(line.timeout(), Some(100));
    assert_eq!(line.frame(1, 60), answer(Usb, 0));
    assert_eq!(line.timeout(), Some(160), "the arm answers one after the other");
    assert_eq!(line.frame(1, 61), Match::Unsolicited);
    assert_eq!(line.timeout(), Some(160));
}

#[test]
fn an_answer_gives_no_time_to_those_before_it() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Usb, 10);
    assert_eq!(line.frame(2, 60), answer(Usb, 10));
    assert_eq!(line.timeout(), Some(100));
}

#[test]
fn a_repeat_is_of_the_same_call() {
    let mut line = Line::<Plain, ()>::new(Bytes);
    line.send(1, (), 0);
    line.exchange.repeat(info(1), (), line.handover(100));
    assert_eq!(line.timeout(), Some(200));
    assert_eq!(
        line.frame(1, 150),
        Match::Answer {
            who: (),
            sent: Instant::ZERO
        }
    );
    line.exchange.give_up(());
    assert!(!line.may(1, ()), "the second answer is still to come");
    assert_eq!(line.frame(1, 151), Match::Late(()));
    assert!(line.may(1, ()));
}

#[test]
fn an_initiator_is_due_when_its_first_answer_is() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Can, 5);
    assert_eq!(line.exchange.due(Can), Some(Instant::from_micros(105)));
    line.exchange.give_up(Can);
    assert_eq!(line.exchange.due(Can), None);
    assert_eq!(line.exchange.due(Usb), Some(Instant::from_micros(100)));
}

#[test]
fn another_arm_on_the_line_ends_everything() {
    let mut line = plain();
    for n in 0..9 {
        line.send(1, Usb, n);
    }
    assert!(!line.may(2, Can));
    assert_eq!(line.exchange.clear(), 4);
    assert!(line.exchange.is_idle() && line.may(2, Usb));
    assert_eq!(line.frame(1, 9), Match::Unsolicited);
}

/// What happens on a line.
#[derive(Clone, Debug)]
enum Step {
    /// Somebody wants to send, and does if it may.
    Send(u8, Who),
    /// Somebody gives up waiting.
    Withdraw(Who),
    /// The arm answers the nth request that it has, or says this of itself.
    Answer(usize),
    Say(u8),
    Wait(u64),
}

fn step() -> impl Strategy<Value = Step> {
    let who = prop_oneof![Just(Usb), Just(Can), Just(Poll)];
    let key = prop_oneof![0..3_u8, 10..12_u8];
    prop_oneof![
        4 => (key.clone(), who.clone()).prop_map(|(key, who)| Step::Send(key, who)),
        1 => who.prop_map(Step::Withdraw),
        3 => (0..3_usize).prop_map(Step::Answer),
        1 => key.prop_map(Step::Say),
        2 => (1..60_u64).prop_map(Step::Wait),
    ]
}

/// A send as the oracle keeps it: all of them, for ever.
#[derive(Clone, Debug)]
struct Fact {
    key: u8,
    who: Who,
    offset: u64,
    at: u64,
    due: u64,
    stale: bool,
    resolved: bool,
    counted: bool,
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    /// An oracle that keeps every send for ever and looks each rule up.
    #[test]
    fn the_exchange_follows_its_rules(steps in vec(step(), 0..120)) {
        let mut line = plain();
        let mut facts: Vec<Fact> = Vec::new();
        // Requests that wait, in order: key and who.
        let mut waiting: Vec<(u8, Who)> = Vec::new();
        let (mut now, mut saturated_until) = (0_u64, None::<u64>);
        for step in steps {
            match step {
                Step::Wait(micros) => now += micros,
                Step::Withdraw(who) => {
                    line.exchange.withdraw(who);
                    waiting.retain(|(_, other)| *other != who);
                }
                Step::Send(key, who) => {
                    let open: Vec<_> = facts.iter().filter(|fact| fact.counted && !fact.resolved).collect();
                    let ahead: Vec<_> = waiting.iter().take_while(|(_, other)| *other != who).collect();
                    let others_wait = waiting.iter().any(|(_, other)| *other != who);
                    let alone = open.iter().all(|fact| fact.who == who) && !others_wait;
                    let counted_room = saturated_until.is_none() && open.len() + ahead.len() < 4;
                    let free = open.iter().all(|fact| {
                        fact.key / 10 == key / 10 && (fact.key != key || fact.who == who && !fact.stale)
                    });
                    let passes = ahead.iter().any(|(other, _)| *other == key || other / 10 != key / 10);
                    let may = (counted_room || who == Usb && alone) && free && !passes;
                    prop_assert_eq!(line.may(key, who), may, "{:?} {:?} {:?}", key, who, facts);
                    if !may {
                        match waiting.iter_mut().find(|(_, other)| *other == who) {
                            Some(waiter) => waiter.0 = key,
                            None => waiting.push((key, who)),
                        }
                        continue;
                    }
                    waiting.retain(|(_, other)| *other != who);
                    let counted = saturated_until.is_none() && open.len() < 4;
                    if !counted {
                        saturated_until = saturated_until.max(Some(now + 150));
                    }
                    line.send(key, who, now);
                    let offset = line.offset;
                    let (due, stale, resolved) = (now + 100, false, false);
                    facts.push(Fact { key, who, offset, at: now, due, stale, resolved, counted });
                }
                Step::Answer(_) | Step::Say(_) => {
                    let key = match step {
                        Step::Answer(nth) => {
                            let open: Vec<_> = facts.iter().filter(|fact| !fact.resolved).collect();
                            match open.get(nth) {
                                Some(fact) => fact.key,
                                None => continue,
                            }
                        }
                        Step::Say(key) => key,
                        _ => unreachable!(),
                    };
                    let offset = line.offset;
                    let of = facts.iter().position(|fact| {
                        fact.counted && !fact.resolved && fact.key == key && fact.offset <= offset && now < fact.due + 50
                    });
                    let expected = match of {
                        None => Match::Unsolicited,
                        Some(index) if facts[index].stale => Match::Late(facts[index].who),
                        Some(index) => answer(facts[index].who, facts[index].at),
                    };
                    prop_assert_eq!(line.frame(key, now), expected);
                    if let Some(index) = of {
                        facts[index].resolved = true;
                        let at = facts[index].at;
                        for (other, fact) in facts.iter_mut().enumerate() {
                            if fact.counted && !fact.resolved && !fact.stale && fact.at >= at && other != index {
                                fact.due = fact.due.max(now + 100);
                            }
                        }
                        saturated_until = saturated_until.map(|until| until.max(now + 150));
                    }
                }
            }
            // Time passes for what is due.
            let mut missing = Vec::new();
            for fact in facts.iter_mut().filter(|fact| fact.counted && !fact.resolved) {
                if !fact.stale && fact.due <= now {
                    fact.stale = true;
                    missing.push(fact.who);
                }
                fact.resolved = fact.stale && fact.due + 50 <= now;
            }
            saturated_until = saturated_until.filter(|until| now < *until);
            prop_assert_eq!(line.missing(now), missing);
            // Nothing that is due is left, and what is left is bounded.
            let open: Vec<_> = facts.iter().filter(|fact| fact.counted && !fact.resolved).collect();
            prop_assert!(open.len() <= 4);
            let next = open.iter().map(|fact| if fact.stale { fact.due + 50 } else { fact.due });
            prop_assert_eq!(line.timeout(), next.chain(saturated_until).min());
            let expect = open.first().map_or(u8::MAX, |fact| fact.key / 10);
            prop_assert_eq!(line.exchange.expect(&Bytes), expect);
            prop_assert_eq!(line.exchange.is_idle(), open.is_empty() && saturated_until.is_none());
        }
    }
}
