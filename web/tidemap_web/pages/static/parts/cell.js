// The selected cell: its facts at the moment that is shown, and its series over what the timeline covers.

import { ask } from "../core/api.js";
import { colours } from "../core/colours.js";
import { lastSeenText, probabilityText } from "../core/facts.js";
import { drawStrips } from "../core/strips.js";
import { zoneOf } from "../core/time.js";
import { windowOf } from "../core/window.js";
import { clockText, dayText } from "../core/words.js";
import { byId as $, reason } from "../dom.js";
import { pairs } from "./layers.js";
/** @import { State } from "../core/state.js" */
/** @import { CellFacts, Series, ViewState } from "../../../../types.d.ts" */

const POINTS = 240;
const QUIET_MS = 200;
const STRIP = 7;

/**
 * @param {State<ViewState>} state
 * @param {{ embedded: boolean, go: (time: number, entry: "push" | "replace") => void }} how
 */
export function mount(state, { embedded, go }) {
  const canvas = $("series");
  /** @type {(Series & { step: number }) | null} */
  let series = null;
  let asked = "";
  let timer = 0;

  async function load() {
    const { location, cell, grid, frame } = state.values;
    const [low, high] = windowOf(state.values);
    if (cell === null || !grid?.span || !frame?.selected) return;
    const step = Math.max(1, Math.ceil((high - low) / POINTS / grid.interval_s)) * grid.interval_s;
    const start = Math.floor(low / step) * step;
    const question = `/locations/${encodeURIComponent(location ?? "")}/series?cell=${cell}&start=${start}&stop=${high}&step=${step}`;
    const version = `${question} ${frame.revision} ${grid.span.last}`;
    if (version === asked) return;
    asked = version;
    try {
      const answer = await ask(question);
      if (version !== asked) return;
      series = { ...answer, step };
      $("series-note").textContent = "";
    } catch (error) {
      series = null;
      asked = "";
      $("series-note").textContent = reason(error);
    }
    redraw();
  }

  const redraw = () => draw(canvas, series, state.values);
  state.subscribe((changed) => {
    if (changed.has("cell") || changed.has("location")) series = null;
    showFacts(state.values, embedded);
    redraw();
    clearTimeout(timer);
    timer = setTimeout(load, QUIET_MS);
  });
  canvas.addEventListener("pointerdown", (event) => {
    const [low, high] = windowOf(state.values);
    go(low + (event.offsetX / canvas.clientWidth) * (high - low), "push");
  });
  new ResizeObserver(redraw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}

/**
 * @param {ViewState} view
 * @param {boolean} embedded
 */
function showFacts(view, embedded) {
  const cell = view.frame?.selected ?? null;
  $("selected-none").hidden = cell !== null;
  $("selected-none").textContent = view.cell === null || !view.frame ? "Click a cell in the scene to inspect it." : `Cell ${view.cell} has never been observed.`;
  $("series").hidden = cell === null;
  if (cell === null) return $("selected-facts").replaceChildren();
  pairs($("selected-facts"), [
    ["Number", String(cell.cell)],
    ["Index", `[${cell.index.join(", ")}]`],
    ["Centre", `${cell.position_m.join(", ")} m`],
    ["Probability", probabilityText(cell)],
    ["Last seen", lastSeenText(cell, view.frame?.time ?? 0)],
    ...(embedded ? [] : [linkTo(view.location ?? "", cell)]),
  ]);
}

/**
 * @param {string} location
 * @param {CellFacts} cell
 * @returns {[string, Node]}
 */
function linkTo(location, cell) {
  const link = document.createElement("a");
  link.href = `/locations/${encodeURIComponent(location)}?cell=${cell.cell}`;
  link.textContent = "over time";
  return ["", link];
}

/**
 * The curve of p, a strip of what it says at the confidence, a strip of what was observed, and the moment shown.
 * @param {HTMLCanvasElement} canvas
 * @param {(Series & { step: number }) | null} series
 * @param {ViewState} view
 */
function draw(canvas, series, view) {
  const ratio = devicePixelRatio;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const ctx = canvas.getContext("2d");
  if (!ctx || !series || !width || !view.grid?.span) return;
  ctx.scale(ratio, ratio);
  const c = colours();
  const [low, high] = windowOf(view);
  const x = (/** @type {number} */ time) => ((time - low) / (high - low)) * width;
  const bottom = height - 2 * (STRIP + 2) - 12;
  const y = (/** @type {number} */ p) => 2 + (1 - p) * (bottom - 4);
  const confidence = view.frame?.confidence ?? view.grid.confidence;
  ctx.fillStyle = c.future;
  ctx.fillRect(x(view.grid.span.last), 0, width, bottom);
  ctx.strokeStyle = c.predicted;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  let pen = false;
  for (const [i, p] of series.probability.entries()) {
    if (p !== null) ctx[pen ? "lineTo" : "moveTo"](x(series.time[i]), y(p));
    pen = p !== null;
  }
  ctx.stroke();
  const within = (/** @type {number} */ time) => Math.min(width, Math.max(0, x(time)));
  const top = (/** @type {number} */ row) => bottom + 2 + row * (STRIP + 2);
  drawStrips(ctx, series, { confidence, x: within, top, height: STRIP, least: 1 });
  label(ctx, low, high, width, height, c, zoneOf(view.zone, view.grid.time_zone));
  if (view.time === null) return;
  ctx.fillStyle = c.ink;
  ctx.fillRect(x(view.time) - 0.75, 0, 1.5, bottom + 2 * (STRIP + 2));
}

/**
 * The moments at both ends.
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} low
 * @param {number} high
 * @param {number} width
 * @param {number} height
 * @param {Record<string, string>} c
 * @param {string} zone
 */
function label(ctx, low, high, width, height, c, zone) {
  ctx.font = "10px system-ui, sans-serif";
  ctx.fillStyle = c.quiet;
  ctx.textBaseline = "bottom";
  ctx.textAlign = "left";
  ctx.fillText(`${dayText(low, zone)} ${clockText(low, zone, false)}`, 0, height);
  ctx.textAlign = "right";
  ctx.fillText(`${dayText(high, zone)} ${clockText(high, zone, false)}`, width, height);
}
