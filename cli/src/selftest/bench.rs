//! The adapter on the bench: its serial port with the jumper, and its control port.

use std::collections::VecDeque;
use std::time::Duration;

use armwire::ling::READ_JOINTS;
use armwire_bridge::config::{ArmKind, Can, Config, HostTimeout, Poll};
use armwire_bridge::control::{
    Event, Failure, FromAdapter, FromHost, Identity, MAX_COBS, MAX_MESSAGE, Reader, Reply, Request as ControlRequest,
    Stamp, Subscription, encode_cobs,
};
use armwire_bridge::{Counters, LineCoding};

use super::report::{Trouble, ensure};
use super::usb::{Payload, Pipe, Request, Usb};

/// Requests of CDC (PSTN 1.2, 6.3), to the serial port's first interface.
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;
const SET_CONTROL_LINE_STATE: u8 = 0x22;
const DTR_AND_RTS: u16 = 3;

/// Timeout of a control port reply. The adapter may write flash first.
const REPLY_TIMEOUT: Duration = Duration::from_secs(3);
/// Timeout of a new line coding: 100 ms, plus the delays of USB.
const LINE_CODING_TIMEOUT: Duration = Duration::from_millis(500);
/// Timeout between two echoed bytes, and of a frame's event.
pub(super) const STALL_TIMEOUT: Duration = Duration::from_millis(500);
/// Idle time after which the line counts as quiet.
const QUIET_TIME: Duration = Duration::from_millis(20);
/// Timeout of draining the bytes of an earlier send.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(1);
/// Maximum bytes in flight: fewer than the adapter's buffer for a slow host.
const WINDOW: usize = 512;
/// Maximum time between two checks for a stop by the user.
const STOP_PERIOD: Duration = Duration::from_millis(500);
/// Bytes of one transfer.
const CHUNK: usize = 192;

/// A frame for the jumper. A Ling arm would only answer with its joints.
pub(super) const FRAME: [u8; 7] = READ_JOINTS;

/// The adapter on the bench.
pub(super) struct Bench<'u> {
    pub(super) usb: &'u mut dyn Usb,
    stopped: &'u dyn Fn() -> bool,
    reader: Reader<MAX_MESSAGE>,
    sequence: u8,
    events: VecDeque<(Stamp, Event)>,
}

impl<'u> Bench<'u> {
    pub(super) fn new(usb: &'u mut dyn Usb, stopped: &'u dyn Fn() -> bool) -> Self {
        Self {
            usb,
            stopped,
            reader: Reader::new(),
            sequence: 0,
            events: VecDeque::new(),
        }
    }

    /// Ends a check once the user stops the run.
    pub(super) fn check_stop(&self) -> Result<(), Trouble> {
        match (self.stopped)() {
            true => Err(Trouble::NotTried("stopped".to_owned())),
            false => Ok(()),
        }
    }

    /// Lets this much time pass, unless the user stops the run.
    pub(super) fn sleep(&mut self, span: Duration) -> Result<(), Trouble> {
        let until = self.usb.now() + span;
        loop {
            self.check_stop()?;
            let left = until.saturating_sub(self.usb.now());
            if left.is_zero() {
                return Ok(());
            }
            self.usb.sleep(left.min(STOP_PERIOD))?;
        }
    }

    // ---- The control port ----

    /// Makes a request on the control port, and returns the reply.
    pub(super) fn call(&mut self, request: ControlRequest) -> Result<Reply, Trouble> {
        self.sequence = self.sequence.wrapping_add(1);
        let message = FromHost {
            sequence: self.sequence,
            request,
        };
        // The leading zero ends a partial message of an earlier program.
        let mut bytes = [0; 1 + MAX_COBS];
        let len = encode_cobs(&message, &mut bytes[1..]).expect("room for any message");
        self.usb.send(Pipe::Control, &bytes[..1 + len])?;
        let until = self.usb.now() + REPLY_TIMEOUT;
        loop {
            let left = until.saturating_sub(self.usb.now());
            if let Some(reply) = self.receive_control(left)? {
                return Ok(reply);
            }
            let millis = REPLY_TIMEOUT.as_millis();
            ensure(
                !left.is_zero(),
                format_args!("no reply to {request:?} on the control port in {millis} ms"),
            )?;
        }
    }

    /// Makes a request whose reply has no data.
    pub(super) fn order(&mut self, request: ControlRequest) -> Result<(), Trouble> {
        match self.call(request)? {
            Reply::Done => Ok(()),
            reply => Err(unexpected(&request, &reply)),
        }
    }

    /// The next event within this time. `None` on timeout.
    pub(super) fn next_event(&mut self, wait: Duration) -> Result<Option<(Stamp, Event)>, Trouble> {
        let until = self.usb.now() + wait;
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(Some(event));
            }
            let left = until.saturating_sub(self.usb.now());
            self.receive_control(left)?;
            if left.is_zero() && self.events.is_empty() {
                return Ok(None);
            }
        }
    }

    /// Receives from the control port. Queues events and returns the reply to the last request.
    fn receive_control(&mut self, wait: Duration) -> Result<Option<Reply>, Trouble> {
        let bytes = self.usb.receive(Pipe::Control, wait)?;
        let mut rest = &bytes[..];
        let mut answer = None;
        while !rest.is_empty() {
            rest = self.reader.push(rest);
            match self.reader.next() {
                Some(Ok(FromAdapter::Reply { sequence, reply })) if sequence == self.sequence => answer = Some(reply),
                // A reply to an abandoned request.
                Some(Ok(FromAdapter::Reply { .. })) | None => {}
                Some(Ok(FromAdapter::Event { at, event })) => self.events.push_back((at, event)),
                Some(Err(error)) => {
                    return Err(Trouble::failed(format_args!(
                        "the adapter's message on the control port cannot be read: {error}"
                    )));
                }
            }
        }
        Ok(answer)
    }

    /// The configuration in force.
    pub(super) fn config(&mut self) -> Result<Config, Trouble> {
        match self.call(ControlRequest::GetConfig)? {
            Reply::Config(config) => Ok(config),
            reply => Err(unexpected(&ControlRequest::GetConfig, &reply)),
        }
    }

    /// The adapter's counters.
    pub(super) fn counters(&mut self) -> Result<Counters, Trouble> {
        let bytes = self.usb.control(&read_counters())?;
        Counters::from_bytes(&bytes)
            .map_err(|error| Trouble::failed(format_args!("the adapter's counters cannot be read: {error}")))
    }

    /// Restarts the adapter and opens it.
    pub(super) fn restart(&mut self) -> Result<(), Trouble> {
        self.order(ControlRequest::Restart)?;
        self.usb.reopen()?;
        self.forget_session();
        Ok(())
    }

    // ---- The serial port ----

    /// Brings the adapter into the initial state of a check: no transmissions of its own, and the serial port open at
    /// a Ling arm's rate with an empty receive buffer.
    pub(super) fn open(&mut self) -> Result<(), Trouble> {
        let config = quiet(&self.config()?);
        self.order(ControlRequest::SetConfig(config))?;
        self.open_port()
    }

    /// Opens the serial port and runs `act` with the line reserved: no poll and no other host sends. The
    /// configuration stays.
    pub(super) fn with_reserved_line<T>(
        &mut self,
        act: impl FnOnce(&mut Self) -> Result<T, Trouble>,
    ) -> Result<T, Trouble> {
        match self.call(ControlRequest::ReserveLine)? {
            Reply::Done => {}
            Reply::Failed(Failure::StreamArmed) => {
                let text = "a host streams motion: stop it, disconnect the arm, and join TX and RX with a jumper";
                return Err(Trouble::failed(text));
            }
            reply => return Err(unexpected(&ControlRequest::ReserveLine, &reply)),
        }
        let result = self.open_port().and_then(|()| act(self));
        let released = self.order(ControlRequest::ReleaseLine);
        // The first error is the cause of the second.
        let value = result?;
        released?;
        Ok(value)
    }

    fn open_port(&mut self) -> Result<(), Trouble> {
        self.order(ControlRequest::Subscribe(Subscription::default()))?;
        let dtr_on = port_request(0x21, SET_CONTROL_LINE_STATE, DTR_AND_RTS, Payload::Write(&[]));
        self.usb.control(&dtr_on)?;
        self.set_line(LineCoding::LING)?;
        self.drain()?;
        self.events.clear();
        Ok(())
    }

    /// Sets the line coding of the serial port and waits until it is in effect.
    pub(super) fn set_line(&mut self, coding: LineCoding) -> Result<(), Trouble> {
        self.usb.control(&set_line_coding(&coding.to_cdc()))?;
        let until = self.usb.now() + LINE_CODING_TIMEOUT;
        loop {
            let line = match self.call(ControlRequest::GetLine)? {
                Reply::Line(line) => line,
                reply => return Err(unexpected(&ControlRequest::GetLine, &reply)),
            };
            if line.coding == coding && line.waiting.is_none() {
                return Ok(());
            }
            let reason = format_args!("{coding:?} was set and the line is at {:?}", line.coding);
            ensure(self.usb.now() <= until, reason)?;
            self.usb.sleep(Duration::from_millis(5))?;
        }
    }

    /// The line coding that the serial port reports.
    pub(super) fn line_coding(&mut self) -> Result<LineCoding, Trouble> {
        let bytes = self.usb.control(&get_line_coding())?;
        let coding = bytes.clone().try_into().ok().map(LineCoding::from_cdc);
        match coding {
            Some(Ok(coding)) => Ok(coding),
            _ => Err(Trouble::failed(format_args!("GET_LINE_CODING read {bytes:02X?}"))),
        }
    }

    /// Reads until the line is quiet. Returns the number of bytes read.
    pub(super) fn drain(&mut self) -> Result<usize, Trouble> {
        let until = self.usb.now() + DRAIN_TIMEOUT;
        let mut count = 0;
        loop {
            match self.usb.receive(Pipe::Port, QUIET_TIME)?.len() {
                0 => return Ok(count),
                more => count += more,
            }
            ensure(
                self.usb.now() <= until,
                "bytes arrive continuously though none were sent: disconnect the arm and join TX and RX with a jumper",
            )?;
        }
    }

    /// Sends bytes and expects exactly the same bytes back. Returns the duration.
    pub(super) fn echo(&mut self, bytes: &[u8]) -> Result<Duration, Trouble> {
        let begun = self.usb.now();
        self.echo_with(bytes, |_| Ok(()))?;
        let took = self.usb.now() - begun;
        let (more, sent) = (self.drain()?, bytes.len());
        ensure(
            more == 0,
            format_args!("{more} bytes more than the {sent} sent came back"),
        )?;
        Ok(took)
    }

    /// Sends bytes and expects the same bytes back, calling `meanwhile` repeatedly until all have arrived.
    pub(super) fn echo_with(
        &mut self,
        bytes: &[u8],
        mut meanwhile: impl FnMut(&mut Self) -> Result<(), Trouble>,
    ) -> Result<(), Trouble> {
        let (mut sent, mut received) = (0, 0);
        let mut progressed = self.usb.now();
        while received < bytes.len() {
            if sent < bytes.len() && sent - received < WINDOW {
                let end = bytes.len().min(sent + CHUNK);
                self.usb.send(Pipe::Port, &bytes[sent..end])?;
                sent = end;
            }
            let more = self.usb.receive(Pipe::Port, QUIET_TIME)?;
            compare(bytes, received, &more)?;
            received += more.len();
            if !more.is_empty() {
                progressed = self.usb.now();
            }
            let reason = format_args!("{received} of {} bytes came back", bytes.len());
            ensure(self.usb.now() <= progressed + STALL_TIMEOUT, reason)?;
            meanwhile(self)?;
        }
        Ok(())
    }

    /// Expects the echo of sent bytes.
    pub(super) fn expect_back(&mut self, sent: &[u8]) -> Result<(), Trouble> {
        let mut received = 0;
        while received < sent.len() {
            let more = self.usb.receive(Pipe::Port, STALL_TIMEOUT)?;
            compare(sent, received, &more)?;
            received += more.len();
            let reason = format_args!("{received} of {} bytes came back", sent.len());
            ensure(!more.is_empty(), reason)?;
        }
        Ok(())
    }

    /// Discards partial messages on the control port after a reset of the adapter.
    pub(super) fn forget_session(&mut self) {
        self.reader = Reader::new();
        self.events.clear();
    }
}

/// Compares received with sent bytes, from the byte `at` on.
pub(super) fn compare(sent: &[u8], at: usize, received: &[u8]) -> Result<(), Trouble> {
    let expected = sent.get(at..).unwrap_or_default();
    let len = sent.len();
    ensure(
        received.len() <= expected.len(),
        format_args!("more bytes than the {len} sent came back"),
    )?;
    match (at..).zip(expected.iter().zip(received)).find(|(_, (a, b))| a != b) {
        Some((place, (expected, got))) => Err(Trouble::failed(format_args!(
            "byte {place} of {len}: {expected:#04x} was sent and {got:#04x} came back"
        ))),
        None => Ok(()),
    }
}

/// Pseudorandom bytes, different for each seed. None can begin a frame of an arm: Ling frames begin with AA, those of
/// Alpha1 and its servos with EF and above.
pub(super) fn payload(seed: u64, len: usize) -> Vec<u8> {
    // Steele and Vigna's SplitMix64.
    let mut state = seed;
    let bytes = std::iter::repeat_with(move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 56) as u8
    });
    bytes.filter(|&byte| byte != 0xAA && byte < 0xEF).take(len).collect()
}

/// A configuration without transmissions of the adapter's own.
pub(super) fn quiet(config: &Config) -> Config {
    Config {
        arm: ArmKind::Ling,
        poll: Poll::Off,
        can: Can {
            telemetry_hz: 0,
            commands: false,
            unsolicited: false,
            ..config.can
        },
        host_timeout: HostTimeout {
            after_ms: 0,
            torque_off: false,
        },
    }
}

/// Line errors and lost bytes between two readings of the counters, as text. `None` without any.
pub(super) fn losses(before: &Counters, after: &Counters) -> Option<String> {
    let counts = [
        ("framing errors", before.framing_errors, after.framing_errors),
        ("parity errors", before.parity_errors, after.parity_errors),
        ("noise errors", before.noise_errors, after.noise_errors),
        ("overruns", before.overrun_errors, after.overrun_errors),
        ("overruns of the ring", before.ring_overruns, after.ring_overruns),
        ("bytes dropped", before.dropped_bytes, after.dropped_bytes),
        ("bytes undelivered", before.undelivered_bytes, after.undelivered_bytes),
        ("bytes refused", before.refused_bytes, after.refused_bytes),
        (
            "bytes refused at another rate",
            before.refused_rate_bytes,
            after.refused_rate_bytes,
        ),
    ];
    let words: Vec<_> = counts
        .into_iter()
        .filter(|(_, before, after)| before != after)
        .map(|(name, before, after)| format!("{} {name}", after.wrapping_sub(before)))
        .collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// A reply of the wrong type.
pub(super) fn unexpected(request: &ControlRequest, reply: &Reply) -> Trouble {
    Trouble::failed(format_args!("{request:?} was answered by {reply:?}"))
}

pub(super) fn get_line_coding() -> Request<'static> {
    port_request(0xA1, GET_LINE_CODING, 0, Payload::Read(7))
}

pub(super) fn set_line_coding(coding: &[u8]) -> Request<'_> {
    port_request(0x21, SET_LINE_CODING, 0, Payload::Write(coding))
}

pub(super) fn read_counters() -> Request<'static> {
    let (kind, request) = Counters::READ_REQUEST;
    port_request(kind, request, 0, Payload::Read(Counters::MAX_LEN as u16))
}

/// A request with index 0: to the device, or to the serial port's first interface.
fn port_request(kind: u8, request: u8, value: u16, payload: Payload<'_>) -> Request<'_> {
    Request {
        kind,
        request,
        value,
        index: 0,
        payload,
    }
}

/// Adds the place in a check to a failure. A check that was not tried stays not tried.
pub(super) fn at(place: impl std::fmt::Display) -> impl FnOnce(Trouble) -> Trouble {
    move |trouble| match trouble {
        Trouble::Failed(text) => Trouble::failed(format_args!("{place}: {text}")),
        other => other,
    }
}

/// Reads the adapter's identity.
pub(super) fn identify(bench: &mut Bench<'_>) -> Result<Identity, Trouble> {
    match bench.call(ControlRequest::Identify)? {
        Reply::Identity(identity) => Ok(identity),
        reply => Err(unexpected(&ControlRequest::Identify, &reply)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn payload_begins_no_frame_of_an_arm() {
        let bytes = payload(7, 10_000);
        assert_eq!(bytes.len(), 10_000);
        assert!(bytes.iter().all(|&byte| byte != 0xAA && byte < 0xEF));
        assert_ne!(bytes[..100], payload(8, 100));
    }

    #[test]
    fn first_wrong_byte_is_reported() {
        assert_eq!(compare(b"abcd", 1, b"bc"), Ok(()));
        let error = |at, came: &[u8]| compare(b"abcd", at, came).unwrap_err().to_string();
        assert_eq!(error(1, b"bx"), "byte 2 of 4: 0x63 was sent and 0x78 came back");
        assert_eq!(error(3, b"de"), "more bytes than the 4 sent came back");
    }

    #[test]
    fn each_count_of_a_loss_is_reported() {
        let before = Counters::default();
        let mut after = before;
        assert_eq!(losses(&before, &after), None);
        (after.parity_errors, after.dropped_bytes) = (2, 7);
        assert_eq!(losses(&before, &after).unwrap(), "2 parity errors, 7 bytes dropped");
    }
}
