//! The built program against virtual arms on pseudo-terminals: output and errors.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use crate::common::{
    Arm, NO_ANSWER, PROGRAM, failure, finish, free_path, install, retry_while, run, run_against, start, success, usage,
};
use armwire::ling::{Frame, JointState, Ling, MAX_FRAME, MotionStatus, Response};
use armwire::messages::Messages;
use armwire_sim::pty::Pty;
use rustix::fs::OFlags;
use rustix::process::{Pid, Signal, geteuid, kill_process};

/// Runs `armwire info` on a pty that answers each request with `answer`.
fn info_on_a_port_that_sends(answer: &[u8]) -> Output {
    retry_while(NO_ANSWER, || {
        run_against(&["info", "PORT"], |_, pty, _| {
            assert_eq!(pty.write(answer).unwrap(), answer.len())
        })
    })
}

/// The answer of an arm with these raw positions.
fn joints(joint: u16, gripper: u16) -> Vec<u8> {
    let response = Response::Joints(JointState {
        joints: [joint; 6],
        gripper,
        status: MotionStatus::Idle,
    });
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_response(&response, None, &mut out).unwrap();
    out[..n].to_vec()
}

#[test]
fn info_shows_the_arm_and_its_state() {
    let arm = Arm::start(
        "ling",
        "info",
        &["--plant", "ideal", "--stroke", "100", "--serial", "ADFS990101000001"],
    );
    let out = success(&["info", &arm.port]);
    for line in [
        "arm              Ling follower",
        "serial           ADFS990101000001",
        "hardware         v1.10",
        "firmware         v6.10",
        "status           locked",
        "joints           +0.00° +0.00° +0.00° +0.00° +0.00° +0.00°",
        "gripper          0.0 % open",
        "stroke           100 mm",
        "self-check       all 10 servos normal",
        "line             clean",
    ] {
        assert!(out.lines().any(|printed| printed == line), "{line} is not in\n{out}");
    }
    assert_eq!(success(&["info", &arm.port]), out, "a port may be opened again");
}

#[test]
fn info_copes_with_echo_and_a_slow_leader() {
    let arm = Arm::start("ling", "leader", &["--leader", "--echo", "--turnaround-us", "5000"]);
    let out = success(&["info", &arm.port]);
    assert!(
        out.contains("Ling leader") && out.contains("all 6 servos normal"),
        "{out}"
    );
}

#[test]
fn temperatures_decide_the_number_of_servos() {
    let arm = Arm::start("ling", "serial", &["--leader", "--serial", "ADFS990101000001"]);
    let out = success(&["info", &arm.port]);
    assert!(out.contains("all 6 servos normal"), "{out}");
}

#[test]
fn info_repeats_damaged_requests_and_reports_the_damage() {
    let arm = Arm::start("ling", "damaged", &["--faults", "corrupt=5000", "--seed", "3"]);
    // The number of requests, and with it the damage, depends on the system.
    assert!((0..50).any(|_| success(&["info", &arm.port]).contains(" stray bytes")));
}

#[test]
fn monitor_prints_the_requested_number_of_readings() {
    let arm = Arm::start("ling", "monitor", &["--plant", "ideal"]);
    let out = success(&["monitor", &arm.port, "--rate", "200", "--count", "5"]);
    assert_eq!(out.lines().count(), 5);
    assert!(
        out.lines()
            .all(|line| line.contains("joints: +0.00° +0.00°") && line.ends_with("gripper: 0.0 % open, status: locked"))
    );
}

#[test]
fn monitor_goes_on_after_an_odd_reading() {
    let mut readings = [joints(4100, 2051), joints(2048, 1000)].into_iter().cycle();
    let output = retry_while(NO_ANSWER, || {
        run_against(&["monitor", "PORT", "--rate", "100", "--count", "6"], |_, pty, _| {
            pty.write(&readings.next().unwrap()).unwrap();
        })
    });
    let out = String::from_utf8(output.stdout).unwrap();
    assert_eq!(out.lines().count(), 6);
    // Repeated requests shift the order of the readings.
    let is_odd = |line: &str| line.contains("+180.35° (out of range), gripper: 205.1 % (out of range)");
    let mut lines = out.lines().skip_while(|line| !is_odd(line));
    assert!(
        lines.any(|line| line.contains("+0.00°, gripper: 100.0 % open")),
        "{out}"
    );
}

#[test]
fn ctrl_c_ends_monitor_of_a_silent_arm() {
    let output = retry_while(NO_ANSWER, || {
        run_against(&["monitor", "PORT"], |monitor, _, _| {
            // The monitor may have ended already.
            let _ = kill_process(Pid::from_child(monitor), Signal::INT);
        })
    });
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
}

/// Fills the port's buffer. Returns the number of bytes written.
fn fill(port: &mut File) -> usize {
    let mut written = 0;
    loop {
        match port.write(&[0]) {
            Ok(n) => written += n,
            Err(error) => {
                assert_eq!(error.kind(), ErrorKind::WouldBlock);
                return written;
            }
        }
    }
}

#[test]
fn full_port_is_reported_as_stuck() {
    let pty = Pty::open(None).unwrap();
    let mut client = OpenOptions::new()
        .write(true)
        .custom_flags(OFlags::NONBLOCK.bits() as i32)
        .open(pty.path())
        .unwrap();
    // The kernel moves bytes later, which frees space: the buffer is full if it is still full after a pause.
    while fill(&mut client) > 0 {
        thread::sleep(Duration::from_millis(50));
    }
    for command in ["info", "monitor"] {
        let line = failure(&run(&[command, pty.path().to_str().unwrap()]));
        assert!(
            line.ends_with("accepts no bytes: is the device behind it stuck?"),
            "{line}"
        );
    }
}

/// Starts a monitor, and calls `act` after its first reading.
pub(crate) fn with_monitor(port: &str, act: impl FnOnce(&Child)) -> Output {
    let mut monitor = start(Command::new(PROGRAM).args(["monitor", port]));
    BufReader::new(monitor.stdout.as_mut().unwrap())
        .read_line(&mut String::new())
        .unwrap();
    act(&monitor);
    finish(monitor)
}

#[test]
fn monitor_ends_cleanly_on_ctrl_c() {
    let arm = Arm::start("ling", "watched", &[]);
    let output = retry_while(NO_ANSWER, || {
        with_monitor(&arm.port, |monitor| {
            kill_process(Pid::from_child(monitor), Signal::INT).unwrap();
        })
    });
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
}

#[test]
fn virtual_arm_ends_cleanly_on_signals() {
    for signal in [Signal::INT, Signal::TERM] {
        let arm = Arm::start("ling", "end", &[]);
        success(&["info", &arm.port]);
        let port = arm.port.clone();
        let last = arm.stop(signal);
        // The number of requests varies: some may be repeated.
        assert!(
            last.contains(" answered, 0 refused), 0 unknown frames, 0 noise bytes."),
            "{last}"
        );
        assert!(fs::symlink_metadata(port).is_err(), "the link is left behind");
    }
}

#[test]
fn virtual_arm_does_not_replace_a_file() {
    let path = free_path("file");
    fs::write(&path, "precious").unwrap();
    let line = failure(&run(&["sim", "ling", "--pty", path.to_str().unwrap()]));
    assert!(line.contains("exists and is not a symbolic link"), "{line}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    fs::remove_file(path).unwrap();
}

#[test]
fn missing_port_is_reported() {
    let line = failure(&run(&["info", "/dev/no-such-port"]));
    assert!(line.starts_with("/dev/no-such-port: no such port"), "{line}");
}

#[test]
fn wrong_kind_of_port_has_a_hint() {
    for host in ["192.0.2.1", "arm.local:502"] {
        let line = failure(&run(&["info", host]));
        assert!(
            line.contains(
                "no such port; a server of a serial port is tcp:HOST:PORT; is it an xarm's host (--arm xarm)?"
            ),
            "{line}"
        );
    }
    for port in ["/dev/null", "tcp:arm.local:4000", "slcan:/dev/null/3"] {
        let text = usage(&["info", "--arm", "xarm", port]);
        assert!(text.contains("is it another arm (--arm ling or alpha1)?"), "{text}");
    }
}

#[test]
fn wrong_arm_has_a_hint() {
    let arm = Arm::start("ling", "wrong-arm", &[]);
    let line = failure(&run(&["info", "--arm", "alpha1", &arm.port]));
    assert!(
        line.contains("not a Ling arm (--arm ling, or 'armwire call ling')"),
        "{line}"
    );
}

#[test]
fn file_is_not_a_serial_port() {
    assert_eq!(failure(&run(&["info", "/dev/null"])), "/dev/null: not a serial port");
}

#[test]
fn usb_serial_number_is_looked_up_among_ports() {
    for port in ["usb:no-such-number", "slcan:usb:no-such-number"] {
        let line = failure(&run(&["info", port]));
        assert!(
            line.starts_with("usb:no-such-number: no port has this USB serial number"),
            "{line}"
        );
    }
    // It is not the port of a host.
    let line = failure(&run(&["info", "usb:4711"]));
    assert!(
        line.starts_with("usb:4711: no port has this USB serial number") && !line.contains("xarm"),
        "{line}"
    );
    let line = failure(&run(&["counters", "usb:no-such-number"]));
    assert!(
        line.starts_with("usb:no-such-number: no port has this USB serial number"),
        "{line}"
    );
    let line = usage(&["torque", "usb:no-such-number/control", "on"]);
    assert!(
        line.contains("usb:no-such-number/control is a control port: only its adapter is on it"),
        "{line}"
    );
}

#[test]
fn port_of_another_program_is_busy() {
    let arm = Arm::start("ling", "busy", &[]);
    let mut info = None;
    let output = retry_while(NO_ANSWER, || {
        with_monitor(&arm.port, |monitor| {
            info = Some((run(&["info", &arm.port]), monitor.id()));
            kill_process(Pid::from_child(monitor), Signal::INT).unwrap();
        })
    });
    assert!(output.status.success(), "{output:?}");
    let (info, monitor) = info.unwrap();
    let error = format!("in use by another program, armwire (process {monitor}): close that one first");
    assert!(failure(&info).ends_with(&error), "{info:?}");
    success(&["info", &arm.port]);
}

#[test]
fn missing_permission_names_the_group() {
    let pty = Pty::open(None).unwrap();
    let mut command;
    let mut group = "the group ".to_owned();
    let copy = free_path("copy");
    if geteuid().is_root() {
        // Root may open any port: the program runs as another user.
        fs::set_permissions(pty.path(), Permissions::from_mode(0o600)).unwrap();
        // A group other than root's. Each line is `name:password:id:members`.
        let groups = fs::read_to_string("/etc/group").unwrap();
        let other = groups.lines().find(|line| !line.contains(":0:")).unwrap();
        let fields: Vec<_> = other.split(':').collect();
        chown(pty.path(), None, Some(fields[2].parse().unwrap())).unwrap();
        group = format!("the group '{}'", fields[0]);
        install(Path::new(PROGRAM), &copy);
        command = Command::new(&copy);
        command.uid(65_534).current_dir("/");
    } else {
        fs::set_permissions(pty.path(), Permissions::from_mode(0o000)).unwrap();
        command = Command::new(PROGRAM);
    }
    let output = finish(start(command.arg("info").arg(pty.path())));
    let _ = fs::remove_file(&copy);
    let line = failure(&output);
    let advice = format!("permission denied: add yourself to {group}");
    assert!(line.contains(&advice), "{line}");
}

#[test]
fn silent_port_is_reported_with_hints() {
    let pty = Pty::open(None).unwrap();
    let line = failure(&run(&["info", pty.path().to_str().unwrap()]));
    assert!(line.contains("no answer in") && line.contains("3 attempts"), "{line}");
    assert!(line.contains("is the arm powered"), "{line}");
    assert!(
        line.contains("not an Alpha1 (--arm alpha1, or 'armwire call alpha1') nor an SLCAN adapter (slcan:PORT)?"),
        "{line}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn missing_answer_names_another_user_of_the_port() {
    let pty = Pty::open(None).unwrap();
    let theirs = fs::File::open(pty.path()).unwrap();
    let mut thief = Command::new("sleep").arg("600").stdin(theirs).spawn().unwrap();
    let line = failure(&run(&["info", pty.path().to_str().unwrap()]));
    thief.kill().unwrap();
    thief.wait().unwrap();
    let id = thief.id();
    let user = format!(
        "3 attempts: the port is also open in another program, sleep (process {id}), which may take the answers: close that \
         one first"
    );
    assert!(line.ends_with(&user), "{line}");
}

#[cfg(target_os = "linux")]
#[test]
fn stolen_bytes_of_answers_blame_no_cable() {
    let mut thief = None;
    let output = run_against(&["call", "ling", "PORT", "read-joints"], |_, pty, _| {
        thief.get_or_insert_with(|| {
            let theirs = fs::File::open(pty.path()).unwrap();
            Command::new("sleep").arg("600").stdin(theirs).spawn().unwrap()
        });
        // The thief has read the rest.
        let answer = joints(2_048, 0);
        pty.write(&answer[..answer.len() / 2]).unwrap();
    });
    let mut thief = thief.unwrap();
    thief.kill().unwrap();
    thief.wait().unwrap();
    let line = failure(&output);
    assert!(line.contains("the answers arrive damaged"), "{line}");
    let user = format!(
        "the port is also open in another program, sleep (process {}), ",
        thief.id()
    );
    assert!(line.contains(&user) && !line.contains("cable"), "{line}");
}

#[test]
fn damaged_answers_are_reported_as_damaged() {
    let arm = Arm::start(
        "ling",
        "corrupt",
        &["--faults", "corrupt=100000", "--faults-on", "answers"],
    );
    let line = failure(&retry_while(NO_ANSWER, || run(&["info", &arm.port])));
    assert!(line.contains("the answers arrive damaged"), "{line}");
}

#[test]
fn bytes_outside_of_frames_are_shown() {
    let line = failure(&info_on_a_port_that_sends(&[0x55, 0x0D, 0x0A, 0xAA]));
    assert!(
        line.contains("no frame of a Ling arm") && line.contains("first bytes: 55 0D 0A AA 55"),
        "{line}"
    );
    assert!(line.contains("is 1000000 the baud rate"), "{line}");
}

#[test]
fn unknown_frame_is_named() {
    let mut out = [0; MAX_FRAME];
    let (command, function, data) = (0x77, 0x00, &[0x01][..]);
    let n = Frame {
        command,
        function,
        data,
    }
    .encode(&mut out)
    .unwrap();
    let line = failure(&info_on_a_port_that_sends(&out[..n]));
    assert!(
        line.contains("the arm answers with command 77 function 00: unknown"),
        "{line}"
    );
}

#[test]
fn echoed_requests_are_not_answers() {
    let line = failure(&info_on_a_port_that_sends(&[0xAA, 0x01, 0x00, 0x01, 0xFE, 0x23, 0xFF]));
    assert!(line.contains("only our own requests come back"), "{line}");
}

#[test]
fn decode_reads_bytes_and_hexadecimal_text() {
    let path = free_path("recording");
    let decode = |path: &Path| success(&["decode", path.to_str().unwrap()]);
    fs::write(&path, [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF]).unwrap();
    let of_bytes = decode(&path);
    assert_eq!(
        of_bytes,
        "       0  AA 05 00 01 01 F9 FF\n          to the arm: torque on\nbytes: 7, frames: 1, noise bytes: 0\n"
    );
    fs::write(&path, "AA 05 00 01 01 F9 FF\n").unwrap();
    assert_eq!(decode(&path), of_bytes);
    fs::write(&path, "\u{FEFF}AA 05 00 01 01 F9 FF\r\n").unwrap();
    assert_eq!(decode(&path), of_bytes, "a byte order mark is no byte of the line");
    fs::write(&path, "AA 05\nAB CG\n").unwrap();
    let output = String::from_utf8(run(&["decode", path.to_str().unwrap()]).stdout).unwrap();
    assert!(
        output.starts_with("not understood: line 2: 'AB CG': 'CG' is not a byte or bytes in hexadecimal\n"),
        "{output}"
    );
    fs::remove_file(&path).unwrap();
    assert!(failure(&run(&["decode", path.to_str().unwrap()])).contains("No such file"));

    let mut child = Command::new(PROGRAM)
        .arg("decode")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(b"aa 05 00 01 01 f9 ff").unwrap();
    assert_eq!(finish(child).stdout, of_bytes.as_bytes());
}

/// Runs a program with a standard error without a reader.
fn run_unread(args: &[&str]) -> Output {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut command = Command::new(PROGRAM);
    let child = command
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(writer);
    finish(child.spawn().unwrap())
}

#[test]
fn unread_error_still_fails() {
    assert_eq!(run_unread(&["info", "/dev/no-such-port"]).status.code(), Some(1));
}

#[test]
fn wrong_usage_exits_with_2() {
    for args in [
        &["info"][..],
        &["sim", "ling", "--stroke", "60"],
        &["sim", "ling", "--faults", "gremlins=1"],
        &["info", "x", "--baud", "0"],
    ] {
        assert_eq!(run(args).status.code(), Some(2), "{args:?}");
    }
}

#[test]
fn text_from_outside_is_escaped_and_cut() {
    let path = free_path("\x1B]0;title\x07");
    std::fs::write(&path, "AA \x1B[2J").unwrap();
    let line = failure(&run(&["decode", path.to_str().unwrap()]));
    assert!(
        line.contains(r": line 1: 'AA \u{1b}[2J': the line may have bytes"),
        "{line}"
    );
    assert!(line.contains(r"\u{1b}]0;title\u{7}"), "{line}");
    std::fs::write(&path, "AA \x1B[2J".repeat(400_000)).unwrap();
    let out = String::from_utf8(run(&["decode", path.to_str().unwrap()]).stdout).unwrap();
    assert!(out.starts_with(r"not understood: line 1: 'AA \u{1b}[2J"), "{out}");
    assert!(
        out.len() < 1000 && out.lines().all(|line| !line.contains(char::is_control)),
        "{out}"
    );

    // A log goes on behind such a line.
    let record = "(1.000000) can0 \x1B[2J";
    for log in [format!("{record}\n"), record.repeat(400_000) + "\n"] {
        std::fs::write(&path, log).unwrap();
        let output = run(&["decode", path.to_str().unwrap(), "--strict"]);
        assert_eq!(output.status.code(), Some(3));
        let out = String::from_utf8(output.stdout).unwrap();
        assert!(
            out.starts_with(r"not understood: line 1: '(1.000000) can0 \u{1b}[2J"),
            "{out}"
        );
        assert!(
            out.len() < 3000 && out.lines().all(|line| !line.contains(char::is_control)),
            "{out}"
        );
        let warning = String::from_utf8(output.stderr).unwrap();
        assert!(warning.contains(r"\u{1b}]0;title\u{7}"), "{warning}");
    }
    std::fs::remove_file(path).unwrap();
}
