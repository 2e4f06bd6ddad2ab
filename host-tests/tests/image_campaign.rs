//! The fault campaign's checks can fail: each test here does behind their back what they are to find. And what a run shows
//! hangs on its seed and its number alone.

use armwire_host_tests::image::campaign::{self, Bench, Case, Fault, Moment, Mutation};

/// A run in which a byte is lost.
const RUN: Case = Case {
    seed: 3,
    number: 0,
    fault: Fault::ByteDropped,
    moment: Moment::Any,
    second: None,
};

/// A run on a used board, with a mutation that the invariants must detect.
fn run(mutation: Option<Mutation>) -> Result<(), String> {
    let mut bench = Bench::default();
    bench.run(RUN).result?;
    bench.run_mutated(RUN, mutation).result.map(drop)
}

fn expect_found(mutation: Mutation, complaint: &str) {
    let error = run(Some(mutation)).unwrap_err();
    println!("{error}");
    assert!(error.contains(complaint), "{error}");
}

#[test]
fn a_run_without_deceit_passes() {
    assert_eq!(run(None), Ok(()));
}

#[test]
fn uncounted_lost_bytes_are_detected() {
    expect_found(Mutation::LostBytes, "bytes from the arm");
}

#[test]
fn wrong_counter_is_detected() {
    expect_found(Mutation::ExtraErrorCount, "framing errors");
}

#[test]
fn forged_answer_is_detected() {
    expect_found(Mutation::ForgedAnswer, "answers nothing");
}

#[test]
fn a_motion_that_nobody_commanded_is_found() {
    expect_found(Mutation::UnrequestedMove, "the arm was commanded");
}

#[test]
fn a_restart_is_found() {
    expect_found(Mutation::UnexpectedRestart, "restarts [Power]");
}

#[test]
fn traffic_that_does_not_come_back_is_found() {
    expect_found(Mutation::SilentArm, "no traffic of");
}

#[test]
fn single_run_equals_run_among_others() {
    let numbers = [0, 1, 2, 3];
    let among = campaign::run(1, &numbers, |_| {}).pop().unwrap();
    let [alone] = &campaign::run(1, &numbers[3..], |_| {})[..] else {
        panic!("not one outcome");
    };
    assert_eq!(alone.case.number, 3);
    assert_eq!(alone.result, among.result);
}

#[test]
fn failed_or_restarted_run_gets_new_board() {
    let first = Bench::default().run(RUN).result;
    let power_loss = Case {
        fault: Fault::PowerLossInSave,
        ..RUN
    };
    let mut bench = Bench::default();
    assert!(bench.run(power_loss).result.is_ok());
    assert_eq!(bench.run(RUN).result, first);
    assert!(bench.run_mutated(RUN, Some(Mutation::SilentArm)).result.is_err());
    assert_eq!(bench.run(RUN).result, first);
    // A board that has had a run meets other moments, which nearly always show.
    assert!((0..8).any(|_| bench.run(RUN).result != first));
}
