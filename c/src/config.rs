//! The timing of a client.

use core::num::NonZeroU32;

use armwire::time::Duration;
use armwire::{Config, OutOfRange};

use crate::memory;
use crate::status::ArmwireStatus;

/// The baud rate of a line without one.
const NO_BAUD: u32 = u32::MAX;

/// The timing of a client.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ArmwireConfig {
    /// Baud rate of the line, at least 1; UINT32_MAX for a line without a baud rate.
    pub baud: u32,
    /// Maximum round-trip delay between host and line, caused by USB and the operating system. May be 0.
    pub latency_us: u32,
    /// Time after the timeout of an answer during which it may still arrive. After a missing answer, the next request
    /// with the same answer is delayed by this time, unless the protocol numbers its answers.
    pub stale_window_us: u32,
    /// Maximum number of bytes that are received before a request, on a port that never runs out of them. The size of
    /// the port's receive buffer suffices. 0 counts as 1.
    pub backlog_bytes: u32,
    /// Number of repeats of an unanswered read request.
    pub repeats: u8,
}

impl ArmwireConfig {
    fn of(config: Config) -> Self {
        let micros = |time: Duration| u32::try_from(time.as_micros()).unwrap_or(u32::MAX);
        Self {
            baud: config.baud.map_or(NO_BAUD, NonZeroU32::get),
            latency_us: micros(config.latency),
            stale_window_us: micros(config.stale_window),
            backlog_bytes: config.backlog,
            repeats: config.repeats,
        }
    }

    pub(crate) fn get(&self) -> Result<Config, OutOfRange<u32>> {
        let baud = NonZeroU32::new(self.baud).ok_or(OutOfRange::new("baud rate", "baud", 0, 1, u32::MAX))?;
        Ok(Config {
            baud: Some(baud).filter(|baud| baud.get() != NO_BAUD),
            latency: Duration::from_micros(self.latency_us.into()),
            repeats: self.repeats,
            stale_window: Duration::from_micros(self.stale_window_us.into()),
            backlog: self.backlog_bytes,
        })
    }
}

/// The timing of an arm at 1 Mbaud over USB: 10 ms of latency, two repeats, answers up to 100 ms late, 64 KiB in the
/// port's receive buffer. For a UART of this microcontroller set `latency_us` to the maximum time between two calls of
/// `poll`, and `backlog_bytes` to the size of its receive buffer.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_config_serial(config: Option<&mut ArmwireConfig>) -> ArmwireStatus {
    memory::put(config, ArmwireConfig::of(Config::DEFAULT)).into()
}

/// The timing of a TCP connection in a local network: 100 ms of latency, no repeats, answers up to a second late.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_config_tcp(config: Option<&mut ArmwireConfig>) -> ArmwireStatus {
    memory::put(config, ArmwireConfig::of(Config::TCP)).into()
}
