// A list of anomalies: new ones come by themselves, and one or several are acknowledged, with a note where there is one.

import { post } from "../core/api.js";
import { all, closest, reason } from "../dom.js";
import * as fragment from "./fragment.js";
/** @import { Live } from "../core/live.js" */

const TABLE = "anomalies-table";

/**
 * @param {HTMLElement} section holds the table and the form to acknowledge with
 * @param {Live} live
 * @param {string | null} location the only one that is listed, null for all
 */
export function mount(section, live, location = null) {
  const form = section.querySelector("form[data-acknowledging]");
  if (!(form instanceof HTMLFormElement)) return;
  // Where all are listed, those of a location go with it, or are called by its new name.
  fragment.mount(TABLE, live, (message) => location === null || message.kind === "anomaly" || message.kind === "attention");
  const update = () => showChosen(form, chosen());
  section.addEventListener("change", update);
  document.body.addEventListener("htmx:afterSwap", update);
  section.addEventListener("click", (event) => {
    const one = closest(event, "[data-acknowledge]");
    if (one instanceof HTMLButtonElement) acknowledge(form, [one.dataset.acknowledge ?? ""]);
    if (closest(event, "[data-all]")) chooseAll(update);
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    acknowledge(form, chosen().map((each) => each.value));
  });
}

const boxes = () => /** @type {HTMLInputElement[]} */ (all(`#${TABLE} input[name="pick"]`));
const chosen = () => boxes().filter((each) => each.checked);

/** @param {() => void} update */
function chooseAll(update) {
  const every = boxes();
  const wanted = every.some((each) => !each.checked);
  for (const each of every) each.checked = wanted;
  update();
}

/**
 * @param {HTMLFormElement} form
 * @param {HTMLInputElement[]} picked
 */
function showChosen(form, picked) {
  const button = form.querySelector("button[type=submit]");
  if (!(button instanceof HTMLButtonElement)) return;
  button.disabled = picked.length === 0;
  button.textContent = picked.length ? `Acknowledge ${picked.length} chosen` : "Acknowledge chosen";
}

/**
 * Acknowledge some, one after the other; what fails is said, and what was done before stays so.
 * @param {HTMLFormElement} form
 * @param {string[]} ids
 */
async function acknowledge(form, ids) {
  const said = form.querySelector("output");
  const note = form.elements.namedItem("note");
  const text = note instanceof HTMLInputElement ? note.value.trim() : "";
  let done = 0;
  try {
    for (const id of ids) {
      await post(`/anomalies/${id}/acknowledge`, text ? { note: text } : {});
      done += 1;
    }
    if (said) said.textContent = done === 1 ? "Acknowledged." : `${done} acknowledged.`;
    if (note instanceof HTMLInputElement) note.value = "";
  } catch (error) {
    if (said) said.textContent = `${done} of ${ids.length} acknowledged. ${reason(error)}`;
  }
  fragment.refresh(TABLE);
}
