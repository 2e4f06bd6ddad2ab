// A port of the virtual arm in the engine, in real time.

import { now } from './link.js';

export class VirtualPort {
  #engine;
  #timer = 0;
  onbytes = () => {};
  onclose = () => {};

  constructor(engine, seed, plant) {
    this.#engine = engine;
    engine.startVirtual(seed, plant);
  }

  get name() { return 'virtual arm'; }

  write(bytes) {
    this.#engine.virtualReceive(now(), bytes);
    this.#schedule();
  }

  async close() { clearTimeout(this.#timer); }

  // Bytes are delivered outside of `write`, as on a serial port.
  #schedule() {
    clearTimeout(this.#timer);
    const timeout = this.#engine.virtualTimeout();
    if (timeout !== Infinity) this.#timer = setTimeout(() => this.poll(), Math.max(0, (timeout - now()) / 1000));
  }

  poll() {
    const bytes = this.#engine.virtualTransmit(now());
    this.#schedule();
    if (bytes.length > 0) this.onbytes(bytes);
  }
}
