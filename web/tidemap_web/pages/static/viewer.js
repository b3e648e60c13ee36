// The viewer's page: it owns the address, the time and the settings; the session on the server draws the scene.

import { all, byId as $ } from "./dom.js";
import { Timeline } from "./timeline.js";
import { dateText, clockText, durationText, zoneText } from "./words.js";
/** @import { CellFacts, FrameMessage, GridMessage, Handlers, NoticeMessage, ViewRequest } from "../../../types.d.ts" */

const { token, scene } = document.body.dataset;
const embedded = document.body.classList.contains("embedded");
const asked = new URLSearchParams(window.location.search);
const HOUR = 3600;
const DAY = 86400;

/** @type {ViewRequest} */
const request = { location: asked.get("location"), time: askedTime(), live: false, confidence: null, order: null, floor: 0.1, dim: true };
request.live = request.time === null;
/** @type {GridMessage | null} */
let location = null;
/** @type {FrameMessage | null} */
let frame = null;
let playing = false;
/** @type {WebSocket | null} */
let socket = null;
let tried = 0;

const timeline = new Timeline($("marks"), $("time"), (time) => go(time));

function askedTime() {
  const text = asked.get("time");
  if (text === null || text === "") return null;
  const time = /^-?\d+(\.\d+)?$/.test(text) ? Number(text) : Date.parse(text) / 1000;
  return Number.isFinite(time) ? time : null;
}

/** @param {object} message */
function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

/** @param {Partial<ViewRequest>} changes */
function want(changes) {
  Object.assign(request, changes);
  send({ kind: "view", ...request });
  showRequest();
}

/** @param {number} time */
function go(time) {
  if (!location?.span) return;
  want({ time: timeline.clamp(time), live: false });
}

// ---- the socket -------------------------------------------------------------------------------------------------

function connect() {
  const address = new URL(`/view/control/${token}`, window.location.href);
  address.protocol = address.protocol.replace("http", "ws");
  socket = new WebSocket(address);
  socket.addEventListener("open", () => {
    tried = 0;
    send({ kind: "view", ...request });
    loadScene();
  });
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    handlers[/** @type {keyof Handlers} */ (message.kind)]?.(message);
  });
  socket.addEventListener("close", lost);
}

async function lost() {
  tried += 1;
  const answer = await fetch("/view/sessions").catch(() => null);
  if (top && (answer?.status === 401 || answer?.status === 403)) {
    top.location.assign(`/login?next=${encodeURIComponent(top.location.pathname + top.location.search)}`);
    return;
  }
  notice("No connection", "The server does not answer. Trying again …");
  setTimeout(connect, Math.min(8000, 500 * 2 ** tried));
}

function loadScene() {
  const query = asked.has("fixedDpr") ? `&fixedDpr=${encodeURIComponent(asked.get("fixedDpr") ?? "")}` : "";
  const fresh = /** @type {HTMLIFrameElement} */ ($("scene").cloneNode());
  fresh.src = `${scene}${query}#${token}`;
  fresh.addEventListener("load", () => fresh.contentWindow?.addEventListener("keydown", keys));
  $("scene").replaceWith(fresh);
}

/** @type {Handlers} */
const handlers = {
  grids(message) {
    const names = message.items.map((item) => item.name);
    const select = $("location");
    if ([...select.options].map((option) => option.value).join() !== names.join()) {
      select.replaceChildren(...names.map((name) => new Option(name, name)));
    }
    select.disabled = names.length === 0;
    select.value = location?.name ?? request.location ?? names[0] ?? "";
  },
  location(message) {
    const other = location?.name !== message.name;
    location = message;
    request.location = message.name;
    $("location").value = message.name;
    if (other && request.confidence === null) setConfidence(message.confidence);
    document.title = `${message.name} · Tidemap`;
    timeline.setLocation(location);
    markReach();
    showRequest();
  },
  frame(message) {
    frame = message;
    $("notice").hidden = true;
    if (message.live && request.live) request.time = message.time;
    showFrame();
    showRequest();
  },
  refused(message) {
    console.warn(`The viewer did not understand the page: ${message.detail}`);
  },
  notice(message) {
    frame = null;
    for (const id of ["unexpected", "missing", "stale", "model"]) $(id).textContent = "";
    $("facts").replaceChildren();
    showSelected(null);
    explain(message);
  },
};

// ---- what is shown ------------------------------------------------------------------------------------------------

/**
 * @param {string} title
 * @param {string} text
 */
function notice(title, text, code = "") {
  $("notice-title").textContent = title;
  $("notice-text").textContent = text;
  $("notice-code").textContent = code;
  $("notice-code").hidden = code === "";
  $("notice").hidden = false;
}

/** @param {NoticeMessage} message */
function explain({ reason, detail }) {
  const origin = window.location.origin;
  const name = request.location ?? "lab";
  if (reason === "no-grids") {
    const form = `{"name": "lab", "kind": "grid3d", "interval_s": 300, "time_zone": "Europe/London",\n  "grid": {"resolution_m": 0.2, "shape": [60, 40, 12]}}`;
    notice("No grid yet", "The viewer shows locations of kind grid2d and grid3d. Make one, or run “tidemap demo”:",
      `curl ${origin}/api/v1/locations --json '${form}'`);
  } else if (reason === "no-observations") {
    notice("Nothing observed yet", `Post what a robot saw in ${name}; cells are numbers or [i, j, k]:`,
      `curl ${origin}/api/v1/locations/${name}/observations --json '{\n  "observations": [{"time": "…Z", "occupied": [[0, 0, 0]], "free": [[1, 0, 0]]}]}'`);
  } else if (reason === "not-found") {
    notice("No such grid", `${detail} Choose another location.`);
  } else notice("This did not work", detail);
}

/** @param {number | string} value */
function setConfidence(value) {
  $("confidence").value = String(value);
  $("confidence-value").textContent = Number(value).toFixed(2);
}

/**
 * @param {HTMLElement} list
 * @param {[string, string | Node][]} items
 */
function pairs(list, items) {
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

/** @param {number} number */
const count = (number) => number.toLocaleString("en");

function showFrame() {
  if (!frame || !location) return;
  $("model").textContent = frame.revision
    ? `revision ${frame.revision} (${frame.estimator})`
    : `no model yet: first update at ${count(location.first_update)} measurements`;
  $("unexpected").textContent = frame.unexpected ? count(frame.unexpected) : "";
  $("missing").textContent = frame.missing ? count(frame.missing) : "";
  $("stale").textContent = frame.stale ? count(frame.stale) : "";
  $("fresh").textContent = durationText(frame.fresh_s);
  pairs($("facts"), [
    ["Revision", frame.revision ? String(frame.revision) : "–"],
    ["Estimator", frame.revision ? `${frame.estimator}, order ${frame.order}` : "–"],
    ["Predicted", `${count(frame.predicted)} cells shown`],
    ["Observed", `${count(frame.observed)} cells shown`],
    ["Known", `${count(frame.cells)} cells`],
    ["Grid", `${location.shape.join(" × ")} of ${location.resolution_m} m`],
    ["Floor lines", `every ${frame.lines_m} m`],
    ["Frame", location.frame],
  ]);
  showSelected(frame.selected);
}

/** @param {CellFacts | null} cell */
function showSelected(cell) {
  $("selected-none").hidden = cell !== null;
  if (cell === null) return $("selected-facts").replaceChildren();
  const link = document.createElement("a");
  link.href = `/locations/${encodeURIComponent(location?.name ?? "")}?cell=${cell.cell}`;
  link.textContent = "over time";
  if (embedded) {
    link.addEventListener("click", (event) => {
      event.preventDefault();
      parent.postMessage({ kind: "cell", cell: cell.cell }, window.location.origin);
    });
  }
  const seen = cell.observed === null ? "never by then" : cell.observed ? "occupied" : "free";
  const ago = cell.observed_time === null ? "–" : `${durationText((frame?.time ?? 0) - cell.observed_time)} before`;
  pairs($("selected-facts"), [
    ["Number", String(cell.cell)],
    ["Index", `[${cell.index.join(", ")}]`],
    ["Centre", `${cell.position_m.join(", ")} m`],
    ["Probability", cell.probability === null ? "–" : cell.probability.toFixed(3)],
    ["Last seen", seen],
    ["", ago],
    ["", link],
  ]);
}

function showRequest() {
  $("floor-value").textContent = request.floor.toFixed(2);
  $("floor-note").textContent = request.floor > 0 ? `(hidden below ${request.floor.toFixed(2)})` : "";
  $("ramp-floor").style.width = `${100 * request.floor}%`;
  for (const part of all(".structure")) part.hidden = !request.dim;
  $("live").setAttribute("aria-pressed", String(request.live));
  if (!location?.span || request.time === null) {
    $("date").textContent = "–";
    for (const id of ["clock", "zone", "tense"]) $(id).textContent = "";
    return;
  }
  const zone = location.time_zone;
  $("date").textContent = dateText(request.time, zone);
  $("clock").textContent = clockText(request.time, zone);
  $("zone").textContent = zoneText(request.time, zone);
  const ahead = request.time - location.span.last;
  $("tense").textContent = ahead > 1 ? `forecast, +${durationText(ahead)}` : ahead < -1 ? `${durationText(-ahead)} before last` : "newest";
  timeline.show(request.time);
  address();
}

let addressTimer = 0;
function address() {
  clearTimeout(addressTimer);
  addressTimer = setTimeout(() => {
    const query = new URLSearchParams(window.location.search);
    query.set("location", location?.name ?? "");
    if (request.live) query.delete("time");
    else query.set("time", String(Math.round(request.time ?? 0)));
    history.replaceState(null, "", `?${query}`);
  }, 300);
}

function markReach() {
  for (const button of all("[data-reach]")) {
    button.setAttribute("aria-pressed", String(button.dataset.reach === timeline.reach));
  }
}

// ---- playing --------------------------------------------------------------------------------------------------

let before = 0;
/** @param {number} now */
function tick(now) {
  if (!playing) return;
  const elapsed = Math.min(0.5, (now - before) / 1000);
  before = now;
  const ready = frame === null || frame.time === request.time || request.live;
  if (ready && location?.span) {
    const [low, high] = timeline.reach === "all" ? timeline.window() : [location.span.first, location.span.stop];
    const next = (request.time ?? high) + owed + elapsed * Number($("speed").value);
    owed = 0;
    want({ time: next > high ? low : next, live: false });
  } else owed += elapsed * Number($("speed").value);
  requestAnimationFrame(tick);
}
let owed = 0;

/** @param {boolean} on */
function play(on) {
  if (on && !location?.span) return;
  playing = on;
  owed = 0;
  $("play").setAttribute("aria-pressed", String(on));
  $("play-sign").textContent = on ? "❚❚" : "▶";
  before = performance.now();
  if (on) requestAnimationFrame(tick);
}

/** @param {number} seconds */
function step(seconds) {
  if (request.time !== null) go(request.time + seconds);
}

/** @param {number} direction */
function anomaly(direction) {
  const { time } = request;
  if (!location?.span || time === null) return;
  const starts = location.events.map((event) => event.start).sort((a, b) => a - b);
  const found = direction > 0 ? starts.find((s) => s > time + 1) : starts.findLast((s) => s < time - 1);
  if (found !== undefined) go(found);
}

function live() {
  play(false);
  want({ live: true });
}

// ---- hands ------------------------------------------------------------------------------------------------------

$("location").addEventListener("change", () => {
  play(false);
  frame = null;
  if (!embedded) want({ location: $("location").value, time: null, live: true });
  else want({ location: $("location").value });
});
$("confidence").addEventListener("input", () => {
  setConfidence($("confidence").value);
  want({ confidence: Number($("confidence").value) });
});
$("floor").addEventListener("input", () => want({ floor: Number($("floor").value) }));
$("dim").addEventListener("change", () => want({ dim: $("dim").checked }));
function setOrder() {
  const auto = $("order-auto").checked;
  $("order").disabled = auto;
  $("order-value").textContent = auto ? "auto" : $("order").value;
  want({ order: auto ? null : Number($("order").value) });
}
$("order").addEventListener("input", setOrder);
$("order-auto").addEventListener("change", setOrder);
$("play").addEventListener("click", () => play(!playing));
$("live").addEventListener("click", live);
$("previous").addEventListener("click", () => anomaly(-1));
$("next").addEventListener("click", () => anomaly(1));
$("time").addEventListener("pointerdown", () => play(false));
for (const button of all("[data-step]")) {
  button.addEventListener("click", () => step(Number(button.dataset.step)));
}
for (const button of all("[data-view]")) {
  button.addEventListener("click", () => send({ kind: "aim", view: button.dataset.view }));
}
for (const button of all("[data-reach]")) {
  button.addEventListener("click", () => {
    timeline.setReach(button.dataset.reach);
    markReach();
  });
}

/** @param {KeyboardEvent} event */
function keys(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const target = /** @type {Element} */ (event.target);
  const pressable = target.matches?.("select, input:not(#time), summary, button, a");
  const movable = target.matches?.("select, input:not(#time):not([type=checkbox])");
  const inScene = target.ownerDocument !== document;
  /** @type {Record<string, () => void>} */
  const actions = {
    " ": () => play(!playing),
    ",": () => step(-(location?.interval_s ?? 0)),
    ".": () => step(location?.interval_s ?? 0),
    l: live,
    p: () => anomaly(-1),
    n: () => anomaly(1),
    1: () => send({ kind: "aim", view: "slanted" }),
    2: () => send({ kind: "aim", view: "above" }),
  };
  if (!inScene) {
    actions.ArrowLeft = () => step(event.shiftKey ? -DAY : -HOUR);
    actions.ArrowRight = () => step(event.shiftKey ? DAY : HOUR);
  }
  const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action || !location || (pressable && event.key === " ") || (movable && event.key.startsWith("Arrow"))) return;
  event.preventDefault();
  action();
}
document.addEventListener("keydown", keys);

for (const bar of all("[data-gradient]")) bar.style.background = bar.dataset.gradient ?? "";
for (const swatch of all("[data-colour]")) swatch.style.background = swatch.dataset.colour ?? "";
showRequest();
connect();
