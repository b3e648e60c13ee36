// Times and periods in words, in the time zone of a location.

/** @type {Map<string, Intl.DateTimeFormat>} */
const formats = new Map();

/**
 * @param {string} zone
 * @param {string} key
 * @param {Intl.DateTimeFormatOptions} options
 * @returns {Intl.DateTimeFormat}
 */
function format(zone, key, options) {
  const name = zone + key;
  const known = formats.get(name) ?? new Intl.DateTimeFormat("en-GB", { timeZone: zone, ...options });
  formats.set(name, known);
  return known;
}

/**
 * @param {number} time
 * @param {string} zone
 */
function parts(time, zone) {
  /** @type {Intl.DateTimeFormatOptions} */
  const options = {
    weekday: "short", day: "numeric", month: "short", year: "numeric",
    hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23", timeZoneName: "short",
  };
  /** @type {Record<string, string>} */
  const found = {};
  for (const part of format(zone, "all", options).formatToParts(time * 1000)) found[part.type] = part.value;
  return found;
}

/**
 * @param {number} time
 * @param {string} zone
 */
export function dateText(time, zone) {
  const p = parts(time, zone);
  return `${p.weekday} ${p.day} ${p.month} ${p.year}`;
}

/**
 * @param {number} time
 * @param {string} zone
 */
export function clockText(time, zone, seconds = true) {
  const p = parts(time, zone);
  return seconds ? `${p.hour}:${p.minute}:${p.second}` : `${p.hour}:${p.minute}`;
}

/**
 * @param {number} time
 * @param {string} zone
 */
export function zoneText(time, zone) {
  const short = parts(time, zone).timeZoneName;
  return short === zone ? zone : `${zone} (${short})`;
}

/**
 * @param {number} time
 * @param {string} zone
 */
export function timeText(time, zone) {
  return `${dateText(time, zone)}, ${clockText(time, zone)}`;
}

/**
 * @param {number} time
 * @param {string} zone
 */
export function dayText(time, zone) {
  const p = parts(time, zone);
  return `${p.weekday} ${p.day} ${p.month}`;
}

/**
 * Seconds that local time is ahead of UTC at a moment.
 * @param {number} time
 * @param {string} zone
 */
export function offsetOf(time, zone) {
  /** @type {Intl.DateTimeFormatOptions} */
  const options = {
    year: "numeric", month: "numeric", day: "numeric", hour: "numeric", minute: "numeric", second: "numeric",
    hourCycle: "h23",
  };
  /** @type {Record<string, number>} */
  const p = {};
  for (const part of format(zone, "offset", options).formatToParts(time * 1000)) p[part.type] = Number(part.value);
  const local = Date.UTC(p.year, p.month - 1, p.day, p.hour, p.minute, p.second) / 1000;
  return local - Math.floor(time);
}

/** @type {[number, number, string][]} */
const STEPS = [[100, 1, "s"], [3600, 60, "min"], [47 * 3600, 3600, "h"], [Infinity, 86400, "d"]];

/** @param {number} seconds */
export function durationText(seconds) {
  const [, size, unit] = STEPS.find(([limit]) => seconds < limit) ?? STEPS[STEPS.length - 1];
  return `${Number((seconds / size).toPrecision(3))} ${unit}`;
}

/** @type {[number, number, string][]} */
const AGES = [[90, 1, "s"], [5400, 60, "min"], [129600, 3600, "h"], [60 * 86400, 86400, "days"], [Infinity, 30.44 * 86400, "months"]];

/**
 * How long ago, or in how long, as `relative` of the server's words says it.
 * @param {number} time
 * @param {number} now
 */
export function relativeText(time, now) {
  const away = Math.abs(now - time);
  if (away < 10) return "just now";
  const [, size, unit] = AGES.find(([limit]) => away < limit) ?? AGES[AGES.length - 1];
  const text = `${halfEven(away / size)} ${unit}`;
  return time < now ? `${text} ago` : `in ${text}`;
}

/**
 * Rounded as Python rounds: half to even.
 * @param {number} value
 */
function halfEven(value) {
  const rounded = Math.round(value);
  return rounded - value === 0.5 && rounded % 2 ? rounded - 1 : rounded;
}

/**
 * A share in percent, or a dash.
 * @param {number | null} share
 */
export const percentText = (share) => (share === null ? "–" : `${(100 * share).toFixed(1)} %`);

/**
 * A whole number with thousands apart.
 * @param {number} number
 */
export const countText = (number) => number.toLocaleString("en");
