//! The xArm: joint positions and state.
//!
//! Joint positions are in register 42, which the document does not have. It is read as the vendor's package does: seven
//! little-endian floating-point numbers in radians, of which an arm with fewer axes uses the first. What an arm answers
//! otherwise is shown as it is.

use armwire::xarm::{Command, Raw, Reply, State, Transactions, XArm};

use super::Reading;
use crate::call::ask;
use crate::describe::angle;
use crate::hex;
use crate::link::{Line, Link};
use crate::problem::Problem;

/// The register of joint positions.
const POSITIONS: u8 = 42;
/// How many positions there are, whatever the arm.
const JOINTS: usize = 7;

/// What is known of the arm between readings.
#[derive(Default)]
pub(super) struct Watch {
    transactions: Transactions,
    /// How many joints the arm has, once it was asked.
    axes: Option<usize>,
}

impl Watch {
    pub(super) fn read(&mut self, link: &mut Link<XArm, impl Line>) -> Result<Option<Reading>, Problem> {
        let axes = match self.axes {
            Some(axes) => axes,
            None => {
                let axes = self.read_axes(link)?;
                *self.axes.insert(axes)
            }
        };
        let positions = Raw::new(POSITIONS, &[]).expect("the document does not have this register");
        Ok(match ask(link, &mut self.transactions, Command::Raw(positions))? {
            Some((state, Reply::Raw(raw))) => Some(reading(state, raw.params(), axes)),
            _ => None,
        })
    }

    /// How many joints the arm has; as many as any if it does not tell.
    fn read_axes(&mut self, link: &mut Link<XArm, impl Line>) -> Result<usize, Problem> {
        Ok(match ask(link, &mut self.transactions, Command::ReadVersion)? {
            Some((_, Reply::Version(text))) => text.version().map_or(JOINTS, |version| version.axes.into()),
            _ => JOINTS,
        })
    }
}

fn reading(state: State, params: &[u8], axes: usize) -> Reading {
    let joints: Vec<_> = match params.as_chunks() {
        (positions, []) if positions.len() == JOINTS => positions
            .iter()
            .take(axes)
            .map(|&bytes| angle(f32::from_le_bytes(bytes)))
            .collect(),
        _ => Vec::new(),
    };
    let mut rows: Vec<_> = (1..)
        .zip(&joints)
        .map(|(n, joint)| format!("joint {n}  {joint}"))
        .collect();
    let mut line = joints.join("  ");
    if joints.is_empty() {
        line = match params {
            [] => format!("register {POSITIONS} not told"),
            params => format!("register {POSITIONS} {}", hex::show(params)),
        };
        rows.push(line.clone());
    }
    rows.push(format!("state    {state}"));
    Reading {
        line: format!("{line}  {state}"),
        rows,
    }
}
