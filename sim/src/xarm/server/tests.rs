//! The server over real sockets, on free ports of the loopback.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpStream};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;

use super::*;
use crate::xarm::{Config, Model};

/// Longer than any operation takes, unless it hangs.
const TIMEOUT: Duration = Duration::from_secs(30);
const ANY: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

/// "Version", by its transaction id.
fn version(id: u16) -> Vec<u8> {
    [&id.to_be_bytes(), &[0, 2, 0, 1, 1][..]].concat()
}

const VERSION: [u8; 7] = [0, 1, 0, 2, 0, 1, 1];
const VERSION_ANSWER: &[u8; 48] = b"\0\x01\0\x02\0\x2A\x01\x106,6,XI1202,AC1302,v1.12.10\0\0\0\0\0\0\0\0\0\0\0\0\0\0";
const STATE: [u8; 7] = [0, 9, 0, 3, 0, 1, 13];
const STATE_ANSWER: [u8; 9] = [0, 9, 0, 3, 0, 3, 13, 0x10, 4];
const REBOOT: [u8; 8] = [0, 2, 0, 2, 0, 2, 10, 2];
const SHUTDOWN: [u8; 8] = [0, 2, 0, 2, 0, 2, 10, 1];
const CONTROL_ANSWER: [u8; 8] = [0, 2, 0, 2, 0, 2, 10, 0x10];

/// A server that runs.
struct Running {
    control: SocketAddr,
    report: SocketAddr,
    notices: Receiver<Notice>,
}

impl Running {
    fn connect(&self) -> TcpStream {
        let stream = connect_to(self.control);
        self.wait_for("connected", |notice| {
            matches!(notice, Notice::Connected(_, Port::Control))
        });
        stream
    }

    fn wait_for(&self, what: &str, is: impl Fn(&Notice) -> bool) -> Notice {
        loop {
            match self.notices.recv_timeout(TIMEOUT) {
                Ok(notice) if is(&notice) => return notice,
                Ok(_) => {}
                Err(error) => panic!("no notice '{what}': {error}"),
            }
        }
    }
}

/// Stops the server also when a test fails.
struct StopAtEnd<'a>(&'a AtomicBool);

impl Drop for StopAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Serves a newly switched-on arm while `test` runs, and returns the server's counters.
fn serving(test: impl FnOnce(&Running)) -> Served {
    let server = Server::bind(ANY, Some(ANY)).unwrap();
    let (sender, notices) = mpsc::channel();
    let running = Running {
        control: server.control_address(),
        report: server.report_address().unwrap(),
        notices,
    };
    let stop = &AtomicBool::new(false);
    thread::scope(|scope| {
        let server = scope.spawn(move || {
            let mut arm = VirtualXArm::new(Config::new(Model::XArm6));
            server.serve(&mut arm, stop, &mut |notice| drop(sender.send(notice)))
        });
        {
            let _stop = StopAtEnd(stop);
            test(&running);
        }
        server.join().unwrap().unwrap()
    })
}

fn connect_to(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    stream.set_nodelay(true).unwrap();
    stream
}

fn read<const N: usize>(mut stream: &TcpStream) -> [u8; N] {
    let mut bytes = [0; N];
    stream.read_exact(&mut bytes).unwrap();
    bytes
}

/// Reads until the server closes the connection.
fn read_to_end(mut stream: &TcpStream) -> Vec<u8> {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    bytes
}

fn write(mut stream: &TcpStream, bytes: &[u8]) {
    stream.write_all(bytes).unwrap();
}

#[test]
fn clients_get_own_answers_in_any_chunks() {
    let served = serving(|server| {
        let (a, b) = (server.connect(), server.connect());
        for (i, byte) in VERSION.into_iter().enumerate() {
            write(&a, &[byte]);
            if i % 2 == 0 {
                write(&b, &STATE);
                assert_eq!(read(&b), STATE_ANSWER);
            }
        }
        assert_eq!(read(&a), *VERSION_ANSWER);
        write(&a, &[&VERSION[..], &STATE, &VERSION].concat());
        let expected = [&VERSION_ANSWER[..], &STATE_ANSWER, VERSION_ANSWER].concat();
        assert_eq!(read::<105>(&a)[..], expected);
    });
    assert_eq!((served.clients, served.requests), (2, 8));
}

#[test]
fn heartbeats_and_refused_modbus_keep_the_connection() {
    let served = serving(|server| {
        let client = server.connect();
        write(&client, &[0, 0, 0, 1, 0, 2, 0, 0]);
        write(&client, &[0, 7, 0, 0, 0, 6, 1, 3, 0, 0, 0, 2]);
        assert_eq!(read(&client), [0, 7, 0, 0, 0, 3, 1, 0x83, 1]);
        write(&client, &[0, 8, 0, 3, 0, 2, 6, 9]);
        assert_eq!(read(&client), [0, 8, 0, 3, 0, 6, 6, 0x18, 0, 0, 0, 0]);
        write(&client, &STATE);
        assert_eq!(read(&client), STATE_ANSWER);
    });
    assert_eq!((served.requests, served.unknown, served.broken), (2, 2, 0));
}

#[test]
fn invalid_frame_ends_only_its_connection_with_reason() {
    let served = serving(|server| {
        let other = server.connect();
        for (wrong, why) in [
            (&[0, 1, 0, 4][..], "byte 3 is 0x04"),
            (b"GET / HTTP/1.0\r\n\r\n", "byte 2 is 0x54"),
        ] {
            let client = server.connect();
            // Earlier requests are answered; later bytes are ignored.
            write(&client, &[&VERSION, wrong, &VERSION].concat());
            assert_eq!(read_to_end(&client), VERSION_ANSWER);
            let notice = server.wait_for("broken", |notice| matches!(notice, Notice::Broken(..)));
            assert!(notice.to_string().contains(why), "{notice}");
            write(&other, &STATE);
            assert_eq!(read(&other), STATE_ANSWER);
        }
    });
    assert_eq!((served.broken, served.requests), (2, 4));
}

#[test]
fn slow_client_delays_no_other() {
    serving(|server| {
        let (unread, other) = (server.connect(), server.connect());
        // More than the socket buffers hold.
        const MOST: usize = 64 << 20;
        unread.set_write_timeout(Some(Duration::from_millis(500))).unwrap();
        let requests = (0..=u16::MAX).flat_map(version).collect::<Vec<_>>();
        let mut sent = 0;
        while let Ok(n) = (&unread).write(&requests[sent % requests.len()..]) {
            sent += n;
            assert!(sent < MOST, "the server accepts everything");
        }
        write(&other, &STATE);
        assert_eq!(read(&other), STATE_ANSWER);
        // Once it reads, it gets everything, in order.
        for i in 0..sent / 7 {
            let answer = read::<48>(&unread);
            assert_eq!(answer[..2], (i as u16).to_be_bytes());
            assert_eq!(answer[2..], VERSION_ANSWER[2..]);
        }
    });
}

#[test]
fn clients_come_and_go() {
    let served = serving(|server| {
        for _ in 0..2 * MAX_CLIENTS {
            let client = server.connect();
            write(&client, &VERSION[..3]);
            drop(client);
            server.wait_for("gone", |notice| matches!(notice, Notice::Gone(_) | Notice::Lost(..)));
        }
        // A client that has closed its sending side still gets all answers.
        let client = server.connect();
        write(&client, &VERSION.repeat(100));
        client.shutdown(Shutdown::Write).unwrap();
        assert_eq!(read_to_end(&client), VERSION_ANSWER.repeat(100));
    });
    assert_eq!((served.requests, served.broken), (100, 0));
}

/// A service whose clients connect at times chosen by the test.
struct Places<'a> {
    listener: TcpListener,
    service: Service<'a>,
}

impl Places<'_> {
    fn connect(&mut self, port: Port, now: Instant) -> TcpStream {
        let stream = connect_to(self.listener.local_addr().unwrap());
        self.service.accept(&self.listener, port, now);
        stream
    }

    /// The indices of the clients whose connections are closing.
    fn closing(&self) -> Vec<usize> {
        let closes_at = |&i: &usize| self.service.clients[i].closes_at.is_some();
        (0..self.service.clients.len()).filter(closes_at).collect()
    }
}

/// Runs the test and returns the notices, without addresses.
fn with_places(test: impl FnOnce(&mut Places<'_>)) -> Vec<String> {
    let mut notices = Vec::new();
    let mut arm = VirtualXArm::new(Config::new(Model::XArm6));
    let service = Service {
        arm: &mut arm,
        notice: &mut |notice| notices.push(notice.to_string().split_once(": ").unwrap().1.to_owned()),
        start: Instant::now(),
        clients: Vec::new(),
        accept_again: None,
        served: Served::default(),
    };
    // A loopback connection can be accepted as soon as it is made.
    let listener = TcpListener::bind(ANY).unwrap();
    listener.set_nonblocking(true).unwrap();
    test(&mut Places { listener, service });
    notices
}

#[test]
fn each_port_has_places_of_its_own() {
    let notices = with_places(|places| {
        let now = Instant::now();
        let clients: Vec<_> = (0..MAX_CLIENTS).map(|_| places.connect(Port::Control, now)).collect();
        for client in &mut places.service.clients {
            client.last_active = Some(now);
        }
        assert_eq!(read_to_end(&places.connect(Port::Control, now)), []);
        let reports = places.connect(Port::Report, now);
        assert_eq!(places.closing(), []);
        drop((clients, reports));
    });
    let expected = ["rejected, 32 clients are connected", "connected for reports"];
    assert_eq!(notices[MAX_CLIENTS..], expected);
}

#[test]
fn oldest_client_without_request_gives_its_place() {
    let notices = with_places(|places| {
        let now = Instant::now();
        let clients: Vec<_> = (0..MAX_CLIENTS).map(|_| places.connect(Port::Control, now)).collect();
        write(&clients[0], &STATE);
        places.service.wait(&[], TIMEOUT).unwrap();
        places.service.serve_clients(Instant::now());
        let further = places.connect(Port::Control, now);
        assert_eq!(places.closing(), [1]);
        places.service.serve_clients(Instant::now());
        assert_eq!(read_to_end(&clients[1]), []);
        drop(further);
    });
    let expected = ["connection closed without a request, for a new client", "connected"];
    assert_eq!(notices[MAX_CLIENTS..], expected);
}

#[test]
fn oldest_client_of_reports_gives_its_place() {
    with_places(|places| {
        let now = Instant::now();
        let clients: Vec<_> = (0..MAX_CLIENTS).map(|_| places.connect(Port::Report, now)).collect();
        places.service.report();
        places.service.serve_clients(Instant::now());
        let further = places.connect(Port::Report, now);
        assert_eq!(places.closing(), [0]);
        drop((clients, further));
    });
}

#[test]
fn idle_clients_are_sent_away() {
    let notices = with_places(|places| {
        let now = Instant::now();
        let clients = [
            places.connect(Port::Control, now),
            places.connect(Port::Control, now),
            places.connect(Port::Report, now),
        ];
        let nearly = now + IDLE - Duration::from_millis(1);
        places.service.dismiss_idle(nearly);
        assert_eq!(places.closing(), []);
        places.service.clients[1].last_active = Some(nearly);
        places.service.clients[2].last_active = Some(nearly);
        places.service.dismiss_idle(now + IDLE);
        assert_eq!(places.closing(), [0]);
        places.service.dismiss_idle(nearly + IDLE);
        assert_eq!(places.closing(), [0, 1, 2]);
        drop(clients);
    });
    assert_eq!(notices[3..], ["connection closed, idle for 5 minutes"; 3]);
}

#[test]
fn client_that_reads_no_reports_is_idle() {
    with_places(|places| {
        let now = Instant::now();
        let reader = places.connect(Port::Report, now);
        let active = |places: &Places<'_>| places.service.clients[0].last_active;
        places.service.report();
        places.service.serve_clients(Instant::now());
        let last_active = active(places);
        assert!(last_active.is_some());
        // More than the socket buffers hold.
        while places.service.served.lost == 0 {
            places.service.report();
            places.service.serve_clients(Instant::now());
        }
        let stuck = active(places);
        places.service.serve_clients(Instant::now());
        assert_eq!(active(places), stuck);
        drop(reader);
    });
}

#[test]
fn reports_follow_the_arm() {
    let served = serving(|server| {
        let (reports, control) = (connect_to(server.report), server.connect());
        let first = read::<REPORT>(&reports);
        assert_eq!((first[4], &first[7..35]), (4, &[0; 28][..]));
        // The arm ignores bytes from clients of its report port.
        write(&reports, &[0xFF; 100]);

        let floats = [0.05_f32, 0.05, 0.05, 0.05, 0.05, 0.05, 0.0, 1.0, 1.0, 0.0];
        let target = floats.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<_>>();
        write(&control, &[0, 1, 0, 2, 0, 3, 11, 8, 1]);
        write(&control, &[0, 2, 0, 2, 0, 2, 12, 0]);
        write(&control, &[&[0, 3, 0, 2, 0, 41, 23][..], &target].concat());
        assert_eq!(read::<24>(&control)[23], 0, "it moves");
        loop {
            let report = read::<REPORT>(&reports);
            assert_eq!(report[..4], first[..4]);
            if report[4] == 2 {
                assert_eq!(report[7..35], target[..28]);
                break;
            }
        }
    });
    assert!(served.reports >= 2 && served.lost == 0);
}

#[test]
fn reports_that_nobody_reads_are_left_out_whole() {
    let listener = TcpListener::bind(ANY).unwrap();
    let reader = connect_to(listener.local_addr().unwrap());
    let (stream, peer) = listener.accept().unwrap();
    let mut service = Service {
        arm: &mut VirtualXArm::new(Config::new(Model::XArm6)),
        notice: &mut |_| {},
        start: Instant::now(),
        clients: vec![Client::new(stream, peer, Port::Report, Instant::now())],
        accept_again: None,
        served: Served::default(),
    };
    for _ in 0..20 {
        service.report();
    }
    assert_eq!((service.served.reports, service.served.lost), (8, 12));
    service.clients[0].flush(Instant::now()).unwrap();
    drop(service);
    assert_eq!(read_to_end(&reader).len(), 8 * REPORT);
}

#[test]
fn reboot_is_answered_then_ends_all_connections() {
    serving(|server| {
        let (one, other, reports) = (server.connect(), server.connect(), connect_to(server.report));
        read::<REPORT>(&reports);
        write(&other, &VERSION);
        assert_eq!(read(&other), *VERSION_ANSWER);
        // Later requests are lost, but not its answer.
        write(&one, &[&REBOOT[..], &VERSION.repeat(1_000)].concat());
        assert_eq!(read_to_end(&one), CONTROL_ANSWER);
        assert_eq!(read_to_end(&other), []);
        assert_eq!(read_to_end(&reports).len() % REPORT, 0);

        let again = server.connect();
        write(&again, &STATE);
        assert_eq!(read(&again), STATE_ANSWER);
    });
}

/// Returns true while the server has not closed its side.
fn is_open(stream: &TcpStream) -> bool {
    stream.set_nonblocking(true).unwrap();
    let peeked = stream.peek(&mut [0]);
    stream.set_nonblocking(false).unwrap();
    peeked.is_err_and(|error| error.kind() == ErrorKind::WouldBlock)
}

#[test]
fn connections_close_half_a_second_behind_the_answer() {
    for request in [REBOOT, SHUTDOWN] {
        with_places(|places| {
            let now = Instant::now();
            let after = |millis| now + Duration::from_millis(millis);
            let clients = [Port::Control, Port::Control, Port::Report].map(|port| places.connect(port, now));
            write(&clients[0], &request);
            places.service.wait(&[], TIMEOUT).unwrap();
            assert!(places.service.serve_clients(now).is_some());
            assert_eq!(read(&clients[0]), CONTROL_ANSWER);
            // A new connection does not wait for the others.
            let new = places.connect(Port::Control, after(100));
            write(&new, &STATE);
            places.service.wait(&[], TIMEOUT).unwrap();
            places.service.serve_clients(after(100));
            assert_eq!(read(&new), STATE_ANSWER);
            places.service.serve_clients(after(499));
            assert!(clients.iter().all(is_open));
            places.service.serve_clients(after(500));
            assert!(clients.iter().all(|client| read_to_end(client).is_empty()));
            assert!(is_open(&new));
            places.service.serve_clients(after(2_000));
            assert_eq!(places.service.clients.len(), 1);
        });
    }
}

#[test]
fn shutdown_is_answered_and_ends_the_serving() {
    let mut control = None;
    let served = serving(|server| {
        control = Some(server.control);
        let (one, other) = (server.connect(), server.connect());
        write(&one, &SHUTDOWN);
        assert_eq!(read_to_end(&one), CONTROL_ANSWER);
        assert_eq!(read_to_end(&other), []);
        server.wait_for("shutdown", |notice| matches!(notice, Notice::ShutDown(_)));
        drop((one, other));
        assert_eq!(
            server.notices.recv_timeout(TIMEOUT).err(),
            Some(RecvTimeoutError::Disconnected)
        );
    });
    assert_eq!(served.requests, 1);
    assert!(TcpStream::connect(control.unwrap()).is_err());
}

#[test]
fn port_that_is_taken_is_named() {
    let taken = Server::bind(ANY, None).unwrap();
    assert_eq!(taken.report_address(), None);
    let address = taken.control_address();
    let error = Server::bind(ANY, Some(address)).unwrap_err();
    assert_eq!((error.address, error.error.kind()), (address, ErrorKind::AddrInUse));
}
