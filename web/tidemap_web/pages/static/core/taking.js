// What is taken along: names of files, the moments of a loop, and a scale of round metres.

import { clockText } from "./words.js";
/** @import { Span } from "../../../../types.d.ts" */

const MOST_FRAMES = 120;

/**
 * The moments of a loop, by whole samples, no more than a film has room for.
 * @param {[number, number]} loop
 * @param {number} interval
 * @param {Span} span
 * @param {number} most
 * @returns {number[]}
 */
export function momentsOf([low, high], interval, { first, stop }, most = MOST_FRAMES) {
  const [start, end] = [Math.max(low, first), Math.min(high, stop)];
  const step = Math.max(1, Math.ceil((end - start) / interval / most)) * interval;
  const count = Math.max(1, Math.min(most, Math.ceil((end - start) / step - 1e-9)));
  return Array.from({ length: count }, (_, i) => start + i * step);
}

/**
 * A name of a file that says what is in it and from when, in letters that every system takes.
 * @param {string[]} parts
 * @param {number | null} time
 * @param {string} zone
 * @param {string} ending
 */
export function fileName(parts, time, zone, ending) {
  const when = time === null ? [] : [isoDate(time, zone), clockText(time, zone, false).replace(":", "-")];
  return `${[...parts, ...when].map((part) => part.replaceAll(/[^A-Za-z0-9._-]+/g, "-")).join("-")}.${ending}`;
}

/**
 * @param {number} time
 * @param {string} zone
 */
const isoDate = (time, zone) => new Intl.DateTimeFormat("en-CA", { timeZone: zone, dateStyle: "short" }).format(time * 1000);

/**
 * The longest bar of 1, 2 or 5 times a power of ten metres that fits.
 * @param {number} pixelsPerMetre
 * @param {number} most pixels
 * @returns {{ metres: number, pixels: number }}
 */
export function scaleBar(pixelsPerMetre, most) {
  const longest = most / pixelsPerMetre;
  const ten = 10 ** Math.floor(Math.log10(longest));
  const metres = ten * (longest >= 5 * ten ? 5 : longest >= 2 * ten ? 2 : 1);
  return { metres: Number(metres.toPrecision(1)), pixels: metres * pixelsPerMetre };
}

/**
 * @param {Blob} content
 * @param {string} name
 */
export function save(content, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
