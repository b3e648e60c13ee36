// A period of a location, drawn to be printed: how much was observed, and of a cell what was expected and what was seen.

import { ask } from "../core/api.js";
import { verdictOf } from "../core/colours.js";
import { barsOf } from "../core/density.js";
import { seriesQuestion } from "../core/series.js";
import { runs } from "../core/strips.js";
import { scale, svg } from "../core/svg.js";
import { stepOf, ticksOf } from "../core/ticks.js";
import { clockText, dayText } from "../core/words.js";
/** @import { Anomaly, Density, LocationView, Series } from "../../../../types.d.ts" */

const POINTS = 1000;
const BINS = 250;
const [WIDTH, LEFT, RIGHT] = [1000, 44, 994];
const CURVE = { top: 14, height: 150 };
const STRIP = 11;
const SEEN = 26;
const MOST_TICKS = 9;

/** @typedef {(time: number) => number} Scale */

/**
 * @param {HTMLElement} host
 * @param {LocationView} view
 * @param {[number, number]} span
 */
export async function drawPeriod(host, view, span) {
  const [series, density, events] = await Promise.all([
    view.cell === null ? null : seriesOf(view, span),
    densityOf(view, span),
    ask(`${view.path}/anomalies?start=${span[0]}&stop=${span[1]}&limit=1000`),
  ]);
  const x = scale(span[0], span[1], LEFT, RIGHT);
  const within = (/** @type {number} */ time) => Math.min(RIGHT, Math.max(LEFT, x(time)));
  const mine = events.items.filter((/** @type {Anomaly} */ event) => view.cell === null || event.cells.includes(view.cell));
  const rows = layout(series !== null);
  host.replaceChildren(
    svg("svg", { viewBox: `0 0 ${WIDTH} ${rows.height}`, class: "period-chart", role: "img", "aria-label": "The period: what was expected, and what was observed" },
      ...ahead(view, within, rows.bottom), ...axis(span, x, rows, view.zone),
      ...(series ? [...curve(series, x), ...strips(series, within, rows, view.confidence)] : []),
      ...anomalies(mine, within, rows), ...bars(density, within, rows)),
    key(series !== null));
  host.classList.remove("quiet");
}

/** @param {boolean} hasSeries */
function layout(hasSeries) {
  const strips = hasSeries ? CURVE.top + CURVE.height + 8 : CURVE.top;
  const seen = hasSeries ? strips + 2 * (STRIP + 3) + 4 : strips;
  return { strips, seen, bottom: seen + SEEN, height: seen + SEEN + 22 };
}

/** @typedef {ReturnType<typeof layout>} Rows */

/**
 * @param {LocationView} view
 * @param {[number, number]} span
 * @returns {Promise<Series & { step: number }>}
 */
async function seriesOf(view, span) {
  const { question, step } = seriesQuestion(view, span, POINTS);
  return { ...(await ask(question)), step };
}

/**
 * @param {LocationView} view
 * @param {[number, number]} span
 * @returns {Promise<Density>}
 */
function densityOf({ path, last, interval }, [start, stop]) {
  const end = Math.max(start, Math.min(stop, (last ?? start) + interval));
  return ask(`${path}/density?start=${start}&stop=${end}&bins=${BINS}`);
}

/**
 * @param {LocationView} view
 * @param {Scale} x
 * @param {number} bottom
 */
const ahead = ({ last }, x, bottom) =>
  last === null || x(last) >= RIGHT ? [] : [svg("rect", { class: "ahead", x: x(last), y: CURVE.top, width: RIGHT - x(last), height: bottom - CURVE.top }),
    ...(RIGHT - x(last) > 60 ? [svg("text", { x: x(last) + 4, y: CURVE.top - 3 }, "forecast")] : [])];

/**
 * @param {[number, number]} span
 * @param {Scale} x
 * @param {Rows} rows
 * @param {string} zone
 */
function axis([low, high], x, { strips, bottom }, zone) {
  const step = stepOf(high - low, MOST_TICKS);
  const levels = strips > CURVE.top ? [0, 0.5, 1] : [];
  const y = scale(0, 1, CURVE.top + CURVE.height, CURVE.top);
  return [
    ...levels.flatMap((level) => [svg("path", { class: "grid", d: `M${LEFT} ${y(level)}H${RIGHT}` }),
      svg("text", { x: LEFT - 6, y: y(level) + 4, "text-anchor": "end" }, level.toFixed(1))]),
    ...ticksOf(low, high, step, zone).flatMap((time) => [svg("path", { class: "grid", d: `M${x(time)} ${CURVE.top}V${bottom + 4}` }),
      svg("text", { x: Math.min(RIGHT - 30, Math.max(LEFT + 20, x(time))), y: bottom + 17, "text-anchor": "middle" }, step >= 86400 ? dayText(time, zone) : clockText(time, zone, false))]),
  ];
}

/**
 * @param {Series} series
 * @param {Scale} x
 */
function curve(series, x) {
  const y = scale(0, 1, CURVE.top + CURVE.height, CURVE.top);
  let pen = "M";
  const points = series.probability.map((p, i) => {
    const point = p === null ? "" : `${pen}${x(series.time[i]).toFixed(1)} ${y(p).toFixed(1)}`;
    pen = p === null ? "M" : "L";
    return point;
  });
  return [svg("path", { class: "curve", d: points.join("") })];
}

/**
 * @param {Series & { step: number }} series
 * @param {Scale} x
 * @param {Rows} rows
 * @param {number} confidence
 */
function strips(series, x, { strips: top }, confidence) {
  const says = series.probability.map((p) => verdictOf(p, confidence));
  return [says, series.observed].flatMap((values, row) => [...runs(values)].flatMap(([first, past, value]) => {
    if (value === null) return [];
    const [left, right] = [x(series.time[first]), x(series.time[past - 1] + series.step)];
    const box = { x: left, y: top + row * (STRIP + 3), width: Math.max(0.6, right - left), height: STRIP };
    return [svg("rect", { class: `${row ? "was" : "said"}${value}`, ...box })];
  }));
}

/**
 * @param {Anomaly[]} events
 * @param {Scale} x
 * @param {Rows} rows
 */
const anomalies = (events, x, { bottom }) => events.map((event) => {
  const [left, right] = [x(Date.parse(event.start) / 1000), x(Date.parse(event.stop) / 1000)];
  return svg("rect", { class: "anomaly", x: left - 0.75, y: CURVE.top, width: Math.max(1.5, right - left), height: bottom - CURVE.top, "fill-opacity": 0.75 });
});

/**
 * @param {Density} density
 * @param {Scale} x
 * @param {Rows} rows
 */
const bars = (density, x, { seen }) => [
  svg("text", { x: LEFT - 6, y: seen + SEEN, "text-anchor": "end" }, "seen"),
  ...barsOf(density).map(({ start, stop, share }) => {
    const height = Math.max(1.5, share * SEEN);
    return svg("rect", { class: "seen", x: x(start), y: seen + SEEN - height, width: Math.max(0.6, x(stop) - x(start)), height });
  }),
];

/** @param {boolean} hasSeries */
function key(hasSeries) {
  const made = document.createElement("p");
  made.className = "key";
  const items = [
    ...(hasSeries ? [["said1", "expected occupied"], ["said2", "uncertain"], ["said0", "free"], ["was1", "observed occupied"]] : []),
    ["anomaly", "anomaly"], ["seen", "how much was observed"],
  ];
  made.append(...items.map(([name, text]) => {
    const item = document.createElement("span");
    item.append(Object.assign(document.createElement("i"), { className: name }), text);
    return item;
  }));
  return made;
}
