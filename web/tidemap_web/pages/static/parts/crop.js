// The crop box: what the scene shows of a grid, along each of its axes.

import { byId as $ } from "../dom.js";
/** @import { State } from "../core/state.js" */
/** @import { GridMessage, ViewState } from "../../../../types.d.ts" */

const AXES = /** @type {const} */ (["x", "y"]);
const ENDS = /** @type {const} */ (["first", "last"]);
const FARTHEST = 65535; // no grid has more cells along an axis

/** @param {State<ViewState>} state */
export function mount(state) {
  let name = state.values.location;
  for (const [axis, letter] of AXES.entries()) {
    for (const [end, word] of ENDS.entries()) {
      const input = $(`crop-${letter}-${word}`);
      let moved = false;
      input.addEventListener("input", () => {
        state.change({ crop: cropWith(state.values, 2 * axis + end, Number(input.value)) }, moved ? "replace" : "push");
        moved = true;
      });
      input.addEventListener("change", () => (moved = false));
    }
  }
  $("crop-all").addEventListener("click", () => state.change({ crop: null, low: null, high: null }, "push"));
  $("crop").toggleAttribute("open", state.values.crop !== null);
  state.subscribe((changed) => {
    const { location, crop } = state.values;
    if (changed.has("location") && name !== null && location !== name && crop) state.change({ crop: null });
    name = location;
    show(state.values);
  });
}

/**
 * The crop with another border; first and last stay in order, and all of the grid is no crop.
 * @param {ViewState} view
 * @param {number} border of x first and last, y first and last
 * @param {number} value
 */
function cropWith({ grid, crop }, border, value) {
  const whole = [0, (grid?.shape[0] ?? 1) - 1, 0, (grid?.shape[1] ?? 1) - 1];
  const changed = (crop ?? whole).map((each, number) => (number === border ? value : Math.min(each, whole[number] || each)));
  const other = border ^ 1;
  changed[other] = border % 2 ? Math.min(changed[other], value) : Math.max(changed[other], value);
  return changed.every((each, number) => each === whole[number]) ? null : changed;
}

/** @param {ViewState} view */
function show({ grid, crop, low, high }) {
  if (!grid) return;
  for (const [axis, letter] of AXES.entries()) {
    const last = grid.shape[axis] - 1;
    const [from, to] = crop ? [crop[2 * axis], Math.min(crop[2 * axis + 1], last)] : [0, last];
    for (const [end, word] of ENDS.entries()) {
      const input = $(`crop-${letter}-${word}`);
      input.max = String(last);
      input.value = String([from, to][end]);
    }
    $(`crop-${letter}-value`).textContent = `${metres(grid, axis, from)} – ${metres(grid, axis, to + 1)} m`;
  }
  $("crop-all").disabled = crop === null && (low ?? 0) === 0 && (high ?? FARTHEST) >= (grid.shape[2] ?? 1) - 1;
}

/**
 * @param {GridMessage} grid
 * @param {number} axis
 * @param {number} steps
 */
const metres = (grid, axis, steps) => (grid.origin_m[axis] + steps * grid.resolution_m).toFixed(2);
