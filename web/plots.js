// A plot of a quantity over the last seconds, on a canvas.

const SECONDS = 20;
// Longest gap between readings that a line spans, in seconds.
const GAP = 0.5;
const MAX_SAMPLES = 4000;

// Samples of the last seconds: pairs of a time in seconds and a value.
export class History {
  samples = [];

  push(time, value) {
    this.samples.push([time, value]);
    const oldest = time - SECONDS - 1;
    let stale = 0;
    while (stale < this.samples.length && this.samples[stale][0] < oldest) stale += 1;
    // Removed in blocks: a removal moves all remaining samples.
    if (stale > 200 || this.samples.length > MAX_SAMPLES) this.samples.splice(0, Math.max(stale, this.samples.length - MAX_SAMPLES));
  }

  clear() { this.samples = []; }
}

// The value range of a plot: at least `span`, within `limits` if given.
export function range(samples, span, limits) {
  let [low, high] = [Infinity, -Infinity];
  for (const [, value] of samples) {
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) [low, high] = [0, 0];
  const half = Math.max((high - low) * 1.15, span) / 2;
  const middle = (low + high) / 2;
  const [least, most] = limits;
  return [Math.max(middle - half, least), Math.min(middle + half, most)];
}

export class Plot {
  #canvas;
  #span;
  #limits;
  #width = 0;
  #height = 0;
  history = new History();

  // `span` is the minimum range of the plot, `limits` the range of the quantity.
  constructor(canvas, { span, limits }) {
    this.#canvas = canvas;
    this.#span = span;
    this.#limits = limits;
    new ResizeObserver(() => this.#resize()).observe(canvas);
    this.#resize();
  }

  #resize() {
    this.#width = this.#canvas.clientWidth;
    this.#height = this.#canvas.clientHeight;
    const ratio = Math.min(window.devicePixelRatio, 2);
    this.#canvas.width = Math.round(this.#width * ratio);
    this.#canvas.height = Math.round(this.#height * ratio);
  }

  // Draws the seconds before `time`.
  draw(time, { line, grid }) {
    const context = this.#canvas.getContext('2d');
    const [width, height] = [this.#width, this.#height];
    const ratio = this.#canvas.width / width || 1;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const start = time - SECONDS;
    const samples = this.history.samples.filter(([at]) => at >= start);
    const [low, high] = range(samples, this.#span, this.#limits);
    const x = (at) => ((at - start) / SECONDS) * (width - 4);
    const y = (value) => height - 4 - ((value - low) / (high - low || 1)) * (height - 8);

    context.strokeStyle = grid;
    context.lineWidth = 1;
    context.beginPath();
    for (let second = Math.ceil(start / 5) * 5; second <= time; second += 5) {
      const at = Math.round(x(second)) + 0.5;
      context.moveTo(at, 0);
      context.lineTo(at, height);
    }
    context.stroke();
    if (low < 0 && high > 0) {
      context.setLineDash([3, 3]);
      context.beginPath();
      context.moveTo(0, Math.round(y(0)) + 0.5);
      context.lineTo(width, Math.round(y(0)) + 0.5);
      context.stroke();
      context.setLineDash([]);
    }

    context.strokeStyle = line;
    context.lineWidth = 1.75;
    context.lineJoin = 'round';
    context.beginPath();
    let last = -Infinity;
    for (const [at, value] of samples) {
      if (at - last > GAP) context.moveTo(x(at), y(value));
      else context.lineTo(x(at), y(value));
      last = at;
    }
    context.stroke();
    const newest = samples.at(-1);
    if (newest) {
      context.fillStyle = line;
      context.beginPath();
      context.arc(x(newest[0]), y(newest[1]), 2.5, 0, 2 * Math.PI);
      context.fill();
    }
  }
}
