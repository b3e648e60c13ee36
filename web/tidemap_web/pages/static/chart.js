// Predicted probability and what was observed, over time: a curve, and two strips below it.

import { verdictOf } from "./core/colours.js";
import { dayText, clockText, offsetOf, timeText, zoneText } from "./core/words.js";
/** @import { ChartState, Plot } from "../../../types.d.ts" */

/* global uPlot */
const STRIP = 12;
const ANOMALY_MIN_PX = 3;

/** @returns {Record<string, string>} */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  /** @param {string} name */
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return Object.fromEntries(
    ["ink", "quiet", "line", "grid", "predicted", "occupied", "free", "uncertain", "anomaly", "future", "paper"].map((n) => [n, of(n)]),
  );
}

/**
 * Ticks on whole local hours, days or weeks.
 * @param {string} zone
 */
function splits(zone) {
  const steps = [300, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800, 1209600, 2419200, 7257600];
  /** @type {(chart: Plot, axis: number, low: number, high: number) => number[]} */
  const ticksOf = (chart, _axis, low, high) => {
    const wanted = Math.max(2, chart.bbox.width / devicePixelRatio / 95);
    const step = steps.find((s) => (high - low) / s <= wanted) ?? 14515200;
    const monday = 4 * 86400; // the epoch was a Thursday
    /** @type {number[]} */
    const ticks = [];
    const offset = offsetOf(low, zone);
    let local = Math.ceil((low + offset - monday) / step) * step + monday;
    for (; ; local += step) {
      let time = local - offset;
      time = local - offsetOf(time, zone);
      if (time > high) return ticks;
      if (time >= low) ticks.push(time);
    }
  };
  return ticksOf;
}

/** @param {string} zone */
function tickTexts(zone) {
  /** @type {(chart: Plot, ticks: number[]) => string[]} */
  const texts = (_chart, ticks) => {
    let day = "";
    return ticks.map((time) => {
      const text = dayText(time, zone);
      const clock = clockText(time, zone, false);
      const whole = ticks.length > 1 && ticks[1] - ticks[0] >= 86400 - 3600;
      if (whole) return text;
      const label = text === day ? clock : `${clock}\n${text}`;
      day = text;
      return label;
    });
  };
  return texts;
}

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
    const row = (/** @type {number} */ index) => bbox.top + bbox.height - (2 - index) * (STRIP + 4) * ratio + 2 * ratio;
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
    ctx.fillStyle = c.anomaly;
    for (const event of state.events) {
      const left = x(event.start);
      const right = x(event.stop);
      if (right <= bbox.left || left >= bbox.left + bbox.width) continue;
      ctx.fillRect(left, row(1) - 3 * ratio, Math.max(ANOMALY_MIN_PX * ratio, right - left), (STRIP + 6) * ratio);
    }
    ctx.restore();
  };
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

export function legendHtml() {
  const c = colours();
  /**
   * @param {string} kind
   * @param {string} colour
   * @param {string} text
   */
  const item = (kind, colour, text) => {
    const mark = document.createElement("i");
    mark.className = kind;
    mark.style[kind ? "borderTopColor" : "backgroundColor"] = colour;
    const label = document.createElement("span");
    label.append(mark, text);
    return label;
  };
  return [
    item("line", c.predicted, "predicted probability of occupied"),
    item("dash", c.quiet, "confidence"),
    item("", c.predicted, "upper strip: predicted occupied"),
    item("", c.occupied, "lower strip: observed occupied"),
    item("", c.uncertain, "uncertain"),
    item("", c.free, "free"),
    item("", c.anomaly, "anomaly"),
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
      scales: { x: { time: true }, y: { range: [-0.16, 1.1] } },
      series: [{}, { stroke: c.predicted, width: 2, points: { show: false } }],
      axes: [
        { stroke: c.quiet, grid: { stroke: c.grid }, ticks: { stroke: c.grid }, splits: splits(zone), values: tickTexts(zone), size: 46 },
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
