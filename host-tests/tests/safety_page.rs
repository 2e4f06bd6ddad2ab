//! `docs/safety.md` names existing tests.

use std::fs;
use std::path::Path;

/// The files of these tests.
const TESTS: [&str; 54] = [
    "bridge/src/tests/control.rs",
    "bridge/src/tests/delayed.rs",
    "bridge/src/tests/line_rate.rs",
    "bridge/src/tests/order.rs",
    "bridge/src/tests/recovery.rs",
    "bridge/src/tests/safety.rs",
    "bridge/src/tests/share.rs",
    "bridge/src/tests/stop.rs",
    "cli/tests/program/adapter.rs",
    "cli/tests/program/foreign.rs",
    "cli/tests/program/park.rs",
    "cli/tests/program/replay.rs",
    "cli/tests/program/signals.rs",
    "cli/tests/program/stop.rs",
    "cli/tests/program/teleop.rs",
    "host-tests/tests/image/crash_loop.rs",
    "host-tests/tests/image/flash.rs",
    "host-tests/tests/image/delayed.rs",
    "host-tests/tests/image/rate.rs",
    "host-tests/tests/image/recovery.rs",
    "host-tests/tests/image/start.rs",
    "host-tests/tests/image/stop.rs",
    "host-tests/tests/image/stop_with_weight.rs",
    "host-tests/tests/image/teleop.rs",
    "host-tests/tests/stop_with_weight.rs",
    "host/src/motion/goal.rs",
    "host/src/ports/link/calls.rs",
    "host/src/motion/replay/motion.rs",
    "host/src/motion/trajectory.rs",
    "host/src/arm/ling.rs",
    "host/src/arm/ling/park.rs",
    "host/src/arm/ling/wait.rs",
    "host/src/arm/stop.rs",
    "host/tests/ling.rs",
    "host/tests/lost_port.rs",
    "host/tests/motion/follow.rs",
    "host/tests/motion/replay.rs",
    "host/tests/motion/trajectory.rs",
    "protocol/tests/client.rs",
    "protocol/tests/driver.rs",
    "protocol/tests/read_back.rs",
    "protocol/tests/stop.rs",
    "python/tests/test_aio.py",
    "python/tests/test_board.py",
    "python/tests/test_foreign.py",
    "python/tests/test_hiccup.py",
    "python/tests/test_lerobot.py",
    "python/tests/test_ling.py",
    "python/tests/test_stop.py",
    "ros2/src/joint_states.rs",
    "ros2/src/motion.rs",
    "ros2/src/silence.rs",
    "ros2/src/source.rs",
    "web/engine/src/session/tests.rs",
];

#[test]
fn each_guarantee_has_a_test() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let page = fs::read_to_string(root.join("docs/safety.md")).unwrap();
    let tables = page.split("| Guarantee | Test |\n|---|---|\n").skip(1);
    let code = TESTS.map(|path| fs::read_to_string(root.join(path)).unwrap()).concat();
    // Some tests are in a module of their file.
    let code: String = code.lines().flat_map(|line| [line.trim_start(), "\n"]).collect();
    let rows: Vec<&str> = tables
        .flat_map(|rest| rest.split("\n\n").next().unwrap().lines())
        .collect();
    assert!(rows.len() >= 40, "{} guarantees", rows.len());
    for row in rows {
        let (guarantee, tests) = row.trim_matches('|').split_once(" | ").unwrap();
        // Every other part is between backticks.
        let tests: Vec<&str> = tests.split('`').skip(1).step_by(2).collect();
        assert!(!tests.is_empty(), "no test of: {guarantee}");
        for name in tests {
            assert!(
                code.contains(&format!("#[test]\nfn {name}()")) || code.contains(&format!("\ndef {name}(")),
                "no test is called {name}"
            );
        }
    }
}
