//! Angles in the mechanics of virtual arms.

use std::f64::consts::{PI, TAU};

/// Returns the cosine of an angle in turns, to a millionth. Unlike the system's, it is the same on every computer.
pub(crate) fn cosine(turns: f64) -> f64 {
    let angle = TAU * (turns - turns.round_ties_even()).abs();
    let (angle, sign) = if angle > PI / 2.0 {
        (PI - angle, -1.0)
    } else {
        (angle, 1.0)
    };
    let square = angle * angle;
    let factors = [90.0, 56.0, 30.0, 12.0, 2.0];
    sign * factors.iter().fold(1.0, |sum, factor| 1.0 - square / factor * sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosine_is_that_of_the_system() {
        for ticks in -8192..=8192 {
            let turns = f64::from(ticks) / 4096.0;
            assert!((cosine(turns) - (turns * TAU).cos()).abs() < 1e-6, "{turns}");
        }
    }
}
