//! The joints file in docs/joints.md.

use std::time::Duration;

use armwire_host::joints_file::{Joints, parse};

const PAGE: &str = include_str!("../../../docs/joints.md");

#[test]
fn file_of_the_page_sets_what_it_says() {
    let mut blocks = PAGE.split("```toml\n").skip(1);
    let block = blocks.next().and_then(|rest| rest.split("```").next()).unwrap();
    assert_eq!(blocks.next(), None);
    let arms = parse(block).unwrap();
    let left = &arms["left"];
    assert_eq!(left.goal_time, Duration::from_millis(500));
    let [joint1, joint2, joint3, joint4, .., gripper] = &left.all;
    assert_eq!((&*joint1.name, joint1.min, joint1.max), ("left_joint1", -2.8, 2.8));
    assert_eq!(joint1.max_speed, Some(3.0));
    assert_eq!(
        (&*joint2.name, joint2.path, joint2.goal),
        ("joint2", Some(0.3), Some(0.02))
    );
    assert_eq!((joint3.scale.value(0.5), joint3.min, joint3.max), (-0.5, -1.5, 0.5));
    assert_eq!(*joint4, Joints::default().all[3]);
    assert_eq!((&*gripper.name, gripper.scale.value(0.05)), ("left_gripper", 0.0));
    assert_eq!(arms["right"], Joints::default());
}
