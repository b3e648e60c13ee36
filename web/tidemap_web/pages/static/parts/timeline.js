// The timeline: what was observed and what is to come, marks of anomalies, a slider over what is covered, and a strip of
// all there is to choose that from.

import { countAt } from "../core/density.js";
import { loopOf } from "../core/playing.js";
import { timeScale } from "../core/scale.js";
import { zoneOf } from "../core/time.js";
import { allOf, dragged, gripAt, panned, windowOf, zoomed } from "../core/window.js";
import { clockText, countText, dayText, durationText } from "../core/words.js";
import { DensityStrip } from "./density.js";
import { MARGIN, drawTimeline, drawWhole, middleOf } from "./timeline_canvas.js";
/** @import { State } from "../core/state.js" */
/** @import { Mark, ViewState } from "../../../../types.d.ts" */

/** @typedef {(time: number, entry: "push" | "replace") => void} Go */

const HIT = 6;
const WHEEL = 1.0015;

/**
 * @param {HTMLElement} element
 * @param {State<ViewState>} state
 * @param {Go} go
 */
export function mount(element, state, go) {
  const canvas = /** @type {HTMLCanvasElement} */ (element.querySelector("canvas.covered"));
  const whole = /** @type {HTMLCanvasElement} */ (element.querySelector("canvas.whole"));
  const redraw = () => {
    drawTimeline(canvas, state.values, near.density ?? far.density);
    drawWhole(whole, state.values, far.density);
    say();
  };
  const [near, far] = [new DensityStrip(redraw), new DensityStrip(redraw)];
  const say = hint(canvas, element, state, (moment, onWhole) => {
    const close = onWhole ? null : countAt(near.density, moment);
    return close ?? countAt(far.density, moment);
  });
  state.subscribe(() => {
    count(state.values, near, far);
    redraw();
  });
  slide(element, state, go);
  press(canvas, element, state, go);
  brush(whole, state);
  element.addEventListener("wheel", (event) => wheel(event, canvas, state), { passive: false });
  const sizes = new ResizeObserver(redraw);
  for (const each of [canvas, whole]) sizes.observe(each);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}

/**
 * Ask what was observed of all, and of what is covered.
 * @param {ViewState} view
 * @param {DensityStrip} near
 * @param {DensityStrip} far
 */
function count(view, near, far) {
  const { grid } = view;
  if (!grid?.span) return;
  const { first, last } = grid.span;
  const [low, high] = windowOf(view);
  far.show(grid.name, [first, last + grid.interval_s], last);
  const seen = /** @type {[number, number]} */ ([Math.max(low, first), Math.min(high, last + grid.interval_s)]);
  if (seen[1] > seen[0]) near.show(grid.name, seen, last);
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {ViewState} view
 */
const scaleOf = (canvas, view) => timeScale(windowOf(view), canvas.clientWidth, MARGIN);

/**
 * @param {HTMLElement} element
 * @param {MouseEvent} event
 */
const at = (element, event) => event.clientX - element.getBoundingClientRect().left;

/**
 * The mark that is drawn at a position.
 * @param {HTMLCanvasElement} canvas
 * @param {ViewState} view
 * @param {number} x
 * @returns {Mark | null}
 */
function markAt(canvas, view, x) {
  const scale = scaleOf(canvas, view);
  const drawn = view.events.filter((event) => event.stop >= scale.low && event.start <= scale.high);
  const away = (/** @type {Mark} */ event) => Math.abs(x - middleOf(event, scale));
  const close = drawn.filter((event) => away(event) <= Math.max(HIT, (scale.x(event.stop) - scale.x(event.start)) / 2));
  return close.sort((one, other) => away(one) - away(other))[0] ?? null;
}

/**
 * The slider. The first movement of a drag is an entry of its own, the rest goes on in it.
 * @param {HTMLElement} element
 * @param {State<ViewState>} state
 * @param {Go} go
 */
function slide(element, state, go) {
  const slider = /** @type {HTMLInputElement} */ (element.querySelector("input"));
  let moved = false;
  slider.addEventListener("pointerdown", () => (moved = false));
  slider.addEventListener("input", () => {
    go(Number(slider.value), moved ? "replace" : "push");
    moved = true;
  });
  slider.addEventListener("change", () => (moved = false));
  state.subscribe(() => {
    const { grid, time, zone } = state.values;
    slider.disabled = !grid?.span;
    if (!grid?.span || time === null) return;
    const [low, high] = windowOf(state.values);
    slider.min = String(Math.floor(low));
    slider.max = String(Math.ceil(high));
    slider.value = String(Math.round(time));
    slider.setAttribute("aria-valuetext", momentText(time, zoneOf(zone, grid.time_zone)));
  });
}

/**
 * A click on a mark goes to its moment; with Shift, a drag chooses what playing goes round in.
 * @param {HTMLCanvasElement} canvas
 * @param {HTMLElement} element
 * @param {State<ViewState>} state
 * @param {Go} go
 */
function press(canvas, element, state, go) {
  /** @type {number | null} */
  let from = null;
  /** @type {"push" | "replace"} */
  let entry = "push";
  element.addEventListener("pointerdown", (event) => {
    const { grid } = state.values;
    if (event.button !== 0 || !grid?.span || /** @type {Element} */ (event.target).matches(".whole")) return;
    const mark = event.shiftKey ? null : markAt(canvas, state.values, at(canvas, event));
    if (!mark && !event.shiftKey) return;
    event.preventDefault();
    event.stopPropagation();
    if (mark) return go(mark.start, "push");
    from = scaleOf(canvas, state.values).time(at(canvas, event));
    entry = "push";
    element.setPointerCapture(event.pointerId);
  }, true);
  element.addEventListener("pointermove", (event) => {
    const { grid } = state.values;
    if (from === null || !grid?.span) return;
    const loop = loopOf(from, scaleOf(canvas, state.values).time(at(canvas, event)), grid.span, grid.interval_s);
    state.change({ loop }, entry);
    entry = "replace";
  });
  for (const kind of ["pointerup", "pointercancel"]) element.addEventListener(kind, () => (from = null));
}

/**
 * The time under the pointer, and what there is. Returns a function that says it again, for more may be known by then.
 * @param {HTMLCanvasElement} canvas
 * @param {HTMLElement} element
 * @param {State<ViewState>} state
 * @param {(moment: number, onWhole: boolean) => ReturnType<typeof countAt>} observed
 */
function hint(canvas, element, state, observed) {
  const tip = document.createElement("output");
  tip.className = "tip";
  tip.hidden = true;
  element.append(tip);
  /** @type {{ x: number, onWhole: boolean } | null} */
  let pointer = null;
  const say = () => {
    const { grid, zone } = state.values;
    if (!pointer || !grid?.span) return void (tip.hidden = true);
    const { x, onWhole } = pointer;
    const mark = onWhole ? null : markAt(canvas, state.values, x);
    const scale = onWhole ? timeScale(allOf(grid.span, grid.interval_s), canvas.clientWidth, MARGIN) : scaleOf(canvas, state.values);
    const moment = mark ? mark.start : scale.time(x);
    const said = mark ? wordsOf(mark) : moment > grid.span.last ? "forecast" : observedText(observed(moment, onWhole));
    tip.textContent = [momentText(moment, zoneOf(zone, grid.time_zone)), said].filter(Boolean).join(" · ");
    tip.hidden = false;
    tip.style.left = `${Math.min(canvas.clientWidth - tip.offsetWidth, Math.max(0, x - tip.offsetWidth / 2))}px`;
    element.classList.toggle("on-mark", mark !== null);
  };
  element.addEventListener("pointermove", (event) => {
    pointer = { x: at(canvas, event), onWhole: /** @type {Element} */ (event.target).matches(".whole") };
    say();
  });
  element.addEventListener("pointerleave", () => {
    pointer = null;
    say();
  });
  return say;
}

/**
 * The strip of all: its window is moved, resized at an edge, or drawn anew; a double click covers all.
 * @param {HTMLCanvasElement} whole
 * @param {State<ViewState>} state
 */
function brush(whole, state) {
  /** @type {{ grip: import("../core/window.js").Grip, from: number, stretch: [number, number] } | null} */
  let held = null;
  const scale = () => {
    const { grid } = state.values;
    return grid?.span ? timeScale(allOf(grid.span, grid.interval_s), whole.clientWidth, MARGIN) : null;
  };
  const gripOf = (/** @type {PointerEvent} */ event) => {
    const [left, right] = windowOf(state.values).map((time) => scale()?.clip(time) ?? 0);
    return gripAt(at(whole, event), left, right, HIT);
  };
  whole.addEventListener("pointerdown", (event) => {
    const found = scale();
    if (event.button !== 0 || !found) return;
    event.preventDefault();
    whole.setPointerCapture(event.pointerId);
    const covered = windowOf(state.values);
    const all = covered[0] <= found.low && covered[1] >= found.high;
    held = { grip: all ? "new" : gripOf(event), from: found.time(at(whole, event)), stretch: covered };
  });
  whole.addEventListener("pointermove", (event) => {
    const { grid } = state.values;
    const to = scale()?.time(at(whole, event));
    whole.dataset.grip = held?.grip ?? gripOf(event);
    if (!held || !grid?.span || to === undefined) return;
    state.change({ span: dragged(held.stretch, held.grip, held.from, to, grid.span, grid.interval_s) });
  });
  for (const kind of ["pointerup", "pointercancel"]) whole.addEventListener(kind, () => (held = null));
  whole.addEventListener("dblclick", () => state.change({ span: null, reach: "all" }));
}

/**
 * @param {WheelEvent} event
 * @param {HTMLCanvasElement} canvas
 * @param {State<ViewState>} state
 */
function wheel(event, canvas, state) {
  if (!state.values.grid?.span) return;
  event.preventDefault();
  if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) pan(state, (event.deltaX || event.deltaY) / canvas.clientWidth);
  else zoom(state, WHEEL ** event.deltaY, scaleOf(canvas, state.values).time(at(canvas, event)));
}

/**
 * @param {State<ViewState>} state
 * @param {number} factor
 * @param {number} around
 */
export function zoom(state, factor, around) {
  const { grid } = state.values;
  if (grid?.span) state.change({ span: zoomed(windowOf(state.values), factor, around, grid.span, grid.interval_s) });
}

/**
 * @param {State<ViewState>} state
 * @param {number} share of what is covered
 */
export function pan(state, share) {
  const { grid } = state.values;
  if (grid?.span) state.change({ span: panned(windowOf(state.values), share, grid.span) });
}

/**
 * @param {number} time
 * @param {string} zone
 */
const momentText = (time, zone) => `${dayText(time, zone)}, ${clockText(time, zone)}`;

/** @param {Mark} mark */
const wordsOf = (mark) =>
  `${mark.observed ? "occupied, expected free" : "free, expected occupied"} for ${durationText(Math.max(1, mark.stop - mark.start))}`;

/** @param {ReturnType<typeof countAt>} count */
function observedText(count) {
  if (!count) return "";
  const measurements = `${countText(count.measurements)} ${count.measurements === 1 ? "measurement" : "measurements"}`;
  return count.measurements ? `${measurements} in ${durationText(count.stop - count.start)}` : "nothing observed";
}
