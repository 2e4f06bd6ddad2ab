//! Invariants of every run, independent of the fault.

use armwire::framing::LONGEST_VOID;
use armwire_bridge::Counters;
use armwire_bridge::control::{Event, Initiator, MAX_FRAME};
use armwire_virtual_board::Nanos;
use armwire_virtual_board::report::{Cause, Crash, Violation};

use super::super::ticket_arm::ANSWER_LEN;
use super::super::{RequestTracker, Ticket, counters};
use super::Result;
use super::matrix::Fault;
use super::rig::Rig;

/// Start of the answer to a poll.
const JOINTS: [u8; 4] = [0xAA, 0x06, 0x00, 0x0F];

/// Counted losses, by name.
pub type Losses = Vec<(&'static str, u32)>;

/// A counter and its name.
type Named = (&'static str, fn(&Counters) -> u32);

/// Counters of losses, errors and refusals.
const LOSSES: [Named; 19] = [
    ("unanswered", |c| c.unanswered_requests),
    ("late answers", |c| c.late_answers),
    ("noise bytes", |c| c.noise_bytes),
    ("dropped bytes", |c| c.dropped_bytes),
    ("undelivered bytes", |c| c.undelivered_bytes),
    ("framing errors", |c| c.framing_errors),
    ("noise errors", |c| c.noise_errors),
    ("overruns", |c| c.overrun_errors),
    ("ring overruns", |c| c.ring_overruns),
    ("missed polls", |c| c.missed_polls),
    ("CAN requests refused", |c| c.refused_can_requests),
    ("CAN answers dropped", |c| c.dropped_can_answers),
    ("ISO-TP failures", |c| c.isotp_failures),
    ("CAN receive overruns", |c| c.can_receive_overruns),
    ("CAN bus errors", |c| c.can_bus_errors),
    ("bus-offs", |c| c.can_bus_offs),
    ("events dropped", |c| c.dropped_events),
    ("USB resets", |c| c.usb_resets),
    ("USB suspends", |c| c.usb_suspends),
];

/// Counters that no fault of the campaign may increment.
const NEVER: [Named; 17] = [
    ("refused bytes", |c| c.refused_bytes),
    ("parity errors", |c| c.parity_errors),
    ("refused line codings", |c| c.refused_line_codings),
    ("cyclic commands", |c| c.requests_command),
    ("PDUs that are no frame", |c| c.refused_can_frames),
    ("half commands", |c| c.commands_incomplete),
    ("stale commands", |c| c.commands_stale),
    ("commands out of range", |c| c.commands_out_of_range),
    ("silent hosts", |c| c.host_silences),
    ("silenced bytes", |c| c.silenced_bytes),
    ("control messages not known", |c| c.control_unsupported),
    ("configurations saved", |c| c.config_saves),
    ("configurations not saved", |c| c.config_failures),
    ("CAN frames not sent", |c| c.dropped_can_frames),
    ("panics", |c| c.panics),
    ("watchdog resets", |c| c.watchdog_resets),
    ("hard faults", |c| c.hard_faults),
];

/// Violated invariants of a run, a line each.
#[derive(Debug, Default)]
struct Findings(Vec<String>);

impl Findings {
    fn equal(&mut self, what: &str, counted: u32, happened: u32) {
        self.expect(counted == happened, || {
            format!("{what}: {counted} counted, {happened} happened")
        });
    }

    fn expect(&mut self, is_so: bool, otherwise: impl FnOnce() -> String) {
        if !is_so {
            self.0.push(otherwise());
        }
    }
}

impl Rig {
    /// Compares the adapter's counters with the recorded traffic. Returns the counted losses.
    ///
    /// # Errors
    ///
    /// All violated invariants.
    pub(super) fn check(&mut self, faults: &[Fault]) -> Result<Losses> {
        let mut findings = Findings::default();
        let after = counters(&mut self.board);
        self.traffic.count(&mut self.board);
        let counted = after.since(self.account.counters);
        let restart = faults.iter().find_map(|fault| fault.restart());

        self.check_run(restart, &after, &mut findings);
        self.check_line(&counted, &mut findings);
        self.check_requests(&counted, faults, &mut findings);
        self.check_hosts(&counted, faults, &mut findings);
        self.check_usb_bytes(&counted, &mut findings);
        self.check_can(&counted, &mut findings);
        for (name, get) in NEVER {
            findings.equal(name, get(&counted), 0);
        }
        let losses: Losses = LOSSES.iter().map(|&(name, get)| (name, get(&counted))).collect();
        // A storm of NAKs in the middle of a request may cut it. Nothing is lost only if each request fits in a packet.
        if let [fault] = faults
            && fault.is_lossless()
        {
            let excused = ["missed polls", "noise errors"];
            for (name, count) in losses.iter().filter(|(name, _)| !excused.contains(name)) {
                findings.equal(name, *count, 0);
            }
            for tracker in self.hosts.trackers() {
                findings.equal("requests given up by a host", tracker.given_up, 0);
            }
        }
        if findings.0.is_empty() {
            Ok(losses)
        } else {
            Err(findings.0.join("; ").into())
        }
    }

    /// Checks the restarts, and that the firmware did nothing illegal.
    fn check_run(&self, restart: Option<Cause>, after: &Counters, findings: &mut Findings) {
        let mut report = self.board.report();
        let is_panic = restart == Some(Cause::Software);
        if is_panic {
            let panics = report.violations.extract_if(
                ..,
                |found| matches!(found, Violation::Crashed { crash, .. } if *crash == Crash::Panic),
            );
            findings.expect(panics.count() == 1, || "not one panic".to_owned());
        }
        if let Err(violations) = report.check() {
            findings.0.push(violations.to_string());
        }
        let causes: Vec<Cause> = report.restarts.iter().map(|restart| restart.cause).collect();
        let expected = Vec::from_iter(restart);
        findings.expect(causes == expected, || {
            format!("restarts {causes:?}, expected {expected:?}")
        });
        findings.equal("panics since power-on", after.panics, is_panic.into());
        let is_watchdog = restart == Some(Cause::Watchdog);
        findings.equal(
            "watchdog resets since power-on",
            after.watchdog_resets,
            is_watchdog.into(),
        );
    }

    /// Checks the arm's line: every byte and every error.
    fn check_line(&self, counted: &Counters, findings: &mut Findings) {
        let traffic = self.traffic;
        findings.equal("bytes that came while the receiver was off", 0, traffic.unreceived);
        findings.equal("overruns", counted.overrun_errors, traffic.overruns);
        // The STM32F405 clears an error by a read of the data register. A byte that ends at that instant leaves no
        // trace.
        findings.equal("bytes taken from the DMA", 0, traffic.taken);
        let received = traffic.bytes_from_arm - traffic.overruns;
        let bytes = counted.arm_to_host_bytes;
        if counted.ring_overruns == 0 {
            findings.equal("bytes from the arm", bytes, received);
        } else {
            findings.expect(bytes <= received, || {
                format!("{bytes} bytes from the arm of {received}")
            });
        }
        findings.equal("bytes to the arm", counted.host_to_arm_bytes, traffic.bytes_to_arm);

        let framing = traffic.framing_faults + traffic.breaks;
        findings.equal("framing errors", counted.framing_errors, framing);
        findings.equal("noise errors", counted.noise_errors, traffic.noise_faults);

        if self.account.missed_events {
            return;
        }
        let subscriber = &self.hosts.subscriber;
        let frames = subscriber.frames.len() as u32 + counted.dropped_events;
        let events = subscriber.events.len() as u32;
        findings.expect((frames..=frames + events).contains(&(counted.frames + events)), || {
            format!("{} frames counted, {frames} reported or dropped", counted.frames)
        });
        if counted.dropped_events == 0 {
            let noise = bytes - subscriber.frame_bytes();
            findings.equal("bytes in no frame", counted.noise_bytes, noise);
        }
        findings.equal("frames with a stamp before the last", 0, subscriber.disorder);
    }

    /// Checks the requests: each reached the arm and ended once.
    fn check_requests(&mut self, counted: &Counters, faults: &[Fault], findings: &mut Findings) {
        let (arm_counts, before) = (self.arm_counts(), self.account.arm_counts);
        let issued = [counted.requests_usb, counted.requests_can, counted.requests_poll];
        // A host on USB that pauses for more than 10 ms in the middle of a request loses the line.
        let is_cut = faults.contains(&Fault::FullPackets) && faults.contains(&Fault::NakStorm);
        // Zeros end an incomplete request before the request of another host, in several bursts.
        let bursts = LONGEST_VOID.div_ceil(MAX_FRAME) as u32;
        let zeros = counted.requests_adapter;
        let noise = arm_counts.noise_bytes - before.noise_bytes;
        findings.expect(
            zeros == 0 || is_cut && noise * bursts >= zeros * LONGEST_VOID as u32,
            || format!("{zeros} bursts of zeros from the adapter, {noise} bytes of noise at the arm"),
        );
        if !self.account.requests_damaged && !is_cut {
            let received = [
                arm_counts.tickets_usb - before.tickets_usb,
                arm_counts.tickets_can - before.tickets_can,
                arm_counts.polls - before.polls,
            ];
            for (nth, name) in ["USB", "CAN", "polls"].into_iter().enumerate() {
                findings.equal(&format!("requests of {name}"), issued[nth], received[nth]);
            }
            findings.equal("bytes of noise at the arm", 0, noise);
        }
        let answers = counted.frames - counted.unsolicited_frames - counted.late_answers;
        findings.equal(
            "requests, by answers and those missing",
            answers + counted.unanswered_requests,
            issued.iter().sum(),
        );
        // The arm moves only at a host's request, and there was none.
        let others = self.board.with_arm(|cable| cable.arm.take_others());
        findings.expect(others.is_empty(), || format!("the arm was commanded {others:02X?}"));
    }

    /// Checks the hosts: each request ended once, no answer was forged, and each missing answer was counted.
    fn check_hosts(&self, counted: &Counters, faults: &[Fault], findings: &mut Findings) {
        // A frame with a long pause is noise for the adapter, but may be a frame for a host.
        let in_noise = counted.noise_bytes / ANSWER_LEN;
        let unclaimed = counted.late_answers + counted.unsolicited_frames + in_noise;
        let issued_on_can = self.hosts.can.tracker.issued;
        // One in 256 bursts of noise has a valid checksum. It cannot be distinguished from an answer.
        let mut noise_like_answers = u32::from(faults.contains(&Fault::NoiseBurst));
        for (name, tracker) in ["USB", "CAN"].into_iter().zip(self.hosts.trackers()) {
            let RequestTracker {
                issued,
                answered,
                given_up,
                ..
            } = *tracker;
            findings.expect(answered + given_up == issued, || {
                format!("{name}: {issued} requested, {answered} answered, {given_up} given up")
            });
            // A stray frame is either an unsolicited frame of the arm, or the late answer to a request that was given
            // up, once each.
            let mut unsolicited = self.account.unsolicited.clone();
            let mut late = Vec::new();
            let mut of_others = 0;
            for stray in &tracker.strays {
                if let Some(nth) = unsolicited.iter().position(|frame| name == "USB" && frame == stray) {
                    unsolicited.remove(nth);
                    continue;
                }
                let ticket = Ticket::of_answer(stray).map(|(ticket, _)| ticket);
                let is_late = ticket.is_some_and(|ticket| {
                    ticket.initiator == tracker.initiator && ticket.number < issued && !late.contains(&ticket.number)
                });
                // Late answers to given-up requests of other hosts go to the serial port.
                let is_of_others = match ticket {
                    Some(ticket) => ticket.initiator != tracker.initiator && ticket.number < issued_on_can,
                    None => stray.starts_with(&JOINTS),
                };
                if name == "USB" && is_of_others {
                    of_others += 1;
                    continue;
                }
                if !is_late && noise_like_answers > 0 {
                    noise_like_answers -= 1;
                    continue;
                }
                findings.expect(is_late, || format!("{name} got {stray:02X?}, which answers nothing"));
                late.extend(ticket.map(|ticket| ticket.number));
            }
            findings.expect(of_others <= unclaimed, || {
                format!("{name} got {of_others} late answers of others, {unclaimed} counted")
            });
            findings.expect(late.len() as u32 <= given_up, || {
                format!("{name}: {} late answers, {given_up} given up", late.len())
            });
        }
    }

    /// Checks the bytes for the host on USB: each arrived or was counted as lost.
    fn check_usb_bytes(&mut self, counted: &Counters, findings: &mut Findings) {
        let (for_usb, unsure) = if self.account.missed_events || counted.dropped_events > 0 {
            // Without events, only the requests are known, provided the line had no fault.
            let requests = self.arm_counts().tickets_usb - self.account.arm_counts.tickets_usb;
            let lost = counted.unanswered_requests * ANSWER_LEN;
            (requests * ANSWER_LEN, lost + counted.noise_bytes)
        } else {
            let frames = self.hosts.subscriber.frames.iter();
            let for_others = frames.filter(|frame| matches!(frame.0, Some(Initiator::Can | Initiator::Poll)));
            let for_others: u32 = for_others.map(|frame| frame.1).sum();
            (counted.arm_to_host_bytes - for_others, 0)
        };
        let arrived = self.hosts.usb.bytes;
        let lost = counted.dropped_bytes + counted.undelivered_bytes;
        let possible = for_usb.saturating_sub(self.account.in_core + unsure)..=for_usb + unsure;
        findings.expect(possible.contains(&(arrived + lost)), || {
            format!("{arrived} bytes at the host and {lost} counted as lost of {for_usb} for it")
        });
    }

    /// Checks the CAN bus: every frame and every answer.
    fn check_can(&self, counted: &Counters, findings: &mut Findings) {
        let (traffic, can) = (self.traffic, &self.hosts.can);
        let received = counted.can_frames_received;
        if counted.can_receive_overruns == 0 && counted.can_bus_offs == 0 {
            findings.equal("CAN frames received", received, traffic.frames_of_nodes);
        } else {
            // A controller in bus-off receives nothing.
            findings.expect(received <= traffic.frames_of_nodes, || {
                format!("{received} CAN frames received of {}", traffic.frames_of_nodes)
            });
        }
        findings.equal("CAN frames sent", counted.can_frames_sent, traffic.frames_of_board);
        let (errors, broken) = (counted.can_bus_errors, traffic.broken_frames);
        findings.expect((errors > 0) == (broken > 0), || {
            format!("{errors} CAN errors counted, {broken} frames broken")
        });
        if !self.account.missed_events {
            let events = self.hosts.subscriber.events.iter();
            let offs = events
                .filter(|(_, event)| *event == Event::BusOff { off: true })
                .count();
            findings.equal("bus-offs", counted.can_bus_offs, offs as u32);
        }
        let excuses = counted.unanswered_requests
            + counted.isotp_failures
            + counted.dropped_can_answers
            + counted.refused_can_requests
            + counted.can_receive_overruns
            + counted.overrun_errors
            // A request during bus-off.
            + traffic.frames_of_nodes.saturating_sub(received)
            + can.failures.len() as u32;
        let given_up = can.tracker.given_up - self.account.given_up_on_can;
        findings.expect(given_up <= excuses, || {
            format!("{given_up} answers missing on CAN, {excuses} counted or reported")
        });
    }

    /// Runs the load until each host has the answer to a request made after `over`. Returns the time that took.
    ///
    /// # Errors
    ///
    /// If it takes longer than `limit`.
    pub(super) fn recover(&mut self, over: Nanos, limit: Nanos) -> Result<Nanos> {
        self.hosts.set_paused(false);
        let issued = self.hosts.trackers().map(|tracker| tracker.issued);
        let polls = self.arm_counts().polls;
        let frames = self.hosts.subscriber.frames.len();
        let state = |rig: &Self| {
            let [usb, can] = rig.hosts.trackers().map(|tracker| tracker.last_answered);
            [
                ("the host on USB", usb >= Some(issued[0])),
                ("the host on CAN", can >= Some(issued[1])),
                ("the poll", rig.hosts.can.telemetry.newest >= Some(polls)),
                ("the subscriber", rig.hosts.subscriber.frames.len() > frames),
            ]
        };
        let left = (over + limit).since(self.board.now());
        if self.work_until(left, |rig| state(rig).iter().all(|(_, works)| *works))? {
            return Ok(self.board.now().since(over));
        }
        let dead = state(self).into_iter().filter(|(_, works)| !works);
        let dead: Vec<&str> = dead.map(|(name, _)| name).collect();
        Err(format!("no traffic of {} within {limit}", dead.join(", ")).into())
    }
}
