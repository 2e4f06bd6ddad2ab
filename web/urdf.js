// A robot model from URDF: links with simple shapes, joints in order. Meshes are counted and not loaded.

import { pose, identity } from './kinematics.js';

// Size limit: URDF files have at most a few hundred kilobytes.
export const MAX_LENGTH = 4_000_000;
const MAX_LINKS = 2000;
// Shapes that are drawn: each is a call of the graphics card, twice for each frame.
export const MAX_VISUALS = 1000;
// Tick 4095 of the arm, in radians; tick 0 is at -π.
const LAST_TICK = ((4095 - 2048) * 2 * Math.PI) / 4096;
const TYPES = ['revolute', 'continuous', 'prismatic', 'fixed', 'floating', 'planar'];
const MOVING = ['revolute', 'continuous', 'prismatic'];
const GREY = [0.6, 0.62, 0.65, 1];

// Parses a model. Throws an error that describes the fault in the text. Faults that other parsers accept are no errors.
export function parseUrdf(text) {
  if (text.length > MAX_LENGTH) throw new Error(`the file has ${text.length} characters, the maximum is ${MAX_LENGTH}`);
  const page = parseXml(text);
  if (page.querySelector('parsererror')) throw new Error('the file is not XML');
  const robot = page.documentElement;
  if (robot.tagName !== 'robot') throw new Error(`the file is not a URDF: its root is <${robot.tagName}>, must be <robot>`);

  const materials = new Map(children(robot, 'material').map((element) => [element.getAttribute('name'), element]));
  const links = new Map(children(robot, 'link').map((element) => [name(element), readLink(element, materials)]));
  if (links.size === 0) throw new Error('the robot has no links');
  const joints = children(robot, 'joint').map((element) => readJoint(element, links));
  if (links.size > MAX_LINKS) throw new Error(`the robot has ${links.size} links, the maximum is ${MAX_LINKS}`);
  const { root, ordered, loops } = order(links, joints);
  const meshes = [...links.values()].reduce((sum, link) => sum + link.meshes, 0);
  // Independent joints from the root outwards: the arm's axes in order.
  const axes = ordered.filter((joint) => MOVING.includes(joint.type) && !joint.mimic);
  const hidden = limitVisuals(links);
  return { name: robot.getAttribute('name') ?? '', root, links, joints: ordered, axes, meshes, hidden, loops };
}

// Ends joints where the arm's ticks end. Returns the names of those whose limits are beyond.
export function endAtTicks(joints) {
  const beyond = joints.filter(({ type, lower, upper }) => type === 'revolute' && (lower < -Math.PI || upper > LAST_TICK));
  for (const joint of beyond) {
    joint.lower = Math.max(joint.lower, -Math.PI);
    joint.upper = Math.min(joint.upper, LAST_TICK);
  }
  return beyond.map((joint) => joint.name);
}

// Parses XML as other programs do: blank lines before the declaration, any version in it, hyphens in comments, and
// prefixes without a namespace are no errors.
function parseXml(text) {
  const body = withoutComments(text).trimStart().replace(/^<\?xml\s[^>]*\?>/, '');
  const names = body.matchAll(/[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_]/g);
  const prefixes = [...new Set([...names].map(([, prefix]) => prefix))];
  const unknown = prefixes.filter((prefix) => !['xml', 'xmlns'].includes(prefix) && !body.includes(`xmlns:${prefix}=`));
  const namespaces = unknown.map((prefix) => ` xmlns:${prefix}="urn:${prefix}"`).join('');
  return new DOMParser().parseFromString(body.replace(/<robot\b/, `<robot${namespaces}`), 'application/xml');
}

function withoutComments(text) {
  const parts = [];
  let at = 0;
  for (;;) {
    const start = text.indexOf('<!--', at);
    const end = start < 0 ? -1 : text.indexOf('-->', start + 4);
    if (end < 0) return parts.join('') + text.slice(at);
    parts.push(text.slice(at, start));
    at = end + 3;
  }
}

// Leaves out the visuals over the maximum. Returns their number.
function limitVisuals(links) {
  let [left, hidden] = [MAX_VISUALS, 0];
  for (const link of links.values()) {
    hidden += Math.max(0, link.visuals.length - left);
    link.visuals.length = Math.min(link.visuals.length, left);
    left -= link.visuals.length;
  }
  return hidden;
}

function children(element, tag) {
  return [...element.children].filter((child) => child.tagName === tag);
}

const child = (element, tag) => children(element, tag)[0] ?? null;

function name(element) {
  const value = element.getAttribute('name');
  if (!value) throw new Error(`a <${element.tagName}> has no name`);
  return value;
}

// Returns an attribute's numbers, or `fallback` without the element or attribute.
function numbers(element, attribute, fallback) {
  const text = element?.getAttribute(attribute);
  if (text === null || text === undefined) return fallback;
  const values = text.trim().split(/\s+/).map(Number);
  if (values.length !== fallback.length || !values.every(Number.isFinite)) {
    throw new Error(`<${element.tagName} ${attribute}="${text}"> must be ${fallback.length} numbers`);
  }
  return values;
}

const number = (element, attribute, fallback) => numbers(element, attribute, [fallback])[0];

function readOrigin(element) {
  const origin = child(element, 'origin');
  return origin ? pose(numbers(origin, 'xyz', [0, 0, 0]), numbers(origin, 'rpy', [0, 0, 0])) : identity();
}

function readLink(element, materials) {
  const link = { visuals: [], meshes: 0 };
  for (const visual of children(element, 'visual')) {
    const shape = readShape(child(visual, 'geometry'));
    if (shape) link.visuals.push({ origin: readOrigin(visual), color: readColor(visual, materials), ...shape });
    else link.meshes += 1;
  }
  return link;
}

// Returns a shape and its size in metres; null if the shape is not supported.
function readShape(geometry) {
  const element = geometry?.firstElementChild;
  switch (element?.tagName) {
    case 'box':
      return { shape: 'box', size: numbers(element, 'size', [1, 1, 1]) };
    case 'cylinder': {
      const radius = number(element, 'radius', 1);
      return { shape: 'cylinder', size: [2 * radius, 2 * radius, number(element, 'length', 1)] };
    }
    case 'sphere': {
      const diameter = 2 * number(element, 'radius', 1);
      return { shape: 'sphere', size: [diameter, diameter, diameter] };
    }
    default:
      return null;
  }
}

function readColor(visual, materials) {
  const own = child(visual, 'material');
  const material = own && !child(own, 'color') ? materials.get(own.getAttribute('name')) : own;
  try {
    return numbers(material ? child(material, 'color') : null, 'rgba', GREY);
  } catch {
    return GREY;
  }
}

// Returns a limit. One that is infinite, or no number, is none.
function limitOf(element, attribute) {
  const value = Number(element?.getAttribute(attribute) ?? 0);
  return Number.isFinite(value) ? value : 0;
}

function readJoint(element, links) {
  const joint = { name: name(element), type: element.getAttribute('type'), mimic: null };
  const fail = (reason) => { throw new Error(`joint ${joint.name}: ${reason}`); };
  if (!TYPES.includes(joint.type)) fail(`its type is ${joint.type}, must be one of ${TYPES.join(', ')}`);
  for (const end of ['parent', 'child']) {
    joint[end] = child(element, end)?.getAttribute('link');
    // The parent of a robot's part is in another file.
    if (end === 'parent' && joint.parent && !links.has(joint.parent)) links.set(joint.parent, { visuals: [], meshes: 0 });
    if (!links.has(joint[end])) fail(`its ${end} ${joint[end]} is not a link`);
  }
  joint.origin = readOrigin(element);
  // Exporters write axes of zeros to joints that do not turn.
  joint.axis = MOVING.includes(joint.type) ? numbers(child(element, 'axis'), 'xyz', [1, 0, 0]) : [1, 0, 0];
  const limit = child(element, 'limit');
  joint.lower = limitOf(limit, 'lower');
  joint.upper = limitOf(limit, 'upper');
  const mimic = child(element, 'mimic');
  if (mimic) {
    joint.mimic = {
      joint: mimic.getAttribute('joint'),
      multiplier: number(mimic, 'multiplier', 1),
      offset: number(mimic, 'offset', 0),
    };
  }
  return joint;
}

// Returns the root, the joints with each parent before its children, and the names of joints that close a loop: they lead
// to a link that has a parent.
function order(links, joints) {
  const children = new Map([...links.keys()].map((link) => [link, []]));
  const isChild = new Set();
  const loops = [];
  for (const joint of joints) {
    if (isChild.has(joint.child)) {
      loops.push(joint.name);
      continue;
    }
    isChild.add(joint.child);
    children.get(joint.parent).push(joint);
  }
  const roots = [...links.keys()].filter((link) => !isChild.has(link));
  if (roots.length !== 1) throw new Error(`the robot has ${roots.length} links without a parent, must be 1`);
  const ordered = [];
  for (const waiting = [roots[0]]; waiting.length > 0; ) {
    for (const joint of children.get(waiting.shift())) {
      ordered.push(joint);
      waiting.push(joint.child);
    }
  }
  if (ordered.length + loops.length !== joints.length) throw new Error('the joints form a cycle');
  return { root: roots[0], ordered, loops };
}
