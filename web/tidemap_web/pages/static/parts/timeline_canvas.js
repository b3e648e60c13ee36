// What the timeline shows, on canvases: what was observed, what is to come, anomalies, the loop, and ticks.

import { colours } from "../core/colours.js";
import { barsOf } from "../core/density.js";
import { timeScale } from "../core/scale.js";
import { stepOf, ticksOf } from "../core/ticks.js";
import { zoneOf } from "../core/time.js";
import { allOf, windowOf } from "../core/window.js";
import { clockText, dayText } from "../core/words.js";
/** @import { TimeScale } from "../core/scale.js" */
/** @import { Density, Mark, Span, ViewState } from "../../../../types.d.ts" */

/** @typedef {Record<string, string>} Colours */

const DAY = 86400;
export const MARGIN = 6;
const BAND = 14;
const HEIGHT = 16;

/**
 * The stretch that is covered, in detail.
 * @param {HTMLCanvasElement} canvas
 * @param {ViewState} view
 * @param {Density | null} density
 */
export function drawTimeline(canvas, view, density) {
  const ctx = cleared(canvas);
  if (!ctx || !view.grid?.span) return;
  const c = colours();
  const scale = timeScale(windowOf(view), canvas.clientWidth, MARGIN);
  drawBand(ctx, scale, view.grid.span, c, BAND, HEIGHT);
  drawBars(ctx, scale, density, c, BAND, HEIGHT);
  forecastText(ctx, scale, view.grid.span, c);
  drawTicks(ctx, scale, c, canvas.clientWidth, zoneOf(view.zone, view.grid.time_zone));
  drawLoop(ctx, scale, view, c, BAND, HEIGHT);
  for (const event of view.events) drawMark(ctx, event, scale, c, canvas.clientWidth);
  drawNow(ctx, scale, view.grid.span, c, BAND - 4, HEIGHT + 8);
}

/**
 * All there is, with what of it the timeline covers, and the moment.
 * @param {HTMLCanvasElement} canvas
 * @param {ViewState} view
 * @param {Density | null} density
 */
export function drawWhole(canvas, view, density) {
  const ctx = cleared(canvas);
  if (!ctx || !view.grid?.span) return;
  const c = colours();
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const scale = timeScale(allOf(view.grid.span, view.grid.interval_s), width, MARGIN);
  drawBand(ctx, scale, view.grid.span, c, 1, height - 2);
  drawBars(ctx, scale, density, c, 1, height - 2);
  ctx.fillStyle = c.anomaly;
  for (const event of view.events) {
    if (!event.acknowledged) ctx.fillRect(scale.clip(event.start) - 0.75, 1, Math.max(1.5, scale.clip(event.stop) - scale.clip(event.start)), 4);
  }
  drawLoop(ctx, scale, view, c, 1, height - 2);
  drawCover(ctx, scale, windowOf(view), c, height);
  if (view.time === null) return;
  ctx.fillStyle = c.accent;
  ctx.fillRect(scale.clip(view.time) - 1, 0, 2, height);
}

/**
 * @param {HTMLCanvasElement} canvas
 * @returns {CanvasRenderingContext2D | null} for lengths in CSS pixels
 */
function cleared(canvas) {
  canvas.width = Math.round(canvas.clientWidth * devicePixelRatio);
  canvas.height = Math.round(canvas.clientHeight * devicePixelRatio);
  const ctx = canvas.width ? canvas.getContext("2d") : null;
  ctx?.scale(devicePixelRatio, devicePixelRatio);
  return ctx;
}

/**
 * History is plain, what nobody has seen yet is hatched.
 * @param {CanvasRenderingContext2D} ctx
 * @param {TimeScale} scale
 * @param {Span} span
 * @param {Colours} c
 * @param {number} top
 * @param {number} height
 */
function drawBand(ctx, scale, { first, last, stop }, c, top, height) {
  ctx.fillStyle = c.raised;
  ctx.fillRect(scale.clip(scale.low), top, scale.clip(scale.high) - scale.clip(scale.low), height);
  ctx.fillStyle = c.free;
  ctx.fillRect(scale.clip(first), top, Math.max(0, scale.clip(last) - scale.clip(first)), height);
  const [left, right] = [scale.clip(last), scale.clip(stop)];
  if (right <= left) return;
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, right - left, height);
  ctx.clip();
  ctx.strokeStyle = c.quiet;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let x = left - height; x < right; x += 5) {
    ctx.moveTo(x, top + height);
    ctx.lineTo(x + height, top);
  }
  ctx.stroke();
  ctx.restore();
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {TimeScale} scale
 * @param {Density | null} density
 * @param {Colours} c
 * @param {number} top
 * @param {number} height
 */
function drawBars(ctx, scale, density, c, top, height) {
  ctx.fillStyle = c.seen;
  for (const { start, stop, share } of density ? barsOf(density) : []) {
    if (stop < scale.low || start > scale.high) continue;
    // On whole pixels: fractions of neighbours would leave lines between them.
    const left = Math.round(scale.clip(start));
    const tall = Math.max(2, share * height);
    ctx.fillRect(left, top + height - tall, Math.max(1, Math.round(scale.clip(stop)) - left), tall);
  }
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {TimeScale} scale
 * @param {Span} span
 * @param {Colours} c
 */
function forecastText(ctx, scale, { last, stop }, c) {
  const left = scale.clip(last);
  if (scale.clip(stop) - left <= 70) return;
  ctx.font = "11px system-ui, sans-serif";
  ctx.fillStyle = c.quiet;
  ctx.textBaseline = "top";
  ctx.textAlign = "left";
  ctx.fillText("forecast ›", left + 5, 0);
}

/**
 * What playing goes round in.
 * @param {CanvasRenderingContext2D} ctx
 * @param {TimeScale} scale
 * @param {ViewState} view
 * @param {Colours} c
 * @param {number} top
 * @param {number} height
 */
function drawLoop(ctx, scale, { loop }, c, top, height) {
  if (!loop || loop[1] < scale.low || loop[0] > scale.high) return;
  const [left, right] = [scale.clip(loop[0]), scale.clip(loop[1])];
  ctx.fillStyle = c.loop;
  ctx.fillRect(left, top, right - left, height);
  ctx.fillStyle = c.accent;
  ctx.fillRect(left, top + height - 2, right - left, 2);
  for (const [edge, inward] of [[left, 1], [right, -1]]) {
    ctx.fillRect(inward > 0 ? edge : edge - 2, top, 2, height);
    ctx.fillRect(inward > 0 ? edge : edge - 5, top, 5, 2);
  }
}

/**
 * What is covered stays clear, the rest is dimmed.
 * @param {CanvasRenderingContext2D} ctx
 * @param {TimeScale} scale
 * @param {[number, number]} covered
 * @param {Colours} c
 * @param {number} height
 */
function drawCover(ctx, scale, covered, c, height) {
  const [left, right] = covered.map(scale.clip);
  ctx.fillStyle = c.paper;
  ctx.globalAlpha = 0.6;
  ctx.fillRect(0, 0, left, height);
  ctx.fillRect(right, 0, scale.clip(scale.high) + MARGIN - right, height);
  ctx.globalAlpha = 1;
  ctx.strokeStyle = c.ink;
  ctx.lineWidth = 1;
  ctx.strokeRect(left - 0.5, 0.5, Math.max(3, right - left + 1), height - 1);
  ctx.fillStyle = c.ink;
  for (const edge of [left, right]) ctx.fillRect(edge - 1.5, height / 2 - 4, 3, 8);
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {TimeScale} scale
 * @param {Span} span
 * @param {Colours} c
 * @param {number} top
 * @param {number} height
 */
function drawNow(ctx, scale, { last }, c, top, height) {
  ctx.fillStyle = c.ink;
  if (last >= scale.low && last <= scale.high) ctx.fillRect(scale.x(last) - 0.75, top, 1.5, height);
}

/**
 * @param {Mark} mark
 * @param {TimeScale} scale
 */
export const middleOf = (mark, { x }) => x(mark.start) + Math.max(2, x(mark.stop) - x(mark.start)) / 2;

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Mark} event
 * @param {TimeScale} scale
 * @param {Colours} c
 * @param {number} width
 */
function drawMark(ctx, event, scale, c, width) {
  const left = scale.x(event.start);
  const size = Math.max(2, scale.x(event.stop) - left);
  if (left + size < MARGIN || left > width - MARGIN) return;
  ctx.fillStyle = event.acknowledged ? c.quiet : c.anomaly;
  ctx.fillRect(left, BAND, size, HEIGHT);
  const middle = middleOf(event, scale);
  ctx.beginPath();
  ctx.moveTo(middle - 5, 2);
  ctx.lineTo(middle + 5, 2);
  ctx.lineTo(middle, 11);
  ctx.fill();
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {TimeScale} scale
 * @param {Colours} c
 * @param {number} width
 * @param {string} zone
 */
function drawTicks(ctx, { low, high, x }, c, width, zone) {
  const step = stepOf(high - low, Math.max(2, width / 92));
  const below = BAND + HEIGHT;
  ctx.font = "11px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  for (const time of ticksOf(low, high, step, zone)) {
    const at = x(time);
    ctx.fillStyle = c.line;
    ctx.fillRect(at, below, 1, 5);
    const clock = clockText(time, zone, false);
    const day = clock === "00:00" || step >= DAY;
    ctx.fillStyle = day ? c.ink : c.quiet;
    const label = day ? dayText(time, zone) : clock;
    const half = ctx.measureText(label).width / 2;
    if (at - half >= 0 && at + half <= width) ctx.fillText(label, at, below + 7);
  }
}
