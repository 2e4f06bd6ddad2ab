//! `armwire sim ling`: a virtual Ling arm on a pseudo-terminal.

use std::sync::atomic::AtomicBool;

use armwire::ling::{Kind, SerialNumber, Stroke};
use armwire_bridge::Duration;
use armwire_sim::ling::legacy::{self, LegacyArm};
use armwire_sim::ling::{Config, Leader, LingArm, Plant};
use clap::Args;

use super::line::{LineArgs, print_counts};
use crate::call::ling::STROKES;
use crate::call::values::{one_of, whole};
use crate::error::Error;
use crate::output::print_line;

/// The arguments of `armwire sim ling`.
#[derive(Args)]
pub(crate) struct LingSim {
    #[command(flatten)]
    line: LineArgs,
    /// A leader arm: six servos, moved by hand. Without it a follower: ten servos.
    #[arg(long)]
    leader: bool,
    /// Serial number, 16 characters.
    #[arg(long, value_parser = parse_serial)]
    serial: Option<SerialNumber>,
    /// Gripper stroke in millimetres.
    #[arg(long, default_value = "50", value_parser = one_of(STROKES))]
    stroke: Stroke,
    /// Time from the end of a request to the start of its answer, in microseconds.
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = whole::<u64>(0..=u64::MAX))]
    turnaround_us: u64,
    /// Echo every received byte immediately, as a half-duplex adapter does.
    #[arg(long)]
    echo: bool,
    /// Joints that follow their commands as an arm with weight does: 'typical' (a guess), 'ideal', or a list.
    ///
    /// A list refines a preset, for example 'typical,sag=26', or the ideal arm. Its words are sag=TICKS (a loaded joint
    /// rests that far below its goal, and sinks without torque), lag=TIMEms, overshoot=PERCENT%, friction=TICKS,
    /// backlash=TICKS, noise=TICKS (of a reading), seed=N (of the noise), restart (a new goal's trajectory begins at the
    /// position), obstacle=JOINT:ANGLEdeg and other=JOINT:ANGLEdeg@TIMEms (a move of another program, once). A leader has
    /// the noise only.
    #[arg(long, default_value_t)]
    plant: Plant,
    /// A leader with force feedback: it answers requests for its control mode, and moves under power. WORDS change it.
    ///
    /// They are separated by commas: apply=TIMEms (a mode is applied so long after it was accepted, 100ms otherwise),
    /// never (it is never applied), refuse (no mode is accepted), teleoperation (force feedback becomes effective), stale,
    /// fault and unsupported (reasons why it does not), and blocked=2, blocked=3 or blocked=2+3 (blocked joints).
    #[arg(long, value_name = "WORDS", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    force_feedback: Option<Leader>,
    /// An arm of the older generation instead: it sends forty times per second, and accepts no requests.
    #[arg(long, conflicts_with_all = ["leader", "serial", "stroke", "turnaround_us", "echo", "plant", "force_feedback"])]
    legacy: bool,
}

fn parse_serial(text: &str) -> Result<SerialNumber, String> {
    let bytes = text.as_bytes().try_into();
    bytes
        .map(SerialNumber)
        .map_err(|_| format!("it has {} bytes, not 16", text.len()))
}

impl LingSim {
    pub(super) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        if self.legacy {
            return self.run_legacy(stop);
        }
        let base = if self.leader || self.force_feedback.is_some() {
            Config::leader()
        } else {
            Config::follower()
        };
        let config = Config {
            serial: self.serial.unwrap_or(base.serial),
            stroke: self.stroke,
            turnaround: Duration::from_micros(self.turnaround_us),
            echo: self.echo,
            plant: self.plant,
            force_feedback: self.force_feedback,
            ..base
        };
        let kind = match config.kind {
            Kind::Leader => "leader",
            Kind::Follower => "follower",
        };
        let feedback = if self.force_feedback.is_some() {
            " with force feedback"
        } else {
            ""
        };
        let name = format!("Ling {kind}{feedback} {}, plant {},", config.serial, config.plant);
        let (line, served) = self.line.serve(name, LingArm::new(config), stop)?;
        print_counts(served, line.device().counters())
    }

    fn run_legacy(&self, stop: &AtomicBool) -> Result<(), Error> {
        let arm = LegacyArm::new(legacy::Config::default());
        let (line, served) = self.line.serve("Ling arm of the older generation", arm, stop)?;
        print_line(format_args!(
            "{} bytes in, {} out, {} not read; {} joint frames, {} frames ignored.",
            served.received,
            served.sent,
            served.lost,
            line.device().counters().sent,
            line.device().counters().frames
        ))
    }
}
