//! Invariants of every run, independent of the fault.

use armwire_bridge::Counters;
use armwire_bridge::control::{Event, Initiator, MAX_FRAME};
use armwire_virtual_board::Nanos;
use armwire_virtual_board::report::{Cause, Crash, Violation};

use super::super::{RequestTracker, Ticket, counters};
use super::Result;
use super::matrix::{Fault, Restart};
use super::rig::Rig;

/// Length in bytes of the answer to a host's request.
const ANSWER: u32 = 15;

/// Start of the answer to a poll.
const JOINTS: [u8; 4] = [0xAA, 0x06, 0x00, 0x0F];

/// Counted losses, by name.
pub type Losses = Vec<(&'static str, u32)>;

/// A counter and its name.
type Named = (&'static str, fn(&Counters) -> u32);

/// Counters of losses, errors and refusals.
pub(super) const LOSSES: [Named; 19] = [
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
        let before = self.before;
        let counted = |get: fn(&Counters) -> u32| get(&after).wrapping_sub(get(&before));
        let restart = faults.iter().find_map(|fault| fault.restart());

        self.check_run(restart, &after, &mut findings)?;
        self.check_line(&counted, &mut findings);
        self.check_requests(&counted, faults, &mut findings);
        self.check_hosts(&counted, faults, &mut findings);
        self.check_can(&counted, &mut findings);
        for (name, get) in NEVER {
            findings.equal(name, counted(get), 0);
        }
        let losses: Losses = LOSSES.iter().map(|&(name, get)| (name, counted(get))).collect();
        // A storm of NAKs in the middle of a request may cut it. Nothing is lost only if each request fits in a packet.
        if let [fault] = faults
            && fault.is_lossless()
        {
            let excused = ["missed polls", "noise errors"];
            for (name, count) in losses.iter().filter(|(name, _)| !excused.contains(name)) {
                findings.equal(name, *count, 0);
            }
            for tracker in self.trackers() {
                let given_up = tracker.given_up;
                findings.equal("requests given up by a host", given_up, 0);
            }
        }
        if findings.0.is_empty() {
            Ok(losses)
        } else {
            Err(findings.0.join("; ").into())
        }
    }

    /// Checks the restarts, and that the firmware did nothing illegal.
    fn check_run(&mut self, restart: Option<Restart>, after: &Counters, findings: &mut Findings) -> Result {
        let mut report = self.board.report();
        let crashes = report.violations.len();
        if restart == Some(Restart::Panic) {
            let panicked = |found: &Violation| {
                matches!(
                    found,
                    Violation::Crashed {
                        crash: Crash::Panic,
                        ..
                    }
                )
            };
            report.violations.retain(|found| !panicked(found));
            findings.expect(crashes - report.violations.len() == 1, || "not one panic".to_owned());
        }
        if let Err(violations) = report.check() {
            findings.0.push(violations.to_string());
        }
        let causes: Vec<Cause> = report.restarts.iter().map(|restart| restart.cause).collect();
        let expected: Vec<Cause> = restart
            .map(|restart| match restart {
                Restart::Power => Cause::Power,
                Restart::Panic => Cause::Software,
                Restart::Watchdog => Cause::Watchdog,
            })
            .into_iter()
            .collect();
        findings.expect(causes == expected, || {
            format!("restarts {causes:?}, expected {expected:?}")
        });
        findings.equal(
            "panics since power-on",
            after.panics,
            (restart == Some(Restart::Panic)).into(),
        );
        let bitten = restart == Some(Restart::Watchdog);
        findings.equal("watchdog resets since power-on", after.watchdog_resets, bitten.into());
        Ok(())
    }

    /// Checks the arm's line: every byte and every error.
    fn check_line(&mut self, counted: &dyn Fn(fn(&Counters) -> u32) -> u32, findings: &mut Findings) {
        let traffic = self.traffic;
        findings.equal("bytes that came while the receiver was off", 0, traffic.unreceived);
        findings.equal("overruns", counted(|c| c.overrun_errors), traffic.overruns);
        // The STM32F405 clears an error by a read of the data register. A byte that ends at that instant leaves no
        // trace.
        findings.equal("bytes taken from the DMA", 0, traffic.taken);
        let received = traffic.bytes_from_arm - traffic.overruns;
        let bytes = counted(|c| c.arm_to_host_bytes);
        if counted(|c| c.ring_overruns) == 0 {
            findings.equal("bytes from the arm", bytes, received);
        } else {
            findings.expect(bytes <= received, || {
                format!("{bytes} bytes from the arm of {received}")
            });
        }
        findings.equal(
            "bytes to the arm",
            counted(|c| c.host_to_arm_bytes),
            traffic.bytes_to_arm,
        );

        let framing = traffic.framing_faults + traffic.breaks;
        findings.equal("framing errors", counted(|c| c.framing_errors), framing);
        findings.equal("noise errors", counted(|c| c.noise_errors), traffic.noise_faults);

        let Some(subscriber) = self.hosts.subscriber.as_ref().filter(|_| !self.missed_events) else {
            return;
        };
        let frames = subscriber.all_frames() + counted(|c| c.dropped_events);
        let events = subscriber.events.len() as u32;
        findings.expect(
            (frames..=frames + events).contains(&(counted(|c| c.frames) + events)),
            || format!("{} frames counted, {frames} reported or dropped", counted(|c| c.frames)),
        );
        if counted(|c| c.dropped_events) == 0 {
            findings.equal(
                "bytes in no frame",
                counted(|c| c.noise_bytes),
                bytes - subscriber.frame_bytes,
            );
        }
        findings.equal("frames with a stamp before the last", 0, subscriber.disorder);
    }

    /// Checks the requests: each reached the arm and ended once.
    fn check_requests(
        &mut self,
        counted: &dyn Fn(fn(&Counters) -> u32) -> u32,
        faults: &[Fault],
        findings: &mut Findings,
    ) {
        let (arm_counts, before) = (self.arm_counts(), self.arm_counts_before);
        let issued = [
            counted(|c| c.requests_usb),
            counted(|c| c.requests_can),
            counted(|c| c.requests_poll),
        ];
        // A host on USB that pauses for more than 10 ms in the middle of a request loses the line.
        let is_cut = [Fault::FullPackets, Fault::NakStorm]
            .iter()
            .all(|fault| faults.contains(fault));
        // Zeros end an incomplete request before the request of another host.
        let (zeros, noise) = (
            counted(|c| c.requests_adapter),
            arm_counts.noise_bytes - before.noise_bytes,
        );
        findings.expect(zeros == 0 || is_cut && noise >= zeros * MAX_FRAME as u32, || {
            format!("{zeros} times zeros from the adapter, {noise} bytes of noise at the arm")
        });
        if !self.requests_damaged && !is_cut {
            let received = [
                arm_counts.tickets_of_usb() - before.tickets_of_usb(),
                arm_counts.tickets_of_can() - before.tickets_of_can(),
                arm_counts.polls - before.polls,
            ];
            for (name, (issued, received)) in ["USB", "CAN", "polls"]
                .into_iter()
                .zip(issued.into_iter().zip(received))
            {
                findings.equal(&format!("requests of {name}"), issued, received);
            }
            findings.equal("bytes of noise at the arm", 0, noise);
        }
        let answers = counted(|c| c.frames) - counted(|c| c.unsolicited_frames) - counted(|c| c.late_answers);
        findings.equal(
            "requests, by answers and those missing",
            answers + counted(|c| c.unanswered_requests),
            issued.iter().sum(),
        );
        // The arm moves only at a host's request, and there was none.
        let others = self.board.with_arm(|cable| cable.arm().take_others());
        findings.expect(others.is_empty(), || format!("the arm was commanded {others:02X?}"));
    }

    fn trackers(&self) -> Vec<&RequestTracker> {
        let usb = self.hosts.usb.as_ref().map(|usb| &usb.tracker);
        let can = self.hosts.can.as_ref().map(|can| &can.tracker);
        usb.into_iter().chain(can).collect()
    }

    /// Checks the hosts: each request ended once, no answer was forged, and each missing answer was counted.
    fn check_hosts(
        &mut self,
        counted: &dyn Fn(fn(&Counters) -> u32) -> u32,
        faults: &[Fault],
        findings: &mut Findings,
    ) {
        // A frame with a long pause is noise for the adapter, but may be a frame for a host.
        let in_noise = counted(|c| c.noise_bytes) / ANSWER;
        let nobodys = counted(|c| c.late_answers) + counted(|c| c.unsolicited_frames) + in_noise;
        let other_asked = self.hosts.can.as_ref().map_or(0, |can| can.tracker.issued());
        // One in 256 bursts of noise has a valid checksum. It cannot be told from an answer.
        let mut noise_like_answers = u32::from(faults.contains(&Fault::NoiseBurst));
        for (name, tracker) in ["USB", "CAN"].into_iter().zip(self.trackers()) {
            findings.expect(tracker.answered + tracker.given_up == tracker.issued(), || {
                format!(
                    "{name}: {} asked, {} answered, {} given up",
                    tracker.issued(),
                    tracker.answered,
                    tracker.given_up
                )
            });
            // A stray frame is either an unasked frame of the arm, or the late answer to a request that was given up,
            // once each.
            let mut unasked = self.unasked.clone();
            let mut late = Vec::new();
            let mut of_others = 0;
            for stray in &tracker.strays {
                if let Some(nth) = unasked.iter().position(|frame| name == "USB" && frame == stray) {
                    unasked.remove(nth);
                    continue;
                }
                let ticket = Ticket::of_answer(stray).map(|(ticket, _)| ticket);
                let is_late = ticket.is_some_and(|ticket| {
                    ticket.initiator == tracker.initiator()
                        && ticket.number < tracker.issued()
                        && !late.contains(&ticket.number)
                });
                // Late answers to given-up requests of other hosts go to the serial port.
                let is_of_others = match ticket {
                    Some(ticket) => ticket.initiator != tracker.initiator() && ticket.number < other_asked,
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
            findings.expect(of_others <= nobodys, || {
                format!("{name} got {of_others} late answers of others, {nobodys} counted")
            });
            findings.expect(late.len() as u32 <= tracker.given_up, || {
                format!("{name}: {} late answers, {} given up", late.len(), tracker.given_up)
            });
        }

        let (arm_counts, before) = (self.arm_counts(), self.arm_counts_before);
        let Some(usb) = &self.hosts.usb else { return };
        let missing_counted = counted(|c| c.dropped_bytes) + counted(|c| c.undelivered_bytes);
        let for_others = |subscriber: &super::super::Subscriber| {
            [Initiator::Can, Initiator::Poll]
                .map(|initiator| subscriber.bytes(Some(initiator)))
                .iter()
                .sum::<u32>()
        };
        let subscriber = self
            .hosts
            .subscriber
            .as_ref()
            .filter(|_| !self.missed_events && counted(|c| c.dropped_events) == 0);
        let (for_usb, unsure) = match subscriber {
            Some(subscriber) => (counted(|c| c.arm_to_host_bytes) - for_others(subscriber), 0),
            // Without events, only the requests are known, provided the line had no fault.
            None => {
                let requests = arm_counts.tickets_of_usb() - before.tickets_of_usb();
                let lost = counted(|c| c.unanswered_requests) * ANSWER;
                (requests * ANSWER, lost + counted(|c| c.noise_bytes))
            }
        };
        let seen = usb.bytes + missing_counted;
        let possible = for_usb.saturating_sub(self.in_core + unsure)..=for_usb + unsure;
        findings.expect(possible.contains(&seen), || {
            format!(
                "{} bytes at the host and {missing_counted} counted as lost of {for_usb} for it",
                usb.bytes
            )
        });
    }

    /// Checks the CAN bus: every frame and every answer.
    fn check_can(&mut self, counted: &dyn Fn(fn(&Counters) -> u32) -> u32, findings: &mut Findings) {
        let traffic = self.traffic;
        let received = counted(|c| c.can_frames_received);
        if counted(|c| c.can_receive_overruns) == 0 && counted(|c| c.can_bus_offs) == 0 {
            findings.equal("CAN frames received", received, traffic.frames_of_nodes);
        } else {
            // A controller in bus-off receives nothing.
            findings.expect(received <= traffic.frames_of_nodes, || {
                format!("{received} CAN frames received of {}", traffic.frames_of_nodes)
            });
        }
        let sent = counted(|c| c.can_frames_sent);
        findings.equal("CAN frames sent", sent, traffic.frames_of_board);
        findings.expect(
            (counted(|c| c.can_bus_errors) > 0) == (traffic.broken_frames > 0),
            || {
                format!(
                    "{} CAN errors counted, {} frames broken",
                    counted(|c| c.can_bus_errors),
                    traffic.broken_frames
                )
            },
        );
        if let Some(subscriber) = self.hosts.subscriber.as_ref().filter(|_| !self.missed_events) {
            let offs = subscriber
                .events
                .iter()
                .filter(|(_, event)| *event == Event::BusOff { off: true });
            findings.equal("bus-offs", counted(|c| c.can_bus_offs), offs.count() as u32);
        }
        let Some(can) = &self.hosts.can else { return };
        let excuses = counted(|c| c.unanswered_requests)
            + counted(|c| c.isotp_failures)
            + counted(|c| c.dropped_can_answers)
            + counted(|c| c.refused_can_requests)
            + counted(|c| c.can_receive_overruns)
            + counted(|c| c.overrun_errors)
            // A request during bus-off.
            + traffic.frames_of_nodes.saturating_sub(received)
            + can.failures.len() as u32;
        let given_up = can.tracker.given_up - self.given_up_before;
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
        self.hosts.set_requesting(true);
        let issued: Vec<u32> = self.trackers().iter().map(|tracker| tracker.issued()).collect();
        let polls = self.arm_counts().polls;
        let frames_before = self
            .hosts
            .subscriber
            .as_ref()
            .map_or(0, |subscriber| subscriber.all_frames());
        let state = |rig: &Self| {
            let answered = |(tracker, issued): (&RequestTracker, &u32)| {
                tracker.last_answered().is_some_and(|last| last >= *issued)
            };
            let mut answered = rig.trackers().into_iter().zip(&issued).map(answered);
            let newest = rig.hosts.can.as_ref().and_then(|can| can.telemetry.newest());
            let frames_now = rig
                .hosts
                .subscriber
                .as_ref()
                .map_or(0, |subscriber| subscriber.all_frames());
            [
                ("the host on USB", answered.next() == Some(true)),
                ("the host on CAN", answered.next() == Some(true)),
                ("the poll", newest.is_some_and(|newest| newest >= polls)),
                ("the subscriber", frames_now > frames_before),
            ]
        };
        let left = (over + limit).since(self.board.now());
        if self.work_until(left, &mut |rig| state(rig).iter().all(|(_, works)| *works))? {
            return Ok(self.board.now().since(over));
        }
        let dead: Vec<_> = state(self)
            .iter()
            .filter(|(_, works)| !works)
            .map(|(who, _)| *who)
            .collect();
        Err(format!("no traffic of {} within {limit}", dead.join(", ")).into())
    }
}
