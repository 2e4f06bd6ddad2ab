// A port on WebSerial, at 1 Mbaud.

const OPTIONS = { baudRate: 1_000_000, bufferSize: 4096 };
// Errors of the line, after which the port reads on.
const LINE_ERRORS = ['BreakError', 'BufferOverrunError', 'FramingError', 'ParityError'];
// Frames that the port may owe: about a second of them.
const MAX_WAITING = 64;
// Timeout of the last frames, in milliseconds.
const FLUSH = 500;

export const isSupported = () => 'serial' in navigator;

// Ports that the user has granted to this page before.
export const granted = () => (isSupported() ? navigator.serial.getPorts() : Promise.resolve([]));

// The port that the user chooses; null if none.
export async function choose() {
  try {
    return await navigator.serial.requestPort();
  } catch (error) {
    if (error.name === 'NotFoundError') return null;
    throw error;
  }
}

// A name of a port: browsers tell no more than the USB ids.
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

  // Fails with the browser's error if the port cannot be opened.
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

  write(bytes) {
    if (this.#closed) return;
    if (this.#waiting >= MAX_WAITING) {
      this.#fail(`the port takes no more: ${this.#waiting} frames wait`);
      return;
    }
    this.#waiting += 1;
    this.#writer.write(bytes).then(() => { this.#waiting -= 1; }, (error) => this.#fail(error.message));
  }

  // The browser hands bytes over by itself.
  poll() {}

  // Lets the last frames leave, then closes the port.
  async close() {
    this.#closed = true;
    const flush = this.#writer.close().catch(() => {});
    await Promise.race([flush, new Promise((done) => setTimeout(done, FLUSH))]);
    await this.#reader?.cancel().catch(() => {});
    await this.#reading;
    this.#writer.releaseLock();
    await this.#port.close().catch(() => {});
  }

  async #read() {
    // After an error of the line there is a new stream.
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

  // The port is gone.
  #fail(reason) {
    if (this.#closed) return;
    this.#closed = true;
    this.onclose(reason);
    this.#writer.abort().catch(() => {});
    this.#reading?.then(() => this.#port.close()).catch(() => {});
  }
}
