// The settings of a location: what was changed is sent, what has consequences is asked about first.

import { post } from "../core/api.js";
import { reason } from "../dom.js";
/** @import { State } from "../core/state.js" */
/** @import { LocationView } from "../../../../types.d.ts" */

/** @type {Record<string, string>} */
const WARNINGS = {
  name: "Robots that post under the old name will be refused until they use the new one.",
  retention: "Observations older than this are deleted for good.",
};

/**
 * @param {HTMLFormElement} form
 * @param {State<LocationView>} state
 */
export function mount(form, state) {
  const said = form.querySelector("output");
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const changed = changes(form);
    const warnings = Object.keys(changed).filter((name) => name in WARNINGS && changed[name] !== null).map((name) => WARNINGS[name]);
    if (!said) return;
    if (!Object.keys(changed).length) said.textContent = "Nothing was changed.";
    else if (!warnings.length || window.confirm(`${warnings.join("\n")}\nChange it?`)) await send(state, changed, said);
  });
}

/**
 * @param {State<LocationView>} state
 * @param {Record<string, string | number | null>} changed
 * @param {HTMLOutputElement} said
 */
async function send(state, changed, said) {
  try {
    const made = await post(state.values.path, changed, "PATCH");
    said.textContent = "Saved.";
    window.location.assign(`/locations/${encodeURIComponent(made.name)}#settings`);
    if (made.name === state.values.name) window.location.reload();
  } catch (error) {
    said.textContent = reason(error);
  }
}

/**
 * What differs from what the page came with, as the API takes it: numbers as numbers, what was emptied as null.
 * @param {HTMLFormElement} form
 */
function changes(form) {
  /** @type {Record<string, string | number | null>} */
  const changed = {};
  for (const field of form.elements) {
    if (!(field instanceof HTMLInputElement || field instanceof HTMLSelectElement) || !field.name) continue;
    const before = field.dataset.before ?? "";
    if (field.value === before) continue;
    const isNumber = field.dataset.number !== undefined && field.value !== "auto";
    changed[field.name] = field.value === "" ? null : isNumber ? Number(field.value) : field.value;
  }
  return changed;
}
