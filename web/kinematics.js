// Matrices and forward kinematics. A matrix has 16 numbers in column-major order, as in WebGL. Units: metres, radians.

export const identity = () => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

export function multiply(a, b) {
  const product = new Array(16);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * k + row] * b[4 * column + k];
      product[4 * column + row] = sum;
    }
  }
  return product;
}

export const translation = ([x, y, z]) => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1];

export const scaling = ([x, y, z]) => [x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 0, 0, 0, 1];

// Rotation about an axis of any length except 0.
export function rotation(axis, angle) {
  const length = Math.hypot(...axis);
  const [x, y, z] = axis.map((value) => value / length);
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const t = 1 - c;
  return [
    t * x * x + c, t * x * y + s * z, t * x * z - s * y, 0,
    t * x * y - s * z, t * y * y + c, t * y * z + s * x, 0,
    t * x * z + s * y, t * y * z - s * x, t * z * z + c, 0,
    0, 0, 0, 1,
  ];
}

// A URDF pose: position, and roll, pitch and yaw about fixed axes.
export function pose(xyz, [roll, pitch, yaw]) {
  const turn = multiply(rotation([0, 0, 1], yaw), multiply(rotation([0, 1, 0], pitch), rotation([1, 0, 0], roll)));
  return multiply(translation(xyz), turn);
}

export const place = (matrix) => [matrix[12], matrix[13], matrix[14]];

export function perspective(angle, aspect, near, far) {
  const f = 1 / Math.tan(angle / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
}

const subtract = (a, b) => a.map((value, i) => value - b[i]);
const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
const normalize = (a) => a.map((value) => value / Math.hypot(...a));

// The view from `eye` to `target`, with z up.
export function lookAt(eye, target) {
  const back = normalize(subtract(eye, target));
  const right = normalize(cross([0, 0, 1], back));
  const up = cross(back, right);
  return [
    right[0], up[0], back[0], 0,
    right[1], up[1], back[1], 0,
    right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ];
}

// The least distance of an eye from `target` from which spheres are in view. `direction` leads from the target to the eye
// and has length 1; `angle` is the vertical field of view. A sphere has x, y, z and a radius.
export function distanceToSee(spheres, target, direction, angle, aspect) {
  const right = normalize(cross([0, 0, 1], direction));
  const up = cross(direction, right);
  const halves = [[up, angle / 2], [right, Math.atan(aspect * Math.tan(angle / 2))]];
  let distance = 0;
  for (const [x, y, z, radius] of spheres) {
    const at = subtract([x, y, z], target);
    for (const [side, half] of halves) {
      const needed = dot(at, direction) + Math.abs(dot(at, side)) / Math.tan(half) + radius / Math.sin(half);
      distance = Math.max(distance, needed);
    }
  }
  return distance;
}

// Transformation of a joint at this value: radians, or metres of a prismatic joint. An axis of zeros has no motion.
function motion(joint, value) {
  if (Math.hypot(...joint.axis) === 0) return identity();
  switch (joint.type) {
    case 'revolute':
    case 'continuous':
      return rotation(joint.axis, value);
    case 'prismatic':
      return translation(joint.axis.map((part) => part * value));
    default:
      return identity();
  }
}

// Pose of each link of a model by name, from the joints' values by name. A joint without a value is at 0.
export function forward(model, values) {
  const links = new Map([[model.root, identity()]]);
  // Parents come before their children.
  for (const joint of model.joints) {
    const { mimic } = joint;
    const value = mimic
      ? (values.get(mimic.joint) ?? 0) * mimic.multiplier + mimic.offset
      : values.get(joint.name) ?? 0;
    const parent = multiply(links.get(joint.parent), joint.origin);
    links.set(joint.child, multiply(parent, motion(joint, value)));
  }
  return links;
}
