// The doors and rooms of the building: each as it is at the moment that is shown, with the way to its page.

import { byId as $ } from "../dom.js";
import { lastSeenText } from "../core/facts.js";
/** @import { State } from "../core/state.js" */
/** @import { MarkerFacts, ViewState } from "../../../../types.d.ts" */

/**
 * @param {State<ViewState>} state
 * @param {boolean} embedded
 */
export function mount(state, embedded) {
  state.subscribe((changed) => {
    if (changed.has("markers") || changed.has("frame")) show(state.values, embedded);
    if (changed.has("marker")) choose(state.values.marker);
  });
}

/**
 * @param {ViewState} view
 * @param {boolean} embedded
 */
function show({ markers, frame, marker }, embedded) {
  $("building").hidden = !markers.length;
  $("building-legend").hidden = !markers.length;
  const list = $("building-list");
  const names = markers.map((each) => each.name);
  if ([...list.children].map((item) => item instanceof HTMLElement && item.dataset.name).join("\n") !== names.join("\n")) {
    list.replaceChildren(...names.map((name) => itemOf(name, embedded)));
  }
  for (const [number, each] of markers.entries()) fill(/** @type {HTMLElement} */ (list.children[number]), each, frame?.time ?? 0);
  choose(marker);
}

/**
 * @param {string} name
 * @param {boolean} embedded
 */
function itemOf(name, embedded) {
  const item = document.createElement("li");
  item.dataset.name = name;
  const link = Object.assign(document.createElement("a"), { textContent: name });
  if (embedded) link.target = "_top";
  item.append(dot(), dot(), link, document.createElement("span"));
  return item;
}

const dot = () => document.createElement("i");

/**
 * @param {HTMLElement} item
 * @param {MarkerFacts} marker
 * @param {number} time
 */
function fill(item, marker, time) {
  const [predicted, seen, link, said] = /** @type {HTMLElement[]} */ ([...item.children]);
  [predicted.style.background, seen.style.background] = marker.colors;
  link.setAttribute("href", `/locations/${encodeURIComponent(marker.name)}?time=${time}`);
  said.textContent = marker.probability === null ? "no model yet" : `${marker.verdict}, ${marker.probability.toFixed(2)}`;
  item.title = `Last seen ${lastSeenText(marker, time)}`;
}

/** @param {string | null} name that was clicked in the scene */
function choose(name) {
  for (const item of $("building-list").children) {
    const chosen = item instanceof HTMLElement && item.dataset.name === name;
    item.classList.toggle("chosen", chosen);
    if (chosen) item.scrollIntoView({ block: "nearest" });
  }
}
