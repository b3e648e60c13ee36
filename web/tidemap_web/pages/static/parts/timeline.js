// The timeline: history and future, ticks in local time, marks of anomalies, and a slider over all of it.

import { colours } from "../core/colours.js";
import { stepOf, ticksOf } from "../core/ticks.js";
import { fromLocal, zoneOf } from "../core/time.js";
import { clockText, dayText, durationText, offsetOf } from "../core/words.js";
/** @import { State } from "../core/state.js" */
/** @import { Mark, ViewState } from "../../../../types.d.ts" */

const DAY = 86400;
const THUMB = 12;
const HIT = 6;
const BAND = 14;
const MONDAY = 4 * DAY;
const MIN_SAMPLES = 4;

/**
 * What the timeline covers: what was zoomed to, all, or the local day or week that holds the moment.
 * @param {ViewState} view
 * @returns {[number, number]}
 */
export function windowOf({ grid, reach, span, time, zone }) {
  if (!grid?.span) return [0, 0];
  if (span) return span;
  const { first, stop } = grid.span;
  const chosen = reach ?? (stop - first > 15 * DAY ? "week" : "all");
  if (chosen === "all") return [first, Math.max(stop, first + grid.interval_s)];
  const shown = zoneOf(zone, grid.time_zone);
  const [length, anchor] = chosen === "day" ? [DAY, 0] : [7 * DAY, MONDAY];
  const moment = time ?? grid.span.last;
  const local = moment + offsetOf(moment, shown);
  const start = Math.floor((local - anchor) / length) * length + anchor;
  return [fromLocal(start, shown), fromLocal(start + length, shown)];
}

/**
 * @param {HTMLElement} element
 * @param {State<ViewState>} state
 * @param {(time: number, entry: "push" | "replace") => void} go
 */
export function mount(element, state, go) {
  const canvas = /** @type {HTMLCanvasElement} */ (element.querySelector("canvas"));
  const slider = /** @type {HTMLInputElement} */ (element.querySelector("input"));
  const tip = document.createElement("output");
  tip.className = "tip";
  tip.hidden = true;
  element.append(tip);

  const scale = () => {
    const [low, high] = windowOf(state.values);
    const width = canvas.clientWidth - THUMB;
    return {
      low, high,
      x: (/** @type {number} */ time) => THUMB / 2 + ((time - low) / (high - low)) * width,
      time: (/** @type {number} */ x) => low + ((x - THUMB / 2) / width) * (high - low),
    };
  };
  const at = (/** @type {MouseEvent} */ event) => event.clientX - canvas.getBoundingClientRect().left;

  /**
   * The mark that is drawn at a position.
   * @param {number} x
   * @returns {Mark | null}
   */
  function markAt(x) {
    const { x: of, low, high } = scale();
    const drawn = state.values.events.filter((event) => event.stop >= low && event.start <= high);
    const away = (/** @type {Mark} */ event) => Math.abs(x - middleOf(event, of));
    const near = drawn.filter((event) => away(event) <= Math.max(HIT, (of(event.stop) - of(event.start)) / 2));
    return near.sort((one, other) => away(one) - away(other))[0] ?? null;
  }

  element.addEventListener("pointerdown", (event) => {
    const mark = markAt(at(event));
    if (!mark || event.button !== 0) return;
    event.preventDefault();
    event.stopPropagation();
    go(mark.start, "push");
  }, true);
  let moved = false;
  slider.addEventListener("pointerdown", () => (moved = false));
  slider.addEventListener("input", () => {
    go(Number(slider.value), moved ? "replace" : "push");
    moved = true;
  });
  slider.addEventListener("change", () => (moved = false));

  element.addEventListener("pointermove", (event) => {
    const { grid, zone } = state.values;
    if (!grid?.span) return;
    const x = at(event);
    const mark = markAt(x);
    const { time } = scale();
    const shown = zoneOf(zone, grid.time_zone);
    const moment = mark ? mark.start : time(x);
    tip.textContent = [momentText(moment, shown), mark && wordsOf(mark), !mark && moment > grid.span.last && "forecast"].filter(Boolean).join(" · ");
    tip.hidden = false;
    tip.style.left = `${Math.min(canvas.clientWidth - tip.offsetWidth, Math.max(0, x - tip.offsetWidth / 2))}px`;
    element.classList.toggle("on-mark", mark !== null);
  });
  element.addEventListener("pointerleave", () => (tip.hidden = true));
  element.addEventListener("wheel", (event) => {
    if (!state.values.grid?.span) return;
    event.preventDefault();
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) pan(state, (event.deltaX || event.deltaY) / canvas.clientWidth);
    else zoom(state, 1.0015 ** event.deltaY, scale().time(at(event)));
  }, { passive: false });

  const redraw = () => draw(canvas, state.values);
  state.subscribe(() => {
    const { grid, time } = state.values;
    slider.disabled = !grid?.span;
    if (grid?.span && time !== null) {
      const [low, high] = windowOf(state.values);
      const shown = zoneOf(state.values.zone, grid.time_zone);
      slider.min = String(Math.floor(low));
      slider.max = String(Math.ceil(high));
      slider.value = String(Math.round(time));
      slider.setAttribute("aria-valuetext", momentText(time, shown));
    }
    redraw();
  });
  new ResizeObserver(redraw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}

/**
 * Zoom by a factor around a moment, no closer than a few samples and no further than all there is.
 * @param {State<ViewState>} state
 * @param {number} factor
 * @param {number} around
 */
export function zoom(state, factor, around) {
  const { grid } = state.values;
  if (!grid?.span) return;
  const [low, high] = windowOf(state.values);
  const { first, stop } = grid.span;
  const least = MIN_SAMPLES * grid.interval_s;
  const length = Math.min(Math.max(stop - first, least), Math.max(least, (high - low) * factor));
  const start = around - ((around - low) / (high - low)) * length;
  state.change({ span: within(start, length, first, stop) });
}

/**
 * @param {State<ViewState>} state
 * @param {number} share of what is covered
 */
export function pan(state, share) {
  const { grid } = state.values;
  if (!grid?.span) return;
  const [low, high] = windowOf(state.values);
  state.change({ span: within(low + share * (high - low), high - low, grid.span.first, grid.span.stop) });
}

/**
 * @param {number} start
 * @param {number} length
 * @param {number} first
 * @param {number} stop
 * @returns {[number, number]}
 */
function within(start, length, first, stop) {
  const begin = Math.max(Math.min(start, stop - length), Math.min(first, stop - length));
  return [begin, begin + length];
}

/**
 * @param {number} time
 * @param {string} zone
 */
const momentText = (time, zone) => `${dayText(time, zone)}, ${clockText(time, zone)}`;

/** @param {Mark} mark */
const wordsOf = (mark) =>
  `${mark.observed ? "occupied, expected free" : "free, expected occupied"} for ${durationText(Math.max(1, mark.stop - mark.start))}`;

/**
 * @param {Mark} mark
 * @param {(time: number) => number} x
 */
const middleOf = (mark, x) => x(mark.start) + Math.max(2, x(mark.stop) - x(mark.start)) / 2;

/**
 * @param {HTMLCanvasElement} canvas
 * @param {ViewState} view
 */
function draw(canvas, view) {
  const ratio = devicePixelRatio;
  const width = canvas.clientWidth;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(canvas.clientHeight * ratio);
  const ctx = canvas.getContext("2d");
  if (!ctx || !view.grid?.span || width === 0) return;
  ctx.scale(ratio, ratio);
  const c = colours();
  const [low, high] = windowOf(view);
  const x = (/** @type {number} */ time) => THUMB / 2 + ((time - low) / (high - low)) * (width - THUMB);
  const clip = (/** @type {number} */ value) => Math.min(width - THUMB / 2, Math.max(THUMB / 2, value));
  const { first, last, stop } = view.grid.span;
  ctx.fillStyle = c.raised;
  ctx.fillRect(clip(x(low)), BAND, clip(x(high)) - clip(x(low)), 12);
  ctx.fillStyle = c.free;
  ctx.fillRect(clip(x(first)), BAND, Math.max(0, clip(x(last)) - clip(x(first))), 12);
  drawFuture(ctx, clip(x(last)), clip(x(stop)), c);
  drawTicks(ctx, [low, high], x, c, width, zoneOf(view.zone, view.grid.time_zone));
  for (const event of view.events) drawMark(ctx, event, x, width, c);
  ctx.fillStyle = c.ink;
  if (last >= low && last <= high) ctx.fillRect(x(last) - 0.75, BAND - 4, 1.5, 20);
}

/**
 * What nobody has seen yet is hatched.
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} left
 * @param {number} right
 * @param {Record<string, string>} c
 */
function drawFuture(ctx, left, right, c) {
  if (right <= left) return;
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, BAND, right - left, 12);
  ctx.clip();
  ctx.strokeStyle = c.quiet;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let x = left - 12; x < right; x += 5) {
    ctx.moveTo(x, BAND + 12);
    ctx.lineTo(x + 12, BAND);
  }
  ctx.stroke();
  ctx.restore();
  ctx.font = "11px system-ui, sans-serif";
  ctx.fillStyle = c.quiet;
  ctx.textBaseline = "top";
  ctx.textAlign = "left";
  if (right - left > 70) ctx.fillText("forecast ›", left + 5, 0);
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Mark} event
 * @param {(time: number) => number} x
 * @param {number} width
 * @param {Record<string, string>} c
 */
function drawMark(ctx, event, x, width, c) {
  const left = x(event.start);
  const size = Math.max(2, x(event.stop) - left);
  if (left + size < THUMB / 2 || left > width - THUMB / 2) return;
  ctx.fillStyle = event.acknowledged ? c.quiet : c.anomaly;
  ctx.fillRect(left, BAND, size, 12);
  const middle = middleOf(event, x);
  ctx.beginPath();
  ctx.moveTo(middle - 5, 2);
  ctx.lineTo(middle + 5, 2);
  ctx.lineTo(middle, 11);
  ctx.fill();
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {[number, number]} covered
 * @param {(time: number) => number} x
 * @param {Record<string, string>} c
 * @param {number} width
 * @param {string} zone
 */
function drawTicks(ctx, [low, high], x, c, width, zone) {
  const step = stepOf(high - low, Math.max(2, width / 92));
  ctx.font = "11px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  for (const time of ticksOf(low, high, step, zone)) {
    const at = x(time);
    ctx.fillStyle = c.line;
    ctx.fillRect(at, BAND + 12, 1, 6);
    const clock = clockText(time, zone, false);
    const day = clock === "00:00" || step >= DAY;
    ctx.fillStyle = day ? c.ink : c.quiet;
    const label = day ? dayText(time, zone) : clock;
    const half = ctx.measureText(label).width / 2;
    if (at - half >= 0 && at + half <= width) ctx.fillText(label, at, BAND + 22);
  }
}
