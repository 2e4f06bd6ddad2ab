// A WebSerial port at 1 Mbaud.

const OPTIONS = { baudRate: 1_000_000, bufferSize: 4096 };
// Line errors after which reading continues.
const LINE_ERRORS = ['BreakError', 'BufferOverrunError', 'FramingError', 'ParityError'];
// Maximum number of queued frames: about one second.
const MAX_WAITING = 64;
// Timeout for the last frames, in milliseconds.
const FLUSH = 500;

export const isSupported = () => 'serial' in navigator;

// Returns the ports that the user has granted to this page.
export const granted = () => (isSupported() ? navigator.serial.getPorts() : Promise.resolve([]));

// Returns the port that the user selects; null without a selection.
export async function choose() {
  try {
    return await navigator.serial.requestPort();
  } catch (error) {
    if (error.name === 'NotFoundError') return null;
    throw error;
  }
}

// Calls `back` with each granted port that is plugged in.
export function listenToPorts(back) {
  if (isSupported()) navigator.serial.addEventListener('connect', (event) => back(event.target));
}

// Returns a name for a port. Browsers provide only the USB ids.
export function nameOf(port) {
  const { usbVendorId, usbProductId } = port.getInfo();
  const hex = (id) => id.toString(16).padStart(4, '0');
  return usbVendorId === undefined ? 'serial port' : `USB ${hex(usbVendorId)}:${hex(usbProductId ?? 0)}`;
}

export class SerialPort {
  #port;
  #writer;
  #reader = null;
  #waiting = 0;
  #closed = false;
  #reading;
  // Line errors since the port was opened.
  lineErrors = 0;
  onbytes = () => {};
  onclose = () => {};

  // Throws the browser's error if the port cannot be opened.
  static async open(port) {
    await port.open(OPTIONS);
    return new SerialPort(port);
  }

  constructor(port) {
    this.#port = port;
    this.#writer = port.writable.getWriter();
    this.#reading = this.#read();
  }

  get name() { return nameOf(this.#port); }

  // Whether this port is back as `port`. A USB device that is plugged in again has a new object in Chromium, and a page
  // learns only its USB ids. The arm's serial number shows afterwards whether it is another arm.
  isBackAs(port) {
    const isUsb = port.getInfo().usbVendorId !== undefined;
    return port === this.#port || (isUsb && nameOf(port) === this.name);
  }

  write(bytes) {
    if (this.#closed) return;
    if (this.#waiting >= MAX_WAITING) {
      this.#fail(`the port does not accept bytes: ${this.#waiting} frames are queued`);
      return;
    }
    this.#waiting += 1;
    this.#writer.write(bytes).then(() => { this.#waiting -= 1; }, (error) => this.#fail(error.message));
  }

  // Does nothing: the browser delivers bytes by itself.
  poll() {}

  // Waits for the last frames, then closes the port.
  async close() {
    this.#closed = true;
    const flush = this.#writer.close().catch(() => {});
    await Promise.race([flush, new Promise((done) => setTimeout(done, FLUSH))]);
    await this.#release();
  }

  // Closes the port. A port with a locked stream would stay open.
  async #release() {
    await this.#reader?.cancel().catch(() => {});
    await this.#reading;
    this.#writer.releaseLock();
    await this.#port.close().catch(() => {});
  }

  async #read() {
    // A line error ends the stream; the next iteration opens a new one.
    while (this.#port.readable && !this.#closed) {
      this.#reader = this.#port.readable.getReader();
      try {
        for (;;) {
          const { value, done } = await this.#reader.read();
          if (done) break;
          if (!this.#closed) this.onbytes(value);
        }
      } catch (error) {
        if (!LINE_ERRORS.includes(error.name)) {
          this.#fail(error.message);
          return;
        }
        this.lineErrors += 1;
      } finally {
        this.#reader.releaseLock();
      }
    }
  }

  // Reports a lost port.
  #fail(reason) {
    if (this.#closed) return;
    this.#closed = true;
    this.onclose(reason);
    this.#writer.abort().catch(() => {});
    this.#release();
  }
}
