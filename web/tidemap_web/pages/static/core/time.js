// Moments as people type them, and the time zone that a page shows.

import { offsetOf } from "./words.js";

const HOUR = 3600;
const DAY = 86400;
const WEEKDAYS = ["sun", "mon", "tue", "wed", "thu", "fri", "sat"];
const MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];
const UNITS = { s: 1, min: 60, m: 60, h: HOUR, d: DAY, w: 7 * DAY };
/** What may be typed, for a hint. */
export const EXAMPLES = "now, 10:30, Thu 10:30, yesterday 8:00, 11 Mar 8:30, 2026-03-11 08:30, +2 h, -3 d";

/**
 * The zone that is meant by a choice.
 * @param {"location" | "mine" | "UTC"} choice
 * @param {string} location the location's own
 */
export function zoneOf(choice, location) {
  if (choice === "location") return location;
  return choice === "UTC" ? "UTC" : Intl.DateTimeFormat().resolvedOptions().timeZone;
}

/**
 * Unix seconds at which the clock of a zone shows a moment, given as if it were UTC.
 * @param {number} local
 * @param {string} zone
 */
export function fromLocal(local, zone) {
  const near = local - offsetOf(local, zone);
  return local - offsetOf(near, zone);
}

/**
 * The moment that is meant, or null where the text does not say.
 * @param {string} text
 * @param {{ shown: number, now: number, zone: string }} at the moment that is shown, and now
 */
export function readMoment(text, { shown, now, zone }) {
  const words = text.trim().toLowerCase().replace(/\s+/g, " ");
  if (words === "now") return now;
  return readIso(words) ?? readStep(words, shown) ?? readDay(words, { shown, now, zone });
}

/** @param {string} words */
function readIso(words) {
  if (/^-?\d{9,11}(\.\d+)?$/.test(words)) return Number(words);
  if (!/^\d{4}-\d\d-\d\dt\d\d:\d\d(:\d\d(\.\d+)?)?(z|[+-]\d\d:?\d\d)$/.test(words)) return null;
  const time = Date.parse(words) / 1000;
  return Number.isFinite(time) ? time : null;
}

/**
 * A step from what is shown, as +2 h.
 * @param {string} words
 * @param {number} shown
 */
function readStep(words, shown) {
  const found = /^([+-]|−) ?(\d+(?:\.\d+)?) ?(s|min|m|h|d|w)$/.exec(words);
  if (!found) return null;
  const seconds = Number(found[2]) * UNITS[/** @type {keyof typeof UNITS} */ (found[3])];
  return shown + (found[1] === "+" ? seconds : -seconds);
}

/**
 * A day, a time of day, or both.
 * @param {string} words
 * @param {{ shown: number, now: number, zone: string }} at
 */
function readDay(words, { shown, now, zone }) {
  const clock = /(?:^| )(\d{1,2}):(\d\d)(?::(\d\d))?$/.exec(words);
  const seconds = clock ? Number(clock[1]) * HOUR + Number(clock[2]) * 60 + Number(clock[3] ?? 0) : 0;
  if (seconds >= DAY || (clock && Number(clock[2]) > 59)) return null;
  const named = clock ? words.slice(0, clock.index) : words;
  if (!named && !clock) return null;
  const local = (/** @type {number} */ time) => time + offsetOf(time, zone);
  const day = midnightOf(named, local(shown), local(now));
  return day === null ? null : fromLocal(day + seconds, zone);
}

/**
 * The midnight that begins a named day, on the local clock.
 * @param {string} named
 * @param {number} shown
 * @param {number} now
 */
function midnightOf(named, shown, now) {
  const midnight = (/** @type {number} */ time) => Math.floor(time / DAY) * DAY;
  const away = ["yesterday", "today", "tomorrow"].indexOf(named);
  if (named === "") return midnight(shown);
  if (away >= 0) return midnight(now) + (away - 1) * DAY;
  const weekday = WEEKDAYS.findIndex((day) => named.length >= 3 && named.slice(0, 3) === day && /^[a-z]+$/.test(named));
  if (weekday >= 0) return nearest(midnight(shown), weekday);
  return dateOf(named, shown);
}

/**
 * The weekday that is nearest to a day.
 * @param {number} day
 * @param {number} weekday
 */
function nearest(day, weekday) {
  const ahead = (weekday - new Date(day * 1000).getUTCDay() + 7) % 7;
  return day + (ahead > 3 ? ahead - 7 : ahead) * DAY;
}

/**
 * A date as 2026-03-11, 11 mar or 11 mar 2026.
 * @param {string} named
 * @param {number} shown
 */
function dateOf(named, shown) {
  const iso = /^(\d{4})-(\d\d)-(\d\d)$/.exec(named);
  const spoken = /^(\d{1,2})\.? ([a-z]{3})[a-z]*(?: (\d{4}))?$/.exec(named);
  const year = new Date(shown * 1000).getUTCFullYear();
  if (iso) return valid(Number(iso[1]), Number(iso[2]) - 1, Number(iso[3]));
  if (spoken) return valid(Number(spoken[3] ?? year), MONTHS.indexOf(spoken[2]), Number(spoken[1]));
  return null;
}

/**
 * @param {number} year
 * @param {number} month
 * @param {number} day
 */
function valid(year, month, day) {
  const date = new Date(Date.UTC(year, month, day));
  return date.getUTCMonth() === month && date.getUTCDate() === day ? date.getTime() / 1000 : null;
}
