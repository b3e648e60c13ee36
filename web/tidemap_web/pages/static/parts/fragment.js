// A part of a page that the server renders, brought up to date when something of it happens.

import { morph } from "../core/morph.js";
/** @import { Live } from "../core/live.js" */
/** @import { LiveMessage } from "../../../../types.d.ts" */

/* global htmx */
const MIN_PAUSE_MS = 2000;
const CALM_MS = 60_000;

htmx.defineExtension("morph", {
  isInlineSwap: (/** @type {string} */ style) => style === "morph",
  handleSwap: (/** @type {string} */ style, /** @type {Element} */ target, /** @type {DocumentFragment} */ fragment) => {
    if (style !== "morph") return false;
    const wanted = fragment.querySelector(`#${CSS.escape(target.id)}`);
    if (wanted) morph(target, wanted);
    for (const { name, value } of wanted?.attributes ?? []) target.setAttribute(name, value);
    return [target];
  },
});

/**
 * Ask for the element of this id again when a message that concerns it comes, at most every MIN_PAUSE_MS, when the
 * connection is back, and once a minute anyway, so that nothing that was missed stays old.
 * @param {string} id
 * @param {Live} live
 * @param {(message: LiveMessage) => boolean} concerns
 */
export function mount(id, live, concerns) {
  let last = Date.now();
  let timer = 0;
  const begin = () => {
    timer = 0;
    last = Date.now();
    refresh(id);
  };
  const soon = () => {
    timer ||= setTimeout(begin, Math.max(0, last + MIN_PAUSE_MS - Date.now()));
  };
  live.onMessage((message) => concerns(message) && soon());
  live.onConnection((since) => since === null && soon());
  setInterval(() => live.since === null && Date.now() - last >= CALM_MS && soon(), MIN_PAUSE_MS);
}

/**
 * Ask for an element of the page again; it names the address of its current version.
 * @param {string} id
 */
export function refresh(id) {
  const address = document.getElementById(id)?.dataset.refresh;
  if (address) htmx.ajax("GET", address, { target: `#${id}`, swap: "morph" }).catch(() => {});
}
