// Ticks on whole local hours, days and weeks, and what they are labelled with.

import { clockText, dayText, offsetOf } from "./words.js";

const DAY = 86400;
const MONDAY = 4 * DAY; // the epoch was a Thursday
const STEPS = [
  60, 300, 900, 1800, 3600, 7200, 10800, 21600, 43200, DAY, 2 * DAY, 7 * DAY, 14 * DAY, 28 * DAY, 84 * DAY, 168 * DAY, 364 * DAY,
];
const MAX_TICKS = 200;

/**
 * The least step in seconds that fits into a range no more often than so.
 * @param {number} length
 * @param {number} most
 */
export function stepOf(length, most) {
  return STEPS.find((step) => length / step <= most) ?? Math.ceil(length / most / (364 * DAY)) * 364 * DAY;
}

/**
 * The moments of [low, high] at which the local clock shows a whole multiple of a step, ascending.
 * @param {number} low
 * @param {number} high
 * @param {number} step
 * @param {string} zone
 * @returns {number[]}
 */
export function ticksOf(low, high, step, zone) {
  /** @type {number[]} */
  const ticks = [];
  const offset = offsetOf(low, zone);
  let local = Math.ceil((low + offset - MONDAY) / step) * step + MONDAY;
  for (let i = 0; i < MAX_TICKS; i++, local += step) {
    const time = local - offsetOf(local - offset, zone);
    if (time > high) break;
    if (time >= low) ticks.push(time);
  }
  return ticks;
}

/**
 * The label of each tick: the clock, with the day below it where another one begins; days alone where steps are days.
 * @param {number[]} ticks
 * @param {string} zone
 * @returns {string[]}
 */
export function tickTexts(ticks, zone) {
  const days = ticks.length > 1 && ticks[1] - ticks[0] >= DAY - 3600;
  let before = "";
  return ticks.map((time) => {
    const day = dayText(time, zone);
    const text = days ? day : day === before ? clockText(time, zone, false) : `${clockText(time, zone, false)}\n${day}`;
    before = day;
    return text;
  });
}

/** Half of the width of a letter on an axis, in pixels. */
const HALF_LETTER_PX = 3.5;

/**
 * The same texts, without those that would be cut off at the right end of an axis; a text is centred on its tick.
 * @param {string[]} texts
 * @param {number[]} ticks
 * @param {number} high the end of the axis
 * @param {number} perPixel what a pixel is of it
 * @param {number} room pixels that are free behind its end
 * @returns {string[]}
 */
export function fitting(texts, ticks, high, perPixel, room) {
  const half = (/** @type {string} */ text) => HALF_LETTER_PX * Math.max(...text.split("\n").map((line) => line.length));
  return texts.map((text, i) => ((high - ticks[i]) / perPixel + room < half(text) ? "" : text));
}
