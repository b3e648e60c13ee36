// What a location's page shows: the location as it is now, the cell that is chosen and the moment. Its address has both.

import { cellOf, momentOf } from "./address.js";
import { State } from "./state.js";
/** @import { LocationView } from "../../../../types.d.ts" */

const QUIET_MS = 300;

/**
 * From what the page's element says of the location.
 * @param {DOMStringMap} facts
 * @returns {State<LocationView>}
 */
export function locationState(facts) {
  const name = facts.location ?? "";
  const isGrid = facts.kind !== "state";
  return new State({
    name, isGrid,
    path: `/locations/${encodeURIComponent(name)}`,
    zone: facts.zone ?? "UTC",
    interval: Number(facts.interval),
    confidence: Number(facts.confidence),
    revision: Number(facts.revision),
    first: numberOf(facts.first),
    last: numberOf(facts.last),
    cell: isGrid ? null : 0,
    time: null,
    span: null,
  });
}

/**
 * A number of a page's data, null where it is left empty.
 * @param {string | undefined} text
 */
export const numberOf = (text) => (text === undefined || text === "" ? null : Number(text));

/**
 * The cell and the moment that an address asks for.
 * @param {string} search
 * @param {LocationView} view
 * @returns {Pick<LocationView, "cell" | "time">}
 */
export function readLocation(search, { isGrid }) {
  const asked = new URLSearchParams(search);
  return { cell: isGrid ? cellOf(asked.get("cell")) : 0, time: momentOf(asked.get("time")) };
}

/**
 * The query that shows the same; other parameters stay.
 * @param {LocationView} view
 * @param {string} search
 */
export function writeLocation({ cell, time, isGrid }, search) {
  const query = new URLSearchParams(search);
  const set = (/** @type {string} */ name, /** @type {number | null} */ value) => (value === null ? query.delete(name) : query.set(name, String(value)));
  set("cell", isGrid ? cell : null);
  set("time", time === null ? null : Math.round(time * 1000) / 1000);
  return query.size ? `?${query}` : window.location.pathname;
}

/**
 * Keep the address and the page together: what is chosen makes an entry, what moves changes the current one.
 * @param {State<LocationView>} state
 */
export function keepLocation(state) {
  let timer = 0;
  state.subscribe((changed, entry) => {
    if (entry === "none" || !(changed.has("cell") || changed.has("time"))) return;
    clearTimeout(timer);
    const address = () => writeLocation(state.values, window.location.search) + window.location.hash;
    if (entry === "push") history.pushState(null, "", address());
    else timer = setTimeout(() => history.replaceState(null, "", address()), QUIET_MS);
  });
  window.addEventListener("popstate", () => {
    clearTimeout(timer);
    state.change(readLocation(window.location.search, state.values));
  });
}
