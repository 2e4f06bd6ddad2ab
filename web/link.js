// A session on a port. It writes frames, reads bytes, and keeps the session's timers.
//
// A port has `write(bytes)`, `poll()`, which passes on received bytes, and `close()`. It calls `onbytes(bytes)` and
// `onclose(reason)`.

// Microseconds since the page was loaded.
export const now = () => performance.now() * 1000;

export class Link {
  #engine;
  #port = null;
  #timer = 0;
  #isPumping = false;
  // Called with the reason when a port closes unexpectedly.
  onclose = () => {};

  constructor(engine) { this.#engine = engine; }

  get port() { return this.#port; }

  open(port) {
    this.#port = port;
    port.onbytes = (bytes) => {
      this.#engine.receive(now(), bytes);
      this.pump();
    };
    port.onclose = (reason) => {
      if (this.#port !== port) return;
      this.#detach();
      this.onclose(reason);
    };
    this.#engine.startSession(now());
    this.pump();
  }

  // Stops the arm, sends the remaining frames, and closes the port.
  async close() {
    if (!this.#port) return;
    const port = this.#port;
    this.#engine.release(now());
    this.pump();
    this.#detach();
    await port.close();
  }

  // Sends the frames that are due. Call it after each user action, too.
  pump() {
    if (!this.#port || this.#isPumping) return;
    this.#isPumping = true;
    clearTimeout(this.#timer);
    // Received bytes are processed first, so that only late answers count as late.
    try {
      this.#port.poll();
      this.#transmit();
    } finally {
      this.#isPumping = false;
    }
  }

  #transmit() {
    for (let frame; (frame = this.#engine.transmit(now())).length > 0; ) {
      // Each frame is one write, so that the page never delays half a frame.
      this.#port.write(frame);
      if (!this.#port) return;
    }
    const timeout = this.#engine.timeout();
    if (timeout !== Infinity) this.#timer = setTimeout(() => this.pump(), Math.max(0, (timeout - now()) / 1000));
  }

  #detach() {
    clearTimeout(this.#timer);
    this.#port = null;
  }
}
