//! The fault campaign's checks can fail: each test here does behind their back what they are to find.

use armwire_host_tests::image::campaign::{Case, Deceit, Fault, Moment};

/// A run in which a byte is lost, and something of which nobody tells the checks.
fn run(deceit: Option<Deceit>) -> Result<(), String> {
    let case = Case {
        seed: 1,
        number: 0,
        fault: Fault::ByteDropped,
        moment: Moment::Any,
        second: None,
    };
    case.run_deceived(deceit).result.map(drop)
}

fn expect_found(deceit: Deceit, complaint: &str) {
    let error = run(Some(deceit)).unwrap_err();
    println!("{error}");
    assert!(error.contains(complaint), "{error}");
}

#[test]
fn a_run_without_deceit_passes() {
    assert_eq!(run(None), Ok(()));
}

#[test]
fn bytes_that_are_lost_without_being_counted_are_found() {
    expect_found(Deceit::LosesBytes, "bytes from the arm");
}

#[test]
fn a_counter_that_counts_what_did_not_happen_is_found() {
    expect_found(Deceit::CountsErrors, "framing errors");
}

#[test]
fn an_answer_that_the_arm_did_not_give_is_found() {
    expect_found(Deceit::MakesUpAnswer, "answers nothing");
}

#[test]
fn a_motion_that_nobody_commanded_is_found() {
    expect_found(Deceit::Moves, "the arm was commanded");
}

#[test]
fn a_restart_is_found() {
    expect_found(Deceit::Restarts, "restarts [Power]");
}

#[test]
fn traffic_that_does_not_come_back_is_found() {
    expect_found(Deceit::StaysSilent, "no traffic of");
}
