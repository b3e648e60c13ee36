// The rhythms of a cell: amplitude over period, with the periods of civil life labelled, and a table of the largest.

import { scale, svg } from "../core/svg.js";
import { durationText } from "../core/words.js";
import { peakText } from "../core/peaks.js";
/** @import { Component, LocationView, Model } from "../../../../types.d.ts" */

const DAY = 86400;
const LABELLED = [3600, 3 * 3600, 6 * 3600, 12 * 3600, DAY, 7 * DAY, 28 * DAY, 364 * DAY];
const RHYTHMS = 8;
const WIDTH = 720;
const HEIGHT = 190;
const BASE = HEIGHT - 24;

/**
 * Draw a model's components into `host`.
 * @param {HTMLElement} host
 * @param {Model} model
 * @param {LocationView} view
 */
export function draw(host, model, view) {
  if (model.mean === null || !model.components.length) {
    const line = document.createElement("p");
    line.className = "quiet";
    line.textContent = model.mean === null ? "This cell has not been observed." : "No rhythm: the model is the mean alone.";
    host.replaceChildren(line);
    return;
  }
  const parts = [...model.components].sort((a, b) => b.amplitude - a.amplitude);
  host.replaceChildren(picture(parts), ...table(parts, model, view));
}

/** @param {Component[]} parts */
function picture(parts) {
  const waves = parts.filter((part) => part.period_s !== null);
  const periods = waves.map((part) => part.period_s ?? 1);
  const [low, high] = [Math.min(...periods, DAY / 4), Math.max(...periods, 7 * DAY)].map(Math.log);
  const x = scale(low, high, 24, WIDTH - 24);
  const y = scale(0, Math.max(...waves.map((part) => part.amplitude), 1e-9), BASE, 14);
  const made = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "stems", role: "img", "aria-label": "Amplitude of each period" });
  made.append(svg("path", { class: "axis", d: `M10 ${BASE}H${WIDTH - 10}` }));
  for (const period of LABELLED) {
    const at = x(Math.log(period));
    if (at < 10 || at > WIDTH - 10) continue;
    made.append(svg("path", { class: "tick", d: `M${at} 8V${BASE + 4}` }), svg("text", { x: at, y: HEIGHT - 6 }, durationText(period)));
  }
  for (const part of waves) {
    const at = x(Math.log(part.period_s ?? 1));
    const name = svg("title", {}, `${durationText(part.period_s ?? 0)}: ${part.amplitude.toFixed(3)}`);
    const stem = svg("g", { class: part.gate ? "stem gated" : "stem" }, name);
    stem.append(svg("path", { d: `M${at} ${BASE}V${y(part.amplitude)}` }), svg("circle", { cx: at, cy: y(part.amplitude), r: 3.5 }));
    made.append(stem);
  }
  return made;
}

/**
 * @param {Component[]} parts
 * @param {Model} model
 * @param {LocationView} view
 */
function table(parts, model, view) {
  const made = document.createElement("table");
  made.className = "list";
  const unit = model.link === "logit" ? ", log-odds" : "";
  made.innerHTML = `<thead><tr><th scope="col">Period</th><th scope="col">Amplitude${unit}</th><td></td></tr></thead>`;
  const body = made.createTBody();
  const largest = parts[0].amplitude || 1;
  const rows = parts.map((part) => row(part, largest, model, view));
  const first = rows.length > RHYTHMS + 1 ? RHYTHMS : rows.length;
  body.append(...rows.slice(0, first));
  return first < rows.length ? [made, more(body, rows)] : [made];
}

/**
 * @param {Component} part
 * @param {number} largest
 * @param {Model} model
 * @param {LocationView} view
 */
function row(part, largest, model, view) {
  const line = document.createElement("tr");
  const name = document.createElement("th");
  name.scope = "row";
  name.textContent = part.period_s === null ? "constant" : durationText(part.period_s);
  const peak = document.createElement("small");
  peak.textContent = [peakText(part, model, view.zone), part.gate ? `at the ${part.gate}` : ""].filter(Boolean).join(" · ");
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
