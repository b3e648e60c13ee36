// Playing: how fast, through what, and which moment is next.

/** @import { Span } from "../../../../types.d.ts" */
/** @import { Stretch } from "./window.js" */

/** What the speeds are called that may be chosen, by what they are: samples or seconds that pass in one. */
export const SPEEDS = /** @type {const} */ ([
  ["1 sample", "1 sample/s"], ["2 samples", "2 samples/s"], ["5 samples", "5 samples/s"], ["10 samples", "10 samples/s"],
  ["30 samples", "30 samples/s"], ["600", "10 min/s"], ["1800", "30 min/s"], ["3600", "1 h/s"], ["21600", "6 h/s"], ["86400", "1 d/s"],
]);

/**
 * Seconds that pass in one.
 * @param {string} text seconds, or a number of samples
 * @param {number} interval
 */
export const speedOf = (text, interval) => Number.parseFloat(text) * (text.includes("sample") ? interval : 1);

/**
 * The next faster or slower speed, the same at the end.
 * @param {string} text
 * @param {1 | -1} direction
 * @param {number} interval
 */
export function otherSpeed(text, direction, interval) {
  const speeds = SPEEDS.map(([value]) => value).sort((one, other) => speedOf(one, interval) - speedOf(other, interval));
  const here = speedOf(text, interval);
  const beyond = speeds.filter((value) => direction * (speedOf(value, interval) - here) > 1e-9);
  return (direction > 0 ? beyond[0] : beyond.at(-1)) ?? text;
}

/**
 * A loop between two moments: in order, within what is offered, a sample at least.
 * @param {number} one
 * @param {number} other
 * @param {Span} span
 * @param {number} interval
 * @returns {Stretch}
 */
export function loopOf(one, other, { first, stop }, interval) {
  const begin = Math.max(first, Math.min(one, other, stop - interval));
  return [begin, Math.max(begin + interval, Math.min(stop, Math.max(one, other)))];
}

/**
 * The moment that is next: round and round in the loop where there is one, else in all there is.
 * @param {number} time
 * @param {number} seconds that have passed
 * @param {Stretch | null} loop
 * @param {Span} span
 */
export function next(time, seconds, loop, { first, stop }) {
  const [low, high] = loop ?? [first, stop];
  if (time < low || time > high) return low;
  const moment = time + seconds;
  return moment > high ? low + ((moment - low) % (high - low)) : moment;
}
