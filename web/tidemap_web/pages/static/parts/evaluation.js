// How well a location is predicted: by order, by horizon, and whether p means what it says. Computed when asked.

import { post } from "../core/api.js";
import { scale, svg } from "../core/svg.js";
import { durationText, percentText } from "../core/words.js";
import { reason } from "../dom.js";
/** @import { State } from "../core/state.js" */
/** @import { Evaluation, LocationView, Score } from "../../../../types.d.ts" */

const ORDERS = [0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20];
const HORIZONS = [300, 3600, 4 * 3600, 86400, 7 * 86400];
const ESTIMATORS = ["fft", "calendar"];
const [WIDTH, HEIGHT, LEFT, BASE] = [360, 220, 40, 190];

/**
 * @param {HTMLElement} section with a button, and room for the answer
 * @param {State<LocationView>} state
 */
export function mount(section, state) {
  const button = section.querySelector("button");
  const host = section.querySelector("[data-answer]");
  if (!button || !(host instanceof HTMLElement)) return;
  button.addEventListener("click", async () => {
    button.disabled = true;
    host.textContent = "Learning from the first three quarters of the history, and scoring the last …";
    try {
      show(host, await evaluate(state.values));
    } catch (error) {
      host.textContent = reason(error);
    }
    button.disabled = false;
  });
}

/**
 * What is learned from the first three quarters of a history is scored on the last.
 * @param {LocationView} view
 * @returns {Promise<Evaluation>}
 */
function evaluate({ first, last, interval, path }) {
  if (first === null || last === null) return Promise.reject(new Error("Nothing has been observed yet."));
  const middle = first + 0.75 * (last - first);
  const horizons_s = HORIZONS.filter((horizon) => horizon >= interval && horizon < last - middle);
  return post(`${path}/evaluate`, {
    orders: ORDERS, estimators: [...ESTIMATORS, "static"], horizons_s, start: middle, stop: last + interval,
    train_start: first, ...(horizons_s.length ? {} : { train_stop: middle }),
  });
}

/**
 * @param {HTMLElement} host
 * @param {Evaluation} found
 */
function show(host, found) {
  const parts = [
    figure("Error by order", lines(found.results, (score) => score.error, "error")),
    figure("Log loss by order", lines(found.results, (score) => score.log_loss, "log loss")),
    figure("Reliability: predicted and observed", reliability(found)),
  ];
  const best = document.createElement("p");
  best.textContent = found.best ? `Best on later time: ${found.best.estimator} of order ${found.best.order}.` : "";
  const row = document.createElement("div");
  row.className = "figures";
  row.append(...parts);
  host.replaceChildren(best, row, ...(found.horizons.length ? [horizons(found)] : []));
}

/**
 * @param {string} title
 * @param {SVGElement} picture
 */
function figure(title, picture) {
  const made = document.createElement("figure");
  made.append(Object.assign(document.createElement("figcaption"), { textContent: title }), picture);
  return made;
}

/**
 * @param {Score[]} results
 * @param {(score: Score) => number} value
 * @param {string} name
 */
function lines(results, value, name) {
  const top = Math.max(...results.map(value), 1e-6);
  const x = scale(0, Math.max(...ORDERS), LEFT, WIDTH - 10);
  const y = scale(0, top, BASE, 14);
  const made = frame(name, `order 0 to ${Math.max(...ORDERS)}`, top);
  for (const estimator of ESTIMATORS) {
    const own = results.filter((score) => score.estimator === estimator).sort((a, b) => a.order - b.order);
    if (!own.length) continue;
    made.append(svg("path", { class: `line ${estimator}`, d: own.map((each, i) => `${i ? "L" : "M"}${x(each.order)} ${y(value(each))}`).join("") }));
    made.append(svg("text", { class: `of ${estimator}`, x: WIDTH - 12, y: 18 + 14 * ESTIMATORS.indexOf(estimator) }, estimator));
    for (const each of own) {
      made.append(svg("circle", { cx: x(each.order), cy: y(value(each)), r: 3, class: estimator },
        svg("title", {}, `${estimator} of order ${each.order}: ${name} ${value(each).toFixed(3)}`)));
    }
  }
  return made;
}

/** @param {Evaluation} found */
function reliability(found) {
  const x = scale(0, 1, LEFT, WIDTH - 10);
  const y = scale(0, 1, BASE, 14);
  const made = frame("share observed occupied", "predicted probability, 0 to 1", 1);
  made.append(svg("path", { class: "tick", d: `M${x(0)} ${y(0)}L${x(1)} ${y(1)}` }));
  const most = Math.max(...found.reliability.map((bin) => bin.n), 1);
  for (const bin of found.reliability) {
    if (!bin.n) continue;
    made.append(svg("circle", { class: "fft", cx: x(bin.probability), cy: y(bin.observed), r: 2 + 5 * Math.sqrt(bin.n / most) },
      svg("title", {}, `predicted ${percentText(bin.probability)}, observed ${percentText(bin.observed)}, ${bin.n} readings`)));
  }
  return made;
}

/**
 * @param {string} label
 * @param {string} below
 * @param {number} top
 */
function frame(label, below, top) {
  return svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "figure", role: "img", "aria-label": label },
    svg("path", { class: "axis", d: `M${LEFT} 10V${BASE}H${WIDTH - 8}` }),
    svg("text", { x: LEFT - 5, y: 18, class: "of" }, top.toFixed(2)), svg("text", { x: LEFT - 5, y: BASE + 4, class: "of" }, "0"),
    svg("text", { x: (LEFT + WIDTH) / 2, y: HEIGHT - 8 }, below));
}

/** @param {Evaluation} found */
function horizons(found) {
  const made = document.createElement("table");
  made.className = "list";
  made.innerHTML = '<thead><tr><th scope="col">Ahead of the last reading</th><th scope="col" class="number">Log loss</th><th scope="col" class="number">Rhythm alone</th><th scope="col" class="number">Last reading alone</th></tr></thead>';
  const body = made.createTBody();
  for (const each of found.horizons) {
    const row = body.insertRow();
    const name = document.createElement("th");
    name.scope = "row";
    name.textContent = durationText(each.horizon_s);
    row.append(name);
    for (const kind of [each.conditioned, each.rhythm, each.persistence]) {
      const cell = row.insertCell();
      cell.className = "number";
      cell.textContent = kind.log_loss === null ? "–" : kind.log_loss.toFixed(3);
    }
  }
  return made;
}
