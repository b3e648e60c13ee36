// What was observed when, asked for as the timeline moves and as more comes in.

import { ask } from "../core/api.js";
/** @import { Density } from "../../../../types.d.ts" */
/** @import { Stretch } from "../core/window.js" */

const QUIET_MS = 250;
const FRESH_S = 60;
const BINS = 240;

/** One stretch of one location at a time: what was asked for last, of whatever that is, stands until there is more. */
export class DensityStrip {
  /** @param {() => void} redraw */
  constructor(redraw) {
    this.redraw = redraw;
    /** @type {Density | null} */
    this.density = null;
    this.location = "";
    this.asked = "";
    this.timer = 0;
  }

  /**
   * Show a stretch of a location, whose newest reading is known: it is asked again where that has become a minute older.
   * @param {string} location
   * @param {Stretch} stretch
   * @param {number} last
   */
  show(location, [start, stop], last) {
    if (location !== this.location) this.density = null;
    this.location = location;
    const question = `/locations/${encodeURIComponent(location)}/density?start=${start}&stop=${stop}&bins=${BINS}`;
    const version = `${question} ${Math.floor(last / FRESH_S)}`;
    if (version === this.asked) return;
    this.asked = version;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.load(question, version), QUIET_MS);
  }

  /**
   * @param {string} question
   * @param {string} version
   */
  async load(question, version) {
    const found = await ask(question).catch(() => null); // the strip stays as it is: the banner says what is wrong
    if (version !== this.asked) return;
    if (found === null) this.asked = "";
    else this.density = found;
    this.redraw();
  }
}
