//! `armwire sim`: a virtual arm that any program can open.

mod alpha1;
mod line;
mod ling;
mod so101;
mod xarm;

use std::sync::atomic::AtomicBool;

use clap::Subcommand;

use crate::error::Error;

/// The kinds of virtual arms.
#[derive(Subcommand)]
pub(crate) enum Sim {
    /// A Ling (Alicia-D) arm.
    Ling(ling::LingSim),
    /// A UFACTORY xArm, on TCP ports.
    #[command(name = "xarm")]
    XArm(xarm::XArmSim),
    /// A UBTECH Alpha1 robot.
    Alpha1(alpha1::Alpha1Sim),
    /// Servos of an Alpha1 on a bus of their own.
    Alpha1Servo(alpha1::Alpha1ServoSim),
    /// An SO-101: six Feetech servos on one wire, which fail on order.
    So101(so101::So101Sim),
}

impl Sim {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        match self {
            Self::Ling(sim) => sim.run(stop),
            Self::XArm(sim) => sim.run(stop),
            Self::Alpha1(sim) => sim.run(stop),
            Self::Alpha1Servo(sim) => sim.run(stop),
            Self::So101(sim) => sim.run(stop),
        }
    }
}
