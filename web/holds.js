// Held keys and buttons. Each moves an axis in one direction while held.

// Physical keys, side by side on every keyboard layout: the upper row moves up, the row below it down.
export const KEYS = new Map([
  ['KeyQ', [0, 1]], ['KeyW', [1, 1]], ['KeyE', [2, 1]], ['KeyR', [3, 1]], ['KeyT', [4, 1]], ['KeyY', [5, 1]], ['KeyU', [6, 1]],
  ['KeyA', [0, -1]], ['KeyS', [1, -1]], ['KeyD', [2, -1]], ['KeyF', [3, -1]], ['KeyG', [4, -1]], ['KeyH', [5, -1]], ['KeyJ', [6, -1]],
]);
// Modifier keys: while one is down, some systems do not report the release of other keys.
const MODIFIERS = ['Alt', 'AltGraph', 'Control', 'Meta', 'OS'];
const WRITING = 'input:not([type=range], [type=checkbox], [type=radio]), select, textarea, [contenteditable]';

export class Holds {
  #sources = new Map();
  // Called with an axis and its direction, -1, 0 or 1, on each change.
  onchange = () => {};

  // Records that a source, such as a key, holds an axis.
  press(source, axis, direction) {
    this.#change(() => this.#sources.set(source, { axis, direction }));
  }

  release(source) {
    this.#change(() => this.#sources.delete(source));
  }

  releaseAll() {
    this.#change(() => this.#sources.clear());
  }

  // Opposite directions cancel each other.
  direction(axis) {
    let sum = 0;
    for (const held of this.#sources.values()) if (held.axis === axis) sum += held.direction;
    return Math.sign(sum);
  }

  #change(act) {
    const axes = new Set([...this.#sources.values()].map(({ axis }) => axis));
    const before = new Map([...axes].map((axis) => [axis, this.direction(axis)]));
    act();
    for (const { axis } of this.#sources.values()) if (!before.has(axis)) before.set(axis, 0);
    for (const [axis, direction] of before) {
      if (this.direction(axis) !== direction) this.onchange(axis, this.direction(axis));
    }
  }
}

// Connects the page's keys to axes. Any event that may hide a key's release releases all.
export function listenToKeys(holds, page) {
  page.addEventListener('keydown', (event) => {
    if (event.key === 'Escape' || MODIFIERS.includes(event.key)) holds.releaseAll();
    const key = KEYS.get(event.code);
    const isOther = event.ctrlKey || event.altKey || event.metaKey || event.repeat;
    if (!key || isOther || event.target.closest?.(WRITING) || page.querySelector('dialog[open]')) return;
    event.preventDefault();
    holds.press(event.code, ...key);
  });
  page.addEventListener('keyup', (event) => holds.release(event.code));
  page.addEventListener('visibilitychange', () => holds.releaseAll());
  page.defaultView.addEventListener('blur', () => holds.releaseAll());
  page.defaultView.addEventListener('pagehide', () => holds.releaseAll());
}

// Connects a button to an axis, for pointer, Space and Enter.
export function listenToButton(holds, button, axis, direction) {
  whilePressed(button, () => holds.press(button, axis, direction), () => holds.release(button));
}

// Calls `down` and `up` around each press of a button.
export function whilePressed(button, down, up) {
  button.addEventListener('pointerdown', (event) => {
    if (event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    down();
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture', 'blur']) button.addEventListener(end, up);
  button.addEventListener('keydown', (event) => {
    if (event.key !== ' ' && event.key !== 'Enter') return;
    event.preventDefault();
    if (!event.repeat) down();
  });
  button.addEventListener('keyup', (event) => {
    if (event.key === ' ' || event.key === 'Enter') up();
  });
  // A long touch opens a menu, which would hide the end of the touch.
  button.addEventListener('contextmenu', (event) => event.preventDefault());
}
