//! `armwire monitor`: an arm's joints, gripper and status as they change.

use std::io::{IsTerminal, Write, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

use armwire::Micros;
use armwire::ling::{JointState, Request, Response};
use clap::Args;

use crate::Port;
use crate::describe::angle;
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
            if let Some(Response::Joints(state)) = link.call(Request::ReadJoints)? {
                let text = if terminal {
                    block(&state, reading > 0)
                } else {
                    line(link.now(), &state)
                };
                let text = text.map_err(|error| Problem::Value {
                    port: self.port.port.clone(),
                    error,
                })?;
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
fn block(state: &JointState, again: bool) -> Result<String, armwire::OutOfRange> {
    let mut text = String::new();
    if again {
        text += &format!("\x1b[{}A", state.joints.len() + 2);
    }
    for (i, position) in state.positions()?.into_iter().enumerate() {
        text += &format!("joint {}  {}\x1b[K\n", i + 1, angle(position));
    }
    text += &format!(
        "gripper  {:.1} % open\x1b[K\n",
        100.0 * f32::from(state.gripper) / 1000.0
    );
    text += &format!("status   {}\x1b[K\n", state.status);
    Ok(text)
}

/// One reading on one line.
fn line(now: Micros, state: &JointState) -> Result<String, armwire::OutOfRange> {
    let joints = state.positions()?.map(angle);
    Ok(format!(
        "{:9.3} s  {}  gripper {:.1} %  {}\n",
        now.0 as f64 / 1e6,
        joints.join("  "),
        100.0 * f32::from(state.gripper) / 1000.0,
        state.status
    ))
}
