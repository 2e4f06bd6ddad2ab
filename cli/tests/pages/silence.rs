//! The pages state the limits of an arm's silence.

use armwire_host::SilenceLimit as Limit;

const SAFETY: &str = include_str!("../../../docs/safety.md");
const TELEOP: &str = include_str!("../../../docs/teleop.md");
const ROS2: &str = include_str!("../../../docs/ros2.md");

#[test]
fn documents_state_the_limits() {
    let seconds = |limit: Limit| limit.least().as_micros() as f64 / 1e6;
    for limit in [Limit::STALE, Limit::PAUSE, Limit::FAIL, Limit::REOPEN, Limit::STOP] {
        assert!(SAFETY.contains(&format!("\n| {} s | ", seconds(limit))), "{limit:?}");
    }
    let (pause, fail) = (seconds(Limit::PAUSE), seconds(Limit::FAIL));
    assert!(TELEOP.contains(&format!("the leader is not read for {pause} s, ")));
    assert!(TELEOP.contains(&format!("is not read for {pause} s (`replay`: {fail} s)")));
    assert!(ROS2.contains(&format!("The arm is not read for {fail} s, ")));
    assert!(ROS2.contains(&format!("After {} s the port is opened again", seconds(Limit::REOPEN))));
}
