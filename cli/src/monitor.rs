//! `armwire monitor`: an arm's joints, gripper and status as they change.

use std::io::{IsTerminal, Write, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

use armwire::Micros;
use armwire::ling::{JointState, Request, Response};
use clap::Args;

use crate::Port;
use crate::describe::{gripper, joint};
use crate::link::Link;
use crate::problem::Problem;

/// The arguments of `armwire monitor`.
#[derive(Args)]
pub(crate) struct Monitor {
    #[command(flatten)]
    port: Port,
    /// Readings per second.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: u32,
    /// Stop after so many readings.
    #[arg(long)]
    count: Option<u64>,
}

impl Monitor {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Problem> {
        let mut link = Link::open(&self.port)?;
        let mut out = stdout().lock();
        let terminal = out.is_terminal();
        let period = 1_000_000 / u64::from(self.rate);
        for reading in 0..self.count.unwrap_or(u64::MAX) {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let answer = match link.call(Request::ReadJoints) {
                // Who has asked us to end does not ask why there is no answer.
                Err(_) if stop.load(Ordering::Relaxed) => break,
                answer => answer?,
            };
            if let Some(Response::Joints(state)) = answer {
                let text = if terminal {
                    block(&state, reading > 0)
                } else {
                    line(link.now(), &state)
                };
                out.write_all(text.as_bytes())
                    .and_then(|()| out.flush())
                    .map_err(Problem::Output)?;
            }
            // After a pause in the line there is no catching up.
            let now = link.now();
            link.sleep_until(Micros((now.0 / period + 1) * period));
        }
        Ok(())
    }
}

/// One reading on several lines, in the place of the one before.
fn block(state: &JointState, again: bool) -> String {
    let mut text = String::new();
    if again {
        text += &format!("\x1b[{}A", state.joints.len() + 2);
    }
    for (i, ticks) in state.joints.into_iter().enumerate() {
        text += &format!("joint {}  {}\x1b[K\n", i + 1, joint(ticks));
    }
    text += &format!("gripper  {}\x1b[K\n", gripper(state.gripper));
    text += &format!("status   {}\x1b[K\n", state.status);
    text
}

/// One reading on one line.
fn line(now: Micros, state: &JointState) -> String {
    format!(
        "{:9.3} s  {}  gripper {}  {}\n",
        now.0 as f64 / 1e6,
        state.joints.map(joint).join("  "),
        gripper(state.gripper),
        state.status
    )
}
