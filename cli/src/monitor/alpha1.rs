//! The Alpha1: which servos run.
//!
//! Not where they are: the protocol has that only from a single servo, which releases what it holds to answer.

use armwire::alpha1::{Alpha1, Request, Response};

use super::Reading;
use crate::describe::running;
use crate::link::{Line, Link};
use crate::problem::Problem;

pub(super) fn read(link: &mut Link<Alpha1, impl Line>) -> Result<Option<Reading>, Problem> {
    Ok(match link.call(Request::ReadServoStates)? {
        Some(Response::ServoStates(states)) => {
            let line = format!("servos that run: {}", running(states));
            Some(Reading {
                rows: vec![line.clone()],
                line,
            })
        }
        _ => None,
    })
}
