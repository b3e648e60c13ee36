// How much was observed when, as the bars of a strip.

/** @import { Density } from "../../../../types.d.ts" */

/** @typedef {{ start: number, stop: number, share: number, measurements: number }} Bar */

/**
 * Bars of what was observed: the share of the highest, by its square root, so that a single reading is seen beside many.
 * @param {Density} density
 * @returns {Bar[]}
 */
export function barsOf({ time, step_s, measurements }) {
  const most = Math.max(...measurements, 1);
  return measurements.flatMap((count, i) =>
    count > 0 ? [{ start: time[i], stop: time[i] + step_s, share: Math.sqrt(count / most), measurements: count }] : [],
  );
}

/**
 * What was observed around a moment.
 * @param {Density | null} density
 * @param {number} time
 * @returns {{ measurements: number, samples: number, start: number, stop: number } | null}
 */
export function countAt(density, time) {
  if (!density?.time.length) return null;
  const i = Math.floor((time - density.time[0]) / density.step_s);
  if (i < 0 || i >= density.time.length) return null;
  return { measurements: density.measurements[i], samples: density.samples[i], start: density.time[i], stop: density.time[i] + density.step_s };
}
