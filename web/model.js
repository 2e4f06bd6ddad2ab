// The default model: simple shapes, not to scale, with the axes of a Ling arm in joint order.

const SHELL = 'shell';
const JOINT = 'joint';
const ACCENT = 'accent';

const origin = (xyz, rpy) => `<origin xyz="${xyz}" rpy="${rpy}"/>`;
const visual = (geometry, material, xyz = '0 0 0', rpy = '0 0 0') =>
  `<visual>${origin(xyz, rpy)}<geometry>${geometry}</geometry><material name="${material}"/></visual>`;
const cylinder = (radius, length) => `<cylinder radius="${radius}" length="${length}"/>`;
const box = (size) => `<box size="${size}"/>`;
const sphere = (radius) => `<sphere radius="${radius}"/>`;
const link = (name, ...visuals) => `<link name="${name}">${visuals.join('')}</link>`;
const joint = (name, type, parent, child, xyz, axis, rpy = '0 0 0', more = '') =>
  `<joint name="${name}" type="${type}"><parent link="${parent}"/><child link="${child}"/>${origin(xyz, rpy)}<axis xyz="${axis}"/>${more}</joint>`;

const SIDEWAYS = '1.5708 0 0';

export const ARM = `<robot name="simple arm">
<material name="${SHELL}"><color rgba="0.86 0.87 0.89 1"/></material>
<material name="${JOINT}"><color rgba="0.27 0.30 0.35 1"/></material>
<material name="${ACCENT}"><color rgba="0.05 0.55 0.60 1"/></material>
${link('base', visual(cylinder(0.085, 0.02), JOINT, '0 0 0.01'), visual(cylinder(0.07, 0.06), SHELL, '0 0 0.05'))}
${link('shoulder', visual(cylinder(0.062, 0.012), ACCENT, '0 0 0.006'), visual(cylinder(0.056, 0.05), SHELL, '0 0 0.037'),
    visual(box('0.075 0.075 0.055'), SHELL, '0 0 0.075'), visual(cylinder(0.042, 0.1), JOINT, '0 0 0.095', SIDEWAYS))}
${link('upper arm', visual(cylinder(0.046, 0.022), ACCENT, '0 0.05 0', SIDEWAYS), visual(box('0.056 0.058 0.21'), SHELL, '0 0 0.115'),
    visual(cylinder(0.036, 0.086), JOINT, '0 0 0.23', SIDEWAYS))}
${link('forearm', visual(cylinder(0.039, 0.02), ACCENT, '0 0.043 0', SIDEWAYS), visual(box('0.048 0.05 0.13'), SHELL, '0 0 0.075'))}
${link('wrist roll', visual(cylinder(0.03, 0.012), ACCENT, '0 0 0.006'), visual(cylinder(0.026, 0.07), SHELL, '0 0 0.045'),
    visual(cylinder(0.027, 0.062), JOINT, '0 0 0.09', SIDEWAYS))}
${link('wrist pitch', visual(cylinder(0.029, 0.014), ACCENT, '0 0.032 0', SIDEWAYS), visual(cylinder(0.024, 0.05), SHELL, '0 0 0.035'))}
${link('palm', visual(cylinder(0.027, 0.012), ACCENT, '0 0 0.006'), visual(box('0.05 0.105 0.03'), JOINT, '0 0 0.027'))}
${link('left finger', visual(box('0.026 0.012 0.065'), SHELL, '0 0.006 0.032'), visual(box('0.02 0.003 0.03'), ACCENT, '0 -0.001 0.048'))}
${link('right finger', visual(box('0.026 0.012 0.065'), SHELL, '0 -0.006 0.032'), visual(box('0.02 0.003 0.03'), ACCENT, '0 0.001 0.048'))}
${link('tip', visual(sphere(0.004), ACCENT))}
${joint('J1', 'revolute', 'base', 'shoulder', '0 0 0.08', '0 0 1')}
${joint('J2', 'revolute', 'shoulder', 'upper arm', '0 0 0.095', '0 1 0')}
${joint('J3', 'revolute', 'upper arm', 'forearm', '0 0 0.23', '0 1 0', '0 1.5708 0')}
${joint('J4', 'revolute', 'forearm', 'wrist roll', '0 0 0.14', '0 0 1')}
${joint('J5', 'revolute', 'wrist roll', 'wrist pitch', '0 0 0.09', '0 1 0')}
${joint('J6', 'revolute', 'wrist pitch', 'palm', '0 0 0.06', '0 0 1')}
${joint('gripper', 'prismatic', 'palm', 'left finger', '0 0.002 0.042', '0 1 0', '0 0 0', '<limit lower="0" upper="0.038" effort="1" velocity="1"/>')}
${joint('gripper right', 'prismatic', 'palm', 'right finger', '0 -0.002 0.042', '0 -1 0', '0 0 0', '<mimic joint="gripper"/>')}
${joint('tip', 'fixed', 'palm', 'tip', '0 0 0.11', '0 0 1')}
</robot>`;
