// The 3D view of the arm: the shapes of a model, its shadow on the ground, and the trail of its tip. WebGL 2.

import { distanceToSee, forward, lookAt, multiply, perspective, place, rotation, scaling, translation } from './kinematics.js';

const SEGMENTS = 40;
const TRAIL = 400;
const FIELD_OF_VIEW = 0.62;
// Distance of the eye, as a multiple of the least one from which the arm is in view.
const MARGIN = 1.05;
const LIGHT = [0.42, -0.5, 0.76];
const TURN = 0.008;
const KEY_TURN = 0.12;

const SOLID = {
  vertex: `#version 300 es
    in vec3 position; in vec3 normal;
    uniform mat4 camera; uniform mat4 model; uniform vec3 size;
    out vec3 direction; out vec3 world;
    void main() {
      vec4 at = model * vec4(position, 1.0);
      world = at.xyz;
      direction = mat3(model) * (normal / (size * size));
      gl_Position = camera * at;
    }`,
  fragment: `#version 300 es
    precision highp float;
    in vec3 direction; in vec3 world;
    uniform vec4 color; uniform vec3 light; uniform vec3 eye; uniform float flat_color;
    out vec4 pixel;
    void main() {
      if (flat_color > 0.5) { pixel = vec4(color.rgb * color.a, color.a); return; }
      vec3 n = normalize(direction);
      vec3 view = normalize(eye - world);
      float sun = max(dot(n, light), 0.0);
      float sky = 0.5 + 0.5 * n.z;
      float rim = pow(1.0 - max(dot(n, view), 0.0), 3.0);
      float gloss = pow(max(dot(n, normalize(light + view)), 0.0), 40.0);
      vec3 base = pow(color.rgb, vec3(2.2));
      vec3 lit = base * (0.22 + 0.28 * sky + 0.72 * sun) + vec3(0.10 * gloss) + vec3(0.07 * rim);
      pixel = vec4(pow(lit, vec3(1.0 / 2.2)) * color.a, color.a);
    }`,
};

const GROUND = {
  vertex: `#version 300 es
    in vec3 position;
    uniform mat4 camera; uniform float extent;
    out vec2 at;
    void main() { at = position.xy * extent; gl_Position = camera * vec4(at, 0.0, 1.0); }`,
  fragment: `#version 300 es
    precision highp float;
    in vec2 at;
    uniform vec4 color; uniform float extent; uniform float cell;
    out vec4 pixel;
    float lines(float step) {
      vec2 w = fwidth(at / step);
      vec2 d = abs(fract(at / step - 0.5) - 0.5) / max(w, vec2(1e-6));
      return 1.0 - min(min(d.x, d.y), 1.0);
    }
    void main() {
      float fade = 1.0 - smoothstep(0.25, 1.0, length(at) / extent);
      float alpha = color.a * fade * max(0.45 * lines(cell), lines(5.0 * cell));
      pixel = vec4(color.rgb * alpha, alpha);
    }`,
};

const LINE = {
  vertex: `#version 300 es
    in vec4 point;
    uniform mat4 camera;
    out float age;
    void main() { age = point.w; gl_Position = camera * vec4(point.xyz, 1.0); }`,
  fragment: `#version 300 es
    precision highp float;
    in float age; uniform vec4 color; out vec4 pixel;
    void main() { float alpha = color.a * age; pixel = vec4(color.rgb * alpha, alpha); }`,
};

export class Arm3d {
  #canvas;
  #gl;
  #programs;
  #shapes;
  #trailBuffer;
  #model = null;
  #values = new Map();
  #held = new Map();
  #trail = [];
  #extent = 1;
  #view = { azimuth: -0.9, elevation: 0.36, zoom: 1 };
  #theme = { ground: [0.5, 0.5, 0.5, 0.5], shadow: 0.2, trail: [0, 0.5, 0.5, 1] };
  #isDirty = true;

  // Throws if the browser has no WebGL 2.
  constructor(canvas) {
    this.#canvas = canvas;
    this.#gl = canvas.getContext('webgl2', { antialias: true, stencil: true, alpha: true });
    if (!this.#gl) throw new Error('this browser has no WebGL 2');
    this.#setUp();
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    canvas.addEventListener('webglcontextrestored', () => { this.#setUp(); this.#isDirty = true; });
    new ResizeObserver(() => { this.#isDirty = true; }).observe(canvas);
    this.#listen();
  }

  setModel(model) {
    this.#model = model;
    this.#trail = [];
    this.#extent = reach(model);
    this.#isDirty = true;
  }

  // Joint values by name, in radians or metres.
  setValues(values) {
    const isSame = [...values].every(([name, value]) => this.#values.get(name) === value);
    if (isSame && values.size === this.#values.size) return;
    this.#values = new Map(values);
    this.#isDirty = true;
  }

  // Colours of highlighted links, by name.
  setHeld(held) {
    this.#held = held;
    this.#isDirty = true;
  }

  setTheme(theme) {
    this.#theme = theme;
    this.#isDirty = true;
  }

  resetView() {
    this.#view = { azimuth: -0.9, elevation: 0.36, zoom: 1 };
    this.#trail = [];
    this.#isDirty = true;
  }

  // Draws if the scene has changed.
  draw() {
    if (!this.#isDirty || !this.#model) return;
    this.#isDirty = false;
    const gl = this.#gl;
    const ratio = Math.min(window.devicePixelRatio, 2);
    const [width, height] = [this.#canvas.clientWidth * ratio, this.#canvas.clientHeight * ratio].map(Math.round);
    if (width === 0 || height === 0) return;
    if (this.#canvas.width !== width) this.#canvas.width = width;
    if (this.#canvas.height !== height) this.#canvas.height = height;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

    const links = forward(this.#model, this.#values);
    const parts = this.#parts(links);
    const { eye, camera } = this.#camera(width / height, parts);
    this.#remember(links);

    gl.disable(gl.DEPTH_TEST);
    this.#drawGround(camera);
    this.#drawShadow(camera, parts);
    gl.enable(gl.DEPTH_TEST);
    this.#drawSolids(camera, eye, parts);
    this.#drawTrail(camera);
  }

  // The view of these parts: from farther away in a pose that would leave the canvas.
  #camera(aspect, parts) {
    const { azimuth, elevation, zoom } = this.#view;
    const target = [this.#extent * 0.12, 0, this.#extent * 0.36];
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const direction = [ce * ca, ce * sa, se];
    // A narrow canvas has the horizontal field of view of a square one.
    const usual = (this.#extent * 1.9) / Math.min(1, aspect);
    const spheres = parts.map(({ matrix, size }) => [...place(matrix), Math.hypot(...size) / 2]);
    const distance = zoom * Math.max(usual, MARGIN * distanceToSee(spheres, target, direction, FIELD_OF_VIEW, aspect));
    const eye = target.map((value, i) => value + distance * direction[i]);
    const near = this.#extent / 50;
    const projection = perspective(FIELD_OF_VIEW, aspect, near, distance + 10 * this.#extent);
    return { eye, camera: multiply(projection, lookAt(eye, target)) };
  }

  // Shapes to draw, with matrix, size and colour.
  #parts(links) {
    const parts = [];
    for (const [name, link] of this.#model.links) {
      const at = links.get(name);
      for (const { shape, size, color, origin } of link.visuals) {
        const held = this.#held.get(name);
        const tinted = held ? color.map((value, i) => (i < 3 ? 0.5 * value + 0.5 * held[i] : value)) : color;
        parts.push({ shape, size, color: tinted, matrix: multiply(multiply(at, origin), scaling(size)) });
      }
    }
    if (this.#model.meshes > 0) parts.push(...bones(this.#model, links, this.#extent));
    return parts;
  }

  #drawSolids(camera, eye, parts) {
    const gl = this.#gl;
    const { program, uniforms } = this.#programs.solid;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.camera, false, camera);
    gl.uniform3fv(uniforms.eye, eye);
    gl.uniform3fv(uniforms.light, LIGHT);
    gl.uniform1f(uniforms.flat_color, 0);
    for (const part of parts) this.#drawPart(uniforms, part, part.matrix, part.color);
  }

  // Shadows of the shapes on the ground. Each pixel is drawn once.
  #drawShadow(camera, parts) {
    const gl = this.#gl;
    const { program, uniforms } = this.#programs.solid;
    const flat = [1, 0, 0, 0, 0, 1, 0, 0, -LIGHT[0] / LIGHT[2], -LIGHT[1] / LIGHT[2], 0, 0, 0, 0, 0, 1];
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.camera, false, camera);
    gl.uniform1f(uniforms.flat_color, 1);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 0xff);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    for (const part of parts) this.#drawPart(uniforms, part, multiply(flat, part.matrix), [0, 0, 0, this.#theme.shadow]);
    gl.disable(gl.STENCIL_TEST);
  }

  #drawPart(uniforms, { shape, size }, matrix, color) {
    const gl = this.#gl;
    const { vertices, count } = this.#shapes[shape];
    gl.uniformMatrix4fv(uniforms.model, false, matrix);
    gl.uniform3fv(uniforms.size, size);
    gl.uniform4fv(uniforms.color, color);
    gl.bindVertexArray(vertices);
    gl.drawArrays(gl.TRIANGLES, 0, count);
  }

  #drawGround(camera) {
    const gl = this.#gl;
    const { program, uniforms } = this.#programs.ground;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.camera, false, camera);
    gl.uniform4fv(uniforms.color, this.#theme.ground);
    gl.uniform1f(uniforms.extent, this.#extent * 2);
    gl.uniform1f(uniforms.cell, 10 ** Math.round(Math.log10(this.#extent / 6)));
    gl.bindVertexArray(this.#shapes.ground.vertices);
    gl.drawArrays(gl.TRIANGLES, 0, this.#shapes.ground.count);
  }

  #drawTrail(camera) {
    if (this.#trail.length < 2) return;
    const gl = this.#gl;
    const { program, uniforms } = this.#programs.line;
    const points = this.#trail.flatMap((point, i) => [...point, i / this.#trail.length]);
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.camera, false, camera);
    gl.uniform4fv(uniforms.color, this.#theme.trail);
    gl.bindVertexArray(this.#trailBuffer.vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#trailBuffer.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points), gl.STREAM_DRAW);
    gl.drawArrays(gl.LINE_STRIP, 0, this.#trail.length);
  }

  // Adds the last link's position to the trail if it has moved.
  #remember(links) {
    const tip = place([...links.values()].at(-1));
    const last = this.#trail.at(-1);
    if (last && Math.hypot(...tip.map((value, i) => value - last[i])) < this.#extent / 500) return;
    this.#trail.push(tip);
    if (this.#trail.length > TRAIL) this.#trail.shift();
  }

  #setUp() {
    const gl = this.#gl;
    this.#programs = {
      solid: link(gl, SOLID, ['camera', 'model', 'size', 'color', 'light', 'eye', 'flat_color']),
      ground: link(gl, GROUND, ['camera', 'extent', 'color', 'cell']),
      line: link(gl, LINE, ['camera', 'color']),
    };
    const { solid, ground, line } = this.#programs;
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]];
    this.#shapes = {
      box: upload(gl, solid, boxVertices()),
      cylinder: upload(gl, solid, cylinderVertices()),
      sphere: upload(gl, solid, sphereVertices()),
      ground: upload(gl, ground, corners.flatMap(([x, y]) => [x, y, 0, 0, 0, 1])),
    };
    const vertices = gl.createVertexArray();
    const buffer = gl.createBuffer();
    gl.bindVertexArray(vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    const point = gl.getAttribLocation(line.program, 'point');
    gl.enableVertexAttribArray(point);
    gl.vertexAttribPointer(point, 4, gl.FLOAT, false, 0, 0);
    this.#trailBuffer = { vertices, buffer };
  }

  // Drag, wheel and arrow keys rotate and zoom the view.
  #listen() {
    const canvas = this.#canvas;
    const turn = (x, y) => {
      this.#view.azimuth -= x;
      this.#view.elevation = Math.min(1.5, Math.max(-0.1, this.#view.elevation + y));
      this.#isDirty = true;
    };
    const zoom = (factor) => {
      this.#view.zoom = Math.min(3, Math.max(0.4, this.#view.zoom * factor));
      this.#isDirty = true;
    };
    canvas.addEventListener('pointerdown', (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener('pointermove', (event) => {
      if (canvas.hasPointerCapture(event.pointerId)) turn(TURN * event.movementX, TURN * event.movementY);
    });
    canvas.addEventListener('wheel', (event) => {
      // The wheel zooms with Ctrl, as a pinch does, so that the page still scrolls.
      if (!event.ctrlKey) return;
      event.preventDefault();
      zoom(Math.exp(event.deltaY * 0.01));
    }, { passive: false });
    const keys = {
      ArrowLeft: () => turn(-KEY_TURN, 0),
      ArrowRight: () => turn(KEY_TURN, 0),
      ArrowUp: () => turn(0, KEY_TURN),
      ArrowDown: () => turn(0, -KEY_TURN),
      '+': () => zoom(1 / 1.15),
      '-': () => zoom(1.15),
    };
    canvas.addEventListener('keydown', (event) => {
      if (!Object.hasOwn(keys, event.key)) return;
      event.preventDefault();
      keys[event.key]();
    });
  }
}

// Reach of a model from its root at joint values 0, in metres.
function reach(model) {
  let longest = 0;
  for (const [name, at] of forward(model, new Map())) {
    const sizes = model.links.get(name).visuals.map(({ size }) => Math.max(...size) / 2);
    longest = Math.max(longest, Math.hypot(...place(at)) + Math.max(0, ...sizes));
  }
  return Math.max(longest, 0.05);
}

// A cylinder from each joint to the next, and a sphere at each moving joint.
function bones(model, links, extent) {
  const parts = [];
  const width = extent * 0.035;
  for (const joint of model.joints) {
    const [from, to] = [place(links.get(joint.parent)), place(links.get(joint.child))];
    const along = to.map((value, i) => value - from[i]);
    const length = Math.hypot(...along);
    if (joint.type !== 'fixed') {
      const size = [1.5 * width, 1.5 * width, 1.5 * width];
      parts.push({ shape: 'sphere', size, color: [0.05, 0.55, 0.6, 1], matrix: multiply(translation(to), scaling(size)) });
    }
    if (length < extent / 200) continue;
    const size = [width, width, length];
    const middle = from.map((value, i) => value + along[i] / 2);
    const axis = [-along[1], along[0], 0];
    const isUpright = Math.hypot(...axis) < 1e-9;
    const turn = isUpright ? rotation([1, 0, 0], 0) : rotation(axis, Math.acos(along[2] / length));
    const matrix = multiply(multiply(translation(middle), turn), scaling(size));
    parts.push({ shape: 'cylinder', size, color: [0.8, 0.81, 0.83, 1], matrix });
  }
  return parts;
}

function link(gl, { vertex, fragment }, names) {
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`WebGL: ${gl.getProgramInfoLog(program)}`);
  }
  const uniforms = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
  return { program, uniforms };
}

// Vertices of six numbers each: position and normal.
function upload(gl, { program }, numbers) {
  const vertices = gl.createVertexArray();
  gl.bindVertexArray(vertices);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.STATIC_DRAW);
  for (const [name, offset] of [['position', 0], ['normal', 12]]) {
    const location = gl.getAttribLocation(program, name);
    if (location < 0) continue;
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 24, offset);
  }
  return { vertices, count: numbers.length / 6 };
}

// Shapes of size 1 around the origin.

function boxVertices() {
  const numbers = [];
  for (let axis = 0; axis < 3; axis++) {
    for (const side of [-0.5, 0.5]) {
      for (const [u, v] of [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]]) {
        const position = [0, 0, 0];
        const normal = [0, 0, 0];
        position[axis] = side;
        position[(axis + 1) % 3] = u / 2;
        position[(axis + 2) % 3] = v / 2;
        normal[axis] = 2 * side;
        numbers.push(...position, ...normal);
      }
    }
  }
  return numbers;
}

function cylinderVertices() {
  const numbers = [];
  const at = (i) => [Math.cos((2 * Math.PI * i) / SEGMENTS), Math.sin((2 * Math.PI * i) / SEGMENTS)];
  for (let i = 0; i < SEGMENTS; i++) {
    const [[a, b], [c, d]] = [at(i), at(i + 1)];
    const wall = (x, y, z) => numbers.push(x / 2, y / 2, z, x, y, 0);
    wall(a, b, -0.5); wall(c, d, -0.5); wall(c, d, 0.5);
    wall(a, b, -0.5); wall(c, d, 0.5); wall(a, b, 0.5);
    for (const z of [-0.5, 0.5]) {
      for (const [x, y] of [[0, 0], [a, b], [c, d]]) numbers.push(x / 2, y / 2, z, 0, 0, 2 * z);
    }
  }
  return numbers;
}

function sphereVertices() {
  const numbers = [];
  const rings = SEGMENTS / 2;
  const at = (i, j) => {
    const [across, down] = [(2 * Math.PI * i) / SEGMENTS, (Math.PI * j) / rings];
    return [Math.sin(down) * Math.cos(across), Math.sin(down) * Math.sin(across), Math.cos(down)];
  };
  for (let i = 0; i < SEGMENTS; i++) {
    for (let j = 0; j < rings; j++) {
      for (const [a, b] of [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]) {
        const normal = at(i + a, j + b);
        numbers.push(...normal.map((value) => value / 2), ...normal);
      }
    }
  }
  return numbers;
}
