//! A joint or the gripper: a trajectory, and the mechanics that follow it.

use armwire::time::Instant;

use super::mechanics::{Mechanics, STEP};
use super::plant::Plant;
use super::trajectory::Trajectory;

/// One axis of an arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    trajectory: Trajectory,
    /// `None`: the axis is exactly where its trajectory is.
    mechanics: Option<Mechanics>,
}

impl Axis {
    /// Creates an ideal axis at rest.
    pub(super) fn ideal(ticks: u16) -> Self {
        Self {
            trajectory: Trajectory::at(ticks),
            mechanics: None,
        }
    }

    /// Creates a joint, 0 to 5, at rest in the zero position.
    pub(super) fn joint(plant: &Plant, joint: usize) -> Self {
        Self {
            mechanics: Mechanics::new(plant, joint),
            ..Self::ideal(2048)
        }
    }

    /// Starts a motion, from the position or from the setpoint.
    pub(super) fn go(&mut self, ticks: u16, speed: u16) {
        if let Some(position) = self.mechanics.as_ref().and_then(Mechanics::restart) {
            self.trajectory = Trajectory::at_exactly(position);
        }
        self.trajectory.go(ticks, speed);
    }

    /// Ends a motion: the position becomes the goal.
    pub(super) fn stop(&mut self) {
        match &mut self.mechanics {
            None => self.trajectory.stop(),
            Some(mechanics) => {
                mechanics.halt();
                self.trajectory = Trajectory::at_exactly(mechanics.position());
            }
        }
    }

    /// Moves the axis by hand, as far as nothing is in the way.
    pub(super) fn push(&mut self, ticks: u16) {
        if let Some(mechanics) = &mut self.mechanics {
            mechanics.push(ticks.into());
        }
        self.trajectory = Trajectory::at(ticks);
    }

    /// Makes the position the zero position, at rest.
    pub(super) fn set_zero(&mut self) {
        if let Some(mechanics) = &mut self.mechanics {
            mechanics.renumber(2048.0);
        }
        self.trajectory = Trajectory::at(2048);
    }

    pub(super) fn remove_obstacle(&mut self) {
        if let Some(mechanics) = &mut self.mechanics {
            mechanics.remove_obstacle();
        }
    }

    /// Advances time and returns the distance travelled, in millionths of a tick.
    ///
    /// The mechanics advance at whole milliseconds, so the result does not depend on the number of calls.
    pub(super) fn advance(&mut self, from: Instant, to: Instant, torque: bool) -> u64 {
        let Some(mechanics) = &mut self.mechanics else {
            return self.trajectory.advance(to.since(from));
        };
        let (mut now, mut travelled) = (from, 0);
        loop {
            let next = Instant::from_micros((now.as_micros() / STEP.as_micros() + 1).saturating_mul(STEP.as_micros()));
            if next > to {
                break;
            }
            self.trajectory.advance(next.since(now));
            now = next;
            let before = *mechanics;
            travelled += if torque {
                mechanics.follow(self.trajectory.exact_ticks())
            } else {
                mechanics.fall()
            };
            if *mechanics == before && self.trajectory.velocity() == 0 {
                // The state is final.
                break;
            }
        }
        self.trajectory.advance(to.since(now));
        travelled
    }

    /// Returns the position, rounded to the nearest tick.
    pub(super) fn ticks(&self) -> u16 {
        match &self.mechanics {
            None => self.trajectory.ticks(),
            Some(mechanics) => mechanics.position().round() as u16,
        }
    }

    /// Returns the speed in ticks per second, without direction.
    pub(super) fn velocity(&self) -> u16 {
        match &self.mechanics {
            None => self.trajectory.velocity(),
            Some(mechanics) => mechanics.speed().round() as u16,
        }
    }

    /// Returns true if the axis or its setpoint moves.
    pub(super) fn is_moving(&self) -> bool {
        self.trajectory.velocity() > 0 || self.mechanics.as_ref().is_some_and(Mechanics::is_moving)
    }
}
