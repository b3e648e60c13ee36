// The model of a cell in plain words: what was chosen and why, what it costs, how far to trust it.

import { countText, percentText, timeText } from "../core/words.js";
/** @import { LocationView, Model, Score } from "../../../../types.d.ts" */

/** @type {Record<string, string>} */
const ESTIMATORS = {
  calendar: "the rhythm of the day and the week by the local clock",
  fft: "the strongest rhythms of any period, as in the paper",
  static: "the mean alone, the same at every time",
};

/**
 * @param {HTMLElement} host
 * @param {Model} model
 * @param {LocationView} view
 */
export function draw(host, model, view) {
  const made = document.createElement("dl");
  made.className = "card-facts";
  for (const [name, ...lines] of facts(model, view)) {
    const term = document.createElement("dt");
    term.textContent = name;
    made.append(term, ...lines.map((line) => Object.assign(document.createElement("dd"), { textContent: line })));
  }
  host.replaceChildren(made);
}

/**
 * @param {Model} model
 * @param {LocationView} view
 * @returns {string[][]}
 */
function facts(model, view) {
  const [start, stop] = [model.start, model.stop].map((time) => timeText(Date.parse(time) / 1000, view.zone));
  const { history_bytes, spectrum_bytes } = model.compression;
  const order = model.order ? `, with ${model.order} ${model.order === 1 ? "rhythm" : "rhythms"} at most` : "";
  const outliers = model.outliers.length;
  return [
    ["What it is", `Revision ${view.revision}, ${model.estimator}: ${ESTIMATORS[model.estimator] ?? "an estimator of its own"}${order}.`],
    ["Why", ...why(model)],
    ["Learned from", `${countText(model.samples)} samples, ${start} to ${stop}.`],
    ["How far to trust it", trust(model), remembered(model, outliers)],
    ["What it costs", `${countText(spectrum_bytes)} bytes for this cell, beside ${countText(history_bytes)} bytes of history.`],
  ];
}

/**
 * What was tried, and apart from it how the winner is set.
 * @param {Model} model
 */
function why({ selection }) {
  if (!selection) return ["The location's settings ask for it."];
  const [tried, ...settings] = selection.reason.split("; ");
  return [`${sentence(tried)} A log loss is lower where what happened was thought likelier.`, ...(settings.length ? [`Its settings: ${settings.join("; ")}.`] : [])];
}

/** @param {Model} model */
function trust(model) {
  const scores = model.selection?.scores ?? [];
  const own = scores.find((score) => score.estimator === model.estimator && score.order === model.order);
  const mean = scores.find((score) => score.estimator === "static");
  if (!own || own.log_loss === null || own.error === null) return "It was not tried on later time yet; Evaluation below does that.";
  return `On later time that it had not seen it was wrong ${percentText(own.error)} of the time, log loss ${own.log_loss.toFixed(3)}${beside(own, mean)}.`;
}

/**
 * @param {Score} own
 * @param {Score | undefined} mean
 */
const beside = (own, mean) => (mean && mean !== own && mean.log_loss !== null ? `; the mean alone has ${mean.log_loss.toFixed(3)}` : "");

/**
 * @param {Model} model
 * @param {number} outliers
 */
const remembered = (model, outliers) =>
  `It reproduces ${percentText(model.accuracy)} of the history it was fitted on, which says less: ${countText(outliers)} ${outliers === 1 ? "interval differs" : "intervals differ"}.`;

/** @param {string} text */
const sentence = (text) => `${text.charAt(0).toUpperCase()}${text.slice(1)}.`;
