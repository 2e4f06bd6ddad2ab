//! The bytes and messages of an adapter's hosts and its arm, and their agreement with its counters.

use armwire::alpha1::Alpha1;
use armwire::framing::Scan;
use armwire::ling::Ling;
use armwire::messages::Messages;
use armwire_bridge::Counters;
use armwire_bridge::config::{ArmKind, Config, Poll};
use armwire_bridge::control::{Initiator, MAX_FRAME, Request};

/// The bytes and messages so far.
#[derive(Default)]
pub(crate) struct Accounts {
    /// All bytes sent by the arm and received by the host on USB.
    pub(crate) arm_sent: Vec<u8>,
    pub(crate) usb_received: Vec<u8>,
    /// All bytes accepted from the host on USB, and those of them sent to the arm.
    pub(crate) usb_accepted: Vec<u8>,
    usb_sent: Vec<u8>,
    /// Bytes of that host that were refused as they came, because of its rate.
    pub(crate) refused: u32,
    /// Number of bytes received by the arm, from all initiators.
    to_arm: usize,
    /// Requests of all but the host on USB that want an answer. `None` if unknown.
    wanted: Option<usize>,

    /// PDUs of the host on CAN, and the number of them up to the last one sent to the arm.
    pub(crate) can_requested: Vec<Vec<u8>>,
    can_sent: usize,
    /// Requests of the host on CAN received by the arm, and the number of answers received.
    can_queries: Vec<Vec<u8>>,
    can_received: usize,
    /// Maximum number of bytes from hosts on CAN to the arm.
    pub(crate) can_bytes: usize,

    /// Requests and replies on the control port, and on the control connection on CAN.
    pub(crate) control_requests: usize,
    pub(crate) control_replies: usize,
    pub(crate) can_control_requests: usize,
    pub(crate) can_control_replies: usize,

    /// Events that make some totals inexact.
    pub(crate) usb_gone: bool,
    pub(crate) can_disturbed: bool,
    pub(crate) reconfigured: bool,
    pub(crate) commanded: bool,
    pub(crate) others: bool,
}

impl Accounts {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            wanted: Some(0),
            others: config.poll != Poll::Off,
            ..Self::default()
        }
    }

    pub(crate) fn on_control_request(&mut self, request: Request) {
        self.reconfigured |= matches!(request, Request::SetConfig(_) | Request::ResetConfig);
        self.others |= matches!(request, Request::IdentifyArm | Request::Stop);
    }

    /// Bytes of this initiator were sent to the arm.
    pub(crate) fn on_sent(&mut self, initiator: Initiator, bytes: &[u8], arm: ArmKind) {
        self.to_arm += bytes.len();
        if initiator == Initiator::Usb {
            self.usb_sent.extend(bytes);
            return;
        }
        let wants = wants_answer(arm, bytes);
        self.wanted = self
            .wanted
            .zip(wants)
            .map(|(wanted, wants)| wanted + usize::from(wants));
        if initiator == Initiator::Can {
            // PDUs of hosts on CAN are sent complete and in order.
            let place = self.can_requested[self.can_sent..].iter().position(|pdu| pdu == bytes);
            self.can_sent += 1 + place.expect("no host on CAN sent this");
            self.can_queries.push(bytes.to_vec());
        }
    }

    /// Checks that the arm has sent the PDU, and, if the host on CAN gets answers only, that the host has requested it.
    pub(crate) fn on_can_answer(&mut self, pdu: &[u8], config: &Config) {
        let sent = self.arm_sent.windows(pdu.len()).any(|window| window == pdu);
        assert!(sent, "the arm did not send {pdu:02X?}");
        if self.reconfigured || config.can.unsolicited {
            return;
        }
        self.can_received += 1;
        let (answers, queries) = (self.can_received, self.can_queries.len());
        assert!(answers <= queries, "{answers} answers to {queries} requests");
        if config.arm == ArmKind::Ling {
            // Command and function are those of the request.
            let mut requests = self.can_queries.iter();
            let is_requested = requests.any(|request| request.get(1..3) == pdu.get(1..3));
            assert!(is_requested, "no host on CAN requested {pdu:02X?}");
        }
    }

    /// Checks the invariants that hold at any time.
    pub(crate) fn check(&self, c: &Counters) {
        assert_eq!(c.arm_to_host_bytes as usize, self.arm_sent.len());
        assert_eq!(c.host_to_arm_bytes as usize, self.to_arm);
        assert_eq!(c.refused_bytes, 0, "a packet was accepted without room for it");
        let lost = (c.dropped_bytes + c.undelivered_bytes) as usize;
        assert!(self.usb_received.len() + lost <= self.arm_sent.len());
        let can_sent: usize = self.can_queries.iter().map(Vec::len).sum();
        assert!(
            self.usb_sent.len() + can_sent + self.dropped(c) <= self.usb_accepted.len() + self.can_bytes,
            "bytes for the arm are sent twice, or counted as dropped and sent"
        );
        assert!(c.late_answers + c.unsolicited_frames <= c.frames);
        assert!(c.late_stamps <= c.frames);
        assert!(c.empty_packets_to_host <= c.packets_to_host);
        if self.dropped(c) == 0 {
            let mut accepted = self.usb_accepted.iter();
            // Requests that a stop refuses are missing.
            let is_unaltered = match c.refused_stopped {
                0 => self.usb_accepted.starts_with(&self.usb_sent),
                _ => self.usb_sent.iter().all(|sent| accepted.any(|byte| byte == sent)),
            };
            assert!(is_unaltered, "bytes for the arm are altered");
        }
        assert!(
            lost > 0 || self.others || self.reconfigured || self.arm_sent.starts_with(&self.usb_received),
            "bytes of the arm are altered"
        );
    }

    /// Accepted bytes that were dropped at a host timeout, or because of their rate.
    fn dropped(&self, c: &Counters) -> usize {
        (c.silenced_bytes + c.refused_rate_bytes - self.refused) as usize
    }

    /// Checks the totals after all activity has ended.
    pub(crate) fn check_ended(&self, c: &Counters) {
        self.check_received(c);
        if !self.others && self.dropped(c) == 0 {
            assert_eq!(self.usb_sent, self.usb_accepted, "bytes for the arm are lost");
        }
        if !self.usb_gone {
            let requests = self.control_requests;
            assert_eq!(self.control_replies, requests, "requests on the control interface");
        }
        // The cost of a failed transfer is counted there.
        if !self.can_disturbed && !self.reconfigured && c.isotp_failures == 0 {
            let requests = self.can_control_requests;
            assert_eq!(self.can_control_replies, requests, "requests on the control connection");
            // A command that a newer one replaced is counted as a request that was refused.
            if c.silenced_bytes == 0 && !self.usb_gone && !self.commanded {
                let ended = c.requests_can + c.refused_can_requests + c.refused_can_frames + c.control_requests;
                let sent = self.can_requested.len() + self.can_control_requests + self.control_requests;
                // Some requests refused on a reserved line may be polls, and some refused by a stop those of the host on USB.
                let refused = c.refused_line_reserved + c.refused_stopped;
                assert!((ended as usize..=(ended + refused) as usize).contains(&sent));
            }
        }
        if self.usb_accepted.is_empty()
            && let Some(wanted) = self.wanted
        {
            let ended = answered(c) + c.unanswered_requests;
            assert_eq!(ended as usize, wanted, "answered, or counted as not");
        }
    }

    /// Checks the bytes at the host on USB: those sent by the arm, in order, except counted losses and answers to
    /// others.
    fn check_received(&self, c: &Counters) {
        let mut sent = self.arm_sent.iter();
        assert!(
            self.usb_received.iter().all(|byte| sent.any(|sent| sent == byte)),
            "the host on USB received bytes that the arm did not send"
        );
        if self.reconfigured {
            return;
        }
        let lost = (c.dropped_bytes + c.undelivered_bytes) as usize;
        let accounted = self.usb_received.len() + lost;
        assert!(accounted <= self.arm_sent.len(), "bytes of the arm are counted twice");
        // Only an answer to another is not for the host on USB.
        let answers = if self.others { answered(c) } else { 0 };
        let missing = self.arm_sent.len() - accounted;
        assert!(
            missing <= answers as usize * MAX_FRAME,
            "{missing} bytes of the arm are lost, {answers} answers may have been another's"
        );
    }
}

/// Number of requests that were answered in time.
fn answered(c: &Counters) -> u32 {
    c.frames - c.late_answers - c.unsolicited_frames
}

/// True if the protocol has an answer to the request. `None` for bytes that are no message.
fn wants_answer(arm: ArmKind, bytes: &[u8]) -> Option<bool> {
    match arm {
        ArmKind::Ling => has_response(Ling, bytes),
        ArmKind::Alpha1 | ArmKind::Alpha1Servo => has_response(Alpha1, bytes),
        ArmKind::Raw => Some(false),
    }
}

fn has_response<P: Messages>(protocol: P, bytes: &[u8]) -> Option<bool> {
    if protocol.scan(bytes, protocol.requests()) != Scan::Frame(bytes.len()) {
        return None;
    }
    protocol.parse_request(bytes).ok()?;
    Some(protocol.request(bytes)?.response.is_some())
}
