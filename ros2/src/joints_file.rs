//! The file with the joints of the arms: names, limits and tolerances. Omitted values have defaults.

use std::collections::{BTreeMap, HashSet};
use std::f64::consts::PI;
use std::time::Duration;

use armwire::ling::JOINTS;
use serde::Deserialize;

use crate::joint_states::{DEFAULT_NAMES, joints};
use crate::tolerances::DEFAULT_GOAL_TIME;
use crate::trajectory::{Joint, MAX_GOAL_TIME};

/// The joints of one arm.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Joints {
    /// The six joints and the gripper. The arm reports the gripper's range.
    pub(crate) all: Vec<Joint>,
    /// Time after the last point of a goal, by default, until the joints must be at it.
    pub(crate) goal_time: Duration,
}

/// A section of the file: an arm.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Section {
    goal_time: Option<f64>,
    #[serde(default)]
    joints: BTreeMap<String, Entry>,
}

/// A joint, in rad, rad/s, and m for a gripper.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: Option<String>,
    min: Option<f64>,
    max: Option<f64>,
    max_velocity: Option<f64>,
    path_tolerance: Option<f64>,
    goal_tolerance: Option<f64>,
}

impl Default for Joints {
    fn default() -> Self {
        Self {
            all: joints(&DEFAULT_NAMES.map(str::to_owned)),
            goal_time: DEFAULT_GOAL_TIME,
        }
    }
}

/// The joints of the arms by the names of the arms.
///
/// # Errors
///
/// The first part of the text that is wrong, with the arm and the joint.
pub(crate) fn parse(text: &str) -> Result<BTreeMap<String, Joints>, String> {
    let sections: BTreeMap<String, Section> = toml::from_str(text).map_err(|error| error.to_string())?;
    let arm = |(name, section): (String, Section)| match section.joints() {
        Ok(joints) => Ok((name, joints)),
        Err(error) => Err(format!("{name:?}: {error}")),
    };
    sections.into_iter().map(arm).collect()
}

impl Section {
    fn joints(mut self) -> Result<Joints, String> {
        let mut joints = Joints::default();
        for (nth, joint) in joints.all.iter_mut().enumerate() {
            let entry = self.joints.remove(DEFAULT_NAMES[nth]).unwrap_or_default();
            let is_gripper = nth == JOINTS;
            entry
                .apply(joint, is_gripper)
                .map_err(|error| format!("{}: {error}", DEFAULT_NAMES[nth]))?;
        }
        if let Some(unknown) = self.joints.keys().next() {
            return Err(format!("{unknown:?} is none of {}", DEFAULT_NAMES.join(", ")));
        }
        let mut names = HashSet::new();
        if let Some(joint) = joints.all.iter().find(|joint| !names.insert(&joint.name)) {
            return Err(format!("two joints have the name {:?}", joint.name));
        }
        if let Some(seconds) = self.goal_time {
            let max = MAX_GOAL_TIME.as_secs_f64();
            if !(0.0..=max).contains(&seconds) {
                return Err(format!("goal_time {seconds} is not within 0 to {max} s"));
            }
            joints.goal_time = Duration::from_secs_f64(seconds);
        }
        Ok(joints)
    }
}

impl Entry {
    fn apply(self, joint: &mut Joint, is_gripper: bool) -> Result<(), String> {
        if let Some(name) = self.name {
            if name.is_empty() || name.contains(char::is_control) {
                return Err(format!("the name {name:?} is empty or has a control character"));
            }
            joint.name = name;
        }
        if is_gripper && (self.min.is_some() || self.max.is_some() || self.max_velocity.is_some()) {
            return Err("the arm has the gripper's range and velocity".to_owned());
        }
        let (min, max) = (self.min.unwrap_or(-PI), self.max.unwrap_or(PI));
        if !(-PI <= min && min < max && max <= PI) {
            return Err(format!(
                "min {min} and max {max} are not within ±π rad, the lower end first"
            ));
        }
        if let Some(min) = self.min {
            joint.min = joint.min.max(min);
        }
        if let Some(max) = self.max {
            joint.max = joint.max.min(max);
        }
        if let (Some(velocity), Some(max)) = (self.max_velocity, joint.max_speed) {
            if !(velocity > 0.0 && velocity <= max) {
                return Err(format!("max_velocity {velocity} is not within 0 to {max:.3} rad/s"));
            }
            joint.max_speed = Some(velocity);
        }
        for (field, stated, tolerance) in [
            ("path_tolerance", self.path_tolerance, &mut joint.path),
            ("goal_tolerance", self.goal_tolerance, &mut joint.goal),
        ] {
            if let Some(stated) = stated {
                if !(stated > 0.0 && stated.is_finite()) {
                    return Err(format!("{field} {stated} is not above 0"));
                }
                *tolerance = Some(stated);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The one block of this language in the page.
    fn block_of_page(language: &str) -> &'static str {
        let page = include_str!("../../docs/ros2.md");
        let start = format!("```{language}\n");
        let mut blocks = page.split(&*start).skip(1);
        let block = blocks.next().and_then(|rest| rest.split("```").next()).unwrap();
        assert_eq!(blocks.next(), None);
        block
    }

    #[test]
    fn file_of_the_page_sets_what_it_says() {
        let arms = parse(block_of_page("toml")).unwrap();
        let left = &arms["left"];
        assert_eq!(left.goal_time, Duration::from_secs_f64(0.5));
        let [joint1, joint2, joint3, .., gripper] = &left.all[..] else {
            panic!("seven joints")
        };
        assert_eq!((&*joint1.name, joint1.min, joint1.max), ("left_joint1", -2.8, 2.8));
        assert_eq!(joint1.max_speed, Some(3.0));
        assert_eq!(
            (&*joint2.name, joint2.path, joint2.goal),
            ("joint2", Some(0.3), Some(0.02))
        );
        assert_eq!(*joint3, Joints::default().all[2]);
        assert_eq!(&*gripper.name, "left_gripper");
        assert_eq!(arms["right"], Joints::default());
    }

    #[test]
    fn wrong_files_are_refused_with_their_place() {
        for (text, error) in [
            ("[left", "expected"),
            ("[left]\nlimit = 1", "unknown field `limit`"),
            ("[left.joints]\njoint1 = { mim = 1 }", "unknown field `mim`"),
            ("[left.joints]\njoint7 = {}", "\"left\": \"joint7\" is none of joint1"),
            (
                "[left.joints]\njoint1 = { min = 1, max = 0 }",
                "\"left\": joint1: min 1 and max 0",
            ),
            ("[left.joints]\njoint1 = { max = nan }", "\"left\": joint1: min"),
            ("[left.joints]\njoint1 = { min = -3.2 }", "not within ±π"),
            (
                "[left.joints]\njoint1 = { max_velocity = 8 }",
                "max_velocity 8 is not within 0 to 7.670",
            ),
            ("[left.joints]\njoint1 = { max_velocity = 0 }", "max_velocity 0"),
            (
                "[left.joints]\njoint1 = { goal_tolerance = -1 }",
                "goal_tolerance -1 is not above 0",
            ),
            ("[left.joints]\njoint1 = { path_tolerance = inf }", "path_tolerance inf"),
            (
                "[left.joints]\njoint1 = { name = \"joint2\" }",
                "two joints have the name \"joint2\"",
            ),
            (
                "[left.joints]\njoint1 = { name = \"a\\u0007\" }",
                "the name \"a\\u{7}\"",
            ),
            (
                "[left.joints]\ngripper = { max = 0.04 }",
                "the arm has the gripper's range",
            ),
            ("[left]\ngoal_time = 61", "goal_time 61 is not within 0 to 60 s"),
        ] {
            let got = parse(text).unwrap_err();
            assert!(got.contains(error), "{text}: {got}");
        }
    }
}
