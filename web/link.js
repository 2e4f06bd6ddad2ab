// A session on a port: the one place where frames go out, bytes come in, and the session's time-outs are kept.
//
// A port has `write(bytes)`, `poll()`, which hands over what has arrived, and `close()`. It calls `onbytes(bytes)` and
// `onclose(reason)`.

// Microseconds since the page was loaded.
export const now = () => performance.now() * 1000;

export class Link {
  #engine;
  #port = null;
  #timer = 0;
  #isPumping = false;
  // Called with the reason when a port closed by itself.
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
      this.#forget();
      this.onclose(reason);
    };
    this.#engine.startSession(now());
    this.pump();
  }

  // Stops the arm, hands over what is left to send, and closes the port.
  async close() {
    if (!this.#port) return;
    const port = this.#port;
    this.#engine.release(now());
    this.pump();
    this.#forget();
    await port.close();
  }

  // Sends what is due. To be called after each action of the user, too.
  pump() {
    if (!this.#port || this.#isPumping) return;
    this.#isPumping = true;
    clearTimeout(this.#timer);
    // Received bytes go in first: an answer is late only if it arrived late.
    try {
      this.#port.poll();
      this.#transmit();
    } finally {
      this.#isPumping = false;
    }
  }

  #transmit() {
    for (let frame; (frame = this.#engine.transmit(now())).length > 0; ) {
      // A frame is one write: half a frame never waits for the page.
      this.#port.write(frame);
      if (!this.#port) return;
    }
    const timeout = this.#engine.timeout();
    if (timeout !== Infinity) this.#timer = setTimeout(() => this.pump(), Math.max(0, (timeout - now()) / 1000));
  }

  #forget() {
    clearTimeout(this.#timer);
    this.#port = null;
  }
}
