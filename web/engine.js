// The engine: the WebAssembly module with JavaScript values for numbers, bytes and texts. Times are in microseconds.

export const JOINTS = 6;
export const GRIPPER = 6;
export const AXES = 7;

// The numbers of `State`, `Block`, `StopState`, `TorqueState` and `Event` in web/engine/src.
export const STATES = ['listening', 'silent', 'answering', 'older generation'];
export const BLOCKS = [null, 'disabled', 'no reading', 'torque off', 'out of range', 'unknown status', 'another robot'];
export const STOPS = [null, 'stopping', 'stopped', 'grip may loosen', 'without torque', 'failed'];
export const TORQUES = [null, 'switching', 'confirmed', 'not shown', 'contradicted', 'no reading'];
export const EVENTS = [null, 'sent', 'received', 'unknown', 'noise', 'unanswered'];

export class Engine {
  #wasm;
  #engine;

  // Loads the module from its bytes, or from a response with them.
  static async load(source) {
    const { instance } = source instanceof Response
      ? await WebAssembly.instantiateStreaming(source)
      : await WebAssembly.instantiate(source);
    return new Engine(instance.exports);
  }

  constructor(wasm) {
    this.#wasm = wasm;
    this.#engine = wasm.engine_new();
    this.counterLabels = this.#labels(wasm.counter_label);
    this.faultLabels = this.#labels(wasm.virtual_fault_label);
  }

  // A session with an arm.

  startSession(now) { this.#wasm.session_start(this.#engine, now); }
  receive(now, bytes) { this.#chunks(bytes, (length) => this.#wasm.session_receive(this.#engine, now, length)); }
  // Returns the next frame for the arm; empty without a frame.
  transmit(now) { return this.#bytes(this.#wasm.session_transmit(this.#engine, now)); }
  // Returns the time of the next call of `transmit`; Infinity without a timeout.
  timeout() { return this.#wasm.session_timeout(this.#engine); }

  hold(now, axis, direction) {
    if (!this.#wasm.session_hold(this.#engine, now, axis, direction)) throw new RangeError(`axis ${axis} does not exist`);
  }
  release(now) { this.#wasm.session_release(this.#engine, now); }
  stop(now) { this.#wasm.session_stop(this.#engine, now); }
  enableMotion(now, enabled) { this.#wasm.session_enable_motion(this.#engine, now, enabled); }
  // Radians per second.
  setSpeed(speed) {
    if (!this.#wasm.session_set_speed(this.#engine, speed)) throw new RangeError(`speed ${speed} rad/s is out of range`);
  }
  setTorque(now, on) { this.#wasm.session_set_torque(this.#engine, now, on); }

  state() { return STATES[this.#wasm.session_state(this.#engine)]; }
  stopState() { return STOPS[this.#wasm.session_stop_state(this.#engine)]; }
  torqueState() { return TORQUES[this.#wasm.session_torque_state(this.#engine)]; }
  block(now) { return BLOCKS[this.#wasm.session_block(this.#engine, now)]; }

  // The arm's last readings. Missing numbers are NaN, missing texts are empty.

  // Joints in radians, the gripper as a fraction of its stroke.
  positions() { return Array.from({ length: AXES }, (_, axis) => this.#wasm.arm_position(this.#engine, axis)); }
  readAt() { return this.#wasm.arm_read_at(this.#engine); }
  // Temperature of each servo of the arm, in °C.
  temperatures() {
    const celsius = Array.from({ length: 10 }, (_, servo) => this.#wasm.arm_temperature(this.#engine, servo));
    return celsius.filter((value) => !Number.isNaN(value));
  }
  // Millimetres.
  stroke() { return this.#wasm.arm_stroke(this.#engine); }
  // Bit 0 is servo 1, 1 is normal.
  selfCheck() { return this.#wasm.arm_self_check(this.#engine); }
  status() { return this.#text(this.#wasm.arm_text(this.#engine, 0)); }
  serial() { return this.#text(this.#wasm.arm_text(this.#engine, 1)); }
  firmware() { return this.#text(this.#wasm.arm_text(this.#engine, 2)); }

  // The line.

  counters() { return this.counterLabels.map((_, nth) => this.#wasm.counter_value(this.#engine, nth)); }
  // Response times in microseconds: the last, the shortest, the longest.
  answerTimes() { return [0, 1, 2].map((which) => this.#wasm.answer_time(this.#engine, which)); }
  // Returns the next record of the log; null without a record.
  takeRecord() {
    const event = this.#wasm.record_take(this.#engine);
    if (event === 0) return null;
    return {
      event: EVENTS[event],
      at: this.#wasm.record_at(this.#engine),
      bytes: this.#bytes(this.#wasm.record_bytes(this.#engine)),
      text: this.#text(this.#wasm.record_text(this.#engine)),
    };
  }

  // The virtual arm.

  // Throws the reason why the text of a plant is wrong. An empty text is the default plant.
  startVirtual(seed, plant = '') {
    const bytes = new TextEncoder().encode(plant);
    this.#input().set(bytes);
    const reason = this.#text(this.#wasm.virtual_start(this.#engine, seed, bytes.length));
    if (reason) throw new RangeError(reason);
  }
  virtualReceive(now, bytes) { this.#chunks(bytes, (length) => this.#wasm.virtual_receive(this.#engine, now, length)); }
  virtualTransmit(now) { return this.#bytes(this.#wasm.virtual_transmit(this.#engine, now)); }
  virtualTimeout() { return this.#wasm.virtual_timeout(this.#engine); }
  // Parts per million of the bytes.
  setFaults({ drop, corrupt, duplicate, delay, noise }) {
    this.#wasm.virtual_set_faults(this.#engine, drop, corrupt, duplicate, delay, noise);
  }
  faults() { return this.faultLabels.map((_, nth) => this.#wasm.virtual_fault_count(this.#engine, nth)); }

  // The buffer that the engine reads. The view is new for each use: the memory may have grown.
  #input() { return new Uint8Array(this.#wasm.memory.buffer, this.#wasm.input(this.#engine), this.#wasm.buffer_length()); }

  // Copies bytes to the input, in chunks of its size.
  #chunks(bytes, take) {
    const room = this.#wasm.buffer_length();
    for (let start = 0; start < bytes.length; start += room) {
      const chunk = bytes.subarray(start, start + room);
      this.#input().set(chunk);
      if (!take(chunk.length)) throw new RangeError(`the engine rejected ${chunk.length} bytes`);
    }
  }

  // Returns a copy of the output.
  #bytes(length) {
    if (length === 0) return new Uint8Array(0);
    return new Uint8Array(this.#wasm.memory.buffer, this.#wasm.output(this.#engine), length).slice();
  }

  #text(length) { return new TextDecoder().decode(this.#bytes(length)); }

  #labels(label) {
    const labels = [];
    for (let text; (text = this.#text(label(this.#engine, labels.length))); ) labels.push(text);
    return labels;
  }
}
