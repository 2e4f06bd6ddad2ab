//! The built program with an arm behind a TCP server of its serial port.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use armwire_bridge::time;
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::serial::SerialDevice;
use armwire_sim::so101::{self, So101};
use serde_json::Value;

use crate::common::{failure, run, success, usage};

/// Serves an arm, each time a new one, to one program after another. Returns the name of its port for the command.
fn serve<D: SerialDevice>(arm: impl Fn() -> D + Send + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("tcp:{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for stream in listener.incoming() {
            forward(stream.unwrap(), arm());
        }
    });
    port
}

/// Forwards bytes until the program disconnects.
fn forward(mut stream: TcpStream, mut arm: impl SerialDevice) {
    let start = Instant::now();
    stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    let mut bytes = [0; 256];
    loop {
        let read = stream.read(&mut bytes);
        let now = time::Instant::from_micros(start.elapsed().as_micros() as u64);
        match read {
            Ok(0) => return,
            Ok(n) => bytes[..n].iter().for_each(|&byte| arm.receive(now, byte)),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
        let answer: Vec<_> = std::iter::from_fn(|| arm.transmit(now)).collect();
        if stream.write_all(&answer).is_err() {
            return;
        }
    }
}

#[test]
fn arm_behind_a_server_works_as_on_port() {
    let port = serve(|| LingArm::new(Config::follower()));
    for args in [
        &["info", &port][..],
        &["call", "ling", &port, "read-info"],
        &["monitor", &port, "--rate", "100", "--count", "2"],
    ] {
        assert!(!success(args).is_empty());
    }
    assert!(success(&["info", &port]).contains("arm              Ling follower"));
}

#[test]
fn servo_bus_behind_a_server_has_a_report_without_a_baud_rate() {
    let port = serve(|| So101::new(so101::Config::default()));
    let report: Value = serde_json::from_str(&success(&["bus", &port, "--seconds", "0.5", "--json"])).unwrap();
    assert_eq!(report["servos"].as_array().unwrap().len(), 6);
    assert!(report["baud"].is_null(), "{report}");
    let output = run(&["bus", &port, "--seconds", "0.5", "--ids", "1-2"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.lines().any(|line| line.starts_with("0 noise bytes, ")), "{text}");
    let error = usage(&["bus", &port, "--baud", "500000"]);
    assert!(error.contains("--baud applies to serial ports only"), "{error}");
}

#[test]
fn missing_server_and_missing_arm_are_reported() {
    // The listener is closed: the port is free.
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let line = failure(&run(&["info", &format!("tcp:{free}")]));
    assert!(
        line.starts_with(&format!("{free}: nothing listens there")) && !line.contains("xarm"),
        "{line}"
    );

    // The server accepts connections and sends nothing.
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("tcp:{}", silent.local_addr().unwrap());
    let line = failure(&run(&["call", "ling", &port, "read-joints"]));
    assert!(
        line.contains("is the arm powered, and is it on the server's serial port? Is it a Ling arm, not an Alpha1"),
        "{line}"
    );
}

#[test]
fn server_that_closes_is_not_the_arm() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("tcp:{}", server.local_addr().unwrap());
    thread::spawn(move || server.incoming().for_each(drop));
    let line = failure(&run(&["call", "ling", &port, "read-joints"]));
    assert!(line.contains("server") && !line.contains("the arm"), "{line}");
}

#[test]
fn server_has_a_port_and_no_baud() {
    assert!(usage(&["info", "tcp:localhost"]).contains("'localhost' has no port, such as localhost:4000"));
    assert!(
        usage(&["info", "tcp:localhost:1", "--baud", "9600"])
            .contains("--baud applies to serial ports only, not to tcp:localhost:1")
    );
}
