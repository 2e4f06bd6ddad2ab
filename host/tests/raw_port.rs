//! A protocol that is not of this workspace's hosts, on a port of this one: Feetech servos on a virtual SO-101.
#![cfg(unix)]

use std::net::TcpListener;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use armwire::{Client, Config, Event, Output};
use armwire_feetech::{Feetech, MAX_FRAME, Request, register};
use armwire_host::stopwatch::Stopwatch;
use armwire_host::{Error, RawPort, Tap};
use armwire_sim::pty::Pty;
use armwire_sim::serve::serve;
use armwire_sim::so101::{self, So101};

/// Makes one call, and returns the data of the answer. `None` if no answer came.
fn call(port: &mut RawPort, config: Config, request: &Request<'_>) -> Result<Option<Vec<u8>>, Error> {
    let mut client = Client::<Feetech, MAX_FRAME>::new(Feetech::default(), config);
    let clock = Stopwatch::start();
    client.submit(request).unwrap();
    loop {
        let wait = match client.poll(clock.now()) {
            Output::Receive => Duration::ZERO,
            Output::Timeout(until) => until.map_or(Duration::MAX, |until| clock.until(until)),
            Output::Transmit(bytes) => {
                let n = port.write(bytes)?;
                client.transmitted(clock.now(), n).unwrap();
                continue;
            }
            Output::Event(Event::Answer(status)) => return Ok(Some(status.data.to_vec())),
            Output::Event(Event::TimedOut { .. }) => return Ok(None),
            Output::Event(_) => continue,
        };
        let n = port.read(client.space(), wait)?;
        client.received(clock.now(), n).unwrap();
    }
}

/// A read of the model of a servo.
fn read_model(id: u8) -> Request<'static> {
    let register::Register { address, len, .. } = register::MODEL;
    Request::Read { id, address, len }
}

/// Gives `test` the path of a pty with a virtual SO-101. The pty goes when `gone` is set.
fn with_servos(test: impl FnOnce(&str, &AtomicBool) + Send) {
    let gone = AtomicBool::new(false);
    let pty = Pty::open(None).unwrap();
    let path = pty.path().to_str().unwrap().to_owned();
    thread::scope(|scope| {
        // It closes the pty at its end.
        scope.spawn(|| {
            let pty = pty;
            serve(&mut So101::new(so101::Config::default()), &pty, &gone)
        });
        let tested = scope.spawn(|| test(&path, &gone)).join();
        gone.store(true, Ordering::Relaxed);
        tested.unwrap();
    });
}

/// A busy system may answer late: the call is repeated.
fn patient(port: &mut RawPort, config: Config, request: &Request<'_>) -> Vec<u8> {
    loop {
        if let Some(data) = call(port, config, request).unwrap() {
            return data;
        }
    }
}

#[derive(Clone, Default)]
struct Recording(Arc<Mutex<(Vec<u8>, Vec<u8>)>>);

impl Tap for Recording {
    fn sent(&mut self, bytes: &[u8]) {
        self.0.lock().unwrap().0.extend(bytes);
    }

    fn received(&mut self, bytes: &[u8]) {
        self.0.lock().unwrap().1.extend(bytes);
    }
}

#[test]
fn servo_answers_on_a_port_opened_by_its_text() {
    with_servos(|path, _| {
        let (mut port, config) = armwire_host::open(path).unwrap().raw(Config::DEFAULT).unwrap();
        assert_eq!((port.name(), config), (path, Config::DEFAULT));
        let recording = Recording::default();
        port.set_tap(recording.clone());
        assert_eq!(patient(&mut port, config, &read_model(3)), 777_u16.to_le_bytes());
        let (sent, received) = &*recording.0.lock().unwrap();
        let request = [0xFF, 0xFF, 3, 4, 2, register::MODEL.address, 2];
        assert!(sent.starts_with(&request), "{sent:02X?}");
        assert_eq!(received[..5], [0xFF, 0xFF, 3, 4, 0]);
    });
}

#[test]
fn no_bytes_are_no_error() {
    with_servos(|path, _| {
        let (mut port, _) = armwire_host::open(path).unwrap().raw(Config::DEFAULT).unwrap();
        assert_eq!(port.write(&[]).unwrap(), 0);
        assert_eq!(port.read(&mut [], Duration::MAX).unwrap(), 0);
    });
}

#[test]
fn servo_hears_only_its_baud_rate() {
    with_servos(|path, _| {
        let slow = Config {
            baud: 57_600.try_into().ok(),
            repeats: 0,
            ..Config::DEFAULT
        };
        let connection = armwire_host::open(path).unwrap();
        let (mut port, config) = connection.raw(slow).unwrap();
        assert_eq!(call(&mut port, config, &read_model(1)).unwrap(), None);
        drop(port);
        let (mut port, config) = connection.raw(Config::DEFAULT).unwrap();
        patient(&mut port, config, &read_model(1));
    });
}

#[test]
fn port_is_locked_until_it_is_dropped() {
    with_servos(|path, _| {
        let connection = armwire_host::open(path).unwrap();
        let open = || connection.raw(Config::DEFAULT);
        let first = open().unwrap();
        let error = open().unwrap_err();
        assert!(matches!(error, Error::InUse { .. }), "{error}");
        assert!(error.to_string().starts_with(&format!("{path}: in use by ")), "{error}");
        drop(first);
        open().unwrap();
    });
}

#[test]
fn lost_port_ends_a_read_with_its_reason() {
    with_servos(|path, gone| {
        let (mut port, config) = armwire_host::open(path).unwrap().raw(Config::DEFAULT).unwrap();
        patient(&mut port, config, &read_model(1));
        gone.store(true, Ordering::Relaxed);
        let error = port.read(&mut [0], Duration::MAX).unwrap_err();
        assert!(matches!(error, Error::Lost { .. }), "{error}");
        assert!(error.to_string().contains("was it unplugged?"), "{error}");
    });
}

#[test]
fn interrupt_ends_a_wait_without_an_end() {
    with_servos(|path, _| {
        let (mut port, _) = armwire_host::open(path).unwrap().raw(Config::DEFAULT).unwrap();
        port.set_interrupt(|| Err("Ctrl-C".into()));
        let error = port.read(&mut [0], Duration::MAX).unwrap_err();
        assert!(matches!(error, Error::Interrupted(_)), "{error}");
        assert_eq!(error.to_string(), "Ctrl-C");
    });
}

#[test]
fn server_adds_its_delay_to_the_timing() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let text = format!("tcp:{}", server.local_addr().unwrap());
    let (mut port, config) = armwire_host::open(&text).unwrap().raw(Config::DEFAULT).unwrap();
    assert_eq!(config.latency, Config::DEFAULT.latency + Config::TCP.latency);
    assert_eq!(config.stale_window, Config::TCP.stale_window);
    let patient = Config {
        stale_window: Config::TCP.stale_window + Config::TCP.stale_window,
        ..Config::DEFAULT
    };
    let (_, config) = armwire_host::open(&text).unwrap().raw(patient).unwrap();
    assert_eq!(config.stale_window, patient.stale_window);
    drop(server.accept().unwrap());
    let error = port.read(&mut [0], Duration::MAX).unwrap_err();
    assert!(matches!(error, Error::Lost { .. }), "{error}");
    drop(server);
    let error = armwire_host::open(&text).unwrap().raw(Config::DEFAULT).unwrap_err();
    assert!(error.to_string().ends_with("has the server started?"), "{error}");
}

#[test]
fn port_without_a_line_is_refused_in_words_for_any_device() {
    for (text, reason) in [
        ("/nowhere/tty", "/nowhere/tty: no such port"),
        ("/dev/null", "/dev/null: not a serial port"),
        ("hid:", "hid: is a HID device, which has no line"),
        (
            "control:/tmp/x",
            "control:/tmp/x is a control port: only its adapter is on it",
        ),
        (
            "arm.local:502",
            "arm.local:502: no such port; a server of a serial port is tcp:HOST:PORT",
        ),
    ] {
        let error = armwire_host::open(text).unwrap().raw(Config::DEFAULT).unwrap_err();
        assert!(error.to_string().starts_with(reason), "{error}");
        assert_eq!(error.remedy(), None, "{error}");
    }
    with_servos(|path, _| {
        let rateless = Config {
            baud: None,
            ..Config::DEFAULT
        };
        let error = armwire_host::open(path).unwrap().raw(rateless).unwrap_err();
        assert_eq!(error.to_string(), format!("{path}: a serial port needs a baud rate"));
    });
}
