//! The sensor on a port of this computer: `cargo run --example pc -- /dev/ttyUSB0 2` reads joint 2. The port may also
//! be `usb:SERIAL`, `tcp:HOST:PORT`, or that of an adapter on CAN.

use std::env;
use std::error;
use std::time::Duration;

use armwire::time::Instant;
use armwire_host::stopwatch::Stopwatch;
use armwire_host::{Connection, Error, Missing, RawPort};
use own_arm::call::{CONFIG, CallError, Port, SensorClient, read_angle};
use own_arm::sensor::Sensor;

/// An open port, and a clock.
struct PcPort {
    connection: Connection,
    port: RawPort,
    clock: Stopwatch,
}

impl Port for PcPort {
    type Error = Error;

    fn now(&self) -> Instant {
        self.clock.now()
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        self.port.write(bytes)
    }

    fn read(&mut self, space: &mut [u8], until: Option<Instant>) -> Result<usize, Error> {
        let wait = until.map_or(Duration::MAX, |until| self.clock.until(until));
        self.port.read(space, wait)
    }
}

/// Opens a port by its text, for calls to the sensor on it.
fn open(text: &str) -> Result<(SensorClient, PcPort), Error> {
    let connection = armwire_host::open(text)?;
    let (port, config) = connection.raw(CONFIG)?;
    let port = PcPort {
        connection,
        port,
        clock: Stopwatch::start(),
    };
    Ok((SensorClient::new(Sensor, config), port))
}

/// The error of a sensor that does not answer.
fn silence(port: &PcPort) -> Error {
    port.connection.explain(Error::NoAnswer {
        name: port.port.name().into(),
        cause: "the sensor does not answer".into(),
        hint: "is it powered, and on this port?".into(),
        missing: Missing::Silent,
        bytes: 0,
    })
}

fn main() -> Result<(), Box<dyn error::Error>> {
    let mut args = env::args().skip(1);
    let (Some(text), Some(joint)) = (args.next(), args.next()) else {
        return Err("usage: pc PORT JOINT".into());
    };
    let (mut client, mut port) = open(&text)?;
    match read_angle(&mut client, &mut port, joint.parse()?) {
        Ok(angle) => println!("{angle}"),
        Err(CallError::Silent) => return Err(silence(&port).to_string().into()),
        Err(error) => return Err(error.to_string().into()),
    }
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use std::collections::VecDeque;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread;

    use armwire_sim::pty::Pty;
    use armwire_sim::serial::SerialDevice;
    use armwire_sim::serve::serve;
    use own_arm::sensor::Angle;
    use own_arm::virtual_sensor::VirtualSensor;

    use super::*;

    /// The virtual sensor at the end of a serial line.
    struct OnLine {
        sensor: VirtualSensor,
        answers: VecDeque<u8>,
    }

    impl SerialDevice for OnLine {
        fn receive(&mut self, _: Instant, byte: u8) {
            self.sensor.receive(&[byte], |answer| self.answers.extend(answer));
        }

        fn transmit(&mut self, _: Instant) -> Option<u8> {
            self.answers.pop_front()
        }

        fn poll_timeout(&self) -> Option<Instant> {
            None
        }
    }

    /// Gives `test` the path of a pty with a sensor. The sensor goes when the flag is set.
    fn with_sensor(test: impl FnOnce(&str, &AtomicBool) + Send) {
        let mut sensor = OnLine {
            sensor: VirtualSensor::new([0, 905, 1800, 2701, 3599, 1]),
            answers: VecDeque::new(),
        };
        let (pty, gone) = (Pty::open(None).unwrap(), AtomicBool::new(false));
        let path = pty.path().to_str().unwrap().to_owned();
        thread::scope(|scope| {
            scope.spawn(|| {
                let pty = pty;
                serve(&mut sensor, &pty, &gone)
            });
            let tested = scope.spawn(|| test(&path, &gone)).join();
            gone.store(true, Ordering::Relaxed);
            tested.unwrap();
        });
    }

    #[test]
    fn angle_is_read_over_a_port_opened_by_its_text() {
        with_sensor(|path, _| {
            let (mut client, mut port) = open(path).unwrap();
            // A busy system may answer late.
            let angle = loop {
                match read_angle(&mut client, &mut port, 2) {
                    Err(CallError::Silent) => {}
                    other => break other.unwrap(),
                }
            };
            assert_eq!(angle, Angle { joint: 2, tenths: 905 });
        });
    }

    #[test]
    fn silence_is_explained() {
        let pty = Pty::open(None).unwrap();
        let path = pty.path().to_str().unwrap();
        let (mut client, mut port) = open(path).unwrap();
        let answer = read_angle(&mut client, &mut port, 1);
        assert!(matches!(answer, Err(CallError::Silent)), "{answer:?}");
        let text = format!("{path}: the sensor does not answer: is it powered, and on this port?");
        assert_eq!(silence(&port).to_string(), text);
    }

    #[test]
    fn port_in_use_and_missing_port_are_errors() {
        with_sensor(|path, _| {
            let _first = open(path).unwrap();
            let Err(error @ Error::InUse { .. }) = open(path) else {
                panic!("the port was opened twice");
            };
            assert!(error.to_string().contains(": in use by "), "{error}");
        });
        let Err(error) = open("/nowhere/tty") else {
            panic!("there is no such port");
        };
        assert!(error.to_string().starts_with("/nowhere/tty: no such port"), "{error}");
    }

    #[test]
    fn lost_port_ends_a_call_with_its_reason() {
        with_sensor(|path, gone| {
            let (mut client, mut port) = open(path).unwrap();
            gone.store(true, Ordering::Relaxed);
            let lost = loop {
                match read_angle(&mut client, &mut port, 1) {
                    Ok(_) | Err(CallError::Silent) => {}
                    Err(error) => break error,
                }
            };
            assert!(matches!(lost, CallError::Port(Error::Lost { .. })), "{lost}");
        });
    }
}
