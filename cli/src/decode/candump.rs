//! Logs of a CAN bus, as `candump -L` writes them: what an adapter carries by ISO-TP, put together again.

use std::collections::BTreeMap;

use armwire::framing::Scan;
use armwire_bridge::Instant;
use armwire_bridge::can::{Frame, Function, Id};
use armwire_bridge::control::{self, FromAdapter, FromHost, MAX_MESSAGE, Message};
use armwire_bridge::isotp::{Config, Endpoint, Event, Link};

use super::{Speaker, meaning};
use crate::describe::Arm;
use crate::hex;

/// What is in the high half of a flow control frame's first byte.
const FLOW_CONTROL: u8 = 3;

/// One that only listens, and so has nothing to send.
type Listener = Endpoint<MAX_MESSAGE, 1>;

/// Whether it is such a log: nothing else that can be decoded begins with a parenthesis.
pub(super) fn is_log(text: &[u8]) -> bool {
    text.trim_ascii_start().starts_with(b"(")
}

/// One line of a log.
struct Logged<'a> {
    /// In seconds, as it is in the log.
    stamp: &'a str,
    at: Instant,
    /// None for remote frames, error frames and extended identifiers, of which an adapter has none.
    frame: Option<Frame>,
}

/// The PDUs of a log, and the sum. The error is the line's number, from 1, and the line.
pub(super) fn decode<P: Arm>(text: &str) -> Result<Vec<String>, (usize, String)> {
    let mut listeners = BTreeMap::<Id, Listener>::new();
    let mut lines = Vec::new();
    let (mut frames, mut pdus, mut lost, mut cyclic, mut others) = (0, 0, 0, 0, 0);
    for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let Logged { stamp, at, frame } = parse(line).ok_or_else(|| (i + 1, line.trim().to_owned()))?;
        frames += 1;
        let Some((frame, (function, node))) = frame.and_then(|frame| Some((frame, Function::of(frame.id())?))) else {
            others += 1;
            continue;
        };
        if !is_isotp(function) {
            cyclic += 1;
            continue;
        }
        // That is for the PDUs of the other direction.
        if frame.data().first().is_some_and(|byte| byte >> 4 == FLOW_CONTROL) {
            continue;
        }
        let link = if frame.is_fd() { Link::Fd } else { Link::Classic };
        let new = || Listener::new(Config::new(link, frame.id()));
        let listener = listeners.entry(frame.id()).or_insert_with(new);
        let late = listener.tick(at);
        let events = listener.receive(frame.data(), at);
        // Whom it was for has sent the flow control.
        if listener.transmit(at).is_some() {
            listener.transmitted(at);
        }
        for event in late.chain(events) {
            let (bytes, told) = match event {
                Event::Received => {
                    let pdu = listener.received().unwrap_or_default();
                    pdus += 1;
                    (hex::show(pdu), pdu_meaning::<P>(function, pdu))
                }
                Event::Failed(error) => (hex::show(frame.data()), error.to_string()),
                Event::Refused(refused) => (hex::show(frame.data()), refused.to_string()),
                Event::Ignored(ignored) => (hex::show(frame.data()), ignored.to_string()),
            };
            lost += u64::from(event != Event::Received);
            lines.push(format!("{stamp}  node {}  {bytes}\n          {told}", node.get()));
        }
        listener.release();
    }
    lines.push(format!(
        "CAN frames: {frames}, PDUs: {pdus}, lost: {lost}, cyclic frames: {cyclic}, frames of others: {others}"
    ));
    Ok(lines)
}

fn is_isotp(function: Function) -> bool {
    use Function::{ArmAnswer, ArmRequest, ControlAnswer, ControlRequest};
    matches!(function, ArmRequest | ArmAnswer | ControlRequest | ControlAnswer)
}

/// What a PDU says.
fn pdu_meaning<P: Arm>(function: Function, pdu: &[u8]) -> String {
    match function {
        Function::ArmRequest => frame_meaning::<P>(pdu, Speaker::Host),
        Function::ControlRequest => format!("to the adapter: {}", message::<FromHost>(pdu)),
        Function::ControlAnswer => format!("from the adapter: {}", message::<FromAdapter>(pdu)),
        _ => frame_meaning::<P>(pdu, Speaker::Arm),
    }
}

fn frame_meaning<P: Arm>(pdu: &[u8], from: Speaker) -> String {
    let arm = P::default();
    let expect = super::expected(&arm, Some(from));
    match arm.scan(pdu, expect) {
        Scan::Frame(len) if len == pdu.len() => meaning(&arm, pdu, expect, Some(from)),
        Scan::Noise(_, reason) | Scan::Broken(reason) => format!("no frame of {}: {reason}", P::NAME),
        _ => format!("not one whole frame of {}", P::NAME),
    }
}

fn message<T: Message + std::fmt::Debug>(pdu: &[u8]) -> String {
    match control::decode::<T>(pdu) {
        Ok(message) => format!("{message:?}"),
        Err(error) => format!("no message: {error}"),
    }
}

/// `(1609459200.123456) can0 603#07AA060001FE9AFF`, and with `##` and a digit of flags for FD; newer versions put the
/// direction behind it.
fn parse(line: &str) -> Option<Logged<'_>> {
    let mut words = line.split_whitespace();
    let stamp = words.next()?.strip_prefix('(')?.strip_suffix(')')?;
    let _interface = words.next()?;
    let (id, data) = words.next()?.split_once('#')?;
    let (seconds, micros) = stamp.split_once('.')?;
    let seconds: u64 = seconds.parse().ok()?;
    let micros: u64 = micros.parse().ok().filter(|_| micros.len() == 6)?;
    let at = Instant::from_micros(seconds.checked_mul(1_000_000)?.checked_add(micros)?);
    let raw = u32::from_str_radix(id, 16).ok()?;
    let fd = data.strip_prefix('#');
    let standard = (id.len() == 3).then(|| Id::new(raw as u16).ok()).flatten();
    let frame = match (standard, fd) {
        (None, _) => None,
        (_, None) if data.starts_with('R') => None,
        (Some(id), None) => Some(Frame::new(id, &hex::parse(data).ok()?).ok()?),
        (Some(id), Some(fd)) => Some(Frame::new_fd(id, &hex::parse(fd.get(1..)?).ok()?).ok()?),
    };
    Some(Logged { stamp, at, frame })
}

#[cfg(test)]
mod tests {
    use armwire::alpha1::Alpha1;
    use armwire::ling::{JointState, Ling, MAX_FRAME, MotionStatus, Request, Response};
    use armwire::messages::Messages;
    use armwire_bridge::can::Node;

    use super::*;

    const NODE: Node = Node::MAX;

    /// A frame as `candump -L` writes it, each a millisecond after the one before.
    fn log(lines: &mut Vec<String>, frame: &Frame) {
        let data: String = frame.data().iter().map(|byte| format!("{byte:02X}")).collect();
        let (hash, millis) = (if frame.is_fd() { "##1" } else { "#" }, lines.len());
        lines.push(format!(
            "(1609459200.{millis:03}000) can0 {:03X}{hash}{data}",
            frame.id().get()
        ));
    }

    /// A PDU as it goes over the bus, flow control included.
    fn carry(lines: &mut Vec<String>, link: Link, function: Function, back: Function, pdu: &[u8]) {
        let end = |function: Function| Endpoint::<300, 300>::new(Config::new(link, function.id(NODE)));
        let (mut sender, mut receiver) = (end(function), end(back));
        sender.send(pdu).unwrap();
        while receiver.received().is_none() {
            let frame = sender.transmit(Instant::ZERO).unwrap();
            log(lines, &frame);
            let _ = receiver.receive(frame.data(), Instant::ZERO);
            if let Some(frame) = receiver.transmit(Instant::ZERO) {
                log(lines, &frame);
                let _ = sender.receive(frame.data(), Instant::ZERO);
            }
        }
        assert_eq!(receiver.received(), Some(pdu));
    }

    /// A Ling arm that is asked for its joints, and a question to the adapter.
    fn exchange(link: Link) -> Vec<String> {
        use Function::{ArmAnswer, ArmRequest, ControlAnswer, ControlRequest};
        let mut lines = Vec::new();
        let mut bytes = [0; MAX_FRAME];
        let n = Ling.encode_request(&Request::ReadJoints, &mut bytes).unwrap();
        carry(&mut lines, link, ArmRequest, ArmAnswer, &bytes[..n]);
        let state = JointState {
            joints: [2048; 6],
            gripper: 500,
            status: MotionStatus::Locked,
        };
        let n = Ling
            .encode_response(&Response::Joints(state), None, &mut bytes)
            .unwrap();
        carry(&mut lines, link, ArmAnswer, ArmRequest, &bytes[..n]);
        carry(&mut lines, link, ControlRequest, ControlAnswer, &[7, 2]);
        lines
    }

    /// What the lines of decoded text end with.
    fn meanings<P: Arm>(log: &[String]) -> Vec<String> {
        let decoded = decode::<P>(&log.join("\n")).unwrap();
        let told = decoded.iter().map(|line| {
            line.trim_start()
                .rsplit_once('\n')
                .map_or(&**line, |(_, told)| told.trim_start())
        });
        told.map(str::to_owned).collect()
    }

    const REQUEST: &str = "to the arm: read joints";
    const ANSWER: &str =
        "from the arm: joints: +0.00° +0.00° +0.00° +0.00° +0.00° +0.00°, gripper: 50.0 % open, status: locked";
    const CONTROL: &str = "to the adapter: FromHost { sequence: 7, request: GetConfig }";

    #[test]
    fn what_was_carried_in_many_frames_is_put_together_classic_and_fd() {
        let classic = exchange(Link::Classic);
        let sum = format!(
            "CAN frames: {}, PDUs: 3, lost: 0, cyclic frames: 0, frames of others: 0",
            classic.len()
        );
        assert!(classic.len() > 5);
        assert_eq!(meanings::<Ling>(&classic), [REQUEST, ANSWER, CONTROL, &sum]);
        let sum = "CAN frames: 3, PDUs: 3, lost: 0, cyclic frames: 0, frames of others: 0";
        assert_eq!(meanings::<Ling>(&exchange(Link::Fd)), [REQUEST, ANSWER, CONTROL, sum]);
    }

    #[test]
    fn each_pdu_has_the_time_of_its_last_frame_and_its_node() {
        let lines = decode::<Ling>(&exchange(Link::Classic).join("\n")).unwrap();
        assert!(
            lines[0].starts_with("1609459200.000000  node 15  AA 06 00 01 FE 9A FF\n"),
            "{}",
            lines[0]
        );
    }

    #[test]
    fn a_frame_that_is_missing_costs_its_pdu_and_is_told() {
        let mut log = exchange(Link::Classic);
        let second = log.iter().position(|line| line.contains(" 61F#21")).unwrap();
        log.remove(second);
        let told = meanings::<Ling>(&log);
        assert_eq!(told[1], "receiving: consecutive frame 1 was expected, 2 came");
        assert_eq!(told[told.len() - 2], CONTROL);
        assert!(told.last().unwrap().contains("PDUs: 2, lost: "), "{told:?}");
    }

    #[test]
    fn what_else_is_on_a_bus_is_counted() {
        let log = [
            "(1.000000) can0 20F#0008000800080000",
            "(1.000001) can0 7DF#02010C",
            "(1.000002) can0 1ABCDE00#11 R",
            "(1.000003) can0 60F#R7",
        ];
        let log = log.map(str::to_owned);
        let sum = "CAN frames: 4, PDUs: 0, lost: 0, cyclic frames: 1, frames of others: 3";
        assert_eq!(meanings::<Ling>(&log), [sum]);
    }

    #[test]
    fn a_pdu_that_is_no_frame_of_this_arm_is_told() {
        let told = meanings::<Alpha1>(&exchange(Link::Fd));
        assert!(told[0].starts_with("no frame of an Alpha1: "), "{told:?}");
        let surplus = ["(1.000000) can0 60F##10008AA060001FE9AFF00CCCC".to_owned()];
        assert_eq!(meanings::<Ling>(&surplus)[0], "not one whole frame of a Ling arm");
    }

    #[test]
    fn what_is_no_line_of_a_log_is_told_with_its_number() {
        for line in [
            "(1.000000) can0 603",
            "(1.00000) can0 603#00",
            "(1.000000) can0 603#0",
            "(1.000000) can0 603#000000000000000000",
            "(1.000000) can0 603##1000000000000000000",
            "1.000000 can0 603#00",
        ] {
            let log = format!("(1.000000) can0 603#300000\n\n{line}\n");
            assert_eq!(decode::<Ling>(&log), Err((3, line.to_owned())));
        }
    }
}
