// The banner that says since when there is no connection, and ages that go on meanwhile.

import { now, setClock } from "../core/clock.js";
import { clockText, relativeText } from "../core/words.js";
/** @import { Live } from "../core/live.js" */

const AGE_MS = 1000;
const GRACE_MS = 1500;

/**
 * What every page has: the banner at its top, and ages computed here.
 * @param {HTMLElement} banner
 * @param {Live} live
 */
export function mount(banner, live) {
  setClock(Number(document.body.dataset.now));
  const zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
  let timer = 0;
  live.onConnection((since) => {
    clearTimeout(timer);
    if (since === null) banner.hidden = true;
    else timer = setTimeout(() => say(since), GRACE_MS);
  });
  /** @param {number} since */
  function say(since) {
    banner.textContent = `No connection to the server since ${clockText(since, zone)}. What you see is from then; this page tries again by itself.`;
    banner.hidden = false;
  }
  showAges();
  setInterval(showAges, AGE_MS);
  document.body.addEventListener("htmx:afterSwap", showAges);
}

/** Every `<time data-age>` says how long ago it is. */
export function showAges() {
  const time = now();
  for (const element of document.querySelectorAll("time[data-age]")) {
    const text = relativeText(Number(element.getAttribute("data-age")), time);
    if (element.textContent !== text) element.textContent = text;
  }
}
