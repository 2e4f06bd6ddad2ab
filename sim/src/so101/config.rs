//! The servos of a virtual SO-101.

use std::error::Error;
use std::fmt;

use armwire_feetech::{MAX_ID, register};

use super::servo::Servo;

/// The servos of an arm, and their supply.
///
/// ```
/// use armwire_sim::so101::Config;
///
/// let config = Config::new(&[1, 2, 3, 4, 5, 6], &[777], 12.0)?;
/// assert_eq!(Config::new(&[1, 2, 1], &[777], 7.4).unwrap_err().to_string(), "two servos have id 1");
/// # Ok::<(), armwire_sim::so101::ConfigError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// The id and the model of each servo.
    servos: Vec<(u8, u16)>,
    /// The supply, in tenths of a volt.
    decivolts: u8,
}

impl Config {
    /// The part of the sag of each joint from the base on: the shoulder, the elbow and the wrist carry weight.
    pub(super) const SHARES: [f64; 6] = [0.0, 1.0, 0.8, 0.4, 0.0, 0.0];

    /// An arm with servos of these ids, from its base on. `models` has the model of each, or one for all: 777 is an STS3215,
    /// 2825 an STS3250. `volts` is the supply, 0 to 25.4.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] if an id is above 253 or occurs twice, there is no servo, the models are not as many as the ids, or
    /// the supply is out of range.
    pub fn new(ids: &[u8], models: &[u16], volts: f64) -> Result<Self, ConfigError> {
        if ids.is_empty() {
            return Err(ConfigError::NoServo);
        }
        for (n, &id) in ids.iter().enumerate() {
            if id > MAX_ID {
                return Err(ConfigError::Id(id));
            }
            if ids[..n].contains(&id) {
                return Err(ConfigError::Twice(id));
            }
        }
        let models = match *models {
            [model] => vec![model; ids.len()],
            _ => models.to_vec(),
        };
        if models.len() != ids.len() {
            return Err(ConfigError::Models {
                models: models.len(),
                servos: ids.len(),
            });
        }
        if !(0.0..=25.4).contains(&volts) {
            return Err(ConfigError::Supply(volts.to_string()));
        }
        Ok(Self {
            servos: ids.iter().copied().zip(models).collect(),
            decivolts: (volts * 10.0).round() as u8,
        })
    }

    pub(super) fn servos(&self) -> Vec<Servo> {
        let servo = |&(id, model): &(u8, u16)| Servo::new(id, model, self.decivolts, 0.0);
        self.servos.iter().map(servo).collect()
    }
}

impl Default for Config {
    /// Returns six STS3215 with ids 1 to 6, at 7.4 V.
    fn default() -> Self {
        Self {
            servos: (1..=6).map(|id| (id, register::MODEL.factory)).collect(),
            decivolts: 74,
        }
    }
}

/// The reason why servos make no arm.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs)]
pub enum ConfigError {
    /// No servo at all.
    NoServo,
    /// Id above 253.
    Id(u8),
    /// Id of two servos.
    Twice(u8),
    /// Number of models that is neither one nor that of the servos.
    Models { models: usize, servos: usize },
    /// Supply outside the range of its register.
    Supply(String),
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoServo => f.write_str("an arm has at least one servo"),
            Self::Id(id) => write!(f, "servo id is {id}, must be 0..={MAX_ID}"),
            Self::Twice(id) => write!(f, "two servos have id {id}"),
            Self::Models { models, servos } => {
                write!(
                    f,
                    "there are {models} models for {servos} servos: expected one, or one for each"
                )
            }
            Self::Supply(volts) => write!(f, "supply is {volts} V, must be 0..=25.4"),
        }
    }
}

impl Error for ConfigError {}
