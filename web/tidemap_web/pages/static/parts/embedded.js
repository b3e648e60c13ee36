// The viewer within a location's page: both show the same cell, moment and stretch of time, whichever it was chosen in.

import { windowOf } from "../core/window.js";
/** @import { State } from "../core/state.js" */
/** @import { LocationView, Shared, ViewState } from "../../../../types.d.ts" */

const { origin } = window.location;

/**
 * The side of the viewer. A page that has no moment of its own shows the newest observation.
 * @param {State<ViewState>} state
 */
export function mount(state) {
  const report = connect(() => parent, ({ cell, time, span }) => {
    state.change({ cell, live: time === null, ...(time === null ? {} : { time }), ...(span ? { span } : {}) });
  });
  state.subscribe(() => {
    const { cell, time, live, grid } = state.values;
    if (grid?.span) report({ cell, time: live ? null : time, span: windowOf(state.values) });
  });
}

/**
 * The side of the page. What is chosen in the viewer is an entry of the browser's history there.
 * @param {HTMLIFrameElement} viewer
 * @param {State<LocationView>} state
 */
export function host(viewer, state) {
  const shown = () => ({ cell: state.values.cell, time: state.values.time, span: state.values.span });
  const report = connect(() => viewer.contentWindow, (said) => state.change(said, "replace"));
  viewer.addEventListener("load", () => viewer.contentWindow?.postMessage(shown(), origin));
  state.subscribe((changed) => ["cell", "time", "span"].some((name) => changed.has(name)) && report(shown()));
}

/**
 * Hear what the other side shows; the function that says what this one does, unless the other has just said the same.
 * @param {() => Window | null} other
 * @param {(said: Shared) => void} hear
 * @returns {(said: Shared) => void}
 */
function connect(other, hear) {
  let known = "";
  window.addEventListener("message", ({ origin: from, source, data }) => {
    if (from !== origin || source !== other() || data?.span === undefined) return;
    known = JSON.stringify(data);
    hear(data);
  });
  return (said) => {
    const text = JSON.stringify(said);
    if (text === known) return;
    known = text;
    other()?.postMessage(said, origin);
  };
}
