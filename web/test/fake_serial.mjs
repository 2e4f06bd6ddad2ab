// A WebSerial in the page whose port a test unplugs and plugs in again. A virtual arm is on the port.

// Replaces `navigator.serial`. It runs in the page, before the page's modules.
export function fakeSerial() {
  const READ_INFO = 0x01;

  class Port {
    // Command and function of each frame, once.
    kinds = new Set();
    readable = null;
    writable = null;
    #product;
    #info;
    #isBusy;
    #incoming;

    // `info` replaces the arm's answer about itself. Another program has a busy port.
    constructor({ product = 1, info = null, isBusy = false } = {}) {
      this.#product = product;
      this.#info = info;
      this.#isBusy = isBusy;
    }

    getInfo() { return { usbVendorId: 0x1209, usbProductId: this.#product }; }

    async open() {
      if (this.#isBusy) throw new DOMException('Failed to open serial port.', 'NetworkError');
      const [{ Engine }, { VirtualPort }] = await Promise.all([import('/engine.js'), import('/virtual.js')]);
      const arm = new VirtualPort(await Engine.load(await fetch('/armwire.wasm')), 1, 'ideal');
      this.readable = new ReadableStream({ start: (controller) => { this.#incoming = controller; } });
      arm.onbytes = (bytes) => this.#incoming.enqueue(bytes);
      this.writable = new WritableStream({
        write: (frame) => {
          this.kinds.add(`${frame[1]} ${frame[2]}`);
          if (frame[1] === READ_INFO && this.#info) this.#incoming.enqueue(Uint8Array.from(this.#info));
          else arm.write(frame);
        },
      });
    }

    async close() { this.readable = null; }

    lose() {
      this.readable = null;
      this.#incoming.error(new DOMException('The device has been lost.', 'NetworkError'));
    }
  }

  const serial = new EventTarget();
  let port = new Port();
  serial.getPorts = async () => (port ? [port] : []);
  Object.defineProperty(navigator, 'serial', { value: serial });
  window.fakeSerial = {
    unplug() {
      port.lose();
      port = null;
    },
    // The port has a new object, as in Chromium.
    plugIn(device) {
      port = new Port(device);
      const event = new Event('connect');
      Object.defineProperty(event, 'target', { value: port });
      serial.dispatchEvent(event);
    },
    kinds: () => [...port.kinds].sort(),
    isOpen: () => port.readable !== null,
  };
}
