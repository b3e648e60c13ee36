// The history of a cell: a chart of a range, and below it all of the history with that range to drag.

import { ask } from "../core/api.js";
import { seriesQuestion } from "../core/series.js";
import { all, closest, reason } from "../dom.js";
import { brush, draw, legendOf } from "./chart.js";
/** @import { Live } from "../core/live.js" */
/** @import { State } from "../core/state.js" */
/** @import { Anomaly, LocationView, Model, Plot, Series } from "../../../../types.d.ts" */

const POINTS = 1500;
const DAY = 86400;
const BEFORE = 0.25;
const QUIET_MS = 150;

export class History {
  /**
   * @param {HTMLElement} section
   * @param {HTMLElement} host
   * @param {State<LocationView>} state
   * @param {Live} live
   */
  constructor(section, host, state, live) {
    this.section = section;
    this.host = host;
    this.state = state;
    /** @type {string | null} what the range is called, null of one that was drawn */
    this.range = "week";
    /** @type {Plot[]} */
    this.charts = [];
    this.latest = 0;
    this.timer = 0;
    this.reading = document.createElement("p");
    this.reading.className = "reading";
    this.legend = document.createElement("div");
    this.legend.className = "legend";
    this.whole = document.createElement("div");
    this.whole.className = "brush";
    host.after(this.whole, this.legend, this.reading);
    state.subscribe((changed) => this.update(changed));
    live.onConnection((since) => since === null && this.load());
    this.listen();
    const { time } = state.values;
    if (time === null) this.choose("week");
    else this.show([time - DAY / 2, time + DAY / 2]);
    this.load();
  }

  listen() {
    this.section.addEventListener("click", (event) => {
      const button = closest(event, "[data-range]");
      if (button) this.choose(button.dataset.range ?? "week");
    });
    this.host.addEventListener("dblclick", () => this.choose(this.range ?? "week"));
    let width = 0;
    new ResizeObserver(() => {
      if (this.host.clientWidth === width) return;
      width = this.host.clientWidth;
      for (const [i, chart] of this.charts.entries()) chart.setSize({ width, height: i ? 76 : 300 });
    }).observe(this.host);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.load());
  }

  /**
   * What has changed is drawn: another range or model anew, another moment in the range as a line.
   * @param {Set<string>} changed
   */
  update(changed) {
    const { time, span } = this.state.values;
    if (this.range && (changed.has("first") || changed.has("last"))) this.choose(this.range);
    if (changed.has("time") && time !== null && span && (time < span[0] || time > span[1])) {
      const begin = time - BEFORE * (span[1] - span[0]);
      this.show([begin, begin + span[1] - span[0]]);
    }
    if (changed.has("span")) this.press();
    if (["cell", "revision", "span", "last"].some((name) => changed.has(name))) this.soon();
    else if (changed.has("time")) this.charts[0]?.redraw(false, false);
  }

  /** A range that is being dragged in the viewer is asked for when it rests. */
  soon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.load(), QUIET_MS);
  }

  /** @param {string} range one that has a button */
  choose(range) {
    this.range = range;
    this.show(this.bounds(range), range);
  }

  /**
   * @param {[number, number]} span
   * @param {string | null} range what it is called
   */
  show(span, range = null) {
    this.range = range;
    this.state.change({ span });
    this.press();
  }

  /** The button of the range is pressed as long as that is what is shown. */
  press() {
    const { span } = this.state.values;
    const bounds = this.range ? this.bounds(this.range) : null;
    if (bounds && span && (bounds[0] !== span[0] || bounds[1] !== span[1])) this.range = null;
    for (const button of all("#history [data-range]")) button.setAttribute("aria-pressed", String(button.dataset.range === this.range));
  }

  /**
   * @param {string} range
   * @returns {[number, number]}
   */
  bounds(range) {
    const [first, last] = this.known();
    if (range === "day") return [last - DAY, last + DAY];
    if (range === "week") return [last - 7 * DAY, last + 2 * DAY];
    return [first, last + Math.max(DAY, 0.2 * (last - first))];
  }

  /** @returns {[number, number]} */
  known() {
    const { first, last } = this.state.values;
    return [first ?? last ?? 0, last ?? 0];
  }

  async load() {
    clearTimeout(this.timer);
    const request = ++this.latest;
    const { last, cell, span, path, revision } = this.state.values;
    if (last === null) return this.say("Nothing has been observed yet. Post observations, and they appear here.");
    if (cell === null) return this.say("Choose a cell: enter its number, or click one in the 3D viewer.");
    const [start, stop] = span ?? this.bounds("week");
    const [first] = this.known();
    try {
      const [series, events, whole, model] = await Promise.all([
        this.series(start, stop, POINTS),
        ask(`${path}/anomalies?start=${start}&stop=${stop}&limit=1000`),
        this.series(first, last + Math.max(DAY, 0.1 * (last - first)), POINTS / 2),
        revision ? ask(`${path}/model?cell=${cell}`) : null,
      ]);
      if (request === this.latest) this.draw(series, events.items, whole, model);
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
    const { question, step } = seriesQuestion(this.state.values, [start, stop], points);
    return { ...(await ask(question)), step };
  }

  /**
   * @param {Series & { step: number }} series
   * @param {Anomaly[]} events
   * @param {Series} whole
   * @param {Model | null} model
   */
  draw(series, events, whole, model) {
    const { cell, confidence, last, revision, zone, span } = this.state.values;
    if (whole.probability.every((p) => p === null) && whole.observed.every((s) => s === null)) {
      return this.say(`Cell ${cell} has not been observed. Click another one in the 3D viewer.`);
    }
    this.clear();
    const mine = events.filter((event) => event.cells.includes(cell ?? -1));
    const shown = span ?? this.bounds("week");
    const drawn = {
      series,
      span: shown,
      events: mine.map((event) => ({ ...event, start: Date.parse(event.start) / 1000, stop: Date.parse(event.stop) / 1000 })),
      outliers: model?.outliers ?? [],
      last: last ?? 0,
      confidence,
      moment: () => this.state.values.time,
    };
    const chosen = {
      zoom: (/** @type {number} */ start, /** @type {number} */ stop) => this.show([start, stop]),
      go: (/** @type {number} */ time) => this.state.change({ time }, "push"),
    };
    const chart = draw(this.host, this.reading, drawn, zone, chosen);
    this.charts = [chart, brush(this.whole, whole, shown, zone, chosen.zoom)];
    this.legend.replaceChildren(...legendOf(revision));
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
