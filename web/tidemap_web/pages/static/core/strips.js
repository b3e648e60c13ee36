// The strips below a curve: what it says at a confidence, and what was observed.

import { colours, verdictOf } from "./colours.js";
/** @import { Series } from "../../../../types.d.ts" */

/**
 * Runs of equal values as [first, past, value].
 * @template Value
 * @param {Value[]} values
 * @returns {Generator<[number, number, Value]>}
 */
export function* runs(values) {
  let first = 0;
  for (let i = 1; i <= values.length; i++) {
    if (i === values.length || values[i] !== values[first]) {
      yield [first, i, values[first]];
      first = i;
    }
  }
}

/**
 * Draw both, each run of equal values at once.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Series & { step: number }} series
 * @param {{ confidence: number, x: (time: number) => number, top: (row: number) => number, height: number, least: number }} at
 *   pixels of a time, kept within the drawing, and of the top of a row; the least width of a run
 */
export function drawStrips(ctx, series, { confidence, x, top, height, least }) {
  const c = colours();
  const says = series.probability.map((p) => verdictOf(p, confidence));
  for (const [row, values] of [says, series.observed].entries()) {
    for (const [first, past, value] of runs(values)) {
      if (value === null) continue;
      const left = x(series.time[first]);
      ctx.fillStyle = [c.free, row ? c.occupied : c.predicted, c.uncertain][value];
      ctx.fillRect(left, top(row), Math.max(least, x(series.time[past - 1] + series.step) - left), height);
    }
  }
}
