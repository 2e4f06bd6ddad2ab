//! Values of the command line, and the errors of invalid ones.

use std::f32::consts::PI;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::time::Duration;

use armwire::OutOfRange;
use armwire::ling::Speed;
use armwire_host::Rate;
use clap::builder::{PossibleValuesParser, TypedValueParser};

/// A parser of values with names.
pub(crate) fn one_of<T, const N: usize>(values: [(&'static str, T); N]) -> impl TypedValueParser<Value = T>
where
    T: Copy + Send + Sync + 'static,
{
    PossibleValuesParser::new(values.map(|(name, _)| name)).map(move |text| {
        let (_, value) = values
            .into_iter()
            .find(|(name, _)| *name == text)
            .expect("a possible value");
        value
    })
}

/// Parses a value of the command line. The error says that the text is not `what`.
pub(crate) fn parse<T: FromStr>(text: &str, what: &str) -> Result<T, String> {
    text.trim().parse().map_err(|_| format!("'{text}' is not {what}"))
}

/// A parser of whole numbers in this range.
pub(crate) fn whole<T: TryFrom<u64>>(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        let number = text.trim().parse().ok().filter(|number| range.contains(number));
        let number = number.and_then(|number| T::try_from(number).ok());
        number.ok_or_else(|| {
            format!(
                "'{text}' is not a whole number from {} to {}",
                range.start(),
                range.end()
            )
        })
    }
}

/// A value made of a number, with the errors of both: the number is `what` otherwise.
pub(crate) fn made<T: FromStr, V, E: Display>(
    text: &str,
    what: &str,
    make: impl Fn(T) -> Result<V, E>,
) -> Result<V, String> {
    make(parse(text, what)?).map_err(|error| error.to_string())
}

/// A time in seconds.
pub(crate) fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = parse(text, "a number")?;
    Duration::try_from_secs_f32(seconds).map_err(|_| format!("'{text}' is not a valid time in seconds"))
}

/// A rate in hertz.
pub(crate) fn rate(text: &str) -> Result<Rate, String> {
    made(text, "a rate from 1 to 1000 Hz", Rate::new)
}

/// The speed of a joint that is to move, in degrees per second.
pub(crate) fn joint_speed(text: &str) -> Result<Speed, String> {
    scaled(text, "degrees/s", PI / 180.0, Speed::for_move_radians_per_second)
}

/// The speed of a joint of a force-feedback leader that is to move, in degrees per second.
pub(crate) fn slow_joint_speed(text: &str) -> Result<Speed, String> {
    scaled(text, "degrees/s", PI / 180.0, |speed| {
        Speed::from_slowest_radians_per_second(Speed::SLOWEST_OF_FORCE_FEEDBACK, speed)
    })
}

/// A value in another unit than the protocol's. Errors are in the unit of the command line, with limits of two decimals
/// inside the range.
pub(crate) fn scaled<T>(
    text: &str,
    unit: &'static str,
    scale: f32,
    make: impl Fn(f32) -> Result<T, OutOfRange<f32>>,
) -> Result<T, String> {
    let typed: f32 = parse(text, "a number")?;
    make(typed * scale).map_err(|error| {
        /// An error of the conversion, in hundredths.
        const TOLERANCE: f32 = 0.01;
        // The sum is 0 where the quotient is -0.
        let min = (error.min / scale * 100.0 - TOLERANCE).ceil() / 100.0 + 0.0;
        let max = (error.max / scale * 100.0 + TOLERANCE).floor() / 100.0;
        let error = OutOfRange {
            unit,
            got: typed,
            min,
            max,
            ..error
        };
        error.to_string()
    })
}
