// The page. It owns the engine and the link, passes user actions to them, and shows their state in the views.

import { AXES, Engine, GRIPPER } from './engine.js';
import { Link, now } from './link.js';
import { motionText } from './motion_text.js';
import { VirtualPort } from './virtual.js';
import * as serial from './serial.js';
import { KEYS, Holds, listenToButton, listenToKeys, whilePressed } from './holds.js';
import { Arm3d } from './arm3d.js';
import { Plot } from './plots.js';
import { FrameTable } from './frames.js';
import { CABLES, FAULTS, UNPLUGGED, UNPLUGGED_RATES, percent, rateAt, rates } from './cable.js';
import { MAX_LENGTH, MAX_VISUALS, endAtTicks, parseUrdf } from './urdf.js';
import { ARM } from './model.js';

const NAMES = ['J1', 'J2', 'J3', 'J4', 'J5', 'J6', 'Grip'];
const PARTS = ['base', 'shoulder', 'elbow', 'roll', 'pitch', 'wrist', 'gripper'];
const DEGREES = 180 / Math.PI;
const SEED = 1;
// Update interval of numbers and the table, in milliseconds: the shortest readable one.
const TEXT_PERIOD = 200;
// Time that torque-off must be held, in milliseconds.
const TORQUE_OFF_HOLD = 1000;
// °C.
const HOT = 70;
// Counters that do not indicate errors.
const GOOD_COUNTERS = 4;
const STATE_TEXTS = {
  listening: 'listening',
  silent: 'no answer',
  'older generation': 'an arm of the older generation: nothing is sent to it. It needs a firmware update from the vendor',
};
// The end of a notice about a port that is back.
const MOTION_OFF = 'Motion is off until you enable it.';
const UNKNOWN_ARM = 'Motion stays off until the arm has told its serial number: it may be another arm.';

const element = (id) => document.getElementById(id);

class Page {
  #engine;
  #link;
  #holds = new Holds();
  #arm3d = null;
  #model;
  #axes = [];
  #frames;
  #serialPort = null;
  #connecting = Promise.resolve();
  // The port that was lost and is opened when it is back.
  #lostPort = null;
  // Serial number of the arm before its port was lost; empty if unknown.
  #lostArm = '';
  #readAt = NaN;
  #textAt = 0;
  #answers = [];
  #isPaused = false;
  #colors = {};

  constructor(engine) {
    this.#engine = engine;
    this.#link = new Link(engine);
    this.#link.onclose = (reason) => this.#lost(reason);
    this.#frames = new FrameTable(element('frame-rows'), element('frames-summary'), () => ({
      byMessage: document.querySelector('[name=rows]:checked').value === 'message',
      errorsOnly: element('errors-only').checked,
    }));
    this.#makeAxes();
    this.#makeView();
    this.#makeMotion();
    this.#makeCable();
    this.#makeLine();
    this.#makeConnection();
    this.#makeHelp();
    this.#readColors();
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.#readColors());
  }

  start() {
    // The first frame is slow, because it compiles the shaders. The link is served first.
    this.#draw();
    this.#openVirtual();
    const frame = () => {
      this.#draw();
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  // Executes a user action, and sends the resulting frames.
  #act(action) {
    action(now());
    this.#link.pump();
  }

  // Connection.

  #makeConnection() {
    element('virtual').addEventListener('click', () => this.#connect(() => this.#openVirtual()));
    element('connect').addEventListener('click', async () => {
      await this.#attempt(async () => {
        const port = await serial.choose();
        if (port) await this.#connect(() => this.#openSerial(port));
      });
    });
    element('reconnect').addEventListener('click', async () => {
      await this.#attempt(async () => {
        const [port] = await serial.granted();
        if (port) await this.#connect(() => this.#openSerial(port));
      });
    });
    if (!serial.isSupported()) {
      element('connect').disabled = true;
      element('connect').title = 'This browser has no WebSerial. Chrome and Edge on a desktop have it.';
    }
    serial.listenToPorts((port) => this.#openAgain(port));
    this.#offerReconnect();
    element('notice-close').addEventListener('click', () => this.#notify(''));
  }

  // A port that was granted earlier needs no selection.
  async #offerReconnect() {
    const ports = await serial.granted();
    element('reconnect').hidden = ports.length !== 1 || this.#serialPort !== null;
    if (ports.length === 1) element('reconnect').textContent = `Reconnect ${serial.nameOf(ports[0])}`;
  }

  // Closes the current connection, then connects. One at a time: a port may come back while the user connects.
  #connect(open) {
    this.#lostPort = null;
    const connected = this.#connecting.then(async () => {
      this.#holds.releaseAll();
      this.#notify('');
      await this.#link.close();
      this.#serialPort = null;
      this.#lostPort = null;
      this.#lostArm = '';
      try {
        await open();
      } finally {
        await this.#offerReconnect();
      }
    });
    this.#connecting = connected.catch(() => {});
    return connected;
  }

  // Opens the lost port if it is back as `port`. Only reads are sent until the user enables motion.
  async #openAgain(port) {
    if (!this.#lostPort?.isBackAs(port)) return;
    const arm = this.#lostArm;
    await this.#attempt(() => this.#connect(async () => {
      await this.#openSerial(port);
      this.#lostArm = arm;
      this.#notify(`The port is back. ${MOTION_OFF}`);
    }));
  }

  #openVirtual() {
    this.#open(this.#virtualPort(), true);
    this.#setFaults();
  }

  // The address has the plant, as ?plant=typical,sag=26.
  #virtualPort() {
    try {
      return new VirtualPort(this.#engine, SEED, new URLSearchParams(location.search).get('plant') ?? '');
    } catch (error) {
      this.#notify(`The plant in the address is not used: ${error.message}`);
      return new VirtualPort(this.#engine, SEED, '');
    }
  }

  async #openSerial(granted) {
    try {
      this.#serialPort = await serial.SerialPort.open(granted);
    } catch (error) {
      this.#openVirtual();
      throw error;
    }
    this.#open(this.#serialPort, false);
  }

  // Motion of a real arm is off until the user enables it.
  #open(port, isVirtual) {
    document.body.dataset.port = isVirtual ? 'virtual' : 'serial';
    element('cable').hidden = !isVirtual;
    element('virtual').hidden = isVirtual;
    this.#frames.log.clear();
    for (const { plot } of this.#axes) plot.history.clear();
    this.#answers = [];
    this.#link.open(port);
    this.#engine.setSpeed(element('speed').value / DEGREES);
    this.#enableMotion(isVirtual);
  }

  #lost(reason) {
    this.#lostPort = this.#serialPort;
    this.#lostArm = this.#engine.serial() || this.#lostArm;
    this.#serialPort = null;
    this.#holds.releaseAll();
    element('virtual').hidden = false;
    this.#notify(`The port is closed, and is opened when it is back: ${reason}`);
    this.#offerReconnect();
  }

  async #attempt(action) {
    try {
      await action();
    } catch (error) {
      this.#notify(error.message);
    }
  }

  #notify(text) {
    element('notice').hidden = text === '';
    element('notice-text').textContent = text;
  }

  // Names an arm other than the one before its port was lost.
  #compareArm() {
    const arm = this.#engine.serial();
    if (arm === '' || this.#lostArm === '') return;
    if (arm !== this.#lostArm) {
      this.#notify(`Another arm is on this port: ${arm}, before ${this.#lostArm}. ${MOTION_OFF}`);
    }
    this.#lostArm = '';
  }

  // Motion.

  #enableMotion(isEnabled) {
    element('enable').checked = isEnabled;
    this.#act((at) => this.#engine.enableMotion(at, isEnabled));
  }

  #makeAxes() {
    NAMES.forEach((name, axis) => {
      const keys = [...KEYS].filter(([, [of]]) => of === axis);
      const button = (direction) => {
        const [code] = keys.find(([, [, way]]) => way === direction);
        const made = document.createElement('button');
        const key = document.createElement('kbd');
        made.type = 'button';
        made.className = 'jog';
        made.dataset.axis = axis;
        made.dataset.direction = direction;
        made.setAttribute('aria-label', `${name} ${PARTS[axis]}, ${direction > 0 ? 'up' : 'down'}, hold`);
        made.setAttribute('aria-keyshortcuts', code.slice(-1));
        key.textContent = code.slice(-1);
        key.dataset.code = code;
        made.append(direction > 0 ? '+' : '−', key);
        listenToButton(this.#holds, made, axis, direction);
        return made;
      };
      const row = document.createElement('li');
      const label = document.createElement('span');
      const part = document.createElement('small');
      const canvas = document.createElement('canvas');
      const value = document.createElement('output');
      row.style.setProperty('--line', `var(--axis-${axis})`);
      label.className = 'axis-name';
      part.textContent = PARTS[axis];
      label.append(name, part);
      canvas.className = 'axis-plot';
      canvas.setAttribute('role', 'img');
      canvas.setAttribute('aria-label', `${name} in the last 20 seconds`);
      value.className = 'axis-value';
      value.textContent = '–';
      const [down, up] = [button(-1), button(1)];
      row.append(label, down, canvas, up, value);
      element('axes').append(row);
      const options = axis === GRIPPER ? { span: 20, limits: [-4, 104] } : { span: 24, limits: [-184, 184] };
      this.#axes.push({ plot: new Plot(canvas, options), value, buttons: { '-1': down, 1: up } });
    });
  }

  #makeMotion() {
    this.#holds.onchange = (axis, direction) => {
      this.#act((at) => this.#engine.hold(at, axis, direction));
      const { buttons } = this.#axes[axis];
      for (const way of [-1, 1]) buttons[way].classList.toggle('held', direction === way);
      this.#showHeld();
    };
    listenToKeys(this.#holds, document);
    element('enable').addEventListener('change', (event) => {
      // Another arm would move before it is named.
      const isUnknown = this.#lostArm !== '';
      if (isUnknown && event.target.checked) this.#notify(UNKNOWN_ARM);
      this.#enableMotion(event.target.checked && !isUnknown);
    });
    element('speed').addEventListener('input', (event) => {
      element('speed-text').textContent = `${event.target.value}°/s`;
      this.#engine.setSpeed(event.target.value / DEGREES);
    });
    const stop = () => {
      this.#holds.releaseAll();
      this.#act((at) => this.#engine.stop(at));
    };
    element('stop').addEventListener('click', stop);
    addEventListener('keydown', (event) => {
      if (event.key === 'Escape' && !event.repeat && !document.querySelector('dialog[open]')) stop();
    });
    element('torque-on').addEventListener('click', () => this.#act((at) => this.#engine.setTorque(at, true)));
    const button = element('torque-off');
    let timer = 0;
    const up = () => {
      clearTimeout(timer);
      button.classList.remove('held');
    };
    whilePressed(button, () => {
      up();
      button.classList.add('held');
      timer = setTimeout(() => {
        up();
        this.#holds.releaseAll();
        this.#act((at) => this.#engine.setTorque(at, false));
      }, TORQUE_OFF_HOLD);
    }, up);
    addEventListener('blur', up);
  }

  // View.

  #makeView() {
    try {
      this.#arm3d = new Arm3d(element('arm'));
    } catch (error) {
      element('no-view').hidden = false;
      element('no-view').textContent = `No 3D view: ${error.message}.`;
      element('arm').hidden = true;
    }
    this.#setModel(parseUrdf(ARM));
    element('reset-view').addEventListener('click', () => this.#arm3d?.resetView());
    element('urdf').addEventListener('change', async (event) => {
      await this.#readModel(event.target.files[0]);
      event.target.value = '';
    });
    let inside = 0;
    const isFile = (event) => event.dataTransfer?.types.includes('Files');
    const show = (change) => {
      inside = Math.max(0, inside + change);
      element('drop-here').hidden = inside === 0;
    };
    addEventListener('dragenter', (event) => isFile(event) && show(1));
    addEventListener('dragleave', (event) => isFile(event) && show(-1));
    addEventListener('dragover', (event) => isFile(event) && event.preventDefault());
    addEventListener('drop', async (event) => {
      if (!isFile(event)) return;
      event.preventDefault();
      show(-inside);
      await this.#readModel(event.dataTransfer.files[0]);
    });
  }

  async #readModel(file) {
    if (!file) return;
    await this.#attempt(async () => {
      if (file.size > MAX_LENGTH) throw new Error(`the file has ${file.size} bytes, the maximum is ${MAX_LENGTH}`);
      const model = parseUrdf(await file.text());
      this.#setModel(model);
      const moving = Math.min(model.axes.length, AXES);
      const said = [`${file.name}: ${moving} of its ${model.axes.length} joints follow the arm.`];
      if (model.meshes > 0) said.push(`${model.meshes} meshes are not loaded: cylinders between the joints replace them.`);
      if (model.hidden > 0) said.push(`${model.hidden} of its shapes ${model.hidden === 1 ? 'is' : 'are'} not drawn: the maximum is ${MAX_VISUALS}.`);
      if (model.loops.length > 0) said.push(`Joints that close a loop are left out: ${model.loops.join(', ')}.`);
      const beyond = endAtTicks(model.axes.slice(0, GRIPPER));
      if (beyond.length > 0) said.push(`The arm ends at −180.00° and 179.91°, inside the limits of ${beyond.join(', ')}.`);
      this.#notify(said.join(' '));
    });
  }

  #setModel(model) {
    this.#model = model;
    this.#arm3d?.setModel(model);
    element('model-name').textContent = model.name;
  }

  // Links with a held joint have the colour of their axis.
  #showHeld() {
    const held = new Map();
    this.#model.axes.slice(0, AXES).forEach((joint, axis) => {
      if (this.#holds.direction(axis) !== 0) held.set(joint.child, this.#colors.axes[axis]);
    });
    this.#arm3d?.setHeld(held);
  }

  // The arm's joints are the model's joints, in order. The gripper is a fraction of its range.
  #values(positions) {
    const values = new Map();
    this.#model.axes.slice(0, AXES).forEach((joint, axis) => {
      const position = positions[axis];
      if (Number.isNaN(position)) return;
      const isShare = axis === GRIPPER;
      values.set(joint.name, isShare ? joint.lower + position * (joint.upper - joint.lower) : position);
    });
    return values;
  }

  // Cable.

  #makeCable() {
    for (const input of document.querySelectorAll('[name=cable]')) {
      input.addEventListener('change', () => {
        const places = CABLES[input.value] ?? CABLES.good;
        for (const fault of FAULTS) element(`fault-${fault}`).value = places[fault];
        this.#setFaults();
      });
    }
    for (const fault of FAULTS) {
      element(`fault-${fault}`).addEventListener('input', () => {
        for (const input of document.querySelectorAll('[name=cable]')) input.checked = false;
        this.#setFaults();
      });
    }
  }

  #setFaults() {
    const places = {};
    for (const fault of FAULTS) {
      const slider = element(`fault-${fault}`);
      places[fault] = Number(slider.value);
      const text = percent(rateAt(places[fault]));
      set(slider.nextElementSibling, text);
      slider.setAttribute('aria-valuetext', text === 'none' ? text : `${text} of the bytes`);
    }
    const isUnplugged = document.querySelector('[name=cable]:checked')?.value === UNPLUGGED;
    this.#engine.setFaults(isUnplugged ? UNPLUGGED_RATES : rates(places));
  }

  // Line and frames.

  #makeLine() {
    for (const label of this.#engine.counterLabels) {
      const row = document.createElement('div');
      const term = document.createElement('dt');
      const value = document.createElement('dd');
      term.textContent = label;
      term.title = label;
      value.textContent = '0';
      row.append(term, value);
      element('counters').append(row);
    }
    FAULTS.forEach((fault, nth) => { element(`fault-${fault}-count`).title = `${this.#engine.faultLabels[nth]} so far`; });
    element('pause').addEventListener('click', (event) => {
      this.#isPaused = !this.#isPaused;
      event.target.setAttribute('aria-pressed', this.#isPaused);
    });
    for (const input of document.querySelectorAll('[name=rows], #errors-only')) {
      input.addEventListener('change', () => {
        const isOrder = document.querySelector('[name=rows]:checked').value === 'order';
        element('when-title').textContent = isOrder ? 'Time in s' : 'Count · rate';
        this.#frames.draw(now() / 1e6);
      });
    }
  }

  // Help.

  #makeHelp() {
    const dialog = element('help-dialog');
    const body = dialog.querySelector('tbody');
    NAMES.forEach((name, axis) => {
      const row = body.insertRow();
      row.insertCell().textContent = `${name}, ${PARTS[axis]}`;
      for (const direction of [-1, 1]) {
        const [code] = [...KEYS].find(([, [of, way]]) => of === axis && way === direction);
        const key = document.createElement('kbd');
        key.textContent = code.slice(-1);
        key.dataset.code = code;
        row.insertCell().append(key);
      }
    });
    const open = () => {
      this.#holds.releaseAll();
      dialog.showModal();
    };
    element('help').addEventListener('click', open);
    addEventListener('keydown', (event) => {
      if (event.key === '?' && !dialog.open) open();
    });
    this.#nameKeys();
  }

  // Shows the letters of the current keyboard layout, if the browser provides them.
  async #nameKeys() {
    const layout = await navigator.keyboard?.getLayoutMap?.().catch(() => null);
    if (!layout) return;
    for (const key of document.querySelectorAll('kbd[data-code]')) {
      const letter = layout.get(key.dataset.code);
      if (letter) key.textContent = letter.toUpperCase();
    }
  }

  // Drawing.

  #readColors() {
    const canvas = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
    // Converts any CSS colour to numbers.
    const rgba = (name, alpha = 1) => {
      canvas.fillStyle = resolve(name);
      canvas.fillRect(0, 0, 1, 1);
      const [r, g, b] = canvas.getImageData(0, 0, 1, 1).data;
      return [r / 255, g / 255, b / 255, alpha];
    };
    const isDark = matchMedia('(prefers-color-scheme: dark)').matches;
    const axes = Array.from({ length: AXES }, (_, axis) => `--axis-${axis}`);
    this.#colors = {
      lines: axes.map(resolve),
      grid: resolve('--edge'),
      axes: axes.map((name) => rgba(name)),
    };
    this.#arm3d?.setTheme({
      ground: rgba('--quiet', isDark ? 0.32 : 0.38),
      shadow: isDark ? 0.42 : 0.16,
      trail: rgba('--accent'),
    });
  }

  #draw() {
    const at = now();
    const time = at / 1e6;
    this.#takeRecords();
    this.#takeReading();
    this.#arm3d?.draw();
    this.#axes.forEach(({ plot }, axis) => plot.draw(time, { line: this.#colors.lines[axis], grid: this.#colors.grid }));
    if (at - this.#textAt < TEXT_PERIOD * 1000) return;
    this.#textAt = at;
    this.#compareArm();
    this.#showConnection();
    this.#showMotion(at);
    this.#showFacts(time);
    this.#showCounters();
    if (!this.#isPaused) this.#frames.draw(time);
  }

  #takeRecords() {
    for (let record; (record = this.#engine.takeRecord()); ) this.#frames.log.add(record, record.at / 1e6);
  }

  #takeReading() {
    const readAt = this.#engine.readAt();
    if (Number.isNaN(readAt) || readAt === this.#readAt) return;
    this.#readAt = readAt;
    const positions = this.#engine.positions();
    this.#arm3d?.setValues(this.#values(positions));
    this.#axes.forEach(({ plot, value }, axis) => {
      const isJoint = axis !== GRIPPER;
      const shown = positions[axis] * (isJoint ? DEGREES : 100);
      if (Number.isNaN(shown)) return;
      plot.history.push(readAt / 1e6, shown);
      value.textContent = isJoint ? `${shown.toFixed(1).replace('-', '−')}°` : `${shown.toFixed(0)} %`;
    });
  }

  #showConnection() {
    const port = this.#link.port;
    const state = port ? this.#engine.state() : 'closed';
    const name = port ? port.name[0].toUpperCase() + port.name.slice(1) : 'Not connected';
    const serial = this.#engine.serial();
    const parts = [name];
    if (STATE_TEXTS[state]) parts.push(STATE_TEXTS[state]);
    else if (port && serial) parts.push(serial, this.#engine.firmware());
    element('connection').dataset.state = state;
    set(element('connection-text'), parts.join(' · '));
  }

  #showMotion(at) {
    const block = this.#link.port ? this.#engine.block(at) : 'no reading';
    const isHeld = this.#axes.some((_, axis) => this.#holds.direction(axis) !== 0);
    const output = element('block');
    const { text, isWarning } = motionText(block, this.#engine.stopState(), this.#engine.torqueState());
    output.classList.toggle('warn', isWarning || (block !== null && isHeld));
    set(output, text);
  }

  #showFacts(time) {
    const engine = this.#engine;
    const celsius = engine.temperatures();
    const hottest = Math.max(...celsius);
    set(element('status'), engine.status() || '–');
    set(element('hottest'), celsius.length > 0 ? `${hottest} °C, servo ${celsius.indexOf(hottest) + 1} of ${celsius.length}` : '–');
    element('hottest').className = hottest >= HOT ? 'warn' : '';
    const check = engine.selfCheck();
    const faulty = celsius.map((_, servo) => servo).filter((servo) => !Number.isNaN(check) && !((check >> servo) & 1));
    const isKnown = !Number.isNaN(check) && celsius.length > 0;
    set(element('servos'), !isKnown ? '–' : faulty.length === 0 ? 'all normal' : `not normal: ${faulty.map((servo) => servo + 1).join(', ')}`);
    element('servos').className = isKnown && faulty.length > 0 ? 'bad' : '';
    const millis = (micros) => (micros / 1000).toFixed(1);
    const [last, shortest, longest] = engine.answerTimes();
    set(element('answer-time'), longest > 0 ? `${millis(last)} ms (${millis(shortest)} to ${millis(longest)})` : '–');
    // Answers of the last two seconds.
    const answers = engine.counters()[engine.counterLabels.indexOf('answers')];
    this.#answers.push([time, answers]);
    while (this.#answers[0][0] < time - 2) this.#answers.shift();
    const [from, before] = this.#answers[0];
    set(element('reading-rate'), time > from ? `${Math.round((answers - before) / (time - from))} per second` : '–');
  }

  #showCounters() {
    const values = this.#engine.counters();
    [...element('counters').children].forEach((row, nth) => {
      row.classList.toggle('bad', nth >= GOOD_COUNTERS && values[nth] > 0);
      set(row.lastElementChild, values[nth].toLocaleString('en'));
    });
    const faults = this.#engine.faults();
    FAULTS.forEach((fault, nth) => set(element(`fault-${fault}-count`), faults[nth].toLocaleString('en')));
  }
}

// Returns a custom property as a colour for a canvas.
function resolve(name) {
  const probe = document.createElement('span');
  probe.hidden = true;
  probe.className = 'probe';
  document.body.append(probe);
  probe.style.setProperty('color', `var(${name})`);
  const color = getComputedStyle(probe).color;
  probe.remove();
  return color;
}

function set(output, text) {
  if (output.textContent !== text) output.textContent = text;
}

try {
  new Page(await Engine.load(await fetch('armwire.wasm'))).start();
} catch (error) {
  element('connection-text').textContent = `The page cannot start: ${error.message}`;
  throw error;
}
