//! The names, units and limits of joints, in a file: as a robot's model and other programs have them.
//!
//! `docs/joints.md` describes the file.

use std::collections::{BTreeMap, HashSet};
use std::f64::consts::PI;
use std::fs;
use std::ops::RangeInclusive;
use std::path::Path;
use std::time::Duration;

use armwire::ling::{JOINTS, Position, Speed, Stroke};
use serde::Deserialize;

use crate::error::Error;
use crate::motion::axes::AXES;

/// The names of the joints and of the gripper in this project.
pub const NAMES: [&str; AXES] = ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "gripper"];

/// Maximum time after the last point of a goal.
pub const MAX_GOAL_TIME: Duration = Duration::from_secs(60);
/// The same time by default.
const GOAL_TIME: Duration = Duration::from_secs(1);

/// The distance from the last point, by default, at which a joint has reached its goal, in rad.
const GOAL_TOLERANCE: f64 = 0.05;

/// The part of a range by which a limit may miss its end, one tick: a model has 3.1416 for π.
const ROUNDING: f64 = 1.0 / 4096.0;

/// The sizes of factors: 64 bits keep every tick.
const FACTORS: RangeInclusive<f64> = 1e-9..=1e9;
/// The maximum size of an offset, in times the factor.
const MAX_OFFSET: f64 = 1e6;

/// The unit and the zero of a joint: `value = factor × arm + offset`. `arm` is the arm's angle in rad, or the opening of
/// its gripper in m, where 0 is closed. A negative factor turns the direction.
///
/// ```
/// use armwire_host::joints_file::Scale;
///
/// // A finger of a gripper with 50 mm: at 0 it is open, at -0.025 m closed.
/// let finger = Scale::new(0.5, -0.025)?;
/// assert_eq!(finger.value(0.0), -0.025);
/// assert_eq!(finger.arm(0.0), 0.05);
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    factor: f64,
    offset: f64,
}

impl Scale {
    /// rad and m, as the arm has them.
    pub const ARM: Self = Self {
        factor: 1.0,
        offset: 0.0,
    };

    /// The scale with this factor and offset.
    ///
    /// # Errors
    ///
    /// In words: a factor whose size is not 1e-9 to 1e9, such as 0, and an offset of more than a million times its size.
    pub fn new(factor: f64, offset: f64) -> Result<Self, String> {
        let (size, max_offset) = (factor.abs(), MAX_OFFSET * factor.abs());
        if !FACTORS.contains(&size) {
            let (min, max) = (FACTORS.start(), FACTORS.end());
            return Err(format!(
                "factor {factor:?} is not within {min:e} to {max:e}, or the negative of it"
            ));
        }
        if !(-max_offset..=max_offset).contains(&offset) {
            return Err(format!("offset {offset:?} is not within ±{max_offset}"));
        }
        Ok(Self { factor, offset })
    }

    /// Units for each rad, or for each m of the gripper's opening. Not 0.
    pub const fn factor(self) -> f64 {
        self.factor
    }

    /// The value at the arm's 0 rad, or at the closed gripper.
    pub const fn offset(self) -> f64 {
        self.offset
    }

    /// The value at this angle in rad, or opening in m.
    pub fn value(self, arm: f64) -> f64 {
        self.factor * arm + self.offset
    }

    /// The angle in rad, or the opening in m, at this value.
    pub fn arm(self, value: f64) -> f64 {
        (value - self.offset) / self.factor
    }

    /// The length of a way or a speed in rad or m, in units.
    pub fn length(self, arm: f64) -> f64 {
        self.factor.abs() * arm
    }

    /// The values at two ends, the lower one first.
    fn range(self, ends: [f64; 2]) -> (f64, f64) {
        let [one, other] = ends.map(|end| self.value(end));
        (one.min(other), one.max(other))
    }
}

/// A joint or gripper. Its values are in the units of its [`Scale`].
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Its name in models and messages.
    pub name: String,
    /// Its unit and zero.
    pub scale: Scale,
    /// The lowest position.
    pub min: f64,
    /// The highest position.
    pub max: f64,
    /// Maximum speed, in units per second. `None` without a limit: the gripper.
    pub max_speed: Option<f64>,
    /// Allowed distance from the setpoint during a motion. `None` allows any.
    pub path: Option<f64>,
    /// Allowed distance from the goal after a motion. `None` allows any.
    pub goal: Option<f64>,
}

/// The joints of one arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Joints {
    /// The six joints and the gripper. The range of the gripper is [that of its stroke](Self::with_stroke).
    pub all: [Joint; AXES],
    /// Time after the last point of a goal, by default, until the joints must be at it.
    pub goal_time: Duration,
}

impl Joints {
    /// The same joints, with the range of a gripper of this stroke.
    pub fn with_stroke(mut self, stroke: Stroke) -> Self {
        let open = f64::from(stroke.millimetres()) / 1_000.0;
        let gripper = &mut self.all[JOINTS];
        (gripper.min, gripper.max) = gripper.scale.range([0.0, open]);
        self
    }

    /// The number of the joint with this name, from 0; that of the gripper is the last.
    pub fn axis(&self, name: &str) -> Option<usize> {
        self.all.iter().position(|joint| joint.name == name)
    }

    /// The names, in words.
    pub fn names(&self) -> String {
        self.all.each_ref().map(|joint| &*joint.name).join(", ")
    }
}

impl Default for Joints {
    /// [`NAMES`], in rad and m, with the limits of the protocol.
    fn default() -> Self {
        Self {
            all: std::array::from_fn(|axis| Entry::default().joint(axis).expect("defaults are valid")),
            goal_time: GOAL_TIME,
        }
    }
}

/// A section of the file: an arm.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Section {
    goal_time: Option<f64>,
    #[serde(default)]
    joints: BTreeMap<String, Entry>,
}

/// A joint.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: Option<String>,
    factor: Option<f64>,
    offset: Option<f64>,
    min: Option<f64>,
    max: Option<f64>,
    max_velocity: Option<f64>,
    path_tolerance: Option<f64>,
    goal_tolerance: Option<f64>,
}

/// The joints of the arms in a file, by the names of the arms.
///
/// # Errors
///
/// [`Error::At`] if the file cannot be read, or has a part that is [wrong](parse).
pub fn read(path: &Path) -> Result<BTreeMap<String, Joints>, Error> {
    let text = fs::read_to_string(path).map_err(|error| error.to_string());
    text.and_then(|text| parse(&text))
        .map_err(|reason| Error::at(&path.display().to_string(), reason))
}

/// The joints of one arm in a file: of the only one, or of this one.
///
/// # Errors
///
/// As of [`read`]; [`Error::At`] if the file does not have this arm, or none or several without a name.
pub fn read_arm(path: &Path, name: Option<&str>) -> Result<Joints, Error> {
    let mut arms = read(path)?;
    let names = arms.keys().cloned().collect::<Vec<_>>().join(", ");
    let name = match (name, arms.len()) {
        (Some(name), _) => Some(name.to_owned()),
        (None, 1) => arms.keys().next().cloned(),
        (None, _) => None,
    };
    let reason = match name {
        Some(name) => match arms.remove(&name) {
            Some(joints) => return Ok(joints),
            None => format!("it does not have the arm {name:?}, but: {names}"),
        },
        None if arms.is_empty() => "it has no arm".to_owned(),
        None => format!("it has several arms, and one must be named: {names}"),
    };
    Err(Error::at(&path.display().to_string(), reason))
}

/// The joints of the arms in the text of a file, by the names of the arms.
///
/// # Errors
///
/// The first part of the text that is wrong, with its line, or with the arm and the joint.
pub fn parse(text: &str) -> Result<BTreeMap<String, Joints>, String> {
    let sections: BTreeMap<String, Section> = toml::from_str(text).map_err(|error| in_one_line(text, &error))?;
    let arm = |(name, section): (String, Section)| match section.joints() {
        Ok(joints) => Ok((name, joints)),
        Err(error) => Err(format!("{name:?}: {error}")),
    };
    sections.into_iter().map(arm).collect()
}

fn in_one_line(text: &str, error: &toml::de::Error) -> String {
    let message = error.message().lines().collect::<Vec<_>>().join(", ");
    match error.span().and_then(|span| text.get(..span.start)) {
        Some(before) => format!("line {}: {message}", before.matches('\n').count() + 1),
        None => message,
    }
}

impl Section {
    fn joints(mut self) -> Result<Joints, String> {
        let mut joints = Joints::default();
        for (axis, name) in NAMES.into_iter().enumerate() {
            if let Some(entry) = self.joints.remove(name) {
                joints.all[axis] = entry.joint(axis).map_err(|error| format!("{name}: {error}"))?;
            }
        }
        if let Some(unknown) = self.joints.keys().next() {
            return Err(format!("{unknown:?} is none of {}", NAMES.join(", ")));
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
    /// The joint with this number.
    fn joint(&self, axis: usize) -> Result<Joint, String> {
        let name = self.name.as_deref().unwrap_or(NAMES[axis]);
        if name.is_empty() || name.contains(char::is_control) {
            return Err(format!("the name {name:?} is empty or has a control character"));
        }
        let scale = Scale::new(self.factor.unwrap_or(1.0), self.offset.unwrap_or(0.0))?;
        let is_gripper = axis == JOINTS;
        if is_gripper && (self.min.is_some() || self.max.is_some() || self.max_velocity.is_some()) {
            return Err("the arm has the gripper's range and velocity".to_owned());
        }
        let (min, max) = match is_gripper {
            true => (scale.value(0.0), scale.value(0.0)),
            false => self.range(scale)?,
        };
        Ok(Joint {
            name: name.to_owned(),
            scale,
            min,
            max,
            max_speed: match is_gripper {
                true => None,
                false => Some(self.max_speed(scale)?),
            },
            path: tolerance("path_tolerance", self.path_tolerance)?,
            goal: match tolerance("goal_tolerance", self.goal_tolerance)? {
                // A gripper at an object does not reach its goal.
                None => (!is_gripper).then(|| scale.length(GOAL_TOLERANCE)),
                stated => stated,
            },
        })
    }

    /// The positions that both this entry and the protocol allow.
    fn range(&self, scale: Scale) -> Result<(f64, f64), String> {
        let (low, high) = scale.range([-PI, PI]);
        let (min, max) = (self.min.unwrap_or(low), self.max.unwrap_or(high));
        let rounding = (high - low) * ROUNDING;
        if !(low - rounding <= min && min < max && max <= high + rounding) {
            return Err(format!(
                "min {min} and max {max} are not within {low:.4} to {high:.4}, the lower end first"
            ));
        }
        let first = Position::new(0).unwrap_or(Position::CENTRE);
        let (low, high) = scale.range([first, Position::MAX].map(|end| end.radians().into()));
        let (least, most) = (
            self.min.map_or(low, |min| min.max(low)),
            self.max.map_or(high, |max| max.min(high)),
        );
        match least < most {
            true => Ok((least, most)),
            false => Err(format!(
                "min {min} and max {max} have no position of the arm between them: its range is {low:.4} to {high:.4}"
            )),
        }
    }

    fn max_speed(&self, scale: Scale) -> Result<f64, String> {
        let max = scale.length(Speed::MAX.radians_per_second().into());
        match self.max_velocity {
            None => Ok(max),
            Some(velocity) if velocity > 0.0 && velocity <= max * (1.0 + ROUNDING) => Ok(velocity.min(max)),
            Some(velocity) => Err(format!("max_velocity {velocity} is not within 0 to {max:.3}")),
        }
    }
}

fn tolerance(field: &str, stated: Option<f64>) -> Result<Option<f64>, String> {
    match stated {
        Some(stated) if !(stated > 0.0 && stated.is_finite()) => Err(format!("{field} {stated} is not above 0")),
        stated => Ok(stated),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The joints of the arm in a file of one arm with these joints.
    fn arm(joints: &str) -> Joints {
        let mut arms = parse(&format!("[arm.joints]\n{joints}")).unwrap();
        arms.remove("arm").unwrap()
    }

    #[test]
    fn shipped_examples_have_the_vendors_names_and_ends() {
        for (text, closed) in [
            (include_str!("../../examples/alicia-d-moveit.toml"), -0.025),
            (include_str!("../../examples/alicia-d-driver.toml"), 0.025),
        ] {
            let joints = parse(text).unwrap()["alicia_d"].clone().with_stroke(Stroke::Mm50);
            assert_eq!(
                joints.names(),
                "Joint1, Joint2, Joint3, Joint4, Joint5, Joint6, Gripper"
            );
            let gripper = &joints.all[JOINTS];
            assert_eq!((gripper.scale.value(0.0), gripper.scale.value(0.05)), (closed, 0.0));
            assert_eq!((gripper.min, gripper.max), (closed.min(0.0), closed.max(0.0)));
            assert!(joints.all[..JOINTS].iter().all(|joint| joint.scale == Scale::ARM));
        }
    }

    #[test]
    fn limits_are_in_the_units_of_the_file() {
        let joints = arm("joint1 = { factor = -57.29577951308232, offset = 90, min = -90, max = 100 }");
        let joint = &joints.all[0];
        assert_eq!((joint.min.round(), joint.max), (-90.0, 100.0));
        assert_eq!(joint.max_speed.map(f64::round), Some(439.0));
        assert_eq!(joint.goal.map(|goal| (goal * 100.0).round()), Some(286.0));
        // 0 rad are 90°, and a quarter of a turn goes down.
        assert_eq!(
            (joint.scale.value(0.0), joint.scale.value(PI / 2.0).round()),
            (90.0, 0.0)
        );
        let whole = arm("joint1 = { factor = 57.29577951308232, min = -180, max = 180 }");
        assert_eq!(whole.all[0].max.round(), 180.0);
    }

    #[test]
    fn rounded_limits_are_those_of_the_arm() {
        let rounded = arm("joint1 = { min = -3.1416, max = 3.1416, max_velocity = 7.67 }");
        assert_eq!(rounded.all[0], Joints::default().all[0]);
        let degrees = arm("joint1 = { factor = -57.2958, min = -180, max = 180, max_velocity = 439.5 }");
        assert_eq!((degrees.all[0].min.ceil(), degrees.all[0].max.round()), (-179.0, 180.0));
    }

    #[test]
    fn every_value_survives_its_scale() {
        for (factor, offset) in [
            (1.0, 0.0),
            (-1.0, 0.0),
            (57.3, -180.0),
            (-0.5, 0.025),
            (1e-9, 1e-3),
            (-1e9, 1e15),
        ] {
            let scale = Scale::new(factor, offset).unwrap();
            for ticks in 0..=Position::MAX.ticks() {
                let arm = f64::from(Position::new(ticks).unwrap().radians());
                assert!((scale.arm(scale.value(arm)) - arm).abs() < 1e-9, "{scale:?} {arm}");
            }
        }
    }

    #[test]
    fn arm_of_a_file_is_the_only_or_the_named() {
        let path = std::env::temp_dir().join(format!("armwire-joints-{}.toml", std::process::id()));
        let read = |text: &str, name| {
            fs::write(&path, text).unwrap();
            let result = read_arm(&path, name).map_err(|error| error.to_string());
            fs::remove_file(&path).unwrap();
            result
        };
        let (one, two) = (
            "[a.joints]\njoint1 = { name = \"x\" }",
            "[a]\n[b.joints]\njoint1 = { name = \"x\" }",
        );
        for (text, name) in [(one, None), (one, Some("a")), (two, Some("b"))] {
            assert_eq!(read(text, name).unwrap().axis("x"), Some(0));
        }
        for (text, name, reason) in [
            (one, Some("c"), "it does not have the arm \"c\", but: a"),
            (two, None, "it has several arms, and one must be named: a, b"),
            ("", None, "it has no arm"),
            ("[a]\nfactor = 1", None, "line 2: unknown field `factor`"),
        ] {
            let error = read(text, name).unwrap_err();
            assert!(error.contains(reason) && error.contains("armwire-joints-"), "{error}");
        }
    }

    #[test]
    fn wrong_files_are_refused_with_their_place() {
        for (text, error) in [
            ("[left", "line 1: "),
            ("\n[left]\nlimit = 1", "line 3: unknown field `limit`"),
            ("[left.joints]\njoint1 = { mim = 1 }", "line 2: unknown field `mim`"),
            ("[left.joints]\njoint1 = {}\njoint1 = {}", "line 3: duplicate key"),
            (
                "[left.joints]\njoint1 = { factor = \"2\" }",
                "line 2: invalid type: string",
            ),
            ("[left.joints]\njoint7 = {}", "\"left\": \"joint7\" is none of joint1"),
            (
                "[left.joints]\njoint1 = { min = 1, max = 0 }",
                "\"left\": joint1: min 1 and max 0",
            ),
            ("[left.joints]\njoint1 = { max = nan }", "\"left\": joint1: min"),
            (
                "[left.joints]\njoint1 = { min = 3.1402, max = 3.1415 }",
                "have no position of the arm between them: its range is -3.1416 to 3.1401",
            ),
            (
                "[left.joints]\njoint1 = { factor = -1, min = -3.1415, max = -3.1402 }",
                "its range is -3.1401 to 3.1416",
            ),
            (
                "[left.joints]\njoint1 = { min = -3.2 }",
                "are not within -3.1416 to 3.1416",
            ),
            (
                "[left.joints]\njoint1 = { factor = 2, max = 6.3 }",
                "are not within -6.2832 to 6.2832",
            ),
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
                "[left.joints]\njoint2 = { factor = 1e300 }",
                "joint2: factor 1e300 is not",
            ),
            (
                "[left.joints]\njoint2 = { factor = -0.5, offset = 1e16 }",
                "joint2: offset 1e16 is not within ±500000",
            ),
            (
                "[left.joints]\njoint1 = { name = \"joint2\" }",
                "two joints have the name \"joint2\"",
            ),
            (
                "[left.joints]\njoint1 = { name = \"a\\u0007\" }",
                "the name \"a\\u{7}\"",
            ),
            (
                "[left.joints]\njoint2 = { factor = 0 }",
                "\"left\": joint2: factor 0.0 is not within 1e-9 to 1e9, or the negative of it",
            ),
            ("[left.joints]\njoint2 = { factor = nan }", "joint2: factor NaN is not"),
            (
                "[left.joints]\njoint2 = { factor = -inf }",
                "joint2: factor -inf is not",
            ),
            (
                "[left.joints]\ngripper = { offset = inf }",
                "\"left\": gripper: offset inf is not within ±1000000",
            ),
            (
                "[left.joints]\ngripper = { max = 0.04 }",
                "the arm has the gripper's range",
            ),
            ("[left]\ngoal_time = 61", "goal_time 61 is not within 0 to 60 s"),
        ] {
            let got = parse(text).unwrap_err();
            assert!(got.contains(error) && !got.contains('\n'), "{text}: {got}");
        }
    }
}
