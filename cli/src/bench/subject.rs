//! The arms that are measured.

use std::time::Duration;

use armwire::ling::{GripperSpeed, JointState, Move, Opening, Speed};
use armwire::xarm::{Raw, Request};
use armwire_host::describe::xarm::POSITIONS;
use armwire_host::{Connection, Error as Host, Ling, Rate, Readable, Reader, Shared, XArm, adapter};

use super::measure::{Call, Run, measure};
use crate::args::Place;
use crate::error::Error;
use crate::signals;

/// Maximum wait for the first pose of a reader.
const FIRST: Duration = Duration::from_secs(2);

/// An arm whose pose is read.
pub(super) trait Subject {
    /// The adapter there, in words.
    fn adapter(&self) -> Option<String>;

    /// Makes calls at this rate, for this time.
    fn measure(&mut self, call: Call, rate: Rate, time: Duration) -> Result<Run, Error>;

    /// Ends the measurements.
    fn end(&mut self) -> Result<(), Error> {
        Ok(())
    }
}

/// A Ling arm, on a port that may have an adapter.
pub(super) struct LingArm<'a> {
    place: &'a Place,
    connection: Connection,
    arm: Shared<Ling>,
    /// The goal throughout, of an arm that holds its pose.
    goal: Option<Move>,
}

impl<'a> LingArm<'a> {
    pub(super) fn open(place: &'a Place) -> Result<Self, Error> {
        let connection = place.connect()?;
        if place.control.is_some() {
            // The readings would be by requests without it.
            connection.adapter()?;
        }
        let mut arm = connection.ling()?;
        arm.set_interrupt(signals::check);
        Ok(Self {
            place,
            arm: Shared::new(&place.port, arm),
            connection,
            goal: None,
        })
    }

    /// Makes the present pose the goal. It is refused without torque.
    pub(super) fn hold(&mut self) -> Result<(), Error> {
        let state = self.arm.call(Ling::require_torque)?;
        self.goal = Some(goal(&state).map_err(|error| Error::at(&self.place.port, error))?);
        Ok(())
    }
}

/// A move to this pose. It changes nothing: the slowest speed suffices.
fn goal(state: &JointState) -> Result<Move, armwire::OutOfRange> {
    Ok(Move {
        joints: state.positions()?.map(|position| (position, Speed::SLOWEST)),
        gripper: (state.opening().unwrap_or(Opening::OPEN), GripperSpeed(1_000)),
    })
}

impl Subject for LingArm<'_> {
    fn adapter(&self) -> Option<String> {
        let mut control = self.connection.adapter().ok()?;
        let identity = control.identify().ok()?;
        Some(adapter::describe(&identity).to_string())
    }

    fn measure(&mut self, call: Call, rate: Rate, time: Duration) -> Result<Run, Error> {
        let goal = self.goal;
        let hold = |arm: &mut Ling| goal.map_or(Ok(()), |goal| arm.move_to(&goal));
        match call {
            Call::Read => measure(call, rate, time, || {
                self.arm.call(|arm| {
                    hold(arm)?;
                    arm.read_joints().map(|_| None)
                })
            }),
            Call::Latest => {
                let reader = Reader::start(&self.arm, rate)?;
                measure_reader(&reader, rate, time, || match goal {
                    Some(_) => self.arm.call(hold),
                    None => Ok(()),
                })
            }
        }
    }

    /// Stops an arm that holds its pose: an adapter ends the stream of this host then.
    fn end(&mut self) -> Result<(), Error> {
        match self.goal {
            Some(goal) => {
                let (gripper, _speed) = goal.gripper;
                self.arm.call(|arm| arm.stop(Some(gripper)))?;
                Ok(())
            }
            None => Ok(()),
        }
    }
}

/// An xArm.
pub(super) struct XArmArm(Shared<XArm>);

impl XArmArm {
    pub(super) fn open(place: &Place) -> Result<Self, Error> {
        let mut arm = XArm::connect(&place.host()?)?;
        arm.set_interrupt(signals::check);
        Ok(Self(Shared::new(&place.port, arm)))
    }
}

impl Subject for XArmArm {
    fn adapter(&self) -> Option<String> {
        None
    }

    fn measure(&mut self, call: Call, rate: Rate, time: Duration) -> Result<Run, Error> {
        match call {
            Call::Read => measure(call, rate, time, || {
                let request = Raw::new(POSITIONS, &[]).expect("the document does not have this register");
                self.0
                    .call(|arm| arm.link().call(&Request::Raw(request), |_| ()))
                    .map(|_| None)
            }),
            Call::Latest => measure_reader(&Reader::start(&self.0, rate)?, rate, time, || Ok(())),
        }
    }
}

/// Calls for the newest pose of a reader, after `before` each time.
fn measure_reader<A: Readable>(
    reader: &Reader<A>,
    rate: Rate,
    time: Duration,
    mut before: impl FnMut() -> Result<(), Host>,
) -> Result<Run, Error> {
    reader.next_after(0, FIRST)?;
    let run = measure(Call::Latest, rate, time, || {
        before()?;
        reader.latest().map(|reading| Some(reading.age))
    })?;
    Ok(Run {
        reader: Some(reader.counts()),
        ..run
    })
}
