// The history of a cell: a chart of a range, and below it all of the history with that range to drag.

import { ask } from "../core/api.js";
import { all, closest, reason } from "../dom.js";
import { brush, draw, legendOf } from "./chart.js";
/** @import { LocationState } from "../core/location.js" */
/** @import { Live } from "../core/live.js" */
/** @import { Anomaly, Model, Plot, Series } from "../../../../types.d.ts" */

const POINTS = 1500;
const DAY = 86400;

export class History {
  /**
   * @param {HTMLElement} section
   * @param {HTMLElement} host
   * @param {LocationState} state
   * @param {Live} live
   */
  constructor(section, host, state, live) {
    this.section = section;
    this.host = host;
    this.state = state;
    this.range = "week";
    /** @type {[number, number] | null} */
    this.zoom = null;
    /** @type {{ destroy(): void, setSize(size: { width: number, height: number }): void }[]} */
    this.charts = [];
    this.latest = 0;
    this.reading = document.createElement("p");
    this.reading.className = "reading";
    this.legend = document.createElement("div");
    this.legend.className = "legend";
    this.whole = document.createElement("div");
    this.whole.className = "brush";
    host.after(this.whole, this.legend, this.reading);
    state.subscribe((changed) => (changed.has("cell") || changed.has("revision") || !this.zoom) && this.load());
    live.onConnection((since) => since === null && this.load());
    this.listen();
  }

  listen() {
    this.section.addEventListener("click", (event) => {
      const button = closest(event, "[data-range]");
      if (button) this.choose(button.dataset.range ?? this.range, null);
    });
    this.host.addEventListener("dblclick", () => this.choose(this.range, null));
    let width = 0;
    new ResizeObserver(() => {
      if (this.host.clientWidth === width) return;
      width = this.host.clientWidth;
      for (const [i, chart] of this.charts.entries()) chart.setSize({ width, height: i ? 76 : 300 });
    }).observe(this.host);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.load());
  }

  /**
   * @param {string} range
   * @param {[number, number] | null} zoom
   */
  choose(range, zoom) {
    this.range = range;
    this.zoom = zoom;
    for (const button of all("#history [data-range]")) {
      button.setAttribute("aria-pressed", String(!zoom && button.dataset.range === range));
    }
    this.load();
  }

  /** @returns {[number, number]} */
  bounds() {
    if (this.zoom) return this.zoom;
    const [first, last] = this.known();
    if (this.range === "day") return [last - DAY, last + DAY];
    if (this.range === "week") return [last - 7 * DAY, last + 2 * DAY];
    return [first, last + Math.max(DAY, 0.2 * (last - first))];
  }

  /** @returns {[number, number]} */
  known() {
    const last = this.state.last ?? 0;
    return [this.state.first ?? last, last];
  }

  async load() {
    const request = ++this.latest;
    const { state } = this;
    if (state.last === null) return this.say("Nothing has been observed yet. Post observations, and they appear here.");
    if (state.cell === null) return this.say("Choose a cell: enter its number, or click one in the 3D viewer.");
    const [start, stop] = this.bounds();
    const [first, last] = this.known();
    try {
      const [series, events, whole, model] = await Promise.all([
        this.series(start, stop, POINTS),
        ask(`${state.path}/anomalies?start=${start}&stop=${stop}&limit=1000`),
        this.series(first, last + Math.max(DAY, 0.1 * (last - first)), POINTS / 2),
        state.revision ? ask(`${state.path}/model?cell=${state.cell}`) : null,
      ]);
      if (request === this.latest) this.show(series, events.items, whole, model);
    } catch (error) {
      if (request === this.latest) this.say(reason(error));
    }
  }

  /**
   * @param {number} start
   * @param {number} stop
   * @param {number} points
   * @returns {Promise<Series & { step: number }>}
   */
  async series(start, stop, points) {
    const { interval, path, cell } = this.state;
    const step = Math.max(1, Math.ceil((stop - start) / points / interval)) * interval;
    const from = Math.floor(start / step) * step;
    return { ...(await ask(`${path}/series?cell=${cell}&start=${from}&stop=${stop}&step=${step}`)), step };
  }

  /**
   * @param {Series & { step: number }} series
   * @param {Anomaly[]} events
   * @param {Series} whole
   * @param {Model | null} model
   */
  show(series, events, whole, model) {
    const { state } = this;
    if (whole.probability.every((p) => p === null) && whole.observed.every((s) => s === null)) {
      return this.say(`Cell ${state.cell} has not been observed. Click another one in the 3D viewer.`);
    }
    this.clear();
    const mine = events.filter((event) => event.cells.includes(state.cell ?? -1));
    const drawn = {
      series,
      events: mine.map((event) => ({ ...event, start: Date.parse(event.start) / 1000, stop: Date.parse(event.stop) / 1000 })),
      outliers: model?.outliers ?? [],
      last: state.last ?? 0,
      confidence: state.confidence,
      step: series.step,
    };
    const zoomed = (/** @type {number} */ low, /** @type {number} */ high) => this.choose(this.range, [low, high]);
    const chart = draw(this.host, this.reading, drawn, state.zone, zoomed);
    this.charts = [chart, brush(this.whole, whole, this.bounds(), state.zone, zoomed)];
    this.legend.replaceChildren(...legendOf(state.revision));
  }

  clear() {
    for (const chart of this.charts) chart.destroy();
    this.charts = [];
    this.host.replaceChildren();
    this.whole.replaceChildren();
    this.legend.replaceChildren();
  }

  /** @param {string} text */
  say(text) {
    this.clear();
    const message = document.createElement("div");
    message.className = "message";
    message.textContent = text;
    this.host.replaceChildren(message);
  }
}
