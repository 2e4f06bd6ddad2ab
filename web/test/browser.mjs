// A headless Chromium with the page, and functions that read the page.
import assert from 'node:assert/strict';
import { chromium } from 'playwright-core';

// WebGL by software. The sandbox needs privileges that a container does not have.
export const ARGUMENTS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'];

export const EXECUTABLE = process.env.CHROMIUM ?? '/usr/bin/chromium';

// Time of a stopped clock, in milliseconds. It is later than the time of the empty page, whose clock runs.
const STOPPED_AT = 3_600_000;
// Period of reading in `poll`, and its timeout, in milliseconds.
const POLL_PERIOD = 50;
const POLL_TIMEOUT = 20_000;

export const launch = () => chromium.launch({ executablePath: EXECUTABLE, args: ARGUMENTS });

// Opens the page in a context of its own. `problems` collects errors of the page and requests to other hosts.
// With `stopClock`, time passes on the page only by `page.clock`. The function `script` runs before the page's modules.
export async function open(browser, address, { stopClock = false, plant = 'ideal', script = () => {}, ...options } = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, ...options });
  const page = await context.newPage();
  if (stopClock) await page.clock.pauseAt(STOPPED_AT);
  await page.addInitScript(script);
  const problems = [];
  page.on('console', (message) => ['error', 'warning'].includes(message.type()) && problems.push(message.text()));
  page.on('pageerror', (error) => problems.push(String(error)));
  page.on('request', (request) => {
    if (!request.url().startsWith(address) && !request.url().startsWith('data:')) problems.push(`request: ${request.url()}`);
  });
  page.on('response', (response) => response.status() >= 400 && problems.push(`${response.status()}: ${response.url()}`));
  await page.goto(`${address}?plant=${plant}`);
  // The page shows its counters when it starts.
  await page.locator('#counters div').first().waitFor();
  return { context, page, problems };
}

// Reads until `is` accepts the result, and returns it. `wait` lets a number of milliseconds pass.
export async function poll(wait, what, read, is) {
  let value;
  for (let waited = 0; waited < POLL_TIMEOUT; waited += POLL_PERIOD) {
    value = await read();
    if (is(value)) return value;
    await wait(POLL_PERIOD);
  }
  return assert.fail(`${what}: still ${JSON.stringify(value)} after ${POLL_TIMEOUT / 1000} s`);
}

export const text = (page, selector) => page.locator(selector).innerText();

// The value of an axis as a number; NaN if unknown.
export async function position(page, axis) {
  const value = await page.locator('.axis-value').nth(axis).innerText();
  return Number.parseFloat(value.replace('−', '-'));
}

// A counter of the line by its label.
export async function counter(page, label) {
  const row = page.locator('#counters div').filter({ hasText: label });
  return Number((await row.locator('dd').innerText()).replaceAll(',', ''));
}

// The state of the connection; `answering` once the arm has answered.
export const state = (page) => page.getAttribute('#connection', 'data-state');

export const ready = (wait, page) => poll(wait, 'state', () => state(page), (value) => value === 'answering');
