//! Each message of a host on the control interface gets one matching reply, with its sequence number, for any bytes
//! between messages and any division into packets. A decoded message survives encoding and decoding.
#![no_main]

use core::fmt::Debug;

use armwire_bridge::config::{Can, Config, ConfigError};
use armwire_bridge::control::{
    Failure, FromAdapter, FromHost, Identity, MAX_COBS, MAX_FRAME, MAX_MESSAGE, Malformed, Message, Reason, Reply,
    Request, decode, encode, encode_cobs,
};
use armwire_bridge::store::Saved;
use armwire_bridge::{Action, Bridge, PACKET, Start, Transmit, UartEvent, UsbEvent};
use armwire_bridge::{Duration, Instant};
use armwire_fuzz::{Result, Unstructured};
use armwire_host_tests::adapter::ControlPort;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // A short input is skipped.
    let _ = check(&mut Unstructured::new(input));
});

/// The longest message that the adapter takes, in bytes.
const MAX_REQUEST: usize = 64;

struct Host {
    has_can: bool,
    bridge: Bridge,
    now: Instant,
    /// Unsent bytes, in packets of this number of bytes.
    out: Vec<u8>,
    packet: usize,
    /// Complete requests, and their answers.
    requests: Vec<core::result::Result<FromHost, Malformed>>,
    replies: Vec<(u8, Reply)>,
    port: ControlPort,
}

fn check(u: &mut Unstructured<'_>) -> Result<()> {
    // Classic CAN, CAN FD or none.
    let can: u8 = u.arbitrary()?;
    let identity = Identity {
        can_fd: can & 1 == 1,
        no_can: can & 3 == 2,
        ..Identity::default()
    };
    let mut host = Host {
        has_can: !identity.no_can,
        bridge: Bridge::new(identity, Config::default(), Start::default()),
        now: Instant::ZERO,
        out: Vec::new(),
        packet: u.int_in_range(1..=PACKET)?,
        requests: Vec::new(),
        replies: Vec::new(),
        port: ControlPort::default(),
    };
    host.bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    while !u.is_empty() {
        match u.int_in_range(0..=4)? {
            0 => {
                let message: FromHost = u.arbitrary()?;
                let mut bytes = [0; MAX_COBS];
                let len = encode_cobs(&message, &mut bytes).expect("there is room");
                host.send(&bytes[..len]);
            }
            // Any bytes with a terminator.
            1 => host.send(&[u.arbitrary()?, &[0][..]].concat()),
            2 => (0..u.arbitrary::<u8>()?).for_each(|_| host.read_packet()),
            3 => host.act(u.arbitrary()?),
            _ => host.wait(host.now + Duration::from_micros(u.arbitrary::<u16>()?.into())),
        }
        host.transmit();
    }
    host.end();
    Ok(())
}

impl Host {
    fn send(&mut self, bytes: &[u8]) {
        for segment in bytes.split(|byte| *byte == 0).filter(|segment| !segment.is_empty()) {
            let message = read(segment);
            check_codec::<FromHost>(segment);
            check_codec::<FromAdapter>(segment);
            self.requests.push(message);
        }
        self.out.extend(bytes);
    }

    /// Sends packets as long as the adapter has room.
    fn transmit(&mut self) {
        while self.bridge.update(self.now).control_room && !self.out.is_empty() {
            let packet: Vec<u8> = self.out.drain(..self.packet.min(self.out.len())).collect();
            self.bridge.control_received(&packet, self.now);
        }
    }

    fn read_packet(&mut self) {
        for message in self.port.read_packet(&mut self.bridge, self.now).unwrap_or_default() {
            match message {
                FromAdapter::Reply { sequence, reply } => self.replies.push((sequence, reply)),
                FromAdapter::Event { at, .. } => assert!(at.0 <= self.now.as_micros()),
            }
        }
    }

    /// Executes the firmware's next action: a save or reset succeeds if `done`.
    fn act(&mut self, done: bool) {
        match self.bridge.action(self.now) {
            Some(Action::Save(..) | Action::Reset(_)) => {
                self.bridge.saved(done.then_some(()).ok_or(Failure::Flash), self.now);
            }
            Some(Action::Load) => self
                .bridge
                .loaded(done.then_some(Saved::Nothing).ok_or(Failure::Flash), self.now),
            _ => {}
        }
    }

    fn wait(&mut self, until: Instant) {
        self.now = self.now.max(until);
        self.bridge.tick(self.now);
        let transmit = self.bridge.uart_transmit(&mut [0; MAX_FRAME], self.now, |_, _| {});
        if let Some(Transmit::Configure(uart)) = transmit {
            self.bridge.uart_event(UartEvent::Configured(uart), self.now);
        }
    }

    /// The host reads all packets, the firmware does all actions, and the arm is silent: each request is answered.
    fn end(mut self) {
        for _ in 0..4 * self.requests.len() + 20 {
            self.transmit();
            (0..20).for_each(|_| self.read_packet());
            self.act(true);
            self.wait(self.now + Duration::from_millis(200));
        }
        let mut requests: Vec<u8> = self.requests.iter().map(sequence).collect();
        let mut answered: Vec<u8> = self.replies.iter().map(|(sequence, _)| *sequence).collect();
        requests.sort_unstable();
        answered.sort_unstable();
        assert_eq!(answered, requests);
        for (of, reply) in &self.replies {
            let fits = |message: &_| sequence(message) == *of && answers(message, reply, self.has_can);
            assert!(
                self.requests.iter().any(fits),
                "{reply:?} answers no request with number {of}"
            );
        }
        let counters = self.bridge.counters();
        assert_eq!(counters.control_requests as usize, self.requests.len());
        let malformed = self.requests.iter().filter(|message| message.is_err()).count();
        assert_eq!(counters.control_unsupported as usize, malformed);
    }
}

/// The sequence number of the reply.
fn sequence(message: &core::result::Result<FromHost, Malformed>) -> u8 {
    match message {
        Ok(message) => message.sequence,
        Err(malformed) => malformed.sequence.unwrap_or(0),
    }
}

fn answers(message: &core::result::Result<FromHost, Malformed>, reply: &Reply, has_can: bool) -> bool {
    let Ok(message) = message else {
        return matches!(reply, Reply::Unsupported { .. });
    };
    match message.request {
        Request::Identify => matches!(reply, Reply::Identity(_)),
        Request::IdentifyArm => matches!(reply, Reply::Arm(_) | Reply::Failed(_)),
        Request::GetConfig => matches!(reply, Reply::Config(_)),
        Request::SetConfig(config) if !has_can && config.can != Can::default() => {
            *reply == Reply::BadConfig(ConfigError::NoCan)
        }
        Request::SetConfig(config) => match config.check() {
            Ok(()) => matches!(reply, Reply::Done | Reply::BadConfig(_)),
            Err(error) => *reply == Reply::BadConfig(error),
        },
        Request::SaveConfig | Request::ResetConfig => matches!(reply, Reply::Done | Reply::Failed(_)),
        Request::GetCounters => matches!(reply, Reply::Counters(_)),
        Request::GetLatencies => matches!(reply, Reply::Latencies(_)),
        Request::Subscribe(_) | Request::Restart | Request::RestartIntoBootLoader | Request::EndStream => {
            *reply == Reply::Done
        }
        Request::GetLine => matches!(reply, Reply::Line(_)),
        Request::ReserveLine => matches!(reply, Reply::Done | Reply::Failed(Failure::StreamArmed | Failure::Busy)),
        Request::ReleaseLine => *reply == Reply::Done,
        Request::Stop => matches!(reply, Reply::Done | Reply::Failed(_)),
        Request::GetRecovery => *reply == Reply::Recovery { active: false },
        Request::GetSaved => matches!(reply, Reply::Saved(Saved::Nothing) | Reply::Failed(_)),
        Request::GetStop => matches!(reply, Reply::Stop(_)),
    }
}

/// The message in bytes that end with a zero: a COBS decoder of whole messages.
fn read(segment: &[u8]) -> core::result::Result<FromHost, Malformed> {
    let mut message = Vec::new();
    let mut rest = segment;
    while let Some((&len, behind)) = rest.split_first() {
        let len = usize::from(len) - 1;
        let Some((block, behind)) = behind.split_at_checked(len) else {
            return Err(Malformed {
                sequence: None,
                reason: Reason::NotCobs,
            });
        };
        message.extend(block);
        if len < 254 && !behind.is_empty() {
            message.push(0);
        }
        rest = behind;
    }
    if message.len() > MAX_REQUEST {
        return Err(Malformed {
            sequence: message.first().copied(),
            reason: Reason::TooLong { max: MAX_REQUEST },
        });
    }
    decode(&message)
}

/// Checks that a message decoded from any bytes survives encoding and decoding.
fn check_codec<T: Message + PartialEq + Debug>(bytes: &[u8]) {
    match decode::<T>(bytes) {
        Ok(message) => {
            let mut out = [0; MAX_MESSAGE];
            let len = encode(&message, &mut out).expect("there is room");
            assert_eq!(decode(&out[..len]), Ok(message));
        }
        Err(malformed) => assert!(!malformed.to_string().is_empty()),
    }
}
