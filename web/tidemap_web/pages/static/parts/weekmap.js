// When is it occupied? The hours of a week as the model expects them, beside what was observed.

import { ask, post } from "../core/api.js";
import { now } from "../core/clock.js";
import { DAYS, mondayBefore, weekOf } from "../core/week.js";
import { countText } from "../core/words.js";
import { reason } from "../dom.js";
/** @import { State } from "../core/state.js" */
/** @import { LocationView } from "../../../../types.d.ts" */

const HOUR = 3600;
const STEPS = 4; // an hour
const WEEKS = 8;
const WEEK = 7 * 24 * HOUR;

/**
 * @param {HTMLElement} host
 * @param {State<LocationView>} state
 */
export function mount(host, state) {
  let latest = 0;
  async function load() {
    const request = ++latest;
    const { values: view } = state;
    if (view.cell === null) return say(host, "Choose a cell to see its week.");
    if (!view.revision || view.last === null) return say(host, "There is no model yet. It is made when enough has been observed.");
    try {
      const [expected, observed] = await Promise.all([expectedWeek(view, view.cell), observedWeeks(view, view.cell, view.last)]);
      if (request === latest) host.replaceChildren(table("Expected", expected, () => ""), table(`Observed, last ${WEEKS} weeks`, observed, readings));
    } catch (error) {
      if (request === latest) say(host, reason(error));
    }
  }
  state.subscribe((changed) => (changed.has("cell") || changed.has("revision")) && load());
  return load();
}

/**
 * The model's week: this one, on the whole, without what was seen last.
 * @param {LocationView} view
 * @param {number} cell
 */
async function expectedWeek(view, cell) {
  const start = mondayBefore(now(), view.zone);
  const time = Array.from({ length: 7 * 24 * STEPS }, (_, i) => start + ((i + 0.5) * HOUR) / STEPS);
  const answer = await post(`${view.path}/predict`, { time, cell: [cell], given: "model" });
  return weekOf(time, answer.probability[0], view.zone);
}

/**
 * @param {LocationView} view
 * @param {number} cell
 * @param {number} last
 */
async function observedWeeks(view, cell, last) {
  const step = Math.max(1, Math.ceil(HOUR / STEPS / view.interval)) * view.interval;
  const start = Math.floor(Math.max(view.first ?? last, last - WEEKS * WEEK) / step) * step;
  const answer = await ask(`${view.path}/series?cell=${cell}&start=${start}&stop=${last + 1}&step=${step}`);
  return weekOf(answer.time, answer.observed, view.zone);
}

/** @param {number} count */
const readings = (count) => `, ${countText(count)} ${count === 1 ? "reading" : "readings"}`;

/**
 * @param {HTMLElement} host
 * @param {string} text
 */
function say(host, text) {
  const line = document.createElement("p");
  line.className = "quiet";
  line.textContent = text;
  host.replaceChildren(line);
}

/**
 * @param {string} title
 * @param {{ mean: (number | null)[], count: number[] }} week
 * @param {(count: number) => string} detail
 */
function table(title, week, detail) {
  const made = document.createElement("table");
  made.className = "week";
  made.createCaption().textContent = title;
  const head = made.createTHead().insertRow();
  head.append(cellOf("td", ""), ...Array.from({ length: 24 }, (_, hour) => cellOf("th", hour % 6 ? "" : String(hour).padStart(2, "0"))));
  const body = made.createTBody();
  DAYS.forEach((day, number) => {
    const row = body.insertRow();
    row.append(cellOf("th", day));
    for (let hour = 0; hour < 24; hour++) {
      const at = 24 * number + hour;
      row.append(hourCell(`${day} ${String(hour).padStart(2, "0")}:00`, week.mean[at], detail(week.count[at])));
    }
  });
  return made;
}

/**
 * @param {"td" | "th"} kind
 * @param {string} text
 */
function cellOf(kind, text) {
  const made = document.createElement(kind);
  made.textContent = text;
  return made;
}

/**
 * @param {string} when
 * @param {number | null} mean
 * @param {string} detail
 */
function hourCell(when, mean, detail) {
  const made = document.createElement("td");
  const share = document.createElement("span");
  share.className = "hidden";
  share.textContent = mean === null ? "–" : `${Math.round(100 * mean)} %`;
  made.append(share);
  made.title = mean === null ? `${when}: not observed` : `${when}: occupied ${share.textContent} of the time${detail}`;
  if (mean !== null) {
    made.className = "known";
    made.style.setProperty("--share", `${Math.round(100 * mean)}%`);
  }
  return made;
}
