// Predicted probability and what was observed, over time: a curve, and two strips below it.

import { colours, verdictOf } from "../core/colours.js";
import { stepOf, tickTexts, ticksOf } from "../core/ticks.js";
import { timeText, zoneText } from "../core/words.js";
/** @import { ChartState, Plot, Series } from "../../../../types.d.ts" */

/* global uPlot */
const STRIP = 10;
const ROWS = 3;
const ANOMALY_MIN_PX = 3;

/**
 * Runs of equal values as [first, past, value].
 * @template Value
 * @param {Value[]} values
 * @returns {Generator<[number, number, Value]>}
 */
function* runs(values) {
  let first = 0;
  for (let i = 1; i <= values.length; i++) {
    if (i === values.length || values[i] !== values[first]) {
      yield [first, i, values[first]];
      first = i;
    }
  }
}

/** @param {ChartState} state */
function drawStrips(state) {
  return (/** @type {Plot} */ chart) => {
    const { ctx, bbox } = chart;
    const ratio = devicePixelRatio;
    const c = colours();
    const times = state.series.time;
    const step = state.step;
    const x = (/** @type {number} */ time) => Math.min(bbox.left + bbox.width, Math.max(bbox.left, chart.valToPos(time, "x", true)));
    const row = (/** @type {number} */ index) => bbox.top + bbox.height - (ROWS - index) * (STRIP + 3) * ratio + 2 * ratio;
    ctx.save();
    const says = state.series.probability.map((p) => verdictOf(p, state.confidence));
    for (const [index, values] of [says, state.series.observed].entries()) {
      for (const [first, past, value] of runs(values)) {
        if (value === null) continue;
        const left = x(times[first]);
        ctx.fillStyle = [c.free, index ? c.occupied : c.predicted, c.uncertain][value];
        ctx.fillRect(left, row(index), Math.max(ratio, x(times[past - 1] + step) - left), STRIP * ratio);
      }
    }
    ctx.fillStyle = c.quiet;
    for (const [start, stop] of state.outliers) {
      const left = x(start);
      if (x(stop) > left) ctx.fillRect(left, row(2), Math.max(ratio, x(stop) - left), (STRIP / 2) * ratio);
    }
    ctx.fillStyle = c.anomaly;
    for (const event of state.events) {
      const left = x(event.start);
      const right = x(event.stop);
      if (right <= bbox.left || left >= bbox.left + bbox.width) continue;
      ctx.fillRect(left, row(1) - 2 * ratio, Math.max(ANOMALY_MIN_PX * ratio, right - left), (STRIP + 4) * ratio);
      drawJudgement(chart, event.start, event.probability);
    }
    ctx.restore();
  };
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
 * Draw into `host`. `state`: {series, events, last, confidence, step}; calls `zoomed(start, stop)` after a drag.
 * @param {HTMLElement} host
 * @param {HTMLElement} reading
 * @param {ChartState} state
 * @param {string} zone
 * @param {(start: number, stop: number) => void} zoomed
 */
export function draw(host, reading, state, zone, zoomed) {
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
      padding: [8, 6, 0, 0],
      legend: { show: false },
      cursor: { y: false, drag: { x: true, y: false, setScale: false } },
      scales: { x: { time: true }, y: { range: [-0.2, 1.1] } },
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
        draw: [drawStrips(state), drawForecast(state)],
        setCursor: [read],
        setSelect: [
          (/** @type {Plot} */ made) => {
            const { left, width } = made.select;
            if (width < 4) return;
            zoomed(made.posToVal(left, "x"), made.posToVal(left + width, "x"));
            made.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          },
        ],
      },
    },
    [series.time, series.probability],
    host,
  );
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
      padding: [4, 6, 0, 0],
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
      ticksOf(low, high, stepOf(high - low, Math.max(2, made.bbox.width / devicePixelRatio / 95)), zone),
    values: (/** @type {Plot} */ _made, /** @type {number[]} */ ticks) => tickTexts(ticks, zone),
  };
}
