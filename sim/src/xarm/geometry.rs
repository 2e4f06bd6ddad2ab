//! Forward kinematics.
//!
//! The modified Denavit-Hartenberg parameters, in millimetres, and the joint limits are the vendor's (xArm user manual,
//! appendix on kinematics; limits as in its Python SDK). There is no tool: the tool centre point is the flange.

use std::f32::consts;
use std::f64::consts::{PI, TAU};

/// Maximum number of joints of any model.
pub(super) const MAX_JOINTS: usize = 7;

type Vector = [f64; 3];
/// Three columns of a rotation matrix.
type Matrix = [Vector; 3];

/// Model of an xArm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// xArm 5: five joints.
    XArm5,
    /// xArm 6: six joints.
    XArm6,
    /// xArm 7: seven joints.
    XArm7,
}

impl Model {
    /// Returns the number of joints, which is also the device type.
    pub const fn joints(self) -> usize {
        match self {
            Self::XArm5 => 5,
            Self::XArm6 => 6,
            Self::XArm7 => 7,
        }
    }

    /// Returns the minimum and maximum angle of each joint, in radians.
    pub const fn limits(self) -> &'static [(f32, f32)] {
        const TURN: (f32, f32) = (-consts::TAU, consts::TAU);
        const SHOULDER: (f32, f32) = (-2.059_488, 2.094_395);
        const ELBOW: (f32, f32) = (-3.926_99, 0.191_986);
        const WRIST: (f32, f32) = (-1.692_969, consts::PI);
        match self {
            Self::XArm5 => &[TURN, SHOULDER, ELBOW, WRIST, TURN],
            Self::XArm6 => &[TURN, SHOULDER, ELBOW, TURN, WRIST, TURN],
            Self::XArm7 => &[TURN, SHOULDER, TURN, (-ELBOW.1, -ELBOW.0), TURN, WRIST, TURN],
        }
    }

    fn links(self) -> Vec<Link> {
        let link = |twist, a, d, offset| Link { twist, a, d, offset };
        let base = link(0, 0.0, 267.0, 0.0);
        // The upper arm is inclined, and so is the forearm of an xArm 5.
        let (upper, lean) = (284.5_f64.hypot(53.5), 284.5_f64.atan2(53.5));
        let (fore, fore_lean) = (342.5_f64.hypot(77.5), 342.5_f64.atan2(77.5));
        match self {
            Self::XArm5 => vec![
                base,
                link(-1, 0.0, 0.0, -lean),
                link(0, upper, 0.0, lean + fore_lean),
                link(0, fore, 0.0, -fore_lean),
                link(-1, 76.0, 97.0, 0.0),
            ],
            Self::XArm6 => vec![
                base,
                link(-1, 0.0, 0.0, -lean),
                link(0, upper, 0.0, lean),
                link(-1, 77.5, 342.5, 0.0),
                link(1, 0.0, 0.0, 0.0),
                link(-1, 76.0, 97.0, 0.0),
            ],
            Self::XArm7 => vec![
                base,
                link(-1, 0.0, 0.0, 0.0),
                link(1, 0.0, 293.0, 0.0),
                link(1, 52.5, 0.0, 0.0),
                link(1, 77.5, 342.5, 0.0),
                link(1, 0.0, 0.0, 0.0),
                link(-1, 76.0, 97.0, 0.0),
            ],
        }
    }

    /// Returns the frames of the joints and the flange at these joint angles, in radians.
    pub(super) fn place(self, joints: &[f64; MAX_JOINTS]) -> Placed {
        let mut frame = Frame {
            position: [0.0; 3],
            columns: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        };
        let mut axes = Vec::new();
        for (link, angle) in self.links().iter().zip(joints) {
            frame = frame.along_x(link.twist, link.a);
            axes.push(frame);
            frame = frame.along_z(angle + link.offset, link.d);
        }
        Placed { axes, flange: frame }
    }
}

/// Transformation from one joint's axis to the next.
struct Link {
    /// Rotation about x, in quarter turns: -1, 0 or 1.
    twist: i8,
    /// Translation along x.
    a: f64,
    /// Translation along the joint's axis.
    d: f64,
    /// Rotation about the joint's axis at joint angle zero.
    offset: f64,
}

/// Position and orientation in the base frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    /// In millimetres.
    pub(super) position: Vector,
    /// The x, y and z axes.
    columns: Matrix,
}

impl Frame {
    fn along_x(self, quarters: i8, distance: f64) -> Self {
        let [x, y, z] = self.columns;
        let sin = f64::from(quarters);
        let cos = if quarters == 0 { 1.0 } else { 0.0 };
        Self {
            position: sum(self.position, scaled(x, distance)),
            columns: [
                x,
                sum(scaled(y, cos), scaled(z, sin)),
                sum(scaled(z, cos), scaled(y, -sin)),
            ],
        }
    }

    fn along_z(self, angle: f64, distance: f64) -> Self {
        let [x, y, z] = self.columns;
        let (sin, cos) = angle.sin_cos();
        Self {
            position: sum(self.position, scaled(z, distance)),
            columns: [
                sum(scaled(x, cos), scaled(y, sin)),
                sum(scaled(y, cos), scaled(x, -sin)),
                z,
            ],
        }
    }

    /// Returns roll, pitch and yaw, in radians: rotations about the fixed x, then y, then z axis.
    pub(super) fn roll_pitch_yaw(&self) -> Vector {
        let [[xx, xy, xz], [yx, yy, yz], [.., zz]] = self.columns;
        let level = xx.hypot(xy);
        let pitch = (0.0 - xz).atan2(level);
        if level < 1e-9 {
            // At a pitch of ±90°, roll and yaw are the same rotation.
            return [0.0, pitch, upright((-yx).atan2(yy))];
        }
        [upright(yz.atan2(zz)), pitch, upright(xy.atan2(xx))]
    }

    /// Returns the rotation vector: along the axis, with the angle in radians as its length.
    pub(super) fn rotation_vector(&self) -> Vector {
        let m = &self.columns;
        let twice_sin = [m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]];
        let twice_cos = m[0][0] + m[1][1] + m[2][2] - 1.0;
        let angle = length(twice_sin).atan2(twice_cos);
        if angle < 1e-9 {
            return [0.0; 3];
        }
        if angle < PI - 1e-6 {
            return scaled(twice_sin, angle / length(twice_sin));
        }
        // Half a turn: the matrix has the axis, up to its sign, which is arbitrary.
        let widest = (0..3).max_by(|&i, &j| m[i][i].total_cmp(&m[j][j])).unwrap_or(0);
        let mut axis = m[widest];
        axis[widest] += 1.0;
        scaled(axis, angle / length(axis))
    }
}

/// Joint and flange frames in the base frame.
pub(super) struct Placed {
    /// The z axis of each frame is the joint's axis of rotation.
    axes: Vec<Frame>,
    pub(super) flange: Frame,
}

impl Placed {
    /// Returns the distance of the flange from the axis of a joint, from zero, in millimetres. It is the radius of the
    /// flange's circle when only this joint turns. `None` without this joint.
    pub(super) fn radius(&self, joint: usize) -> Option<f64> {
        let axis = self.axes.get(joint)?;
        let arm = sum(self.flange.position, scaled(axis.position, -1.0));
        Some(length(cross(axis.columns[2], arm)))
    }

    /// Returns the flange's speed at these joint velocities, in millimetres and radians per second.
    pub(super) fn speed(&self, velocities: &[f64; MAX_JOINTS]) -> f64 {
        let moved = self
            .axes
            .iter()
            .zip(velocities)
            .fold([0.0; 3], |moved, (axis, &velocity)| {
                let arm = sum(self.flange.position, scaled(axis.position, -1.0));
                sum(moved, scaled(cross(axis.columns[2], arm), velocity))
            });
        length(moved)
    }
}

/// Removes the sign of half a turn, which depends on rounding.
fn upright(angle: f64) -> f64 {
    if angle < 1e-9 - PI { angle + TAU } else { angle }
}

fn sum([a, b, c]: Vector, [x, y, z]: Vector) -> Vector {
    [a + x, b + y, c + z]
}

fn scaled(vector: Vector, factor: f64) -> Vector {
    vector.map(|v| v * factor)
}

fn cross([a, b, c]: Vector, [x, y, z]: Vector) -> Vector {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}

fn length([a, b, c]: Vector) -> f64 {
    a.hypot(b).hypot(c)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::array::uniform7;
    use proptest::prelude::*;

    use super::*;

    const MODELS: [Model; 3] = [Model::XArm5, Model::XArm6, Model::XArm7];

    fn assert_near(got: Vector, expected: Vector) {
        let near = got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near, "{got:?}, expected {expected:?}");
    }

    #[test]
    fn zero_pose_flange_matches_vendor_data() {
        let homes = [[207.0, 0.0, 112.0], [207.0, 0.0, 112.0], [206.0, 0.0, 120.5]];
        for (model, home) in MODELS.into_iter().zip(homes) {
            let flange = model.place(&[0.0; 7]).flange;
            assert_near(flange.position, home);
            assert_near(flange.roll_pitch_yaw(), [PI, 0.0, 0.0]);
            assert_near(flange.rotation_vector(), [PI, 0.0, 0.0]);
        }
    }

    #[test]
    fn base_joint_turns_everything() {
        for model in MODELS {
            let flange = model.place(&[FRAC_PI_2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]).flange;
            let [x, _, z] = model.place(&[0.0; 7]).flange.position;
            assert_near(flange.position, [0.0, x, z]);
            assert_near(flange.roll_pitch_yaw(), [PI, 0.0, FRAC_PI_2]);
        }
    }

    #[test]
    fn flange_turns_on_the_last_joints_axis() {
        for model in MODELS {
            let placed = model.place(&[0.3; 7]);
            assert!(placed.radius(model.joints() - 1).unwrap() < 1e-9);
            assert_eq!(placed.radius(model.joints()), None);
        }
    }

    /// Rotates a vector by a rotation vector, with Rodrigues' formula.
    fn turned(vector: Vector, by: Vector) -> Vector {
        let angle = length(by);
        if angle == 0.0 {
            return vector;
        }
        let axis = scaled(by, 1.0 / angle);
        let along: f64 = axis.iter().zip(vector).map(|(a, v)| a * v).sum();
        let across = sum(scaled(vector, angle.cos()), scaled(cross(axis, vector), angle.sin()));
        sum(across, scaled(axis, along * (1.0 - angle.cos())))
    }

    proptest! {
        #[test]
        fn radius_and_speed_match_a_small_turn(joints in uniform7(-TAU..TAU), joint in 0_usize..5) {
            for model in MODELS {
                let placed = model.place(&joints);
                let mut further = joints;
                further[joint] += 1e-6;
                let [from, to] = [joints, further].map(|joints| model.place(&joints).flange.position);
                let moved = length(sum(to, scaled(from, -1.0))) / 1e-6;
                let mut velocities = [0.0; 7];
                velocities[joint] = 1.0;
                prop_assert!((placed.radius(joint).unwrap() - moved).abs() < 1e-2);
                prop_assert!((placed.speed(&velocities) - moved).abs() < 1e-2);
            }
        }

        #[test]
        fn both_orientation_forms_turn_base_into_flange(joints in uniform7(-TAU..TAU)) {
            let flange = Model::XArm6.place(&joints).flange;
            let [roll, pitch, yaw] = flange.roll_pitch_yaw();
            let about = flange.rotation_vector();
            for (i, column) in flange.columns.into_iter().enumerate() {
                let mut axis = [0.0; 3];
                axis[i] = 1.0;
                assert_near(turned(axis, about), column);
                let rolled = turned(axis, [roll, 0.0, 0.0]);
                assert_near(turned(turned(rolled, [0.0, pitch, 0.0]), [0.0, 0.0, yaw]), column);
            }
        }
    }
}
