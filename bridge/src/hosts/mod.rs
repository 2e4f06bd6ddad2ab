//! The hosts' side of the adapter: the CAN bus, the control port, the configuration and the events for subscribers.
//!
//! It owns no part of the line to the arm: it submits requests to [`Line`] and takes its deliveries.

mod can_port;
mod control_server;
mod cyclic;
mod event_frames;
mod flash;
mod grid;

use crate::action::{Action, Erase};
use crate::can::Frame;
use crate::config::{Can, Config, ConfigError, Saved};
use crate::control::{
    Event, Failure, FrameBytes, FromHost, Identity, Initiator, Malformed, Refusal, Reply, Request, VERSION,
};
use crate::counters::{CanErrors, Counters, count};
use crate::events::Queued;
use crate::line::{ControlPort, EndedStream, EndedStreams, Line, NotTaken, PACKET};
use crate::start::Recovery;
use armwire::time::Instant;

use can_port::{CanPort, Received};
use control_server::{ControlServer, Pending};
use flash::Outcome;

/// Hosts on CAN and on the control port.
pub(crate) struct Hosts {
    identity: Identity,
    config: Config,
    /// `Some` in recovery.
    recovery: Option<Recovery>,
    /// A host has subscribed to events and does not know of the recovery yet.
    announces_recovery: bool,
    can: CanPort,
    /// The port whose host changed the configuration of the bus, until the controller is reinitialised.
    can_change: Option<ControlPort>,
    /// The port that has requested the factory defaults, until these are in flash.
    reset: Option<ControlPort>,
    control: ControlServer,
    /// A restart that firmware has not taken yet.
    restart: Option<Action>,
    counters: Counters,
}

impl Hosts {
    /// An invalid `saved` configuration is replaced by the factory defaults, and counted as lost.
    pub(crate) fn new(identity: Identity, saved: Config, recovery: Option<Recovery>) -> Self {
        let config = of_board(&identity, saved);
        let is_valid = check(&identity, &config).is_ok();
        let config = if is_valid { config } else { Config::default() };
        let mut counters = Counters::default();
        count(&mut counters.config_failures, usize::from(!is_valid));
        Self {
            identity,
            config,
            recovery,
            announces_recovery: false,
            can: CanPort::new(config.can),
            can_change: None,
            reset: None,
            control: ControlServer::new(),
            restart: None,
            counters,
        }
    }

    pub(crate) const fn config(&self) -> &Config {
        &self.config
    }

    pub(crate) const fn recovery(&self) -> Option<Recovery> {
        self.recovery
    }

    /// Returns true if the CAN controller runs: the board has one, and the adapter is not in recovery.
    pub(crate) const fn is_can_on(&self) -> bool {
        !self.identity.no_can && self.recovery.is_none()
    }

    pub(crate) const fn counters_mut(&mut self) -> &mut Counters {
        &mut self.counters
    }

    /// All counters of the adapter.
    pub(crate) fn all_counters(&self, line: &Line) -> Counters {
        line.counters().plus(&self.counters)
    }

    // ---- The line ----

    /// Takes the line's deliveries, and submits as many requests of CAN as the line has room for.
    pub(crate) fn update(&mut self, line: &mut Line, now: Instant) {
        self.take_deliveries(line);
        if self.take_results(line) {
            self.serve(line, now);
        }
        self.submit(line, now);
    }

    /// Takes the results of requests to the line. Returns true if there was one.
    fn take_results(&mut self, line: &mut Line) -> bool {
        let (identified, stopped) = (line.identified(), line.stopped());
        let any = identified.is_some() || stopped.is_some();
        if let Some(answer) = identified {
            self.control.arm_identified(answer);
        }
        if let Some(result) = stopped {
            self.control.stopped(result);
        }
        any
    }

    /// Takes the line's deliveries.
    fn take_deliveries(&mut self, line: &mut Line) {
        // Usually there is none.
        if line.has_delivery() {
            let mut bytes = FrameBytes::new();
            while let Some((at, queued)) = line.delivery(&mut bytes) {
                match queued {
                    Queued::Frame(initiator) => self.deliver_frame(&bytes, initiator, at),
                    Queued::Event(event) => self.publish_event(&event, at),
                }
            }
        }
    }

    /// Handles a frame of the arm.
    fn deliver_frame(&mut self, bytes: &[u8], initiator: Option<Initiator>, at: Instant) {
        let on_can = match initiator {
            Some(initiator) => initiator == Initiator::Can,
            None => self.config.can.unsolicited && self.is_can_on(),
        };
        if on_can && !self.can.answer(bytes) {
            count(&mut self.counters.dropped_can_answers, 1);
        }
        self.can.frame(self.config.arm, bytes, at);
        self.control
            .queue_frame(at, initiator, bytes, &mut self.can, &mut self.counters);
    }

    /// Publishes an event: as a CAN frame, and to subscribers.
    fn publish_event(&mut self, event: &Event, at: Instant) {
        #[cfg(feature = "defmt")]
        crate::log::event(event);
        if self.is_can_on() && !self.can.event_frame(event, at) {
            count(&mut self.counters.dropped_events, 1);
        }
        self.control.publish_event(at, event, &mut self.can, &mut self.counters);
    }

    /// Refuses a request from the bus.
    fn refuse(&mut self, initiator: Initiator, reason: Refusal, line: &mut Line, now: Instant) {
        line.count_refusal(reason);
        // Earlier frames and events are published first.
        self.take_deliveries(line);
        self.publish_event(&Event::Refused { initiator, reason }, now);
    }

    /// Submits requests from the bus, as many as the line has room for.
    fn submit(&mut self, line: &mut Line, now: Instant) {
        while self.can_change.is_none()
            && let Some(pdu) = self.can.arm.received()
        {
            let taken = line.request(pdu, self.can.arm_arrived);
            if let Err(NotTaken::Full) = taken {
                return;
            }
            self.can.arm.release();
            if let Err(NotTaken::Refused(reason)) = taken {
                self.refuse(Initiator::Can, reason, line, now);
            }
        }
    }

    /// Updates the line's flag for receivers other than the host on USB.
    pub(crate) fn watch(&self, line: &mut Line) {
        let can = self.can.config();
        line.watch(self.control.wants_frames() || can.telemetry_hz > 0 || self.config.can.unsolicited);
    }

    // ---- The control interface on USB ----

    pub(crate) const fn has_packet_room(&self) -> bool {
        self.control.has_packet_room()
    }

    /// Handles a packet of the host. Returns true if the next one fits.
    pub(crate) fn packet_received(&mut self, packet: &[u8], line: &mut Line, now: Instant) -> bool {
        self.control.packet_received(packet);
        self.serve(line, now);
        self.control.has_packet_room()
    }

    pub(crate) fn is_packet_due(&self) -> bool {
        self.control.is_packet_due()
    }

    pub(crate) fn packet(&mut self, packet: &mut [u8; PACKET], line: &mut Line, now: Instant) -> Option<usize> {
        self.take_deliveries(line);
        let len = self.control.packet(packet, &mut self.can, &mut self.counters)?;
        self.serve(line, now);
        Some(len)
    }

    /// The host on USB has disconnected.
    pub(crate) fn usb_gone(&mut self, line: &mut Line) {
        self.publish_deliveries(line);
        self.control.forget(ControlPort::Usb);
        self.watch(line);
    }

    // ---- The CAN bus ----

    /// Handles a frame from the bus.
    pub(crate) fn can_received(&mut self, frame: &Frame, line: &mut Line, now: Instant) {
        let was_replying = self.can.control.is_sending();
        let kind = self.config.arm;
        match self.can.received(frame, kind, now, &mut self.counters) {
            Some(Received::Arm) => {
                self.submit(line, now);
                if self.can.is_motion_waiting(kind) {
                    line.motion_waits(now);
                }
            }
            Some(Received::Control) => self.serve(line, now),
            // The frame may precede a change of the configuration.
            Some(Received::Command(request)) if self.config.can.commands => line.command(&request, now),
            Some(Received::Refused(initiator, refused)) => {
                if refused.keeps_stream {
                    line.keep_alive(initiator, now);
                }
                self.refuse(initiator, refused.reason, line, now);
            }
            Some(Received::Command(_)) | None => {}
        }
        self.serve_behind_reply(was_replying, line, now);
    }

    pub(crate) fn is_can_due(&self, now: Instant) -> bool {
        self.is_can_on() && (self.can.is_due(now) || self.control.is_can_due())
    }

    /// The next frame for the bus, the most urgent first.
    pub(crate) fn can_transmit(&mut self, line: &mut Line, now: Instant) -> Option<Frame> {
        if !self.is_can_on() {
            return None;
        }
        self.take_deliveries(line);
        if self.control.is_can_due() {
            self.control.publish_all(&mut self.can, &mut self.counters);
        }
        let was_replying = self.can.control.is_sending();
        let frame = self.can.transmit(now, &mut self.counters, line.counters());
        self.serve_behind_reply(was_replying, line, now);
        frame
    }

    /// The controller still holds `waiting` frames. Returns true if a connection may have more.
    pub(crate) fn can_sent(&mut self, waiting: u8, now: Instant) -> bool {
        self.can.sent(waiting, now)
    }

    pub(crate) const fn can_errors(&mut self, errors: CanErrors) {
        let c = &mut self.counters;
        c.can_bus_errors = c.can_bus_errors.wrapping_add(errors.bus);
        c.can_receive_overruns = c.can_receive_overruns.wrapping_add(errors.overruns);
        c.dropped_can_frames = c.dropped_can_frames.wrapping_add(errors.unsent);
    }

    /// The controller went bus-off (`off`) or recovered. ISO-TP transfers in progress are aborted.
    pub(crate) fn can_bus_off(&mut self, off: bool, line: &mut Line, now: Instant) {
        self.take_deliveries(line);
        if off {
            count(&mut self.counters.can_bus_offs, 1);
            self.can.on_bus_off(&mut self.counters);
            self.serve(line, now);
        }
        self.publish_event(&Event::BusOff { off }, now);
    }

    // ---- Time, and actions of firmware ----

    pub(crate) fn timeout(&self) -> Option<Instant> {
        self.can.timeout()
    }

    pub(crate) fn tick(&mut self, line: &mut Line, now: Instant) {
        self.take_deliveries(line);
        let silenced = line.tick(now);
        self.silence(silenced, line, now);
        let was_replying = self.can.control.is_sending();
        if let Some(refusal) = self.can.tick(now, &mut self.counters) {
            self.refuse(Initiator::Command, refusal, line, now);
        }
        self.serve_behind_reply(was_replying, line, now);
    }

    /// Drops what waits on the bus from the hosts that have gone silent, and reports them.
    fn silence(&mut self, silenced: EndedStreams, line: &mut Line, now: Instant) {
        for mut stream in silenced.into_iter().flatten() {
            match stream.initiator {
                Initiator::Can => {
                    // The line has had no room for this request.
                    let request = self.can.arm.received().map_or(0, <[u8]>::len);
                    stream.dropped = stream.dropped.saturating_add(request);
                    self.can.arm.release();
                }
                Initiator::Command => self.can.stop_commands(),
                Initiator::Usb | Initiator::Poll | Initiator::Adapter => {}
            }
            self.stream_ended(stream, line, now);
        }
    }

    /// Reports a stream that has ended without its host.
    #[cold]
    fn stream_ended(&mut self, stream: EndedStream, line: &mut Line, now: Instant) {
        count(&mut self.counters.host_silences, 1);
        count(&mut self.counters.silenced_bytes, stream.dropped);
        // Earlier frames and events are published first.
        self.take_deliveries(line);
        let event = Event::HostSilent {
            initiator: stream.initiator,
            dropped: stream.dropped as u16,
            torque_off: stream.torque_off,
        };
        self.publish_event(&event, now);
    }

    /// The next action for firmware, once.
    pub(crate) fn action(&mut self, line: &mut Line, now: Instant) -> Option<Action> {
        // The reply goes out on the old bus configuration, and no host on CAN waits for an answer of the arm.
        let is_replied = |port: &mut ControlPort| {
            *port == ControlPort::Usb || !self.can.control.is_sending() && !self.control.is_can_reply_pending()
        };
        let may_change = self.is_can_on() && line.open_initiator() != Some(Initiator::Can);
        if may_change && self.can_change.take_if(is_replied).is_some() {
            self.publish_deliveries(line);
            self.can.close(&mut self.counters);
            self.can = CanPort::new(self.config.can);
            line.release_line(ControlPort::Can, now);
            self.control.forget(ControlPort::Can);
            self.watch(line);
            return Some(Action::RestartCan(self.config.can));
        }
        // Torque-off and the hold of a stop go out before a restart, and before the core stalls.
        let is_free = !line.is_torque_off_due() && !line.is_stopping();
        if !is_free {
            return None;
        }
        self.control.flash.take_action().or_else(|| self.restart.take())
    }

    /// Handles the result of a write or an erase of the configuration in flash.
    pub(crate) fn saved(&mut self, result: Result<(), Failure>, line: &mut Line, now: Instant) {
        let counter = match result {
            Ok(()) => &mut self.counters.config_saves,
            Err(_) => &mut self.counters.config_failures,
        };
        count(counter, 1);
        if let Some(by) = self.reset.take().filter(|_| result.is_ok()) {
            self.configure(Config::default(), by, line, now);
        }
        if result.is_ok() && self.recovery.take().is_some() {
            // The controller starts, if there is one.
            self.can_change = self.is_can_on().then_some(ControlPort::Usb);
            self.take_deliveries(line);
            self.publish_event(&Event::Recovery { active: false }, now);
        }
        self.flash_done(result.map(|()| None), line, now);
    }

    /// Handles the configuration in flash.
    pub(crate) fn loaded(&mut self, result: Result<Saved, Failure>, line: &mut Line, now: Instant) {
        let saved = result.map(|saved| match saved {
            Saved::Config(config) => Saved::Config(of_board(&self.identity, config)),
            Saved::Nothing | Saved::Unreadable => saved,
        });
        self.flash_done(saved.map(Some), line, now);
    }

    fn flash_done(&mut self, outcome: Outcome, line: &mut Line, now: Instant) {
        // No host could be received meanwhile.
        line.keep_hosts_alive(now);
        self.control.flash.done(outcome);
        self.serve(line, now);
    }

    // ---- Requests on the control port ----

    /// Executes the requests on the control port, as long as their replies fit.
    fn serve(&mut self, line: &mut Line, now: Instant) {
        loop {
            // A failed identification is complete at once.
            self.take_results(line);
            // The request of one host may complete another's.
            if !(self.serve_port(ControlPort::Usb, line, now) | self.serve_port(ControlPort::Can, line, now)) {
                return;
            }
        }
    }

    /// Serves the ports if a reply on CAN in transfer was sent or aborted: the next one may fit.
    fn serve_behind_reply(&mut self, was_replying: bool, line: &mut Line, now: Instant) {
        if was_replying && !self.can.control.is_sending() {
            self.serve(line, now);
        }
    }

    /// Serves one port. Returns true if a request was executed.
    fn serve_port(&mut self, port: ControlPort, line: &mut Line, now: Instant) -> bool {
        let mut any = false;
        while self.control.has_reply_room(port, &self.can) {
            let reply = match self.control.finished(port, &self.config) {
                Some(reply) => Some(reply),
                None => match self.control.next_request(port, &mut self.can) {
                    Some(request) => {
                        // Earlier frames and events belong to the earlier subscription.
                        self.publish_deliveries(line);
                        let reply = self.handle_request(port, request, line, now);
                        // The request's own events go before the reply.
                        self.publish_deliveries(line);
                        reply
                    }
                    None => break,
                },
            };
            any = true;
            if let Some((sequence, reply)) = reply {
                self.control.reply(port, sequence, reply, &mut self.can);
            }
            // A host skips the events before the reply to its subscription.
            if core::mem::take(&mut self.announces_recovery) {
                self.publish_event(&Event::Recovery { active: true }, now);
            }
        }
        any
    }

    fn publish_deliveries(&mut self, line: &mut Line) {
        self.take_deliveries(line);
        self.control.publish_all(&mut self.can, &mut self.counters);
    }

    /// Executes a host's request. `None` if the reply is delayed.
    fn handle_request(
        &mut self,
        port: ControlPort,
        request: Result<FromHost, Malformed>,
        line: &mut Line,
        now: Instant,
    ) -> Option<(u8, Reply)> {
        count(&mut self.counters.control_requests, 1);
        let FromHost { sequence, request } = match request {
            Ok(request) => request,
            Err(malformed) => {
                count(&mut self.counters.control_unsupported, 1);
                let reply = Reply::Unsupported { version: VERSION };
                return Some((malformed.sequence.unwrap_or(0), reply));
            }
        };
        let reply = match request {
            Request::Identify => Reply::Identity(self.identity.clone()),
            Request::IdentifyArm if self.control.arm.is_some() => Reply::Failed(Failure::Busy),
            Request::IdentifyArm => {
                self.control.arm = Pending::new(port, sequence);
                line.identify(now);
                return None;
            }
            Request::GetConfig => Reply::Config(self.config),
            Request::SetConfig(config) => match check(&self.identity, &config) {
                Ok(()) if config.arm != self.config.arm && line.is_armed() => Reply::Failed(Failure::StreamArmed),
                Ok(()) => {
                    self.configure(config, port, line, now);
                    Reply::Done
                }
                Err(error) => Reply::BadConfig(error),
            },
            Request::GetSaved if self.has_crashed_in_load() => Reply::Saved(Saved::Unreadable),
            // The core stalls meanwhile.
            Request::SaveConfig | Request::ResetConfig | Request::GetSaved
                if self.control.flash.is_busy() || line.is_stopping() =>
            {
                Reply::Failed(Failure::Busy)
            }
            Request::SaveConfig | Request::ResetConfig | Request::GetSaved if line.is_armed() => {
                Reply::Failed(Failure::StreamArmed)
            }
            Request::SaveConfig | Request::ResetConfig | Request::GetSaved => {
                // A program on the port would get no answer meanwhile.
                let erase = match line.is_port_open() {
                    true => Erase::Refused,
                    false => Erase::Allowed,
                };
                let action = match (request, self.has_crashed_in_load()) {
                    (Request::GetSaved, _) => Action::Load,
                    (Request::SaveConfig, false) => Action::Save(self.config, erase),
                    (Request::SaveConfig, true) => Action::Replace(self.config),
                    (_, false) => Action::Reset(erase),
                    (_, true) => Action::Erase,
                };
                self.control.flash.request(action, port, sequence);
                self.reset = (request == Request::ResetConfig).then_some(port);
                return None;
            }
            Request::GetCounters => Reply::Counters(self.all_counters(line)),
            Request::GetLatencies => Reply::Latencies(*line.latencies()),
            Request::Subscribe(subscription) => {
                self.control.subscribe(port, subscription);
                self.announces_recovery = self.recovery.is_some() && subscription.events;
                self.watch(line);
                Reply::Done
            }
            Request::Restart => self.restart(Action::Restart, line, now),
            Request::RestartIntoBootLoader => self.restart(Action::RestartIntoBootLoader, line, now),
            Request::EndStream => {
                match port {
                    ControlPort::Usb => line.release_stream(Initiator::Usb),
                    ControlPort::Can => {
                        line.release_stream(Initiator::Can);
                        line.release_stream(Initiator::Command);
                    }
                }
                Reply::Done
            }
            Request::GetLine => Reply::Line(line.state()),
            Request::GetRecovery => Reply::Recovery {
                active: self.recovery.is_some(),
            },
            Request::ReserveLine => match line.reserve_line(port, now) {
                Ok(()) => Reply::Done,
                Err(failure) => Reply::Failed(failure),
            },
            Request::ReleaseLine => {
                line.release_line(port, now);
                Reply::Done
            }
            Request::GetStop => Reply::Stop(line.stop_in_force(now)),
            Request::Stop => match line.stop(port.initiator(), now) {
                Ok(()) => {
                    self.can.stop_commands();
                    if self.control.add_stop(port, sequence) {
                        return None;
                    }
                    Reply::Failed(Failure::Busy)
                }
                Err(failure) => Reply::Failed(failure),
            },
        };
        Some((sequence, reply))
    }

    /// Returns true if the configuration in flash must not be read.
    fn has_crashed_in_load(&self) -> bool {
        self.recovery.is_some_and(|recovery| recovery.crashed_in_load)
    }

    /// Restarts the adapter. If a stream is armed, torque-off goes out first.
    #[cold]
    fn restart(&mut self, action: Action, line: &mut Line, now: Instant) -> Reply {
        let silenced = line.disarm(now);
        self.silence(silenced, line, now);
        self.restart = Some(action);
        Reply::Done
    }

    /// Applies `config` by request of a host on a port.
    fn configure(&mut self, config: Config, by: ControlPort, line: &mut Line, now: Instant) {
        let was = core::mem::replace(&mut self.config, config);
        if config.can.bus() != was.can.bus() {
            self.can_change = Some(by);
            line.drop_can_requests();
        } else if config.can != was.can && self.can_change.is_none() {
            self.can.adopt(config.can, &mut self.counters);
        }
        if config.arm != was.arm {
            self.can.stop_commands();
        }
        for stream in line.configure(&was, &config, now).into_iter().flatten() {
            self.stream_ended(stream, line, now);
        }
        self.watch(line);
    }
}

/// A configuration from flash, as it is on this board. Without CAN it has the factory defaults of the bus: firmware
/// before version 6 saved other settings, which had no effect.
fn of_board(identity: &Identity, mut saved: Config) -> Config {
    if identity.no_can {
        saved.can = Can::default();
    }
    saved
}

/// Checks the configuration against the limits and the board.
fn check(identity: &Identity, config: &Config) -> Result<(), ConfigError> {
    if identity.no_can && config.can != Can::default() {
        return Err(ConfigError::NoCan);
    }
    config.check()?;
    match config.can.data_bit_rate {
        Some(_) if !identity.can_fd => Err(ConfigError::NoCanFd),
        _ => Ok(()),
    }
}
