//! `armwire teleop`: a leader moves a follower.

mod arm;
mod leader;
mod sums;

use std::io::{IsTerminal, stdin};
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use armwire::ling::{JOINTS, JointState, Kind, Speed, TICKS_PER_TURN};
use armwire::time;
use armwire_host::follow::{End, Follow, Output, Pause, Progress, Start};
use armwire_host::stopwatch::Stopwatch;
use armwire_host::{Error as Host, Limits, Ling, Port, Rate, Stream};
use clap::Args;

use crate::args::Baud;
use crate::call::values::{joint_speed, parse, rate};
use crate::confirm;
use crate::error::Error;
use crate::monitor::{RETRY_PERIOD, Recorder};
use crate::output::{print_error, print_line};
use crate::recording::Role;
use crate::signals;
use crate::status::{Status, StatusArg};
use crate::stop;
use arm::{open, prepare};
use leader::Leader;
use sums::Sums;

/// The word that confirms that a follower follows again. It is no answer to another question, which may wait in the
/// terminal.
const GO_ON: &str = "follow";
/// The longest wait for readings of one arm, before those of the other.
const SLICE: Duration = Duration::from_millis(2);

/// The arguments of `armwire teleop`.
#[derive(Args)]
pub(crate) struct Teleop {
    /// Port of the leader: a serial port (/dev/ttyACM0, COM3, usb:SERIAL), tcp:HOST:PORT, can:IFACE/NODE, or
    /// slcan:PORT@BITRATE/NODE.
    leader: Port,
    /// Port of the follower.
    follower: Port,
    #[command(flatten)]
    baud: Baud,
    /// Maximum speed of a joint of the follower, in degrees per second.
    #[arg(long, value_name = "DEGREES/S", default_value = "90", value_parser = joint_speed)]
    max_speed: Speed,
    /// Maximum distance between two goals of a joint, in degrees.
    #[arg(long, value_name = "DEGREES", default_value = "5", value_parser = step)]
    max_step: u16,
    /// Refuse to start when a joint of the follower is more than 5° from the leader. Without it the follower approaches
    /// the leader, at 20°/s.
    #[arg(long)]
    no_approach: bool,
    /// Moves per second.
    #[arg(long, value_name = "HERTZ", default_value = "100", value_parser = rate)]
    rate: Rate,
    /// End with an error when the port of an arm is lost. Without it a leader is waited for, and on a terminal a follower,
    /// too: it follows again when you confirm it.
    #[arg(long)]
    exit_on_loss: bool,
    /// Record both arms to this MCAP file. An existing file is not replaced.
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
    #[command(flatten)]
    status: StatusArg,
}

/// A distance in degrees, as ticks.
fn step(text: &str) -> Result<u16, String> {
    match parse::<f32>(text, "a number")? {
        degrees if (0.1..=45.0).contains(&degrees) => Ok((degrees / 360.0 * f32::from(TICKS_PER_TURN)) as u16),
        degrees => Err(format!("the distance is {degrees} degrees, must be 0.1..=45")),
    }
}

impl Teleop {
    pub(crate) fn run(&self) -> Result<(), Error> {
        // Limits that do not go together are refused before an arm is asked for anything.
        let follow = self.decisions()?;
        signals::catch_first()?;
        let mut recorder = Recorder::of_pair(self.mcap.as_deref());
        let leader = Leader::open(&self.leader, self.baud.baud, self.exit_on_loss, &recorder)?;
        let (follower, state) = self.follower(&recorder)?;
        recorder.create()?;
        print_line(format_args!("{} leads {}; Ctrl-C ends it", self.leader, self.follower))?;

        let mut session = Session {
            leader,
            recorder: &mut recorder,
            start: follow.clone(),
            follow,
            waits_for_follower: !self.exit_on_loss && stdin().is_terminal(),
            clock: Stopwatch::start(),
            sums: Sums::default(),
            status: self.status.line(),
            shown: None,
        };
        session.follow.on_follower(session.clock.now(), &state);
        let (mut follower, end) = session.run(follower);
        let ended = match stop::after(&mut follower, end) {
            Error::Host(Host::Interrupted(_)) => Ok(()),
            Error::Host(Host::Stopped { stopped, .. }) => print_line(stop::show(&stopped)),
            error => Err(error.explained(|error| follower.explain(error))),
        };
        let Session {
            sums, clock, status, ..
        } = session;
        drop(status);
        let summed = print_line(sums.text(clock.now()));
        // The stop is recorded, too.
        ended.and(summed).and(recorder.finish())
    }

    /// The decisions of teleoperation within these limits.
    fn decisions(&self) -> Result<Follow, Error> {
        let limits = Limits {
            speeds: [self.max_speed; JOINTS],
            step: self.max_step,
        };
        let start = match self.no_approach {
            true => Start::Refuse,
            false => Start::Approach,
        };
        let refused = |refusal| Error::Usage(format!("{refusal} (--rate, --max-step, --max-speed)"));
        Follow::new(limits, start, self.rate).map_err(refused)
    }

    /// Opens the follower and reads it, which must have torque.
    fn follower(&self, recorder: &Recorder) -> Result<(Ling, JointState), Error> {
        let mut arm = open(&self.follower, self.baud.baud, Kind::Follower)?;
        arm.set_interrupt(signals::check);
        recorder.tap(Role::Follower, arm.link());
        let state = prepare(&mut arm, recorder).and_then(|()| {
            let state = arm.require_torque()?;
            arm.check_refusal()?;
            Ok(state)
        });
        match state {
            Ok(state) => Ok((arm, state)),
            Err(error) => Err(error.explained(|error| arm.explain(error))),
        }
    }
}

/// Teleoperation until its end.
struct Session<'a> {
    leader: Leader,
    recorder: &'a mut Recorder,
    follow: Follow,
    /// The decisions of a start.
    start: Follow,
    /// True if somebody can confirm that a follower whose port was lost follows again.
    waits_for_follower: bool,
    clock: Stopwatch,
    sums: Sums,
    status: Status,
    /// The state that was printed last.
    shown: Option<&'static str>,
}

impl Session<'_> {
    /// Runs until an error, which may be an interrupt. Returns the follower, too, to be stopped.
    fn run(&mut self, follower: Ling) -> (Ling, Error) {
        let mut follower = follower;
        loop {
            let mut stream = follower.into_stream();
            let pause = self.follow(&mut stream);
            follower = stream.into_arm();
            let mut ended = pause.and_then(|pause| self.stop(&mut follower, &pause));
            while self.waits_for_follower
                && let Err(Error::Host(lost @ Host::Lost { .. })) = &ended
            {
                ended = self.start_again(&mut follower, lost.to_string());
            }
            if let Err(error) = ended {
                return (follower, error);
            }
        }
    }

    /// Waits until the port of a follower that was lost for this reason is back, and until the user confirms that it
    /// follows again.
    fn start_again(&mut self, follower: &mut Ling, reason: String) -> Result<(), Error> {
        let tell = |reason: &str| print_error(&format_args!("waiting for the port: {reason}"));
        self.status.beside(|| tell(&reason));
        let mut told = reason;
        while let Err(error) = follower.reopen() {
            match error {
                Host::Interrupted(_) => return Err(error.into()),
                // Another arm is on the port, or another program has it.
                Host::Lost { .. } | Host::InUse { .. } if told != error.to_string() => {
                    told = error.to_string();
                    self.status.beside(|| tell(&told));
                }
                _ => {}
            }
            self.wait(RETRY_PERIOD)?;
        }
        let question = format!("{} is back. To let it follow again, type {GO_ON}", follower.name());
        self.status.beside(|| print_line(question))?;
        let answer = confirm::wait_for(GO_ON);
        while !answer.is_finished() {
            self.wait(SLICE)?;
        }
        if !matches!(answer.join(), Ok(true)) {
            return Err(Error::Declined);
        }
        let state = follower.require_torque()?;
        follower.check_refusal()?;
        self.follow = self.start.clone();
        self.follow.on_follower(self.clock.now(), &state);
        Ok(())
    }

    /// Waits, unless the program is interrupted.
    fn wait(&mut self, time: Duration) -> Result<(), Error> {
        signals::check().map_err(Host::Interrupted)?;
        self.recorder.write()?;
        thread::sleep(time);
        Ok(())
    }

    /// Stops the follower. One that is silent, or still moves, is asked until it stops.
    fn stop(&mut self, follower: &mut Ling, pause: &Pause) -> Result<(), Error> {
        let mut pause = Some(pause);
        loop {
            self.recorder.write()?;
            match follower.stop_interruptibly(None) {
                Ok(stopped) => {
                    let stopped = stop::show(&stopped);
                    return self.status.beside(|| match pause {
                        Some(pause) => print_line(format_args!("{pause}; {stopped}")),
                        None => print_line(stopped),
                    });
                }
                Err(error @ Host::NotStopped { .. }) => {
                    let Some(pause) = pause.take() else { continue };
                    let error = Error::from(error);
                    self.status
                        .beside(|| print_line(format_args!("{pause}; {error}; it is asked again until it stops")))?;
                }
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Moves the follower until it is to be stopped.
    fn follow(&mut self, follower: &mut Stream) -> Result<Pause, Error> {
        loop {
            signals::check().map_err(Host::Interrupted)?;
            self.recorder.write()?;
            match self.follow.poll(self.clock.now()) {
                Ok(Output::Move(target)) => {
                    follower.move_to(&target)?;
                    self.sums.moved();
                }
                Ok(Output::Stop(pause)) => {
                    // An adapter that refuses motion is the reason.
                    if let Err(refused) = follower.check_refusal() {
                        self.status.beside(|| print_error(&refused));
                    }
                    return Ok(pause);
                }
                Ok(Output::Wait(until)) => {
                    self.show()?;
                    self.read(follower, until)?;
                }
                Err(end @ End::Immovable(_)) => return Err(Error::at(follower.name(), end)),
                Err(end) => return Err(Error::at(self.leader.name(), end)),
            }
        }
    }

    /// Reads both arms once, until this time.
    fn read(&mut self, follower: &mut Stream, until: time::Instant) -> Result<(), Error> {
        self.leader.request(&self.follow)?;
        follower.request_joints()?;
        let (mut of_leader, mut of_follower) = (0, 0);
        loop {
            // An arm that has answered is not waited for.
            if of_leader == 0 {
                for reading in self.leader.receive(self.clock.until(until).min(SLICE))? {
                    self.follow.on_leader(self.clock.at(reading.time), &reading.state);
                    of_leader += 1;
                }
            }
            if of_follower == 0 {
                for reading in follower.receive(self.clock.until(until).min(SLICE))? {
                    self.follow.on_follower(self.clock.at(reading.time), &reading.state);
                    self.sums.lag(self.follow.lag());
                    of_follower += 1;
                }
            }
            let left = self.clock.until(until);
            if of_leader > 0 && of_follower > 0 {
                thread::sleep(left);
            } else if !left.is_zero() {
                continue;
            }
            self.sums.read(of_leader, of_follower);
            return Ok(());
        }
    }

    /// Prints a change of what the follower does, and shows the rest on a terminal.
    fn show(&mut self) -> Result<(), Error> {
        if let Some(loss) = self.leader.take_loss() {
            self.status.beside(|| print_error(&loss));
        }
        let progress = self.follow.progress();
        let (name, text) = match progress {
            Progress::Starting => ("starting", None),
            Progress::Approaching(degrees) => (
                "approaching",
                Some(format!("approaching the leader, which is {degrees:.1}° away")),
            ),
            Progress::Following => ("following", Some("following".to_owned())),
            Progress::Waiting(_, degrees) => (
                "waiting",
                Some(format!(
                    "waiting until both arms are within 5° of each other, now {degrees:.1}°"
                )),
            ),
        };
        if self.shown.replace(name) != Some(name)
            && let Some(text) = &text
        {
            self.status.beside(|| print_line(text))?;
        }
        let sums = &mut self.sums;
        let (now, lag) = (self.clock.now(), self.follow.lag());
        self.status
            .show(|| format!("{}  {}", text.unwrap_or_default(), sums.line(now, lag)));
        Ok(())
    }
}
