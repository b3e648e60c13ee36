// One location's page: the chart, the rhythms, acknowledging anomalies.

import { ask, post } from "./core/api.js";
import { draw, legendHtml } from "./chart.js";
import { all, byId, closest, reason } from "./dom.js";
import { clockText, dayText, durationText, timeText } from "./core/words.js";
/** @import { Anomaly, Component, Model, Plot, Series } from "../../../types.d.ts" */

/* global htmx */
const POINTS = 1500;
const RHYTHMS = 8;
const DAY = 86400;
const section = byId("history");
const facts = section.dataset;
const location = {
  name: facts.location ?? "",
  zone: facts.zone ?? "UTC",
  kind: facts.kind,
  interval: Number(facts.interval),
  confidence: Number(facts.confidence),
  revision: Number(facts.revision),
  first: facts.first === "" ? null : Number(facts.first),
  last: facts.last === "" ? null : Number(facts.last),
};
const base = `/locations/${encodeURIComponent(location.name)}`;
const host = byId("chart");
const reading = document.createElement("p");
reading.className = "reading";
const legend = document.createElement("div");
legend.className = "legend";
host.after(legend, reading);

let range = "week";
/** @type {[number, number] | null} */
let zoom = null;
/** @type {number | null} */
let cell = location.kind === "state" ? 0 : null;
/** @type {Plot | null} */
let chart = null;
let latest = 0;

/** @param {string} text */
function say(text) {
  chart?.destroy();
  chart = null;
  legend.replaceChildren();
  const message = document.createElement("div");
  message.className = "message";
  message.textContent = text;
  host.replaceChildren(message);
}

/** @returns {[number, number]} */
function bounds() {
  if (zoom) return zoom;
  const last = location.last ?? 0;
  const first = location.first ?? last;
  if (range === "day") return [last - DAY, last + DAY];
  if (range === "week") return [last - 7 * DAY, last + 2 * DAY];
  return [first, last + Math.max(DAY, 0.2 * (last - first))];
}

/**
 * @param {number} start
 * @param {number} stop
 */
function stepFor(start, stop) {
  const rough = (stop - start) / POINTS;
  return Math.max(1, Math.ceil(rough / location.interval)) * location.interval;
}

async function load() {
  const request = ++latest;
  if (location.last === null) return say("Nothing has been observed yet. Post observations, and they appear here.");
  if (cell === null) return say("Choose a cell: enter its number, or click one in the 3D viewer.");
  const [start, stop] = bounds();
  const step = stepFor(start, stop);
  const from = Math.floor(start / step) * step;
  try {
    const [series, events] = await Promise.all([
      ask(`${base}/series?cell=${cell}&start=${from}&stop=${stop}&step=${step}`),
      ask(`${base}/anomalies?start=${from}&stop=${stop}&limit=1000`),
    ]);
    if (request !== latest) return;
    show(series, events.items, step);
  } catch (error) {
    if (request === latest) say(reason(error));
  }
}

/**
 * @param {Series} series
 * @param {Anomaly[]} events
 * @param {number} step
 */
function show(series, events, step) {
  if (series.probability.every((p) => p === null) && series.observed.every((s) => s === null)) {
    return say(
      location.kind === "state"
        ? "Nothing was observed in this range, and there is no model yet."
        : `Cell ${cell} has not been observed. Click another one in the 3D viewer.`,
    );
  }
  const mine = events.filter((event) => event.cells.includes(cell ?? -1)).map((event) => ({
    start: Date.parse(event.start) / 1000,
    stop: Date.parse(event.stop) / 1000,
  }));
  chart?.destroy();
  host.replaceChildren();
  const state = { series, events: mine, last: location.last ?? 0, confidence: location.confidence, step };
  chart = draw(host, reading, state, location.zone, (low, high) => {
    zoom = [low, high];
    mark();
    load();
  });
  legend.replaceChildren(...legendHtml());
}

function mark() {
  for (const button of all("#history [data-range]")) {
    button.setAttribute("aria-pressed", String(!zoom && button.dataset.range === range));
  }
}

const DAYS = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"];

// Of a calendar model: its waves run in civil time, counted from a Monday 00:00.
/**
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
 * @param {Component} part
 * @param {Model} model
 */
function peakText(part, model) {
  const period = part.period_s;
  if (period === null || period < 5400) return "";
  if (model.time_zone) return civilPeakText(part, period);
  const start = Date.parse(model.start) / 1000;
  const end = Date.parse(model.stop) / 1000;
  const first = start - (part.phase / (2 * Math.PI)) * period;
  const peak = first + Math.ceil((end - first) / period) * period;
  const near = (/** @type {number} */ wanted) => Math.abs(period / wanted - 1) < 0.01;
  if (near(DAY)) return `highest at ${clockText(peak, location.zone, false)}`;
  if (near(7 * DAY)) return `highest on ${dayText(peak, location.zone).slice(0, 3)}, ${clockText(peak, location.zone, false)}`;
  return "";
}

/**
 * @param {Component} part
 * @param {number} largest
 * @param {Model} model
 */
function row(part, largest, model) {
  const line = document.createElement("tr");
  const name = document.createElement("th");
  name.scope = "row";
  name.textContent = part.period_s === null ? "constant" : durationText(part.period_s);
  const peak = document.createElement("small");
  peak.textContent = [peakText(part, model), part.gate ? `at the ${part.gate}` : ""].filter(Boolean).join(" · ");
  if (peak.textContent) name.append(peak);
  const bar = document.createElement("td");
  const meter = document.createElement("span");
  meter.className = "meter";
  meter.style.width = `${(100 * part.amplitude) / largest}%`;
  bar.append(meter);
  const size = document.createElement("td");
  size.className = "number";
  size.textContent = part.amplitude.toFixed(3);
  line.append(name, bar, size);
  return line;
}

/** @param {Model} model */
function heading(model) {
  const line = document.createElement("p");
  line.className = "note";
  const mean = model.mean === null ? "–" : model.mean.toFixed(3);
  const outliers = model.outliers.length;
  line.textContent =
    `Estimator ${model.estimator}, order ${model.order}, mean ${mean}${model.link === "logit" ? " (log-odds)" : ""}; ` +
    `fitted on ${timeText(Date.parse(model.start) / 1000, location.zone)} to ${timeText(Date.parse(model.stop) / 1000, location.zone)}, ` +
    `${model.samples.toLocaleString("en")} samples; ${outliers} ${outliers === 1 ? "interval" : "intervals"} differ from the prediction. ` +
    (model.selection ? model.selection.reason : "");
  return line;
}

/** @param {Model} model */
function table(model) {
  const made = document.createElement("table");
  made.className = "list";
  made.innerHTML = `<thead><tr><th scope="col">Period</th><th scope="col">Amplitude${model.link === "logit" ? ", log-odds" : ""}</th><th></th></tr></thead>`;
  const body = made.createTBody();
  const parts = [...model.components].sort((a, b) => b.amplitude - a.amplitude);
  const largest = parts.length ? parts[0].amplitude || 1 : 1;
  const rows = parts.map((part) => row(part, largest, model));
  const first = rows.length > RHYTHMS + 1 ? RHYTHMS : rows.length;
  body.append(...rows.slice(0, first));
  return first < rows.length ? [made, more(body, rows)] : [made];
}

/**
 * @param {HTMLElement} body
 * @param {HTMLElement[]} rows
 */
function more(body, rows) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "plain";
  button.textContent = `Show all ${rows.length} rhythms`;
  button.addEventListener("click", () => {
    body.append(...rows.slice(RHYTHMS));
    button.remove();
  });
  return button;
}

async function rhythms() {
  const box = byId("spectrum");
  const quiet = document.createElement("p");
  quiet.className = "quiet";
  box.replaceChildren(quiet);
  if (cell === null) {
    quiet.textContent = "Choose a cell above to see its rhythms.";
    return;
  }
  try {
    const model = await ask(`${base}/model?cell=${cell}`);
    if (model.mean === null) quiet.textContent = "This cell has not been observed.";
    else if (model.components.length) box.replaceChildren(...table(model), heading(model));
    else {
      quiet.textContent = "No rhythm: the model is the mean alone.";
      box.append(heading(model));
    }
  } catch (error) {
    quiet.textContent = reason(error);
  }
}

/** @param {number} number */
function choose(number) {
  cell = number;
  const input = document.getElementById("cell");
  if (input instanceof HTMLInputElement) input.value = String(number);
  const query = new URLSearchParams(window.location.search);
  query.set("cell", String(number));
  history.replaceState(null, "", `?${query}`);
  load();
  rhythms();
}

/** @param {HTMLButtonElement} button */
async function acknowledge(button) {
  button.disabled = true;
  try {
    await post(`/anomalies/${button.dataset.acknowledge}/acknowledge`, {});
    htmx.trigger("#anomalies-table", "refresh");
  } catch (error) {
    button.disabled = false;
    button.textContent = "Try again";
    button.title = reason(error);
  }
}

section.addEventListener("click", (event) => {
  const button = closest(event, "[data-range]");
  if (!button) return;
  range = button.dataset.range ?? range;
  zoom = null;
  mark();
  load();
});
host.addEventListener("dblclick", () => {
  zoom = null;
  mark();
  load();
});
document.getElementById("cell-form")?.addEventListener("submit", (event) => {
  event.preventDefault();
  choose(Number(byId("cell").value));
});
document.addEventListener("click", (event) => {
  const button = closest(event, "[data-acknowledge]");
  if (button instanceof HTMLButtonElement) acknowledge(button);
});
window.addEventListener("message", (event) => {
  if (event.origin === window.location.origin && event.data?.kind === "cell") choose(event.data.cell);
});
document.body.addEventListener("htmx:afterSwap", () => {
  const fresh = byId("facts").dataset;
  const last = fresh.last === "" ? null : Number(fresh.last);
  if (last === location.last && Number(fresh.revision) === location.revision) return;
  const refitted = Number(fresh.revision) !== location.revision;
  location.first ??= last;
  location.last = last;
  location.revision = Number(fresh.revision);
  if (!zoom) load();
  if (refitted) rhythms();
});
let width = 0;
new ResizeObserver(() => {
  if (!chart || host.clientWidth === width) return;
  width = host.clientWidth;
  chart.setSize({ width, height: 300 });
}).observe(host);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", load);

const asked = new URLSearchParams(window.location.search).get("cell");
if (asked !== null && location.kind !== "state") choose(Number(asked));
else {
  load();
  rhythms();
}
