// The viewer's page: what is chosen is in its state and address; a session on the server draws the scene.

import { keepAddress, readAddress } from "./core/address.js";
import { setClock } from "./core/clock.js";
import { State, initialView } from "./core/state.js";
import { all } from "./dom.js";
import { mount as mountCell } from "./parts/cell.js";
import { mount as mountEmbedded } from "./parts/embedded.js";
import { mount as mountLayers } from "./parts/layers.js";
import { mount as mountBuilding } from "./parts/building.js";
import { mount as mountCrop } from "./parts/crop.js";
import { SceneView } from "./parts/scene.js";
import { mount as mountTake } from "./parts/take.js";
import { mount as mountTimeline } from "./parts/timeline.js";
import { mount as mountTransport } from "./parts/transport.js";
/** @import { ViewState } from "../../../types.d.ts" */

const { token = "", scene = "", now = "", keyed } = document.body.dataset;
setClock(Number(now));
const embedded = document.body.classList.contains("embedded");
const asked = new URLSearchParams(window.location.search);
/** @type {State<ViewState>} */
const state = new State({ ...initialView(), ...readAddress(window.location.search) });
const view = new SceneView(state, { token, scene, ratio: asked.get("fixedDpr"), keyed: keyed !== undefined });
const aim = (/** @type {"slanted" | "above"} */ from) => view.aim(from);
keepAddress(state);
mountLayers(state, aim);
mountCrop(state);
mountBuilding(state, embedded);
const transport = mountTransport(state, aim);
const go = (/** @type {number} */ time, /** @type {"push" | "replace"} */ entry) => transport.go(time, entry);
mountTimeline(all(".timeline")[0], state, go);
mountTake(state);
mountCell(state, { embedded, go });
if (embedded) mountEmbedded(state);

/** @param {KeyboardEvent} event */
function keys(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const target = /** @type {Element} */ (event.target);
  const pressable = target.matches?.("select, input:not(#time), summary, button, a");
  const movable = target.matches?.("select, input:not(#time):not([type=checkbox])");
  if (target.matches?.("input:not([type=range]):not([type=checkbox])")) return;
  if ((pressable && event.key === " ") || (movable && /^(Arrow|Home|End)/.test(event.key))) return;
  if (!transport.key(event)) return;
  // Also in the scene, where viser would move the camera.
  event.preventDefault();
  event.stopPropagation();
}
document.addEventListener("keydown", keys);
view.keys = keys;

for (const bar of all("[data-gradient]")) bar.style.background = bar.dataset.gradient ?? "";
for (const swatch of all("[data-colour]")) swatch.style.background = swatch.dataset.colour ?? "";
view.connect();
