// The faults of the virtual arm's line: sliders, and what their places mean.

export const FAULTS = ['drop', 'corrupt', 'duplicate', 'delay', 'noise'];
const MILLION = 1_000_000;

// Cables to choose from, as places of the sliders.
export const CABLES = {
  good: { drop: 0, corrupt: 0, duplicate: 0, delay: 0, noise: 0 },
  noisy: { drop: 20, corrupt: 55, duplicate: 0, delay: 0, noise: 50 },
  loose: { drop: 68, corrupt: 45, duplicate: 0, delay: 0, noise: 35 },
  slow: { drop: 0, corrupt: 0, duplicate: 0, delay: 62, noise: 0 },
};

// With this one, every byte is lost.
export const UNPLUGGED = 'unplugged';

// The rate at a place of a slider, 0 to 100: none at 0, then 0.001 % to 10 % of the bytes, each quarter ten times as many.
export const rateAt = (position) => (position <= 0 ? 0 : Math.round(10 ** (1 + position / 25)));

// A rate in parts per million as text.
export function percent(ppm) {
  if (ppm === 0) return 'none';
  return `${Number((ppm / 10_000).toPrecision(2))} %`;
}

// The rates of all faults, from the places of the sliders.
export const rates = (places) => Object.fromEntries(FAULTS.map((fault) => [fault, rateAt(places[fault])]));

export const UNPLUGGED_RATES = { ...rates(CABLES.good), drop: MILLION };
