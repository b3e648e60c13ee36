// What becomes of the location of a page while it is shown: deleted, or renamed.

import { post } from "../core/api.js";
import { byId, closest, reason } from "../dom.js";
/** @import { LocationState } from "../core/location.js" */
/** @import { Live } from "../core/live.js" */

/**
 * Say so at the top of the page.
 * @param {HTMLElement} notice
 * @param {LocationState} state
 * @param {Live} live
 */
export function mount(notice, state, live) {
  live.onMessage((message) => {
    if (message.kind !== "location" || message.location !== state.name) return;
    if (message.change === "deleted") gone();
    else if (message.called && message.called !== state.name) renamed(message.called);
  });
  // What happened while there was no connection is noticed when the page asks again.
  document.body.addEventListener("htmx:responseError", (event) => {
    if (event instanceof CustomEvent && event.detail.xhr.status === 404) gone();
  });
  function gone() {
    say(`The location ${state.name} was deleted. What you see is what it was.`, "/", "All locations");
    for (const control of byId("main").querySelectorAll("button, input, select")) control.setAttribute("disabled", "");
  }
  /** @param {string} name */
  function renamed(name) {
    say(`The location ${state.name} is called ${name} now.`, `/locations/${encodeURIComponent(name)}`, "Go there");
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
  }
}

/**
 * Have the button of `section` ask for an update; what becomes of it comes with the messages of jobs.
 * @param {HTMLElement} section
 * @param {LocationState} state
 */
export function mountUpdate(section, state) {
  const said = section.querySelector("output");
  section.addEventListener("click", async (event) => {
    const button = closest(event, "[data-update]");
    if (!(button instanceof HTMLButtonElement) || !said) return;
    button.disabled = true;
    try {
      await post(`${state.path}/update`, {});
      said.textContent = "Queued.";
    } catch (error) {
      said.textContent = reason(error);
    }
    button.disabled = false;
  });
}
