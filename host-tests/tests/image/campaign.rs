//! The fault campaign's checks detect each mutation, and a run is determined by its seed and number.

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

fn expect_detected(mutation: Mutation, violation: &str) {
    let error = run(Some(mutation)).unwrap_err();
    println!("{error}");
    assert!(error.contains(violation), "{error}");
}

#[test]
fn run_without_mutation_passes() {
    assert_eq!(run(None), Ok(()));
}

#[test]
fn uncounted_lost_bytes_are_detected() {
    expect_detected(Mutation::LostBytes, "bytes from the arm");
}

#[test]
fn wrong_counter_is_detected() {
    expect_detected(Mutation::ExtraErrorCount, "framing errors");
}

#[test]
fn forged_answer_is_detected() {
    expect_detected(Mutation::ForgedAnswer, "answers nothing");
}

#[test]
fn unrequested_motion_is_detected() {
    expect_detected(Mutation::UnrequestedMove, "the arm was commanded");
}

#[test]
fn unexpected_restart_is_detected() {
    expect_detected(Mutation::UnexpectedRestart, "restarts [Power]");
}

#[test]
fn missing_recovery_is_detected() {
    expect_detected(Mutation::SilentArm, "no traffic of");
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
    // A used board has other phases, which nearly always change the result.
    assert!((0..8).any(|_| bench.run(RUN).result != first));
}
