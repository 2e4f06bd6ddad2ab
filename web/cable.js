// The faults of the virtual arm's line, set by sliders.

export const FAULTS = ['drop', 'corrupt', 'duplicate', 'delay', 'noise'];
const MILLION = 1_000_000;

// Presets: slider positions by name.
export const CABLES = {
  good: { drop: 0, corrupt: 0, duplicate: 0, delay: 0, noise: 0 },
  noisy: { drop: 20, corrupt: 55, duplicate: 0, delay: 0, noise: 50 },
  loose: { drop: 68, corrupt: 45, duplicate: 0, delay: 0, noise: 35 },
  slow: { drop: 0, corrupt: 0, duplicate: 0, delay: 62, noise: 0 },
};

// Preset with 100 % lost bytes.
export const UNPLUGGED = 'unplugged';

// The rate at a slider position, 0 to 100: 0 at 0, then 0.001 % to 10 % of the bytes, a factor of 10 per quarter.
export const rateAt = (position) => (position <= 0 ? 0 : Math.round(10 ** (1 + position / 25)));

// Formats a rate in parts per million.
export function percent(ppm) {
  if (ppm === 0) return 'none';
  return `${Number((ppm / 10_000).toPrecision(2))} %`;
}

// Returns the rates of all faults from the slider positions.
export const rates = (places) => Object.fromEntries(FAULTS.map((fault) => [fault, rateAt(places[fault])]));

export const UNPLUGGED_RATES = { ...rates(CABLES.good), drop: MILLION };
