// What a page shows, in one place: parts of the page change it and hear what has changed.

/** @import { ViewState } from "../../../../types.d.ts" */

/**
 * How a change goes into the browser's history: as a new entry, instead of the current one, or not at all.
 * @typedef {"push" | "replace" | "none"} Entry
 */

/**
 * @template {object} Values
 */
export class State {
  /** @param {Values} values */
  constructor(values) {
    this.values = values;
    /** @type {Set<(changed: Set<string>, entry: Entry) => void>} */
    this.subscribers = new Set();
  }

  /**
   * Call `report` with the names of what has changed, and how that goes into the history.
   * @param {(changed: Set<string>, entry: Entry) => void} report
   */
  subscribe(report) {
    this.subscribers.add(report);
  }

  /**
   * @param {Partial<Values>} values
   * @param {Entry} entry
   */
  change(values, entry = "none") {
    const names = /** @type {(keyof Values & string)[]} */ (Object.keys(values));
    const changed = new Set(names.filter((name) => !same(this.values[name], values[name])));
    if (!changed.size) return;
    Object.assign(this.values, values);
    for (const report of this.subscribers) report(changed, entry);
  }
}

/**
 * @param {unknown} one
 * @param {unknown} other
 */
function same(one, other) {
  if (!Array.isArray(one) || !Array.isArray(other)) return one === other;
  return one.length === other.length && one.every((value, i) => value === other[i]);
}

/**
 * What the viewer begins with.
 * @returns {ViewState}
 */
export const initialView = () => ({
  location: null, time: null, live: true, confidence: null, order: null, floor: 0.1, dim: true, low: null, high: null, crop: null, markers: [], marker: null,
  layout: "beside", predicted: "probability", observed: "seen", cell: null, camera: null, zone: "location",
  reach: null, span: null, loop: null, grid: null, frame: null, events: [], playing: false,
});
