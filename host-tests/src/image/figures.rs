//! Measured durations in virtual time.

use std::fmt;

use armwire_virtual_board::Nanos;

/// Repeated measurements of a duration.
#[derive(Clone, Debug, Default)]
pub struct Spread {
    spans: Vec<Nanos>,
}

impl Spread {
    /// Adds a measurement.
    pub fn add(&mut self, span: Nanos) {
        let place = self.spans.partition_point(|&other| other < span);
        self.spans.insert(place, span);
    }

    /// Number of measurements.
    pub fn count(&self) -> usize {
        self.spans.len()
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

/// In microseconds.
impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let micros = |span: Nanos| span.0 as f64 / 1_000.0;
        let least = self.spans.first().copied().unwrap_or_default();
        write!(
            f,
            "least {:.2}, median {:.2}, worst {:.2} us of {}",
            micros(least),
            micros(self.median()),
            micros(self.worst()),
            self.count()
        )
    }
}
