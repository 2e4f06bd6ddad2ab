//! The plant of a virtual arm: how its joints follow their commands, as a text.

use std::error::Error;
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use armwire::ling::{JOINTS, TICKS_PER_TURN};
use armwire::time::Duration;

/// Lag, sag, friction and noise of a virtual arm, and what is in its way.
///
/// The text has at most one preset, at its beginning, and these words, separated by commas. Without a preset the words
/// refine [`IDEAL`](Self::IDEAL). No number is measured: the joints of a real arm are not known.
///
/// | Word | Effect |
/// |---|---|
/// | `ideal` | preset: the joints are exactly where their trajectories are |
/// | `typical` | preset: `sag=10,lag=40ms,friction=3,noise=1` |
/// | `sag=TICKS` | joint 2, when horizontal, rests this far below its goal, joint 3 80 % and joint 5 40 % of it, times the cosine of their angles; without torque they sink; 0 to 200 |
/// | `lag=TIMEms` | time by which a joint is behind its moving setpoint, 0 to 1000 |
/// | `overshoot=PERCENT%` | overshoot of a step; the model is then of second order and needs a lag; 0 to 50 |
/// | `friction=TICKS` | error that moves no joint, and load that friction carries, 0 to 100 |
/// | `backlash=TICKS` | play between motor and joint, 0 to 100 |
/// | `noise=TICKS` | largest error of a joint's reading, 0 to 20 |
/// | `seed=N` | seed of the noise |
/// | `restart` | a new goal's trajectory begins at the position, not at the setpoint |
/// | `obstacle=JOINT:ANGLEdeg` | position that joint 1 to 6 does not pass |
/// | `other=JOINT:ANGLEdeg@TIMEms` | goal of joint 1 to 6 from another program, once, this long after power-on |
///
/// ```
/// use armwire_sim::ling::{Config, Plant};
///
/// let config = Config { plant: "typical,sag=26".parse()?, ..Config::follower() };
/// assert_eq!(config.plant.to_string(), "sag=26,lag=40ms,friction=3,noise=1");
/// assert_eq!("".parse::<Plant>().unwrap_err().to_string(), format!("unknown word '': expected {}", Plant::WORDS));
/// # Ok::<(), armwire_sim::ling::PlantError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plant {
    pub(super) sag: u8,
    pub(super) lag: Duration,
    /// In percent; 0 for the first-order model.
    pub(super) overshoot: u8,
    pub(super) friction: u8,
    pub(super) backlash: u8,
    pub(super) noise: u8,
    pub(super) seed: u64,
    pub(super) restart: bool,
    pub(super) obstacle: Option<JointAngle>,
    pub(super) other: Option<(JointAngle, Duration)>,
}

/// An angle of one joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct JointAngle {
    /// 0 to 5.
    pub(super) joint: usize,
    /// `-180..180`.
    degrees: i16,
}

impl JointAngle {
    /// Returns the nearest position.
    pub(super) fn ticks(self) -> u16 {
        let turn = i32::from(TICKS_PER_TURN);
        ((i32::from(self.degrees) * turn + 180).div_euclid(360) + turn / 2) as u16
    }
}

impl Plant {
    /// Joints without mechanics and readings without noise.
    pub const IDEAL: Self = Self {
        sag: 0,
        lag: Duration::ZERO,
        overshoot: 0,
        friction: 0,
        backlash: 0,
        noise: 0,
        seed: 1,
        restart: false,
        obstacle: None,
        other: None,
    };

    /// An arm with weight, as a guess.
    pub const TYPICAL: Self = Self {
        sag: 10,
        lag: Duration::from_millis(40),
        friction: 3,
        noise: 1,
        ..Self::IDEAL
    };

    /// The plant of every arm that states none.
    pub const DEFAULT: Self = Self::TYPICAL;

    /// The words of a text.
    pub const WORDS: &str = "ideal, typical, sag=TICKS, lag=TIMEms, overshoot=PERCENT%, friction=TICKS, \
                             backlash=TICKS, noise=TICKS, seed=N, restart, obstacle=JOINT:ANGLEdeg or \
                             other=JOINT:ANGLEdeg@TIMEms";

    /// Applies one word.
    fn refine(&mut self, word: &str) -> Result<(), PlantError> {
        let (key, value) = word.split_once('=').unwrap_or((word, ""));
        let wrong = |expected: String| PlantError::Value {
            word: word.to_owned(),
            expected,
        };
        let number = |unit: &str, range: RangeInclusive<u16>| {
            let number = value.strip_suffix(unit).and_then(|digits| digits.parse().ok());
            let number = number.filter(|number| range.contains(number));
            number.ok_or_else(|| {
                wrong(format!(
                    "{key}=N{unit} with N from {} to {}",
                    range.start(),
                    range.end()
                ))
            })
        };
        let small = |unit: &str, most: u8| number(unit, 0..=most.into()).map(|number| number as u8);
        match key {
            "sag" => self.sag = small("", 200)?,
            "lag" => self.lag = Duration::from_millis(number("ms", 0..=1000)?.into()),
            "overshoot" => self.overshoot = small("%", 50)?,
            "friction" => self.friction = small("", 100)?,
            "backlash" => self.backlash = small("", 100)?,
            "noise" => self.noise = small("", 20)?,
            "seed" => self.seed = value.parse().map_err(|_| wrong("seed=N with a number N".to_owned()))?,
            "restart" if word == key => self.restart = true,
            "restart" => return Err(wrong("restart, without a value".to_owned())),
            "obstacle" => {
                let angle = value.parse().map_err(|()| wrong(format!("obstacle={ANGLE}")))?;
                self.obstacle = Some(angle);
            }
            "other" => {
                let other = value.split_once('@').and_then(|(angle, time)| {
                    let millis = time.strip_suffix("ms")?.parse::<u32>().ok()?;
                    Some((angle.parse().ok()?, Duration::from_millis(millis.into())))
                });
                self.other = Some(other.ok_or_else(|| wrong(format!("other={ANGLE}, then @TIMEms")))?);
            }
            _ => return Err(PlantError::Unknown(word.to_owned())),
        }
        Ok(())
    }
}

impl Default for Plant {
    /// Returns [`DEFAULT`](Self::DEFAULT).
    fn default() -> Self {
        Self::DEFAULT
    }
}

const ANGLE: &str = "JOINT:ANGLEdeg with a joint from 1 to 6 and an angle from -180 to 179";

impl FromStr for JointAngle {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let (joint, angle) = text.split_once(':').ok_or(())?;
        let joint = joint.parse::<usize>().map_err(drop)?.wrapping_sub(1);
        let degrees = angle.strip_suffix("deg").ok_or(())?.parse().map_err(drop)?;
        let is_valid = joint < JOINTS && (-180..180).contains(&degrees);
        is_valid.then_some(Self { joint, degrees }).ok_or(())
    }
}

impl fmt::Display for JointAngle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}deg", self.joint + 1, self.degrees)
    }
}

/// The name of a word, without its value.
fn key(word: &str) -> &str {
    word.split_once('=').map_or(word, |(key, _)| key)
}

impl FromStr for Plant {
    type Err = PlantError;

    fn from_str(text: &str) -> Result<Self, PlantError> {
        let words: Vec<&str> = text.split(',').collect();
        let (mut plant, words) = match words.as_slice() {
            ["ideal", words @ ..] => (Self::IDEAL, words),
            ["typical", words @ ..] => (Self::TYPICAL, words),
            words => (Self::IDEAL, words),
        };
        for (nth, &word) in words.iter().enumerate() {
            if matches!(word, "ideal" | "typical") {
                return Err(PlantError::Preset(word.to_owned()));
            }
            if words[..nth].iter().any(|earlier| key(earlier) == key(word)) {
                return Err(PlantError::Twice(word.to_owned()));
            }
            plant.refine(word)?;
        }
        if plant.overshoot > 0 && plant.lag == Duration::ZERO {
            return Err(PlantError::OvershootWithoutLag);
        }
        Ok(plant)
    }
}

/// Writes the preset, or all words whose value is not the ideal one.
impl fmt::Display for Plant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let preset = match *self {
            Self::IDEAL => Some("ideal"),
            Self::TYPICAL => Some("typical"),
            _ => None,
        };
        if let Some(preset) = preset {
            return f.write_str(preset);
        }
        let number = |key: &str, number: u64, unit: &str| (number > 0).then(|| format!("{key}={number}{unit}"));
        let words = [
            number("sag", self.sag.into(), ""),
            number("lag", self.lag.as_micros() / 1000, "ms"),
            number("overshoot", self.overshoot.into(), "%"),
            number("friction", self.friction.into(), ""),
            number("backlash", self.backlash.into(), ""),
            number("noise", self.noise.into(), ""),
            (self.seed != Self::IDEAL.seed).then(|| format!("seed={}", self.seed)),
            self.restart.then(|| "restart".to_owned()),
            self.obstacle.map(|angle| format!("obstacle={angle}")),
            self.other
                .map(|(angle, at)| format!("other={angle}@{}ms", at.as_micros() / 1000)),
        ];
        f.write_str(&words.into_iter().flatten().collect::<Vec<_>>().join(","))
    }
}

/// The reason why a text is not a [`Plant`].
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PlantError {
    /// Word that does not exist.
    Unknown(String),
    /// Word whose value is missing, malformed or out of range.
    Value {
        /// The word.
        word: String,
        /// Its form.
        expected: String,
    },
    /// Second word of the same name.
    Twice(String),
    /// Preset that is not the first word.
    Preset(String),
    /// Overshoot without a lag: a first-order model has none.
    OvershootWithoutLag,
}

impl fmt::Display for PlantError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(word) => write!(f, "unknown word '{word}': expected {}", Plant::WORDS),
            Self::Value { word, expected } => write!(f, "'{word}': expected {expected}"),
            Self::Twice(word) => write!(f, "'{word}': the same word is given twice"),
            Self::Preset(word) => write!(f, "'{word}': a preset is the first word, and the only preset"),
            Self::OvershootWithoutLag => write!(f, "overshoot needs a lag, for example lag=60ms"),
        }
    }
}

impl Error for PlantError {}

#[cfg(test)]
pub(super) mod tests {
    use proptest::option;
    use proptest::prelude::*;

    use super::*;

    fn any_angle() -> impl Strategy<Value = JointAngle> {
        (0..JOINTS, -180..180_i16).prop_map(|(joint, degrees)| JointAngle { joint, degrees })
    }

    /// Any plant, near the presets more often than by chance.
    pub(in super::super) fn any_plant() -> impl Strategy<Value = Plant> {
        let numbers = (0..=200_u8, 0..=1000_u64, 0..=50_u8, 0..=100_u8, 0..=100_u8, 0..=20_u8);
        let others = (
            prop_oneof![Just(1), any::<u64>()],
            any::<bool>(),
            option::of(any_angle()),
            option::of((any_angle(), 0..=u32::MAX)),
        );
        let any = (numbers, others).prop_map(
            |((sag, lag, overshoot, friction, backlash, noise), (seed, restart, obstacle, other))| Plant {
                sag,
                lag: Duration::from_millis(lag),
                overshoot: if lag == 0 { 0 } else { overshoot },
                friction,
                backlash,
                noise,
                seed,
                restart,
                obstacle,
                other: other.map(|(angle, at)| (angle, Duration::from_millis(at.into()))),
            },
        );
        prop_oneof![1 => Just(Plant::IDEAL), 1 => Just(Plant::TYPICAL), 8 => any]
    }

    proptest! {
        #[test]
        fn text_of_any_plant_gives_it_back(plant in any_plant()) {
            prop_assert_eq!(plant.to_string().parse(), Ok(plant));
        }

        #[test]
        fn any_text_is_a_plant_or_an_error(text in "[a-z0-9=:@%,.-]{0,40}") {
            if let Ok(plant) = text.parse::<Plant>() {
                prop_assert_eq!(plant.to_string().parse(), Ok(plant));
            }
        }
    }

    #[test]
    fn preset_is_refined_by_later_words() {
        let plant: Plant = "typical,sag=26,restart,obstacle=2:30deg,other=1:-12deg@1500ms"
            .parse()
            .unwrap();
        let angle = |joint, degrees| JointAngle { joint, degrees };
        let expected = Plant {
            sag: 26,
            restart: true,
            obstacle: Some(angle(1, 30)),
            other: Some((angle(0, -12), Duration::from_millis(1500))),
            ..Plant::TYPICAL
        };
        assert_eq!(plant, expected);
        assert_eq!(
            [angle(1, 30), angle(0, -12), angle(0, -180)].map(JointAngle::ticks),
            [2389, 1911, 0]
        );
        assert_eq!("ideal".parse(), Ok(Plant::IDEAL));
        assert_eq!(
            "sag=10,lag=40ms,friction=3,noise=1"
                .parse::<Plant>()
                .unwrap()
                .to_string(),
            "typical"
        );
    }

    #[test]
    fn wrong_text_is_refused_with_its_word() {
        for (text, error) in [
            ("sag=201", "'sag=201': expected sag=N with N from 0 to 200"),
            ("sag", "'sag': expected sag=N with N from 0 to 200"),
            ("lag=60", "'lag=60': expected lag=Nms with N from 0 to 1000"),
            ("lag=-1ms", "'lag=-1ms': expected lag=Nms with N from 0 to 1000"),
            (
                "lag=9ms,overshoot=51%",
                "'overshoot=51%': expected overshoot=N% with N from 0 to 50",
            ),
            ("typical,noise=x", "'noise=x': expected noise=N with N from 0 to 20"),
            ("seed=-1", "'seed=-1': expected seed=N with a number N"),
            ("restart=1", "'restart=1': expected restart, without a value"),
            ("sag=1,noise=1,sag=2", "'sag=2': the same word is given twice"),
            (
                "sag=1,typical",
                "'typical': a preset is the first word, and the only preset",
            ),
            (
                "ideal,ideal",
                "'ideal': a preset is the first word, and the only preset",
            ),
            ("overshoot=5%", "overshoot needs a lag, for example lag=60ms"),
        ] {
            assert_eq!(text.parse::<Plant>().unwrap_err().to_string(), error);
        }
        for angle in [
            "",
            "30deg",
            "0:30deg",
            "7:30deg",
            "2:30",
            "2:180deg",
            "2:-181deg",
            "2:1.5deg",
            "x:1deg",
        ] {
            let error = format!("obstacle={angle}").parse::<Plant>().unwrap_err();
            assert!(matches!(error, PlantError::Value { .. }), "{angle}");
            let error = format!("other={angle}@5ms").parse::<Plant>().unwrap_err();
            assert!(matches!(error, PlantError::Value { .. }), "{angle}");
        }
        for time in ["", "@", "@5", "@-5ms", "@4294967296ms"] {
            assert!(format!("other=2:30deg{time}").parse::<Plant>().is_err(), "{time}");
        }
        for word in ["", "typical,", "gremlins=1", "Sag=1", " sag=1", "ideal=1"] {
            let error = word.parse::<Plant>().unwrap_err();
            assert!(matches!(error, PlantError::Unknown(_)), "{word}");
        }
    }
}
