//! The rules of the exchange, one test each, and an oracle written from them.

#[allow(unreachable_pub, reason = "it is shared with a fuzz target")]
mod exchange_oracle;

use armwire::exchange::{Match, time_of_state};
use armwire::time::Instant;
use proptest::collection::vec;
use proptest::prelude::*;

use exchange_oracle::Who::{Can, Poll, Usb};
use exchange_oracle::*;

#[test]
fn answer_matches_the_oldest_send_of_its_key() {
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
fn answer_started_before_the_handover_is_ignored() {
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
fn bytes_without_stamps_match_by_offset() {
    let mut line = plain();
    line.send(1, Usb, 100);
    assert_eq!(line.frame_from(1, 0, None, 50), answer(Usb, 100));
}

#[test]
fn send_is_resolved_after_the_stale_window() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert_eq!(line.timeout(), Some(100));
    assert_eq!(line.missing(99), []);
    assert_eq!(line.missing(100), [Usb]);
    assert_eq!(line.timeout(), Some(150));
    assert!(!line.can_send(1, Usb));
    assert_eq!(line.frame(1, 149), late(Usb, 0));
    assert!(line.exchange.is_idle());

    line.send(1, Usb, 200);
    assert_eq!(line.missing(300), [Usb]);
    assert_eq!(line.missing(350), []);
    assert_eq!(line.frame(1, 350), Match::Unsolicited, "the window is over");
    assert!(line.exchange.is_idle() && line.can_send(1, Usb));
}

#[test]
fn frame_resolves_the_sends_that_ended_before_it() {
    let mut line = plain();
    for (first, expected) in [(149, late(Usb, 0)), (150, Match::Unsolicited)] {
        line.send(1, Usb, 0);
        assert_eq!(line.missing(100), [Usb]);
        let offset = line.offset;
        assert_eq!(line.frame_from(1, offset, Some(first), 200), expected, "{first}");
        assert!(line.exchange.is_idle());
    }
}

#[test]
fn frame_without_a_stamp_resolves_no_send() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert_eq!(line.missing(100), [Usb]);
    assert_eq!(line.frame_from(1, 0, None, 200), late(Usb, 0));
}

#[test]
fn late_answer_counts_once_for_its_own_request() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Usb, 0);
    assert_eq!(line.missing(100), [Usb, Usb]);
    assert_eq!(line.frame(1, 110), late(Usb, 0));
    assert_eq!(line.frame(1, 111), Match::Unsolicited);
    assert_eq!(line.frame(2, 112), late(Usb, 0));
}

#[test]
fn request_waits_for_stale_send_of_its_key() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert_eq!(line.missing(100), [Usb]);
    assert!(!line.can_send(1, Usb) && !line.can_send(1, Can), "by any initiator");
    assert!(line.can_send(2, Poll), "another key");
    assert_eq!(line.frame(1, 120), late(Usb, 0));
    assert!(line.can_send(1, Usb));
}

#[test]
fn request_waits_for_same_key_of_another_initiator() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert!(line.can_send(1, Usb), "its own");
    assert!(!line.can_send(1, Can));
    assert!(line.can_send(2, Poll));
    assert_eq!(line.frame(1, 10), answer(Usb, 0));
    assert!(line.can_send(1, Can));
}

#[test]
fn request_waits_for_sends_with_another_expectation() {
    let mut line = plain();
    line.send(1, Usb, 0);
    assert!(!line.can_send(11, Usb), "even its own");
    assert_eq!(line.missing(100), [Usb]);
    assert!(!line.can_send(11, Usb), "stale ones too");
    assert_eq!(line.missing(150), []);
    assert!(line.can_send(11, Usb));
    line.send(11, Usb, 160);
    assert_eq!(line.exchange.expect(&Bytes), 1);
}

#[test]
fn requests_without_an_answer_wait_for_nothing() {
    let mut line = plain();
    for n in 0..9 {
        line.send(1, Usb, n);
    }
    assert!(!line.can_send(11, Can));
    assert!(line.exchange.can_send(&UNANSWERED, Poll));
    let timeout = line.timeout();
    line.exchange.begin(UNANSWERED, Poll, line.handover(5));
    assert_eq!(line.timeout(), timeout, "no request waits for them");
}

#[test]
fn exchange_limits_the_number_of_tracked_sends() {
    let mut line = plain();
    for n in 0..4 {
        assert!(line.can_send(1, Usb) && line.send(1, Usb, n));
    }
    assert!(!line.can_send(1, Usb) && !line.can_send(2, Can) && !line.exchange.is_saturated());
    assert_eq!(line.frame(1, 10), answer(Usb, 0));
    assert!(line.can_send(1, Usb) && line.can_send(2, Can));
}

#[test]
fn untracked_send_saturates_the_exchange() {
    let mut line = plain();
    for n in 0..4 {
        assert!(line.send(1, Usb, n));
    }
    assert!(!line.send(1, Usb, 4), "it is not tracked");
    assert!(line.exchange.is_saturated());
    assert_eq!(line.frame(1, 10), answer(Usb, 0));
    assert!(
        !line.can_send(1, Usb) && !line.can_send(2, Can),
        "saturated, though a slot is free"
    );
}

#[test]
fn untracked_sends_evict_nothing() {
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
    assert_eq!(line.frame(9, 51), Match::Unsolicited, "not tracked");
}

#[test]
fn saturation_ends_with_the_last_stale_window() {
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
    assert!(line.exchange.is_saturated() && !line.can_send(2, Can));
    line.send(1, Usb, 159);
    assert_eq!(line.missing(160), []);
    assert!(line.exchange.is_saturated(), "sends during saturation are not tracked");
    assert_eq!(line.missing(159 + 150), []);
    assert!(line.exchange.is_idle() && line.can_send(2, Can));
}

#[test]
fn with_transaction_ids_nothing_waits() {
    let mut line = Line::<Numbered>::new(Bytes);
    for key in 0..20 {
        assert!(line.can_send(key, Can));
        line.send(key, Can, key.into());
        line.exchange.give_up(Can);
    }
    assert!(line.can_send(3, Usb));
    line.send(3, Usb, 30);
    assert_eq!(line.frame(19, 40), late(Can, 19));
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
fn answer_extends_no_earlier_deadline() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Usb, 10);
    assert_eq!(line.frame(2, 60), answer(Usb, 10));
    assert_eq!(line.timeout(), Some(100));
}

#[test]
fn repeat_belongs_to_the_same_call() {
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
    assert!(!line.can_send(1, ()), "the second answer is pending");
    assert_eq!(line.frame(1, 151), late((), 100));
    assert!(line.can_send(1, ()));
}

#[test]
fn repeats_take_no_more_room() {
    let mut line: Line<Plain, ()> = Line::new(Bytes);
    line.send(1, (), 0);
    for n in 1..=20 {
        line.exchange.repeat(info(1), (), line.handover(100 * n));
    }
    assert!(!line.exchange.is_saturated());
    assert_eq!(line.exchange.due(()), Some(Instant::from_micros(2100)));
    assert!(matches!(line.frame(1, 2050), Match::Answer { .. }));
    line.exchange.give_up(());
    for _ in 0..20 {
        assert!(matches!(line.frame(1, 2060), Match::Late { .. }));
    }
    assert!(line.exchange.is_idle());
}

#[test]
fn reading_waits_for_no_reading_before_it() {
    let mut line = plain();
    for at in [0, 10, 20] {
        assert!(line.can_follow(1, Usb));
        line.send(1, Usb, at);
        line.exchange.give_up(Usb);
        assert!(!line.can_send(1, Usb) && !line.can_follow(1, Can));
    }
    for at in [0, 10, 20] {
        assert_eq!(line.frame(1, 30), late(Usb, at), "in their order");
    }
    assert!(line.exchange.is_idle() && line.can_send(1, Usb));
}

#[test]
fn reading_takes_the_answer_of_an_overtaken_one() {
    let mut line = plain();
    line.overtake(1, Usb, 0);
    assert_eq!(line.missing(100), [Usb]);
    assert!(!line.can_send(1, Usb) && line.can_overtake(1, Usb) && !line.can_overtake(1, Can));
    line.overtake(1, Usb, 140);
    assert_eq!(line.frame(1, 141), answer(Usb, 140));
    // Its own answer is still to come.
    assert_eq!(line.timeout(), Some(140 + 150));
    assert!(!line.can_send(1, Usb));
    assert_eq!(line.frame(1, 289), late(Usb, 0));
    assert!(line.exchange.is_idle() && line.can_send(1, Usb));
}

#[test]
fn overtaken_readings_take_the_room_of_one() {
    let mut line = plain();
    for n in 0..50 {
        assert!(line.can_overtake(1, Usb), "{n}");
        line.overtake(1, Usb, n);
        line.exchange.give_up(Usb);
    }
    line.send(2, Can, 50);
    line.send(3, Poll, 50);
    assert!(line.can_overtake(1, Usb) && !line.can_send(4, Can));
    line.overtake(1, Usb, 51);
    assert_eq!(line.frame(1, 52), answer(Usb, 51));
    for n in 0..50 {
        assert!(matches!(line.frame(1, 52), Match::Late { .. }), "{n}");
    }
    assert_eq!(line.frame(1, 52), Match::Unsolicited);
}

#[test]
fn answer_to_a_later_send_resolves_earlier_ones() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.exchange.give_up(Usb);
    line.send(2, Usb, 10);
    assert!(!line.can_send(1, Usb));
    assert_eq!(line.frame(2, 20), answer(Usb, 10));
    assert!(line.exchange.is_idle() && line.can_send(1, Usb), "its answer is lost");
}

#[test]
fn order_resolves_no_pending_send() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Can, 10);
    assert_eq!(line.frame(2, 20), answer(Can, 10));
    assert_eq!(line.missing(100), [Usb]);
}

#[test]
fn order_resolves_a_send_after_its_last_handover() {
    let mut line = Line::<Plain, ()>::new(Bytes);
    line.send(1, (), 0);
    line.send(2, (), 10);
    line.exchange.repeat(info(1), (), line.handover(20));
    line.exchange.give_up(());
    assert_eq!(line.frame(2, 30), late((), 10));
    assert!(!line.can_send(1, ()), "the repeat may be answered");
    line.send(2, (), 40);
    assert!(matches!(line.frame(2, 50), Match::Answer { .. }));
    assert!(line.can_send(1, ()));
}

#[test]
fn last_answer_to_a_repeated_send_proves_what_the_repeat_does() {
    let mut line = Line::<Plain, ()>::new(Bytes);
    line.send(1, (), 0);
    line.exchange.give_up(());
    line.send(2, (), 10);
    line.exchange.repeat(info(1), (), line.handover(20));
    line.exchange.give_up(());
    assert_eq!(line.frame(1, 30), late((), 0));
    assert!(!line.can_send(2, ()), "it may be the answer from before");
    assert_eq!(line.frame(1, 40), late((), 20));
    assert!(line.can_send(2, ()));
}

#[test]
fn answer_out_of_order_ends_the_rule_of_order() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.exchange.give_up(Usb);
    line.send(2, Usb, 10);
    assert_eq!(line.frame(2, 20), answer(Usb, 10));
    assert_eq!(line.exchange.out_of_order(), 0);
    assert_eq!(line.frame(1, 21), Match::Unsolicited);
    assert_eq!(line.exchange.out_of_order(), 1);
    line.send(1, Usb, 30);
    line.exchange.give_up(Usb);
    line.send(2, Usb, 40);
    assert_eq!(line.frame(2, 50), answer(Usb, 40));
    assert_eq!(line.frame(1, 51), late(Usb, 30), "only time resolves it");
}

#[test]
fn numbered_answers_need_no_order() {
    let mut line = Line::<Numbered>::new(Bytes);
    line.send(1, Usb, 0);
    line.exchange.give_up(Usb);
    line.send(2, Usb, 10);
    assert_eq!(line.frame(2, 20), answer(Usb, 10));
    assert_eq!(line.frame(1, 21), late(Usb, 0));
}

#[test]
fn state_is_as_old_as_a_slow_answer_may_make_it() {
    let at = Instant::from_millis;
    assert_eq!(time_of_state(at(100), at(110)), at(110));
    assert_eq!(time_of_state(at(100), at(111)), at(100));
}

#[test]
fn initiator_is_due_with_its_first_answer() {
    let mut line = plain();
    line.send(1, Usb, 0);
    line.send(2, Can, 5);
    assert_eq!(line.exchange.due(Can), Some(Instant::from_micros(105)));
    line.exchange.give_up(Can);
    assert_eq!(line.exchange.due(Can), None);
    assert_eq!(line.exchange.due(Usb), Some(Instant::from_micros(100)));
}

#[test]
fn clear_discards_all_sends() {
    let mut line = plain();
    for n in 0..9 {
        line.send(1, Usb, n);
    }
    assert!(!line.can_send(2, Can));
    assert_eq!(line.exchange.clear(), 4);
    assert!(line.exchange.is_idle() && line.can_send(2, Usb));
    assert_eq!(line.frame(1, 9), Match::Unsolicited);
}

fn step() -> impl Strategy<Value = Step> {
    let who = prop_oneof![Just(Usb), Just(Can), Just(Poll)];
    let key = prop_oneof![0..3_u8, 10..12_u8];
    prop_oneof![
        4 => (key.clone(), who.clone()).prop_map(|(key, who)| Step::Send(key, who)),
        1 => (key.clone(), who.clone()).prop_map(|(key, who)| Step::Follow(key, who)),
        1 => (key.clone(), who.clone()).prop_map(|(key, who)| Step::Overtake(key, who)),
        1 => (key.clone(), who.clone()).prop_map(|(key, who)| Step::Repeat(key, who)),
        1 => who.prop_map(Step::GiveUp),
        3 => (0..3_usize).prop_map(Step::Answer),
        1 => (key, 0..4_u64, 0..60_u64).prop_map(|(key, bytes, micros)| Step::Frame(key, bytes, micros)),
        2 => (1..60_u64).prop_map(Step::Wait),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_000))]

    #[test]
    fn exchange_follows_its_rules(steps in vec(step(), 0..120)) {
        exchange_oracle::check(steps);
    }
}
