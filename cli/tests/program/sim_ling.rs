//! `armwire sim ling`: the plant of its arm.

use std::time::Instant;

use rustix::process::Signal;

use crate::common::{Arm, TIMEOUT, success, usage};

#[test]
fn loaded_joints_rest_below_their_goal() {
    let arm = Arm::start("ling", "plant", &["--plant", "sag=26"]);
    let sagged = "joints           +0.00° -2.29° -1.85° +0.00° -0.88° +0.00°";
    let deadline = Instant::now() + TIMEOUT;
    while !success(&["info", &arm.port]).lines().any(|line| line == sagged) {
        assert!(Instant::now() < deadline, "the joints do not sag");
    }
    arm.stop(Signal::INT);
}

#[test]
fn wrong_plant_is_refused_with_its_word() {
    for (plant, reason) in [
        (
            "gremlins=1",
            "unknown word 'gremlins=1': expected ideal, typical, sag=TICKS, ",
        ),
        ("typical,sag=201", "'sag=201': expected sag=N with N from 0 to 200"),
        ("sag=1,sag=2", "'sag=2': the same word is given twice"),
    ] {
        let error = usage(&["sim", "ling", "--plant", plant]);
        assert!(error.contains(reason), "{error}");
    }
    usage(&["sim", "ling", "--legacy", "--plant", "typical"]);
}

#[test]
fn wrong_word_of_a_leader_is_refused() {
    let error = usage(&["sim", "ling", "--force-feedback=apply"]);
    assert!(error.contains("'apply': expected apply=TIMEms, never, "), "{error}");
    usage(&["sim", "ling", "--legacy", "--force-feedback"]);
}
