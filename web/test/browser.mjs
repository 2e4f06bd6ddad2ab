// A headless Chromium with the page, and functions that read the page.
import assert from 'node:assert/strict';
import { chromium } from 'playwright-core';

// WebGL by software. The sandbox needs privileges that a container does not have.
export const ARGUMENTS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'];

export const EXECUTABLE = process.env.CHROMIUM ?? '/usr/bin/chromium';

export const launch = () => chromium.launch({ executablePath: EXECUTABLE, args: ARGUMENTS });

// Opens the page in a context of its own. `problems` collects errors of the page and requests to other hosts.
export async function open(browser, address, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, ...options });
  const page = await context.newPage();
  const problems = [];
  page.on('console', (message) => ['error', 'warning'].includes(message.type()) && problems.push(message.text()));
  page.on('pageerror', (error) => problems.push(String(error)));
  page.on('request', (request) => {
    if (!request.url().startsWith(address) && !request.url().startsWith('data:')) problems.push(`request: ${request.url()}`);
  });
  page.on('response', (response) => response.status() >= 400 && problems.push(`${response.status()}: ${response.url()}`));
  await page.goto(address);
  return { context, page, problems };
}

// Waits until `is` accepts the result of `read`, and returns it.
export async function until(what, read, is) {
  const end = Date.now() + 20_000;
  let value;
  do {
    value = await read();
    if (is(value)) return value;
    await new Promise((done) => setTimeout(done, 50));
  } while (Date.now() < end);
  return assert.fail(`${what}: still ${JSON.stringify(value)} after 20 s`);
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

export const ready = (page) => until('connection', () => page.getAttribute('#connection', 'data-state'), (state) => state === 'answering');
