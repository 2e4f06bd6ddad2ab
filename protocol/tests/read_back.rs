//! Read-backs of what a Ling arm does not confirm.

use armwire::ling::effect::{Effect, EffectError, Outcome, Output, Verdict};
use armwire::ling::{JointState, MotionStatus, ReadBack, Request, Torque};
use armwire::time::{Duration, Instant};

const ON: Effect = Effect::Torque(Torque::On);

fn state(status: u8, ticks: u16) -> JointState {
    JointState {
        joints: [ticks; 6],
        gripper: 500,
        status: MotionStatus::from(status),
    }
}

/// Reads the effect back from an arm with these readings, by the time after the request; `None` is a lost answer. A call
/// takes 5 ms. Returns the result, its time after the request, and the number of requests that are not reads.
fn read_back(
    effect: Effect,
    reading: impl Fn(Duration) -> Option<JointState>,
) -> (Result<Outcome, EffectError>, Duration, usize) {
    let mut read_back = ReadBack::new(effect);
    let start = Instant::from_millis(3_000);
    let (mut now, mut requests) = (start, 0);
    loop {
        match read_back.poll(now) {
            Output::Request(Request::ReadJoints) => {
                let state = reading(now.since(start));
                now += Duration::from_millis(5);
                if let Some(state) = state {
                    read_back.on_joints(now, &state);
                }
            }
            Output::Request(request) => {
                assert_eq!((request, now), (effect.request(), start));
                requests += 1;
            }
            Output::Wait(until) => {
                assert!(until > now);
                now = until;
            }
            Output::Done(result) => {
                assert_eq!(read_back.poll(now), Output::Done(result));
                return (result, now.since(start), requests);
            }
        }
    }
}

#[test]
fn rows_of_readings_have_their_verdicts() {
    for row in include_str!("effects.txt").lines().filter(|row| !row.starts_with('#')) {
        let columns: Vec<_> = row.split_whitespace().collect();
        let [effect, status, ticks, change, later_status, later_ticks, verdict] = columns[..] else {
            panic!("{row}");
        };
        let effect = match effect {
            "torque-on" => ON,
            "torque-off" => Effect::Torque(Torque::Off),
            "zero" => Effect::Zero,
            _ => panic!("{row}"),
        };
        let state = |status, ticks: &str| state(u8::from_str_radix(status, 16).unwrap(), ticks.parse().unwrap());
        let change = Duration::from_millis(change.parse().unwrap());
        let (before, after) = (state(status, ticks), state(later_status, later_ticks));
        let (result, time, requests) = read_back(effect, |at| Some(if at < change { before } else { after }));
        let got = match result {
            Ok(outcome) if outcome.is_shown => Verdict::Confirmed,
            Ok(_) => Verdict::NotShown,
            Err(EffectError::Contradicted { .. }) => Verdict::Contradicted,
            Err(error) => panic!("{row}: {error}"),
        };
        let (expected, end) = match verdict {
            "confirmed" => (Verdict::Confirmed, change + Duration::from_millis(5)),
            "not-shown" => (Verdict::NotShown, ReadBack::LIMIT),
            "contradicted" => (Verdict::Contradicted, ReadBack::LIMIT),
            _ => panic!("{row}"),
        };
        assert_eq!((got, time, requests), (expected, end, 1), "{row}");
    }
}

#[test]
fn lost_answers_leave_the_verdict_to_the_rest() {
    let is_lost = |at: Duration| at < Duration::from_millis(300);
    let (result, ..) = read_back(ON, |at| (!is_lost(at)).then(|| state(1, 2048)));
    assert!(result.is_ok_and(|outcome| outcome.is_shown));
    let (result, time, _) = read_back(Effect::Zero, |_| None);
    assert_eq!(
        (result, time),
        (Err(EffectError::NoReading(Effect::Zero)), ReadBack::LIMIT)
    );
    let text = "set zero position was sent, but no reading came within 0.5 s";
    assert_eq!(result.unwrap_err().to_string(), text);
}

#[test]
fn reading_of_the_time_before_says_nothing() {
    let (now, mut read_back) = (Instant::from_millis(5), ReadBack::new(ON));
    read_back.on_joints(now, &state(1, 2048));
    assert_eq!(read_back.poll(now), Output::Request(ON.request()));
    read_back.on_joints(now, &state(1, 2048));
    assert_eq!(read_back.poll(now), Output::Request(Request::ReadJoints));
    read_back.on_joints(now + Duration::from_millis(1), &state(1, 2048));
    assert!(matches!(read_back.poll(now), Output::Done(Ok(_))));
}

/// Other calls run from the first reading until after the limit.
#[test]
fn verdict_needs_a_reading_at_the_limit() {
    let start = Instant::from_millis(3_000);
    for (late, is_shown) in [
        (state(0x01, 2048), Some(true)),
        (state(0x10, 2048), Some(false)),
        (state(0x00, 2048), None),
    ] {
        let mut read_back = ReadBack::new(ON);
        assert_eq!(read_back.poll(start), Output::Request(ON.request()));
        assert_eq!(read_back.poll(start), Output::Request(Request::ReadJoints));
        let first = start + Duration::from_millis(1);
        read_back.on_joints(first, &state(0x00, 2048));
        assert!(matches!(read_back.poll(first), Output::Wait(_)));
        let now = start + ReadBack::LIMIT + Duration::from_millis(10);
        assert_eq!(read_back.poll(now), Output::Request(Request::ReadJoints));
        assert!(
            matches!(read_back.poll(now), Output::Wait(_)),
            "the answer is on its way"
        );
        let now = now + Duration::from_millis(5);
        read_back.on_joints(now, &late);
        let Output::Done(result) = read_back.poll(now) else {
            panic!("the late reading decides");
        };
        assert_eq!(result.ok().map(|outcome| outcome.is_shown), is_shown);
    }
}

#[test]
fn lost_late_reading_ends_the_read_back() {
    let is_early = |at: Duration| at < Duration::from_millis(10);
    let (result, time, requests) = read_back(ON, |at| is_early(at).then(|| state(0x00, 2048)));
    assert!(matches!(result, Err(EffectError::Contradicted { .. })), "{result:?}");
    assert_eq!((time, requests), (ReadBack::LIMIT + Duration::from_millis(100), 1));
}
