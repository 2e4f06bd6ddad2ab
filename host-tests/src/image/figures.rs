//! Measured durations in virtual time.

use std::fmt;

use armwire_virtual_board::Nanos;

/// Repeated measurements of a duration.
#[derive(Clone, Debug, Default)]
pub struct Spread {
    /// In ascending order.
    spans: Vec<Nanos>,
}

impl Spread {
    /// Adds a measurement.
    pub fn add(&mut self, span: Nanos) {
        let place = self.spans.partition_point(|&other| other < span);
        self.spans.insert(place, span);
    }

    /// Adds other measurements.
    pub fn join(&mut self, other: Self) {
        self.spans.extend(other.spans);
        self.spans.sort_unstable();
    }

    /// Number of measurements.
    pub fn count(&self) -> usize {
        self.spans.len()
    }

    /// The duration that this share of the measurements does not exceed, in microseconds. NaN without measurements.
    pub fn quantile(&self, share: f64) -> f64 {
        let place = (self.spans.len() as f64 * share).ceil() as usize;
        let span = self.spans.get(place.saturating_sub(1));
        span.map_or(f64::NAN, |span| span.0 as f64 / 1e3)
    }

    /// The median.
    pub fn median(&self) -> Nanos {
        self.spans.get(self.spans.len() / 2).copied().unwrap_or_default()
    }

    /// The maximum.
    pub fn worst(&self) -> Nanos {
        self.spans.last().copied().unwrap_or_default()
    }
}

impl FromIterator<Nanos> for Spread {
    fn from_iter<I: IntoIterator<Item = Nanos>>(spans: I) -> Self {
        let mut spans = Vec::from_iter(spans);
        spans.sort_unstable();
        Self { spans }
    }
}

/// In microseconds.
impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [least, median, worst] = [0.0, 0.5, 1.0].map(|share| self.quantile(share));
        write!(
            f,
            "least {least:.2}, median {median:.2}, worst {worst:.2} us of {}",
            self.count()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantile_is_not_exceeded_by_its_share() {
        let spread = Spread::from_iter([Nanos(30), Nanos(10)]);
        assert_eq!([0.5, 0.51, 1.0].map(|share| spread.quantile(share)), [0.01, 0.03, 0.03]);
    }
}
