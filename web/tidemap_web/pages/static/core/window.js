// What a timeline covers: a day, a week, all there is, or what was zoomed to.

import { fromLocal, zoneOf } from "./time.js";
import { offsetOf } from "./words.js";
/** @import { Span, ViewState } from "../../../../types.d.ts" */

/** @typedef {[number, number]} Stretch from and to, in Unix seconds */
/** @typedef {"begin" | "end" | "all" | "new"} Grip what of a stretch is held */

const DAY = 86400;
const MONDAY = 4 * DAY; // the epoch was a Thursday
const MIN_SAMPLES = 4;

/**
 * What the timeline covers: what was zoomed to, all, or the local day or week that holds the moment.
 * @param {Pick<ViewState, "grid" | "reach" | "span" | "time" | "zone">} view
 * @returns {Stretch}
 */
export function windowOf({ grid, reach, span, time, zone }) {
  if (!grid?.span) return [0, 0];
  if (span) return span;
  const { first, stop } = grid.span;
  const chosen = reach ?? (stop - first > 15 * DAY ? "week" : "all");
  if (chosen === "all") return allOf(grid.span, grid.interval_s);
  const shown = zoneOf(zone, grid.time_zone);
  const [length, anchor] = chosen === "day" ? [DAY, 0] : [7 * DAY, MONDAY];
  const moment = time ?? grid.span.last;
  const local = moment + offsetOf(moment, shown);
  const start = Math.floor((local - anchor) / length) * length + anchor;
  return [fromLocal(start, shown), fromLocal(start + length, shown)];
}

/**
 * All there is, a sample at least.
 * @param {Span} span
 * @param {number} interval
 * @returns {Stretch}
 */
export const allOf = ({ first, stop }, interval) => [first, Math.max(stop, first + interval)];

/**
 * Zoomed by a factor around a moment, no closer than a few samples and no further than all there is.
 * @param {Stretch} covered
 * @param {number} factor
 * @param {number} around
 * @param {Span} span
 * @param {number} interval
 * @returns {Stretch}
 */
export function zoomed([low, high], factor, around, { first, stop }, interval) {
  const least = MIN_SAMPLES * interval;
  const length = Math.min(Math.max(stop - first, least), Math.max(least, (high - low) * factor));
  const start = around - ((around - low) / (high - low)) * length;
  return within(start, length, first, stop);
}

/**
 * Moved by a share of its length, within all there is.
 * @param {Stretch} covered
 * @param {number} share
 * @param {Span} span
 * @returns {Stretch}
 */
export const panned = ([low, high], share, { first, stop }) => within(low + share * (high - low), high - low, first, stop);

/**
 * As a hand leaves it that took hold of a stretch at one moment and is at another.
 * @param {Stretch} held
 * @param {Grip} grip
 * @param {number} from
 * @param {number} to
 * @param {Span} span
 * @param {number} interval
 * @returns {Stretch}
 */
export function dragged([low, high], grip, from, to, { first, stop }, interval) {
  const least = MIN_SAMPLES * interval;
  if (grip === "all") return within(low + to - from, high - low, first, stop);
  const moved = Math.min(stop, Math.max(first, to));
  if (grip === "begin") return [Math.min(moved, high - least), high];
  if (grip === "end") return [low, Math.max(moved, low + least)];
  const [begin, end] = moved < from ? [moved, from] : [from, moved];
  return within(begin, Math.max(least, end - begin), first, stop);
}

/**
 * What of a stretch is at a position: an edge where one is near, else the whole of it, or nothing.
 * @param {number} x
 * @param {number} left
 * @param {number} right
 * @param {number} near
 * @returns {Grip}
 */
export function gripAt(x, left, right, near) {
  const [begin, end] = [Math.abs(x - left), Math.abs(x - right)];
  if (Math.min(begin, end) <= near) return begin < end ? "begin" : "end";
  return x > left && x < right ? "all" : "new";
}

/**
 * @param {number} start
 * @param {number} length
 * @param {number} first
 * @param {number} stop
 * @returns {Stretch}
 */
function within(start, length, first, stop) {
  const begin = Math.max(Math.min(start, stop - length), Math.min(first, stop - length));
  return [begin, begin + length];
}
