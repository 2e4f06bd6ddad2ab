//! Virtual servos on a bus without a robot.

use armwire::alpha1::{Request, ServoId};
use armwire::time::{Duration, Instant};

use super::SERVOS;
use super::chain::Chain;
use super::port::{Kind, Port};
use super::servo::Servo;
use crate::serial::{Counters, SerialDevice};

/// The servos on a bus, and the timing of their answers.
///
/// ```
/// use armwire::alpha1::ServoId;
/// use armwire_sim::alpha1::BusConfig;
///
/// let config = BusConfig { ids: vec![ServoId::new(1)?, ServoId::new(7)?], echo: true, ..BusConfig::default() };
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BusConfig {
    /// The id of each servo. Servos with the same id answer at the same time: the bits of their answers are ANDed on
    /// the wire.
    pub ids: Vec<ServoId>,
    /// Time from the last stop bit of a request to the first start bit of its answer. A real servo answers within 400
    /// µs.
    pub turnaround: Duration,
    /// Idle time of the line after which an incomplete frame is discarded. The real servo's timeout is not known.
    pub idle: Duration,
    /// Echo of every received byte, as a host on the same wire sees it.
    pub echo: bool,
}

impl Default for BusConfig {
    /// Returns servos 1 to 16, a turnaround of 200 µs, an idle time of 5 ms, no echo.
    fn default() -> Self {
        Self {
            ids: (1..=SERVOS as u8).filter_map(|id| ServoId::new(id).ok()).collect(),
            turnaround: Duration::from_micros(200),
            idle: Duration::from_millis(5),
            echo: false,
        }
    }
}

/// Virtual servos on a single wire. At time zero they are switched on, released, in the middle position.
///
/// Bytes that arrive while a servo transmits are lost. Only servo requests are recognised.
///
/// ```
/// use armwire::time::Instant;
/// use armwire_sim::alpha1::{BusConfig, ServoBus};
/// use armwire_sim::serial::SerialDevice;
///
/// let mut bus = ServoBus::new(BusConfig::default());
/// for byte in [0xFA, 0xAF, 0x01, 0x01, 0x5A, 0x32, 0x00, 0x32, 0xC0, 0xED] {
///     bus.receive(Instant::ZERO, byte); // servo 1 to 90° in 1 s
/// }
/// assert_eq!(bus.transmit(Instant::from_micros(199)), None);
/// assert_eq!(bus.transmit(Instant::from_micros(200)), Some(0xAB));
/// ```
#[derive(Debug)]
pub struct ServoBus {
    port: Port,
    chain: Chain,
}

impl ServoBus {
    /// Creates a bus of released servos.
    pub fn new(config: BusConfig) -> Self {
        let kind = Kind::SingleWire { echo: config.echo };
        Self {
            port: Port::new(kind, config.turnaround, config.idle),
            chain: Chain::new(config.ids),
        }
    }

    /// Returns the servos. Their order stays the same when ids change.
    pub fn servos(&self) -> &[Servo] {
        self.chain.servos()
    }

    /// Returns the servos, to turn them by hand.
    pub fn servos_mut(&mut self) -> &mut [Servo] {
        self.chain.servos_mut()
    }

    /// Returns the receive and answer counters.
    pub fn counters(&self) -> Counters {
        self.port.counters
    }

    fn process_requests(&mut self, now: Instant) {
        self.port.answer(now, |request| match request {
            Request::Servo(request) => self.chain.execute(now, request),
            _ => None,
        });
    }

    fn advance(&mut self, now: Instant) {
        if let Some(idle_at) = self.port.take_idle(now) {
            self.port.idle();
            self.process_requests(idle_at);
        }
    }
}

impl SerialDevice for ServoBus {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.advance(now);
        self.port.receive(now, byte);
        self.process_requests(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.advance(now);
        self.port.transmit(now)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.port.poll_timeout()
    }
}
