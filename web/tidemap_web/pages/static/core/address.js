// The address of a view: what is chosen is in it, so that a link shows the same, and Back is undo.

import { initialView } from "./state.js";
/** @import { State } from "./state.js" */
/** @import { ViewState } from "../../../../types.d.ts" */

const QUIET_MS = 300;
const FARTHEST = 6e10; // seconds, as the server takes times
const DEFAULTS = initialView();

/**
 * A moment of an address: Unix seconds, or ISO 8601 with a zone, for a clock alone differs from reader to reader.
 * @param {string | null} text
 */
export function momentOf(text) {
  if (!text) return null;
  const zoned = /^\d{4}-\d\d-\d\dT\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:?\d\d)$/i.test(text);
  const time = /^-?\d+(\.\d+)?$/.test(text) ? Number(text) : zoned ? Date.parse(text) / 1000 : Number.NaN;
  return Math.abs(time) <= FARTHEST ? time : null;
}

/**
 * The number of a cell in an address, null where it is none.
 * @param {string | null} text
 */
export function cellOf(text) {
  const cell = numberIn(text, 0, 2 ** 40);
  return cell === null ? null : Math.round(cell);
}

/**
 * The camera of an address: where it is, what is in its middle, and how wide it sees where that is not as usual.
 * @param {string | null} text
 */
const cameraOf = (text) => numbers(text, 6) ?? numbers(text, 7);

/**
 * The first and last cells along x and y of an address.
 * @param {string | null} text such as `0-9,3-5`
 */
function cropOf(text) {
  const found = /^(\d{1,5})-(\d{1,5}),(\d{1,5})-(\d{1,5})$/.exec(text ?? "")?.slice(1).map(Number);
  return found && found.every((each) => each <= 65535) && found[0] <= found[1] && found[2] <= found[3] ? found : null;
}

/**
 * @param {string | null} text
 * @param {number} low
 * @param {number} high
 */
function numberIn(text, low, high) {
  const value = text === null || text.trim() === "" ? Number.NaN : Number(text);
  return value >= low && value <= high ? value : null;
}

/**
 * @template {string} Choice
 * @param {string | null} text
 * @param {readonly Choice[]} choices the first is the default
 * @returns {Choice}
 */
const oneOf = (text, choices) => choices.find((choice) => choice === text) ?? choices[0];

/**
 * So many numbers of an address, null where it has others.
 * @param {string | null} text
 * @param {number} count
 */
function numbers(text, count) {
  const found = (text ?? "").split(",").map(Number);
  return found.length === count && found.every(Number.isFinite) && text ? found : null;
}

/**
 * The loop of an address, from a moment to a later one.
 * @param {string | null} text
 * @returns {[number, number] | null}
 */
function loopIn(text) {
  const [start, stop] = numbers(text, 2) ?? [0, 0];
  return start < stop && Math.abs(start) <= FARTHEST && Math.abs(stop) <= FARTHEST ? [start, stop] : null;
}

/**
 * What an address asks for; what it does not say is as at the beginning.
 * @param {string} search
 * @returns {Partial<ViewState>}
 */
export function readAddress(search) {
  const asked = new URLSearchParams(search);
  const time = momentOf(asked.get("time"));
  const [low, high] = (asked.get("slice") ?? "").split("-");
  const order = numberIn(asked.get("order"), 0, 64);
  return {
    location: asked.get("location"),
    time,
    live: time === null,
    confidence: numberIn(asked.get("confidence"), 0.5, 0.999),
    order: order === null ? null : Math.round(order),
    floor: numberIn(asked.get("floor"), 0, 0.95) ?? DEFAULTS.floor,
    dim: asked.get("walls") !== "coloured",
    low: numberIn(low ?? null, 0, 65535),
    high: numberIn(high ?? null, 0, 65535),
    crop: cropOf(asked.get("crop")),
    layout: oneOf(asked.get("layout"), /** @type {const} */ (["beside", "overlay", "difference"])),
    predicted: oneOf(asked.get("predicted"), /** @type {const} */ (["probability", "verdict", "entropy", "day"])),
    observed: oneOf(asked.get("observed"), /** @type {const} */ (["seen", "age"])),
    cell: cellOf(asked.get("cell")),
    camera: cameraOf(asked.get("camera")),
    loop: loopIn(asked.get("loop")),
    zone: oneOf(asked.get("zone"), /** @type {const} */ (["location", "mine", "UTC"])),
  };
}

/**
 * The query that shows the same; other parameters stay.
 * @param {ViewState} view
 * @param {string} search
 */
export function writeAddress(view, search) {
  const query = new URLSearchParams(search);
  /**
   * @param {string} name
   * @param {string | number | null} value
   * @param {unknown} usual
   */
  const set = (name, value, usual = null) => (value === usual || value === null ? query.delete(name) : query.set(name, String(value)));
  set("location", view.location);
  set("time", view.live || view.time === null ? null : Math.round(view.time * 1000) / 1000);
  for (const name of /** @type {const} */ (["confidence", "order", "cell"])) set(name, view[name]);
  for (const name of /** @type {const} */ (["floor", "layout", "predicted", "observed", "zone"])) set(name, view[name], DEFAULTS[name]);
  set("crop", view.crop && `${view.crop[0]}-${view.crop[1]},${view.crop[2]}-${view.crop[3]}`);
  set("walls", view.dim ? null : "coloured");
  set("slice", view.low === null && view.high === null ? null : `${view.low ?? 0}-${view.high ?? 65535}`);
  set("loop", view.loop?.map(Math.round).join(",") ?? null);
  set("camera", view.camera?.map((value) => Number(value.toFixed(2))).join(",") ?? null);
  return `?${query}`;
}

/**
 * Keep the address and the view together: jumps make an entry, drags change the current one.
 * @param {State<ViewState>} state
 */
export function keepAddress(state) {
  let query = window.location.search;
  let timer = 0;
  const replace = () => history.replaceState(null, "", query + window.location.hash);
  state.subscribe((changed, entry) => {
    const before = query;
    query = writeAddress(state.values, query);
    if (query === before || entry === "none") return;
    clearTimeout(timer);
    if (entry === "replace") timer = setTimeout(replace, QUIET_MS);
    else {
      history.replaceState(null, "", before);
      history.pushState(null, "", query);
    }
  });
  window.addEventListener("popstate", () => {
    clearTimeout(timer);
    query = window.location.search;
    const asked = readAddress(query);
    const elsewhere = asked.location !== state.values.location ? { grid: null, frame: null, events: [], span: null, loop: null } : {};
    state.change({ ...asked, ...elsewhere, playing: false });
  });
}
