//! `armwire replay`: a recorded motion, made again.

mod file;

use std::path::PathBuf;
use std::time::Duration;

use armwire::ling::effect::Effect;
use armwire::ling::{JOINTS, JointState, Kind, Speed, Stroke, Torque};
use armwire::time;
use armwire_host::joints_file;
use armwire_host::replay::{self, Motion, Output, Progress, Range, Refusal, Tracking};
use armwire_host::stopwatch::Stopwatch;
use armwire_host::{Error as Host, Limits, Ling, Rate, Stream};
use clap::Args;

use crate::args::ArmPort;
use crate::call::values::{joint_speed, parse, rate, seconds};
use crate::error::Error;
use crate::output::{print_error, print_line};
use crate::signals;
use crate::status::{Status, StatusArg};
use crate::stop::{self, stoppable};
use file::{Recorded, Source, Wanted};

/// The longest wait for readings. Signals are checked between waits.
const MAX_WAIT: Duration = Duration::from_millis(20);

/// The arguments of `armwire replay`.
#[derive(Args)]
pub(crate) struct Replay {
    /// MCAP file: of 'armwire record', 'monitor --mcap' or 'teleop --mcap'; or of another program, with
    /// sensor_msgs/msg/JointState of joint1 to joint6 in rad, or of the joints in --joints.
    file: PathBuf,
    #[command(flatten)]
    arm: ArmPort,
    /// Factor of the speed, such as 0.5.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, allow_hyphen_values = true, value_parser = factor)]
    speed: f64,
    /// Begin again after the end, until Ctrl-C.
    #[arg(long = "loop")]
    is_endless: bool,
    /// Start of the part to replay, in seconds of the recording.
    #[arg(long, value_name = "SECONDS", default_value = "0", value_parser = seconds)]
    from: Duration,
    /// End of the part to replay, in seconds of the recording. Default: its end.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    to: Option<Duration>,
    /// Refuse a recording in which a joint is faster, in degrees per second.
    #[arg(long, value_name = "DEGREES/S", default_value = "180", value_parser = joint_speed)]
    max_speed: Speed,
    /// Replay readings, also where goals were recorded.
    #[arg(long)]
    readings: bool,
    /// Topic of the arm, if the file has several. Default: that of the follower.
    #[arg(long)]
    topic: Option<String>,
    /// File with the names, units and limits of the joints: docs/joints.md describes it.
    #[arg(long, value_name = "FILE")]
    joints: Option<PathBuf>,
    /// Arm in the file of joints, if it has several.
    #[arg(long, value_name = "NAME", requires = "joints")]
    joints_of: Option<String>,
    /// Moves per second.
    #[arg(long, value_name = "HERTZ", default_value = "100", value_parser = rate)]
    rate: Rate,
    #[command(flatten)]
    status: StatusArg,
}

fn factor(text: &str) -> Result<f64, String> {
    match parse(text, "a number")? {
        factor if factor > 0.0 && factor <= 10.0 => Ok(factor),
        factor => Err(format!("the factor is {factor}, must be over 0 and at most 10")),
    }
}

impl Replay {
    pub(crate) fn run(&self) -> Result<(), Error> {
        if self.to.is_some_and(|to| to <= self.from) {
            return Err(Error::Usage("--to must be after --from".to_owned()));
        }
        let joints = self.joints.as_deref();
        let joints = joints.map(|path| joints_file::read_arm(path, self.joints_of.as_deref()));
        let joints = joints.transpose()?;
        let wanted = Wanted {
            topic: self.topic.as_deref(),
            are_readings: self.readings,
            joints: joints.as_ref(),
        };
        let recorded = file::read(&self.file, &wanted)?;
        for warning in &recorded.warnings {
            print_error(&format_args!("{}: {warning}", self.file.display()));
        }
        // An unsuitable recording is refused before the arm is asked for anything.
        self.motion(&recorded, None)?;
        let mut arm = stoppable::open(&self.arm)?;
        let prepared = self.prepare(&mut arm, &recorded);
        let (motion, state) = prepared.map_err(|error| error.explained(|error| arm.explain(error)))?;
        print_line(what(&recorded, &motion))?;
        if let Some(lack) = lack(recorded.source, motion.has_gripper()) {
            print_error(&lack);
        }
        let length = motion.length();
        let mut replay = replay::Replay::new(motion, self.is_endless);
        let mut stream = arm.into_stream();
        let played = play(
            &mut stream,
            &mut replay,
            &state,
            length,
            self.status.bar(length.as_micros()),
        );
        let mut arm = stream.into_arm();
        // Torque-on ends an adapter's stream, and the torque stays on.
        let ended = match played {
            Ok(()) => arm.send(Effect::Torque(Torque::On)).map_err(Error::from),
            Err(error) => match stop::after(&mut arm, error) {
                // There is no other end.
                Error::Host(Host::Stopped { stopped, .. }) if self.is_endless => print_line(stop::show(&stopped)),
                error => Err(error),
            },
        };
        let reported = report(replay.tracking());
        ended.and(reported)
    }

    /// The motion, for a gripper of this stroke.
    fn motion(&self, recorded: &Recorded, stroke: Option<Stroke>) -> Result<Motion, Error> {
        let range = Range {
            from: micros(self.from),
            to: self.to.map(micros),
            speed: self.speed,
        };
        let limits = Limits {
            speeds: [self.max_speed; JOINTS],
            ..Limits::REPLAY
        };
        let name = self.file.display().to_string();
        let points = recorded.points(stroke).map_err(|reason| Error::at(&name, reason))?;
        Motion::new(&points, &range, limits, self.rate).map_err(|refusal| {
            let hint = match (&refusal, recorded.source) {
                (Refusal::Jump { .. } | Refusal::Gap { .. }, Source::Goals) => " (--readings replays the readings)",
                (Refusal::Jump { .. }, _) => " (--max-speed, --speed)",
                (Refusal::Rate { .. }, _) => " (--rate, --speed)",
                _ => "",
            };
            Error::at(&name, format_args!("{refusal}{hint}"))
        })
    }

    /// Reads what must be known of the arm.
    fn prepare(&self, arm: &mut Ling, recorded: &Recorded) -> Result<(Motion, JointState), Error> {
        if arm.read_info()?.serial.kind() == Some(Kind::Leader) {
            return Err(Error::refused(arm.name(), "this is a leader, which nothing moves"));
        }
        let stroke = match recorded.needs_stroke() {
            true => Some(arm.read_stroke()?),
            false => None,
        };
        let (motion, state) = (self.motion(recorded, stroke)?, arm.require_torque()?);
        arm.check_refusal()?;
        Ok((motion, state))
    }
}

/// Makes the moves of a replay, from an arm in this state.
fn play(
    stream: &mut Stream,
    replay: &mut replay::Replay,
    state: &JointState,
    length: time::Duration,
    mut status: Status,
) -> Result<(), Error> {
    let clock = Stopwatch::start();
    replay.on_reading(clock.now(), state);
    loop {
        signals::check().map_err(Host::Interrupted)?;
        let now = clock.now();
        let next = match replay.poll(now) {
            Ok(next) => next,
            Err(failure) => {
                // An adapter that refuses motion is the reason.
                stream.check_refusal()?;
                return Err(Error::at(stream.name(), failure));
            }
        };
        match next {
            Output::Move(target) => {
                stream.move_to(&target)?;
                stream.request_joints()?;
            }
            Output::Wait(until) => {
                for reading in stream.receive(clock.until(until).min(MAX_WAIT))? {
                    replay.on_reading(clock.at(reading.time), &reading.state);
                }
                let (at, text) = progress(replay.progress(now), length);
                status.show_at(at.as_micros(), || text);
            }
            Output::Done => return Ok(()),
        }
    }
}

/// A time of the command line. One that is too long for the clock is the longest.
fn micros(time: Duration) -> time::Duration {
    time.try_into().unwrap_or(time::Duration::from_micros(u64::MAX))
}

/// A summary of the motion and its source.
fn what(recorded: &Recorded, motion: &Motion) -> String {
    let (count, what) = (
        recorded.len(),
        match recorded.source {
            Source::Goals => "goals",
            Source::Readings => "readings",
            Source::JointStates => "joint states",
        },
    );
    let seconds = motion.length().as_micros() as f64 / 1e6;
    format!("{seconds:.1} s of {} ({count} {what})", recorded.topic)
}

/// A warning about data of the gripper that were not recorded.
fn lack(source: Source, has_gripper: bool) -> Option<&'static str> {
    match (source, has_gripper) {
        (_, false) => Some("the gripper was not recorded, and stays where it is"),
        (Source::Goals, true) => None,
        (Source::Readings, true) => {
            Some("the gripper's goals are its readings: they carry no grip force, and an object may slip")
        }
        (Source::JointStates, true) => {
            Some("the gripper's goals are its joint states: if they were readings, they carry no grip force")
        }
    }
}

/// The time in a motion of this length, and what the arm does.
fn progress(progress: Progress, length: time::Duration) -> (time::Duration, String) {
    let start = time::Duration::ZERO;
    match progress {
        Progress::Waiting => (start, "waiting for the arm".to_owned()),
        Progress::Approaching(degrees) => (start, format!("going to the first pose: {degrees:.1}° left")),
        Progress::Playing(at) => (at, format!("playing: {:.1} s", at.as_micros() as f64 / 1e6)),
        Progress::Arriving(degrees) => (length, format!("coming to rest at the last pose: {degrees:.1}° left")),
        Progress::Done => (start, "done".to_owned()),
    }
}

/// Prints the distances of the arm from the motion, if it began.
fn report(tracking: &Tracking) -> Result<(), Error> {
    if tracking.readings() == 0 {
        return Ok(());
    }
    let each = |degrees: [f64; JOINTS]| degrees.map(|degrees| format!("{degrees:.2}°")).join(" ");
    print_line(format_args!(
        "tracking error of joints 1 to {JOINTS}, in {} readings:",
        tracking.readings()
    ))?;
    print_line(format_args!("  maximum  {}", each(tracking.max_degrees())))?;
    print_line(format_args!("  RMS      {}", each(tracking.rms_degrees())))?;
    match tracking.end_degrees() {
        Some(end) => print_line(format_args!("  at rest  {}", each(end))),
        None => Ok(()),
    }
}
