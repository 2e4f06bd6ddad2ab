//! xArm from the command line: each request, errors on TCP, and recordings.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Output};
use std::thread;

use armwire::xarm::{
    Codes, MAX_FRAME, MAX_PARAMS, Raw, Register, Reply, Request, Response, RotationRadius, SerialsText, State,
    TorqueSource, VersionText, XArm,
};
use armwire::{Device, DeviceEvent};

use crate::common::{PROGRAM, failure, finish, free_path, run, start, success, usage};
use crate::sim_xarm;

/// Runs a program with an address for its argument HOST, and calls `serve` with its connection.
fn run_against(args: &[&str], serve: impl FnOnce(TcpStream) + Send) -> Output {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let host = listener.local_addr().unwrap().to_string();
    let args = args.iter().map(|&arg| if arg == "HOST" { host.as_str() } else { arg });
    let child = start(Command::new(PROGRAM).args(args));
    thread::scope(|scope| {
        scope.spawn(move || serve(listener.accept().unwrap().0));
        let output = finish(child);
        // Without a connection of the program, this one ends the wait.
        let _ = TcpStream::connect(&host);
        output
    })
}

/// Answers each request until the connection ends.
fn answer(mut stream: TcpStream, mut answer: impl FnMut(Request<'_>) -> Option<(State, Reply<'static>)>) {
    let mut device = Device::<XArm, MAX_FRAME>::new(XArm::PRIVATE);
    let mut out = [0; MAX_FRAME];
    while let Ok(n @ 1..) = stream.read(device.space()) {
        device.received(n).unwrap();
        loop {
            let (answer, key) = match device.poll() {
                Some(DeviceEvent::Request { request, key }) => (answer(request), key),
                Some(_) => continue,
                None => break,
            };
            if let Some((state, reply)) = answer {
                let n = device
                    .respond(&Response::Reply { state, reply }, key, &mut out)
                    .unwrap();
                stream.write_all(&out[..n]).unwrap();
            }
        }
    }
}

/// Bytes that an answer may borrow.
fn leaked(bytes: impl Into<Vec<u8>>) -> &'static [u8] {
    bytes.into().leak()
}

/// An arm with the six registers of the document, and registers 15 and 42.
fn arm(request: Request<'_>) -> Option<(State, Reply<'static>)> {
    let reply = match request {
        Request::ReadVersion => {
            let text = VersionText::encode("6,9,XI1300,AC1300,v1.12.10").unwrap();
            Reply::Version(VersionText(leaked(text)))
        }
        Request::ReadSerials => {
            let text = SerialsText::encode("XI130004A1B2", "AC130004A1B2").unwrap();
            Reply::Serials(SerialsText(leaked(text)))
        }
        Request::ReloadDynamics => Reply::Empty(Register::ReloadDynamics),
        Request::ReadTorqueSource => Reply::TorqueSource(TorqueSource::Current),
        Request::ReadRotationRadius(joint) => {
            Reply::RotationRadius(RotationRadius::from_metres(f32::from(joint.number()) / 8.0).unwrap())
        }
        Request::Shutdown | Request::Reboot => Reply::Empty(Register::SystemControl),
        Request::Raw(raw) if raw.register() == 42 => {
            let radians = [0.0, 0.5, -1.0, 3.0, 0.0, -0.25, 0.0_f32];
            let params: Vec<u8> = radians.into_iter().flat_map(f32::to_le_bytes).collect();
            Reply::Raw(Raw::new(42, leaked(params)).unwrap())
        }
        Codes::READ => Reply::Raw(Raw::new(15, &[0, 13]).unwrap()),
        Request::Raw(raw) => return Some((State::INVALID, Reply::empty(raw.register()))),
        other => panic!("{other:?}"),
    };
    Some((State::NOT_READY | State::WARNING, reply))
}

fn with_arm(args: &[&str]) -> Output {
    run_against(args, |stream| answer(stream, arm))
}

fn stdout(output: Output) -> String {
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn each_request_of_an_xarm_can_be_made() {
    let state = ", state: not ready to move, warning, error: none, warning: 13 (unknown command)\n";
    for (args, answer) in [
        (
            &["version"][..],
            "arm: xArm, 6 axes, type 9, hardware: XI1300, control box: AC1300, firmware: v1.12.10",
        ),
        (&["serials"], "serial: XI130004A1B2, control box AC130004A1B2"),
        (&["reload-dynamics"], "reload dynamics: done"),
        (&["torque-source"], "torque: the servos' current, measured"),
        (&["rotation-radius", "6"], "rotation radius: 0.75 m"),
        (&["shutdown"], "system control: done"),
        (&["reboot"], "system control: done"),
        (
            &["raw", "42"],
            "register 42: 00 00 00 00 00 00 00 3F 00 00 80 BF 00 00 40 40 00 00 00 00 00 00 80 BE 00 00 00 00",
        ),
    ] {
        let printed = stdout(with_arm(&[&["call", "xarm", "HOST"], args].concat()));
        assert_eq!(printed.strip_suffix(state), Some(answer), "{printed}");
    }
}

#[test]
fn requests_are_sent_as_given() {
    for (args, bytes) in [
        (&["version"][..], &[0, 1, 0, 2, 0, 1, 1][..]),
        (&["--supervised", "version"], &[0, 1, 0, 3, 0, 1, 1]),
        (&["shutdown"], &[0, 1, 0, 2, 0, 2, 10, 1]),
        (&["reboot"], &[0, 1, 0, 2, 0, 2, 10, 2]),
        (&["rotation-radius", "7"], &[0, 1, 0, 2, 0, 2, 6, 7]),
        (&["raw", "19", "01"], &[0, 1, 0, 2, 0, 2, 19, 1]),
        (
            &["raw", "23", "DB 0F 49 40", "0x00,ff"],
            &[0, 1, 0, 2, 0, 7, 23, 0xDB, 0x0F, 0x49, 0x40, 0, 0xFF],
        ),
        (&["heartbeat"], &[0, 0, 0, 1, 0, 2, 0, 0]),
    ] {
        let output = run_against(&[&["call", "xarm", "HOST"], args].concat(), |mut stream| {
            let mut sent = vec![0; bytes.len()];
            stream.read_exact(&mut sent).unwrap();
            assert_eq!(sent, bytes, "{args:?}");
        });
        if args == ["heartbeat"] {
            assert_eq!(stdout(output), "heartbeat: sent, the arm does not answer it\n");
        }
    }
}

#[test]
fn impossible_xarm_requests_are_never_sent() {
    let too_long = "00".repeat(MAX_PARAMS + 1);
    let too_many = format!(
        "a message has at most {MAX_PARAMS} bytes of parameters, not {}",
        MAX_PARAMS + 1
    );
    for (args, error) in [
        (&["rotation-radius", "0"][..], "joint is 0, must be 1..=7"),
        (&["rotation-radius", "-1"], "'-1' is not a number from 1 to 7"),
        (&["raw", "-1"], "'-1' is not a whole number from 0 to 255"),
        (&["rotation-radius", "8"], "joint is 8, must be 1..=7"),
        (&["raw", "10", "01"], "register 10 has types of its own"),
        (&["raw", "19", &too_long], &too_many),
        (&["raw", "19", "0G"], "'0G' is not a byte or bytes in hexadecimal"),
        (&["raw", "256"], "'256' is not a whole number from 0 to 255"),
    ] {
        let text = usage(&[&["call", "xarm", "no-such-host.invalid"], args].concat());
        assert!(text.contains(error), "{text}");
    }
    assert!(usage(&["call", "xarm", "arm:0", "version"]).contains("there is no port 0"));
    assert!(usage(&["info", "--arm", "xarm", "arm:x"]).contains("is not a port"));
    assert!(usage(&["info", "--arm", "xarm", "arm", "--baud", "9600"]).contains("--baud does not apply to an xarm"));
}

#[test]
fn info_shows_the_arm_and_its_state() {
    let out = stdout(with_arm(&["info", "--arm", "xarm", "HOST"]));
    assert_eq!(
        out.lines().collect::<Vec<_>>(),
        [
            "arm              xArm, 6 axes, type 9",
            "hardware         XI1300",
            "control box      AC1300",
            "firmware         v1.12.10",
            "serial           XI130004A1B2, control box AC130004A1B2",
            "torque           the servos' current, measured",
            "error            none",
            "warning          13 (unknown command)",
            "state            not ready to move, warning",
        ]
    );
}

#[test]
fn info_goes_on_after_refusals_and_odd_versions() {
    let output = run_against(&["info", "--arm", "xarm", "HOST"], |stream| {
        answer(stream, |request| match request {
            Request::ReadVersion => {
                // The document gives no length.
                Some((State::OK, Reply::Version(VersionText(b"v1.0.2"))))
            }
            request => Some((State::INVALID, Reply::empty(request.register().unwrap()))),
        });
    });
    let out = stdout(output);
    assert!(
        out.contains("version          v1.0.2 (the version has 1 fields"),
        "{out}"
    );
    assert!(out.contains("serial           not reported (state invalid)"), "{out}");
    assert!(out.ends_with("state            ok\n"), "{out}");
}

#[test]
fn monitor_shows_the_joints_the_arm_has() {
    let output = with_arm(&["monitor", "--arm", "xarm", "HOST", "--rate", "1000", "--count", "3"]);
    let out = stdout(output);
    assert_eq!(out.lines().count(), 3);
    for line in out.lines() {
        assert_eq!(line.matches('°').count(), 6, "{line}");
        assert!(line.contains("joints: +0.00° +28.65° -57.30°"), "{line}");
        let end = ", state: not ready to move, warning, error: none, warning: 13 (unknown command)";
        assert!(line.ends_with(end), "{line}");
    }
}

#[test]
fn monitor_shows_unknown_answers_as_bytes() {
    let output = run_against(&["monitor", "--arm", "xarm", "HOST", "--count", "1"], |stream| {
        answer(stream, |request| match request {
            Request::Raw(_) => Some((State::OK, Reply::Raw(Raw::new(42, &[1, 2, 3]).unwrap()))),
            request => Some((State::INVALID, Reply::empty(request.register().unwrap()))),
        });
    });
    let out = stdout(output);
    assert!(
        out.ends_with(" s  joints: register 42 01 02 03, state: ok, error: none, warning: none\n"),
        "{out}"
    );
}

#[test]
fn text_of_an_arm_is_escaped() {
    let hostile = |request: Request<'_>| match request {
        Request::ReadVersion => {
            let text = VersionText(b"6,9,\x1b[2J,AC1300,v1.12.10");
            Some((State::OK, Reply::Version(text)))
        }
        request => arm(request),
    };
    for args in [
        &["call", "xarm", "HOST", "version"][..],
        &["call", "--json", "xarm", "HOST", "version"],
        &["info", "--arm", "xarm", "HOST"],
    ] {
        let out = stdout(run_against(args, |stream| answer(stream, hostile)));
        assert!(
            !out.contains('\x1b') && out.contains("1b") && out.contains("[2J"),
            "{out}"
        );
    }
}

#[test]
fn refusal_of_an_arm_is_reported() {
    let line = failure(&with_arm(&["call", "xarm", "HOST", "raw", "19", "01"]));
    assert!(
        line.ends_with(
            ": the arm refused register 19, or failed at it (state invalid); error: none, warning: 13 (unknown command)"
        ),
        "{line}"
    );
}

/// Runs a command against an arm in error that refuses every other request, and counts the reads of register 15.
fn against_stuck_arm(args: &[&str], codes: &'static [u8]) -> (Output, usize) {
    let mut reads = 0;
    let output = run_against(args, |stream| {
        answer(stream, |request| match request {
            Codes::READ => {
                reads += 1;
                Some((State::ERROR, Reply::Raw(Raw::new(15, codes).unwrap())))
            }
            request => Some((State::INVALID | State::ERROR, Reply::empty(request.register().unwrap()))),
        });
    });
    (output, reads)
}

#[test]
fn refusal_names_error_and_warning_once() {
    for (codes, text) in [
        (
            &[31, 11][..],
            "error: 31 (abnormal current, caused by a collision), warning: 11 (command queue is full)",
        ),
        (&[77, 99], "error: 77, warning: 99"),
        (
            &[23, 0, 0x1B],
            "error: 23 (joint angle exceeds its limit), warning: none",
        ),
    ] {
        for request in [&["raw", "19", "01"][..], &["torque-source"], &["reboot"]] {
            let (output, reads) = against_stuck_arm(&[&["call", "xarm", "HOST"], request].concat(), codes);
            let line = failure(&output);
            assert!(line.ends_with(&format!("(state invalid, error); {text}")), "{line}");
            assert_eq!(reads, 1);
        }
    }
}

#[test]
fn refusal_stands_alone_without_codes() {
    let (output, _) = against_stuck_arm(&["call", "xarm", "HOST", "raw", "19", "01"], &[31]);
    let line = failure(&output);
    assert!(line.ends_with("failed at it (state invalid, error)"), "{line}");
}

#[test]
fn codes_of_an_arm_are_numbers_in_json() {
    let (output, reads) = against_stuck_arm(&["info", "--json", "--arm", "xarm", "HOST"], &[31, 99]);
    let facts: serde_json::Value = serde_json::from_str(&stdout(output)).unwrap();
    assert_eq!(facts["error"], 31);
    assert_eq!(facts["error_meaning"], "abnormal current, caused by a collision");
    assert_eq!(
        (&facts["warning"], &facts["warning_meaning"]),
        (&99.into(), &serde_json::Value::Null)
    );
    assert_eq!(reads, 1);
}

#[test]
fn answer_to_another_request_is_ignored() {
    let output = run_against(&["call", "xarm", "HOST", "version"], |mut stream| {
        stream.write_all(&[0, 9, 0, 2, 0, 2, 4, 0]).unwrap();
        answer(stream, |_| None);
    });
    let line = failure(&output);
    assert!(line.contains("frames arrive, but not the answer, 1 attempt"), "{line}");
}

#[test]
fn missing_answer_is_reported() {
    let line = failure(&run_against(&["call", "xarm", "HOST", "version"], |stream| {
        answer(stream, |_| None);
    }));
    assert!(line.contains("no answer in") && line.contains("1 attempt"), "{line}");
    assert!(
        line.ends_with("is an xArm listening at this address and port?"),
        "{line}"
    );
}

#[test]
fn foreign_stream_is_broken_at_its_offset() {
    let line = failure(&run_against(&["info", "--arm", "xarm", "HOST"], |mut stream| {
        stream.write_all(b"SSH-2.0-OpenSSH\r\n").unwrap();
        answer(stream, |_| None);
    }));
    assert!(
        line.contains("the received bytes are no message of an xArm (byte 0: byte 2 is 0x48, expected 0x00)"),
        "{line}"
    );
}

#[test]
fn short_frame_is_skipped() {
    let line = failure(&run_against(&["call", "xarm", "HOST", "version"], |mut stream| {
        stream.write_all(&[0, 1, 0, 2, 0, 0]).unwrap();
        answer(stream, |_| None);
    }));
    assert!(
        line.contains("6 bytes arrive, but no frame of an xArm") && line.ends_with("(first bytes: 00 01 00 02 00 00)"),
        "{line}"
    );
}

#[test]
fn closed_connection_is_reported() {
    for args in [
        &["info", "--arm", "xarm", "HOST"][..],
        &["call", "xarm", "HOST", "version"],
    ] {
        let line = failure(&run_against(args, |mut stream| {
            // Unread bytes would turn the close into a reset.
            stream.read_exact(&mut [0; 7]).unwrap();
        }));
        assert!(line.contains("the arm closed the connection"), "{line}");
    }
}

#[test]
fn refused_connection_is_reported() {
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let line = failure(&run(&["info", "--arm", "xarm", &address.to_string()]));
    assert!(
        line.starts_with(&format!("{address}: nothing listens there: ")),
        "{line}"
    );
}

#[test]
fn unknown_host_name_is_reported() {
    let line = failure(&run(&["call", "xarm", "no-such-host.invalid", "version"]));
    assert!(line.starts_with("no-such-host.invalid:502: no such host ("), "{line}");
}

#[test]
fn all_commands_work_with_a_virtual_xarm() {
    let sim = sim_xarm::SimXArm::start(&["--no-report"]);
    let host = sim.addresses()[0];
    let info = success(&["info", "--arm", "xarm", host]);
    let monitored = success(&["monitor", "--arm", "xarm", host, "--rate", "100", "--count", "2"]);
    let radius = success(&["call", "xarm", host, "--supervised", "rotation-radius", "6"]);
    let refused = failure(&run(&["call", "xarm", host, "raw", "250"]));

    assert!(info.starts_with("arm              xArm, 6 axes, type 6\n"), "{info}");
    assert!(
        monitored.lines().all(|line| line.matches('°').count() == 6),
        "{monitored}"
    );
    assert!(radius.starts_with("rotation radius: "), "{radius}");
    assert!(refused.contains("the arm refused register 250"), "{refused}");
}

#[test]
fn option_selects_the_protocol_id() {
    for (option, id) in [(&[][..], 2), (&["--supervised"], 3)] {
        let args = [&["call", "xarm", "HOST"][..], option, &["version"]].concat();
        let mut request = [0; 7];
        run_against(&args, |mut stream| stream.read_exact(&mut request).unwrap());
        assert_eq!(request, [0, 1, 0, id, 0, 1, 1]);
    }
}

#[test]
fn decode_reads_each_direction_of_a_stream() {
    let path = free_path("stream");
    let decode = |bytes: &[u8], args: &[&str]| {
        std::fs::write(&path, bytes).unwrap();
        run(&[&["decode", "--arm", "xarm", path.to_str().unwrap()], args].concat())
    };
    // All bytes are ASCII, but not text.
    let requests = [0, 1, 0, 2, 0, 1, 1, 0, 2, 0, 2, 0, 2, 10, 1];
    assert_eq!(
        stdout(decode(&requests, &["--from", "host"])),
        "       0  00 01 00 02 00 01 01
          to the arm: read version (transaction 1, protocol id 2)
       7  00 02 00 02 00 02 0A 01
          to the arm: shut down (transaction 2, protocol id 2)
bytes: 15, frames: 2, noise bytes: 0\n"
    );
    let answers = [
        0, 1, 0, 3, 0, 3, 5, 0x50, 1, 0, 0, 0, 1, 0, 2, 0, 0, 0, 9, 0, 0, 0, 3, 1, 0x83, 1,
    ];
    assert_eq!(
        stdout(decode(&answers, &[])),
        "       0  00 01 00 03 00 03 05 50 01
          from the arm: torque: the servos' current, measured, state: not ready to move, error (transaction 1, protocol id 3)
       9  00 00 00 01 00 02 00 00
          from the arm: heartbeat
      17  00 09 00 00 00 03 01 83 01
          from the arm: refused: no standard Modbus function 3, unit 1 (transaction 9)
bytes: 26, frames: 3, noise bytes: 0\n"
    );
    let cut = stdout(decode(&answers[..12], &[]));
    assert!(
        cut.ends_with("the recording ends within a frame\nbytes: 12, frames: 1, noise bytes: 3\n"),
        "{cut}"
    );
    std::fs::remove_file(&path).unwrap();
}

#[test]
fn decode_stops_where_a_stream_breaks() {
    let path = free_path("broken");
    // An answer, then bytes without a protocol id of an xArm.
    let bytes = [0, 1, 0, 2, 0, 2, 10, 0, 0, 1, 3, 1, 0, 2, 0, 2, 4, 0];
    std::fs::write(&path, bytes).unwrap();
    let output = run(&["decode", "--arm", "xarm", path.to_str().unwrap()]);
    std::fs::remove_file(&path).unwrap();
    let line = failure(&output);
    assert!(
        line.contains("the stream is broken at byte 8: byte 2 is 0x03"),
        "{line}"
    );
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(
        out.lines().next().unwrap().ends_with("00 01 00 02 00 02 0A 00")
            && out.ends_with("bytes: 11, frames: 1, noise bytes: 3, the rest not read\n"),
        "{out}"
    );
}

#[test]
fn decode_shows_what_was_encoded() {
    let path = free_path("frame");
    std::fs::write(&path, b"\xBE\xEF\0\x02\0\x06\x06\x10\0\0\x98\x42").unwrap();
    let printed = success(&["decode", "--arm", "xarm", "--from", "arm", path.to_str().unwrap()]);
    std::fs::remove_file(&path).unwrap();
    assert!(
        printed.contains("rotation radius: 0.076 m, state: not ready to move (transaction 48879, protocol id 2)"),
        "{printed}"
    );
}

#[test]
fn joints_of_unknown_number_are_shown_as_bytes() {
    let output = run_against(&["monitor", "--arm", "xarm", "HOST", "--count", "1"], |stream| {
        answer(stream, |request| match request {
            Request::ReadVersion => Some((State::INVALID, Reply::empty(request.register().unwrap()))),
            request => arm(request),
        });
    });
    let out = stdout(output);
    assert!(
        out.contains(" s  joints: register 42 00 00 00 00 00 00 00 3F "),
        "{out}"
    );
}
