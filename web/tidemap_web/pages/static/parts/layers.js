// What the scene shows and how: the location, layers, layout and settings, and the legend of what is shown.

import { all, byId as $ } from "../dom.js";
import { countText, durationText } from "../core/words.js";
/** @import { State } from "../core/state.js" */
/** @import { FrameMessage, ViewState } from "../../../../types.d.ts" */

/**
 * @param {State<ViewState>} state
 * @param {(view: "slanted" | "above") => void} aim
 */
export function mount(state, aim) {
  $("location").addEventListener("change", () => {
    const other = { location: $("location").value, grid: null, frame: null, events: [], span: null, reach: null, loop: null };
    state.change({ ...other, time: null, live: true, playing: false, cell: null, camera: null, low: null, high: null }, "push");
  });
  slider(state, "confidence", (value) => ({ confidence: value }));
  slider(state, "floor", (value) => ({ floor: value }));
  slider(state, "order", (value) => ({ order: value }));
  slider(state, "low", (value) => ({ low: value, high: Math.max(value, highest(state.values)) }));
  slider(state, "high", (value) => ({ high: value, low: Math.min(value, state.values.low ?? 0) }));
  $("order-auto").addEventListener("change", () => state.change({ order: $("order-auto").checked ? null : Number($("order").value) }, "push"));
  $("dim").addEventListener("change", () => state.change({ dim: $("dim").checked }, "push"));
  for (const name of /** @type {const} */ (["predicted", "observed", "zone"])) {
    const select = $(`${name}-layer`);
    select.addEventListener("change", () => state.change({ [name]: select.value }, "push"));
  }
  for (const button of all("[data-layout]")) {
    button.addEventListener("click", () => state.change({ layout: /** @type {any} */ (button.dataset.layout), camera: null }, "push"));
  }
  for (const button of all("[data-view]")) {
    button.addEventListener("click", () => aim(/** @type {any} */ (button.dataset.view)));
  }
  state.subscribe((changed) => {
    showSettings(state.values);
    if (changed.has("frame") || changed.has("grid")) showFrame(state.values);
  });
  showSettings(state.values);
}

/**
 * The first movement of a drag is an entry of its own, the rest goes on in it.
 * @param {State<ViewState>} state
 * @param {"confidence" | "floor" | "order" | "low" | "high"} id
 * @param {(value: number) => Partial<ViewState>} changes
 */
function slider(state, id, changes) {
  let moved = false;
  $(id).addEventListener("input", () => {
    state.change(changes(Number($(id).value)), moved ? "replace" : "push");
    moved = true;
  });
  $(id).addEventListener("change", () => (moved = false));
}

/** @param {ViewState} view */
const highest = (view) => view.high ?? (view.grid?.shape[2] ?? 1) - 1;

/** @param {ViewState} view */
function showSettings(view) {
  const confidence = view.confidence ?? view.grid?.confidence ?? null;
  if (confidence !== null) $("confidence").value = String(confidence);
  $("confidence-value").textContent = confidence === null ? "" : confidence.toFixed(2);
  $("floor").value = String(view.floor);
  $("floor-value").textContent = view.floor.toFixed(2);
  $("floor-note").textContent = view.floor > 0 ? `(hidden where p is below ${view.floor.toFixed(2)})` : "";
  for (const part of all(".ramp-floor")) part.style.width = `${100 * view.floor}%`;
  $("dim").checked = view.dim;
  $("order-auto").checked = view.order === null;
  $("order").disabled = view.order === null;
  if (view.order !== null) $("order").value = String(view.order);
  $("order-value").textContent = view.order === null ? "auto" : String(view.order);
  for (const name of /** @type {const} */ (["predicted", "observed", "zone"])) $(`${name}-layer`).value = view[name];
  for (const button of all("[data-layout]")) button.setAttribute("aria-pressed", String(button.dataset.layout === view.layout));
  showSlice(view);
  showLegend(view);
}

/** @param {ViewState} view */
function showSlice(view) {
  const { grid } = view;
  const layers = grid?.shape[2] ?? 1;
  $("slice").hidden = layers < 2;
  for (const id of /** @type {const} */ (["low", "high"])) $(id).max = String(layers - 1);
  const [low, high] = [view.low ?? 0, Math.min(highest(view), layers - 1)];
  $("low").value = String(low);
  $("high").value = String(high);
  const metres = (/** @type {number} */ steps) => ((grid?.origin_m[2] ?? 0) + steps * (grid?.resolution_m ?? 1)).toFixed(2);
  $("slice-value").textContent = `${metres(low)} – ${metres(high + 1)} m`;
}

/** @param {ViewState} view */
function showLegend(view) {
  for (const part of all("[data-when]")) part.hidden = !(part.dataset.when ?? "").split(" ").some((when) => shown(view, when));
  $("sensors-legend").hidden = !view.frame?.sensors;
  for (const part of all(".structure")) part.hidden = !view.dim || view.predicted === "entropy" || view.layout === "difference";
}

/**
 * @param {ViewState} view
 * @param {string} when such as `beside/seen`: a layout, and a layer of its grids; either may be `*`
 */
function shown(view, when) {
  const [layout, layer] = when.split("/");
  const layers = view.layout === "difference" ? ["difference"] : view.layout === "overlay" ? [view.predicted] : [view.predicted, view.observed];
  return (layout === "*" || layout === view.layout) && (layer === "*" || layers.some((each) => each === layer));
}

/** @param {ViewState} view */
function showFrame({ frame, grid }) {
  const numbers = /** @type {const} */ (["unexpected", "missing", "stale"]);
  for (const id of numbers) {
    for (const part of all(`[data-count=${id}]`)) part.textContent = frame?.[id] ? countText(frame[id]) : "";
  }
  $("model").textContent = frame && grid ? modelText(frame, grid) : "";
  if (frame) for (const part of all(".fresh")) part.textContent = durationText(frame.fresh_s);
  if (frame && grid) pairs($("facts"), factsOf(frame, grid));
  else $("facts").replaceChildren();
}

/**
 * @param {FrameMessage} frame
 * @param {NonNullable<ViewState["grid"]>} grid
 */
const modelText = (frame, grid) =>
  frame.revision ? `revision ${frame.revision} (${frame.estimator})` : `no model yet: first update at ${countText(grid.first_update)} measurements`;

/**
 * @param {FrameMessage} frame
 * @param {NonNullable<ViewState["grid"]>} grid
 * @returns {[string, string][]}
 */
const factsOf = (frame, grid) => [
  ["Revision", frame.revision ? String(frame.revision) : "–"],
  ["Estimator", frame.revision ? `${frame.estimator}, order ${frame.order}` : "–"],
  ["Predicted", `${countText(frame.predicted)} cells shown`],
  ["Observed", `${countText(frame.observed)} cells shown`],
  ["Known", `${countText(frame.cells)} cells`],
  ["Grid", `${grid.shape.join(" × ")} of ${grid.resolution_m} m`],
  ["Floor lines", `every ${frame.lines_m} m`],
  ["Frame", grid.frame],
];

/**
 * @param {HTMLElement} list
 * @param {[string, string | Node][]} items
 */
export function pairs(list, items) {
  list.replaceChildren(
    ...items.flatMap(([term, text]) => {
      const dt = document.createElement("dt");
      const dd = document.createElement("dd");
      dt.textContent = term;
      dd.append(text);
      return [dt, dd];
    }),
  );
}
