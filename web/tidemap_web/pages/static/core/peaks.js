// When a component of a spectrum is highest, on a local clock.

import { DAYS } from "./week.js";
import { clockText, dayText } from "./words.js";
/** @import { Component, Model } from "../../../../types.d.ts" */

const DAY = 86400;

/**
 * Of a calendar model: its waves run in civil time, counted from a Monday 00:00.
 * @param {Component} part
 * @param {number} period
 */
function civilPeakText(part, period) {
  const peak = ((((-part.phase / (2 * Math.PI)) % 1) + 1) % 1) * period;
  const minutes = Math.round(peak / 60) % (24 * 60);
  const clock = `${String(Math.floor(minutes / 60)).padStart(2, "0")}:${String(minutes % 60).padStart(2, "0")}`;
  if (Math.abs(period / DAY - 1) < 0.01) return `highest at ${clock}`;
  if (Math.abs(period / (7 * DAY) - 1) < 0.01) return `highest on ${DAYS[Math.floor(peak / DAY) % 7]}, ${clock}`;
  return "";
}

/**
 * The time of the day, or of the week, at which a component is highest; empty of other periods.
 * @param {Component} part
 * @param {Model} model
 * @param {string} zone
 */
export function peakText(part, model, zone) {
  const period = part.period_s;
  if (period === null || period < 5400) return "";
  if (model.time_zone) return civilPeakText(part, period);
  const start = Date.parse(model.start) / 1000;
  const end = Date.parse(model.stop) / 1000;
  const first = start - (part.phase / (2 * Math.PI)) * period;
  const peak = first + Math.ceil((end - first) / period) * period;
  const near = (/** @type {number} */ wanted) => Math.abs(period / wanted - 1) < 0.01;
  if (near(DAY)) return `highest at ${clockText(peak, zone, false)}`;
  if (near(7 * DAY)) return `highest on ${dayText(peak, zone).slice(0, 3)}, ${clockText(peak, zone, false)}`;
  return "";
}
