// Predicted probability and what was observed, over time: a curve, and two strips below it.

import { colours } from "../core/colours.js";
import { drawStrips } from "../core/strips.js";
import { fitting, stepOf, tickTexts, ticksOf } from "../core/ticks.js";
import { timeText, zoneText } from "../core/words.js";
/** @import { ChartState, Plot, Series } from "../../../../types.d.ts" */

/* global uPlot */
const STRIP = 10;
const ROWS = 3;
const ANOMALY_MIN_PX = 3;
const DRAG_MIN_PX = 4;
/** Free pixels to the right of a chart. */
const RIGHT_PX = 6;

/** @param {ChartState} state */
function drawMarks(state) {
  return (/** @type {Plot} */ chart) => {
    const { ctx, bbox } = chart;
    const ratio = devicePixelRatio;
    const c = colours();
    const x = (/** @type {number} */ time) => Math.min(bbox.left + bbox.width, Math.max(bbox.left, chart.valToPos(time, "x", true)));
    const top = (/** @type {number} */ row) => bbox.top + bbox.height - (ROWS - row) * (STRIP + 3) * ratio + 2 * ratio;
    ctx.save();
    drawStrips(ctx, state.series, { confidence: state.confidence, x, top, height: STRIP * ratio, least: ratio });
    ctx.fillStyle = c.quiet;
    for (const [start, stop] of state.outliers) {
      const left = x(start);
      if (x(stop) > left) ctx.fillRect(left, top(2), Math.max(ratio, x(stop) - left), (STRIP / 2) * ratio);
    }
    ctx.fillStyle = c.anomaly;
    for (const event of state.events) {
      const left = x(event.start);
      const right = x(event.stop);
      if (right <= bbox.left || left >= bbox.left + bbox.width) continue;
      ctx.fillRect(left, top(1) - 2 * ratio, Math.max(ANOMALY_MIN_PX * ratio, right - left), (STRIP + 4) * ratio);
      drawJudgement(chart, event.start, event.probability);
    }
    drawMoment(chart, state.moment());
    ctx.restore();
  };
}

/**
 * The moment that the page shows.
 * @param {Plot} chart
 * @param {number | null} time
 */
function drawMoment({ ctx, bbox, valToPos }, time) {
  const at = time === null ? -1 : valToPos(time, "x", true);
  if (at < bbox.left || at > bbox.left + bbox.width) return;
  ctx.fillStyle = colours().ink;
  ctx.fillRect(at - 0.75 * devicePixelRatio, bbox.top, 1.5 * devicePixelRatio, bbox.height);
}

/**
 * What was expected of an event when it was judged, by the revision of then.
 * @param {Plot} chart
 * @param {number} time
 * @param {number} probability
 */
function drawJudgement({ ctx, valToPos }, time, probability) {
  ctx.beginPath();
  ctx.arc(valToPos(time, "x", true), valToPos(probability, "y", true), 4 * devicePixelRatio, 0, 2 * Math.PI);
  ctx.fill();
}

/** @param {ChartState} state */
function drawForecast(state) {
  return (/** @type {Plot} */ chart) => {
    const { ctx, bbox } = chart;
    const ratio = devicePixelRatio;
    const edge = chart.valToPos(state.last, "x", true);
    if (edge < bbox.left || edge > bbox.left + bbox.width - 60 * ratio) return;
    ctx.save();
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
    ctx.fillStyle = colours().quiet;
    ctx.fillText("forecast", edge + 5 * ratio, bbox.top + 11 * ratio);
    ctx.restore();
  };
}

/** @param {ChartState} state */
function drawBack(state) {
  return (/** @type {Plot} */ chart) => {
    const { ctx, bbox } = chart;
    const c = colours();
    const edge = chart.valToPos(state.last, "x", true);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.fillStyle = c.future;
    ctx.fillRect(edge, bbox.top, bbox.left + bbox.width - edge, bbox.height);
    ctx.strokeStyle = c.quiet;
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([5 * devicePixelRatio, 4 * devicePixelRatio]);
    for (const level of [state.confidence, 1 - state.confidence]) {
      const y = Math.round(chart.valToPos(level, "y", true)) + 0.5;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    if (edge > bbox.left && edge < bbox.left + bbox.width) {
      ctx.setLineDash([]);
      ctx.beginPath();
      ctx.moveTo(edge, bbox.top);
      ctx.lineTo(edge, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  };
}

/**
 * What the chart's colours mean.
 * @param {number} revision that the curve is of
 */
export function legendOf(revision) {
  const c = colours();
  /**
   * @param {string} kind
   * @param {string} colour
   * @param {string} text
   */
  const item = (kind, colour, text) => {
    const mark = document.createElement("i");
    mark.className = kind;
    mark.style[kind === "line" || kind === "dash" ? "borderTopColor" : "backgroundColor"] = colour;
    const label = document.createElement("span");
    label.append(mark, text);
    return label;
  };
  return [
    item("line", c.predicted, revision ? `probability of occupied, by revision ${revision}` : "no model yet"),
    item("dash", c.quiet, "confidence"),
    item("", c.predicted, "first strip: predicted occupied"),
    item("", c.occupied, "second: observed occupied"),
    item("", c.uncertain, "uncertain"),
    item("", c.free, "free"),
    item("", c.quiet, "third: differs from the prediction"),
    item("", c.anomaly, "anomaly"),
    item("dot", c.anomaly, "what was expected when it was judged"),
  ];
}

/**
 * Draw into `host`; a drag chooses a range, a click a moment.
 * @param {HTMLElement} host
 * @param {HTMLElement} reading
 * @param {ChartState} state
 * @param {string} zone
 * @param {{ zoom: (start: number, stop: number) => void, go: (time: number) => void }} chosen
 */
export function draw(host, reading, state, zone, { zoom, go }) {
  const c = colours();
  const { series } = state;
  /** @param {Plot} chart */
  const read = (chart) => {
    const i = chart.cursor.idx;
    if (i === null || i === undefined) {
      reading.textContent = "";
      return;
    }
    const seen = series.observed[i];
    const p = series.probability[i];
    reading.textContent = [
      `${timeText(series.time[i], zone)} ${zoneText(series.time[i], zone)}`,
      p === null ? "no prediction" : `p = ${p.toFixed(3)}`,
      seen === null ? "not observed" : `observed ${seen ? "occupied" : "free"}`,
    ].join("  ·  ");
  };
  const chart = new uPlot(
    {
      width: host.clientWidth,
      height: 300,
      padding: [8, RIGHT_PX, 0, 0],
      legend: { show: false },
      cursor: { y: false, drag: { x: true, y: false, setScale: false } },
      scales: { x: { time: true, range: () => state.span }, y: { range: [-0.2, 1.1] } },
      series: [{}, { stroke: c.predicted, width: 2, points: { show: false } }],
      axes: [
        timeAxis(c, zone),
        {
          stroke: c.quiet, grid: { stroke: c.grid }, ticks: { show: false }, size: 46,
          splits: () => [0, 0.25, 0.5, 0.75, 1],
          values: (/** @type {Plot} */ _chart, /** @type {number[]} */ v) => v.map((x) => x.toFixed(2)),
        },
      ],
      hooks: {
        drawClear: [drawBack(state)],
        draw: [drawMarks(state), drawForecast(state)],
        setCursor: [read],
        setSelect: [
          (/** @type {Plot} */ made) => {
            const { left, width } = made.select;
            if (width < DRAG_MIN_PX) return;
            zoom(made.posToVal(left, "x"), made.posToVal(left + width, "x"));
            made.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          },
        ],
      },
    },
    [series.time, series.probability],
    host,
  );
  let pressed = 0;
  chart.over.addEventListener("pointerdown", (event) => (pressed = event.offsetX));
  chart.over.addEventListener("click", (event) => {
    if (Math.abs(event.offsetX - pressed) < DRAG_MIN_PX) go(chart.posToVal(event.offsetX, "x"));
  });
  return chart;
}

/**
 * All of a history, with the range of the chart to drag or to draw anew; calls `zoomed(start, stop)` after that.
 * @param {HTMLElement} host
 * @param {Series} series
 * @param {[number, number]} range
 * @param {string} zone
 * @param {(start: number, stop: number) => void} zoomed
 */
export function brush(host, series, range, zone, zoomed) {
  const c = colours();
  let set = false;
  return new uPlot(
    {
      width: host.clientWidth,
      height: 76,
      padding: [4, RIGHT_PX, 0, 0],
      legend: { show: false },
      cursor: { x: false, y: false, points: { show: false }, drag: { x: true, y: false, setScale: false } },
      scales: { x: { time: true }, y: { range: [0, 1] } },
      series: [{}, { stroke: c.predicted, width: 1, points: { show: false } }],
      axes: [{ ...timeAxis(c, zone), size: 40 }, { size: 46, stroke: c.quiet, grid: { show: false }, ticks: { show: false }, values: () => [] }],
      hooks: {
        ready: [
          (/** @type {Plot} */ made) => {
            const [left, right] = range.map((time) => Math.min(made.over.clientWidth, Math.max(0, made.valToPos(time, "x", false))));
            made.setSelect({ left, width: right - left, top: 0, height: made.over.clientHeight }, false);
            set = true;
          },
        ],
        setSelect: [
          (/** @type {Plot} */ made) => {
            const { left, width } = made.select;
            if (set && width >= 3) zoomed(made.posToVal(left, "x"), made.posToVal(left + width, "x"));
          },
        ],
      },
    },
    [series.time, series.probability],
    host,
  );
}

/**
 * @param {Record<string, string>} c
 * @param {string} zone
 */
function timeAxis(c, zone) {
  return {
    stroke: c.quiet, grid: { stroke: c.grid }, ticks: { stroke: c.grid }, size: 46,
    splits: (/** @type {Plot} */ made, /** @type {number} */ _axis, /** @type {number} */ low, /** @type {number} */ high) =>
      ticksOf(low, high, stepOf(high - low, Math.max(2, widthOf(made) / 95)), zone),
    values: (/** @type {Plot} */ made, /** @type {number[]} */ ticks) => {
      const { min, max } = made.scales.x;
      return fitting(tickTexts(ticks, zone), ticks, max, (max - min) / widthOf(made), RIGHT_PX);
    },
  };
}

/**
 * How wide the plot is, in pixels of the page.
 * @param {Plot} made
 */
function widthOf({ bbox }) {
  return bbox.width / devicePixelRatio;
}
