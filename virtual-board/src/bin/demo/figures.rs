//! Measurements in virtual time.

use std::fmt;

use armwire_bridge::Duration;
use armwire_virtual_board::Nanos;

/// One byte on the arm's line at 1 Mbaud.
pub(crate) const BYTE: Duration = Duration::from_micros(10);

/// Minimum, mean and maximum of a time.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spread {
    count: u64,
    sum: u64,
    least: Option<Nanos>,
    most: Nanos,
}

impl Spread {
    pub(crate) fn add(&mut self, span: Nanos) {
        self.count += 1;
        self.sum += span.0;
        self.least = Some(self.least.map_or(span, |least| least.min(span)));
        self.most = self.most.max(span);
    }
}

/// In microseconds.
impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let micros = |nanos: u64| nanos as f64 / 1_000.0;
        write!(
            f,
            "{:9.2} {:9.2} {:9.2}",
            micros(self.least.unwrap_or_default().0),
            micros(self.sum / self.count.max(1)),
            micros(self.most.0)
        )
    }
}

/// Breakdown of the time of a call with an answer.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Figures {
    /// The whole call.
    pub(crate) calls: Spread,
    /// From the request's first start bit to the answer's last stop bit: the arm and its line.
    pub(crate) line: Spread,
    /// The rest, added by USB and the adapter.
    pub(crate) added: Spread,
    /// From the program's write to the request's packet in the adapter.
    pub(crate) to_usb: Spread,
    /// From there to the first start bit on the arm's line.
    pub(crate) to_uart: Spread,
    /// From the answer's last stop bit to its packet ready for the host.
    pub(crate) armed: Spread,
    /// From the same stop bit to the packet in the host.
    pub(crate) to_host: Spread,
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "virtual time, us                            min      mean       max")?;
        writeln!(
            f,
            "  call to answer, {:4} calls          {}",
            self.calls.count, self.calls
        )?;
        writeln!(f, "  of which the arm and its line       {}", self.line)?;
        writeln!(f, "  added by USB and the adapter        {}", self.added)?;
        writeln!(f, "  write -> request in the adapter     {}", self.to_usb)?;
        writeln!(f, "  adapter -> start bit to the arm     {}", self.to_uart)?;
        writeln!(f, "  last stop bit -> USB packet ready   {}", self.armed)?;
        write!(f, "  last stop bit -> answer in the host {}", self.to_host)
    }
}
