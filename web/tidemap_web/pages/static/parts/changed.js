// What becomes of the location of a page while it is shown: deleted, or renamed.

import { post } from "../core/api.js";
import { byId, closest, reason } from "../dom.js";
/** @import { State } from "../core/state.js" */
/** @import { LocationView } from "../../../../types.d.ts" */
/** @import { Live } from "../core/live.js" */

/**
 * Say so at the top of the page.
 * @param {HTMLElement} notice
 * @param {State<LocationView>} state
 * @param {Live} live
 */
export function mount(notice, state, live) {
  live.onMessage((message) => {
    if (message.kind !== "location" || message.location !== state.values.name) return;
    if (message.change === "deleted") gone();
    else if (message.called && message.called !== state.values.name) renamed(message.called);
  });
  // What happened while there was no connection is noticed when the page asks again.
  document.body.addEventListener("htmx:responseError", (event) => {
    if (event instanceof CustomEvent && event.detail.xhr.status === 404 && notice.hidden) gone("was deleted or renamed");
  });
  function gone(what = "was deleted") {
    say(`The location ${state.values.name} ${what}. What you see is what it was.`, "/", "All locations");
  }
  /** @param {string} name */
  function renamed(name) {
    say(`The location ${state.values.name} is called ${name} now.`, `/locations/${encodeURIComponent(name)}`, "Go there");
  }
  /**
   * @param {string} text
   * @param {string} address
   * @param {string} label
   */
  function say(text, address, label) {
    const link = Object.assign(document.createElement("a"), { href: address, textContent: label });
    notice.replaceChildren(`${text} `, link);
    notice.hidden = false;
    // What is done by the name that it had would fail.
    for (const control of byId("main").querySelectorAll("button, input, select")) control.setAttribute("disabled", "");
  }
}

/**
 * Have the button of `section` ask for an update; what becomes of it comes with the messages of jobs.
 * @param {HTMLElement} section
 * @param {State<LocationView>} state
 */
export function mountUpdate(section, state) {
  const said = section.querySelector("output");
  section.addEventListener("click", async (event) => {
    const button = closest(event, "[data-update]");
    if (!(button instanceof HTMLButtonElement) || !said) return;
    button.disabled = true;
    try {
      await post(`${state.values.path}/update`, {});
      said.textContent = "Queued.";
    } catch (error) {
      said.textContent = reason(error);
    }
    button.disabled = false;
  });
}
