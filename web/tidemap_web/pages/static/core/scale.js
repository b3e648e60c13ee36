// Where moments are on a timeline.

/** @import { Stretch } from "./window.js" */

/**
 * @typedef {{ low: number, high: number, x: (time: number) => number, time: (x: number) => number, clip: (time: number) => number }} TimeScale
 * `clip` is `x` within the line.
 */

/**
 * @param {Stretch} covered
 * @param {number} width
 * @param {number} margin at both ends
 * @returns {TimeScale}
 */
export function timeScale([low, high], width, margin) {
  const inner = width - 2 * margin;
  const x = (/** @type {number} */ time) => margin + ((time - low) / (high - low)) * inner;
  return {
    low, high, x,
    time: (at) => low + ((at - margin) / inner) * (high - low),
    clip: (time) => Math.min(margin + inner, Math.max(margin, x(time))),
  };
}
