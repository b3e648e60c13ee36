// The report of a location. It may be printed when all is there but the evaluation, which takes longest.

import { ask } from "./core/api.js";
import { setClock } from "./core/clock.js";
import { locationState, numberOf } from "./core/location.js";
import { byId, reason } from "./dom.js";
import * as evaluation from "./parts/evaluation.js";
import * as modelCard from "./parts/model_card.js";
import { drawPeriod } from "./parts/period_chart.js";
import * as weekmap from "./parts/weekmap.js";

setClock(Number(document.body.dataset.now));
const report = byId("report");
const state = locationState(report.dataset);
const cell = numberOf(report.dataset.cell);
state.change({ cell });
const { path, revision, last } = state.values;
/** @type {[number, number]} */
const span = [Number(report.dataset.start), Number(report.dataset.stop)];
for (const part of document.querySelectorAll("[data-of-cell]")) part.toggleAttribute("hidden", cell === null);

/**
 * @param {HTMLElement} host
 * @param {() => Promise<void>} make
 */
const made = (host, make) => make().catch((error) => void (host.textContent = reason(error)));

async function model() {
  if (cell === null || !revision) return void (byId("model-card").textContent = "There is no model yet.");
  modelCard.draw(byId("model-card"), await ask(`${path}/model?cell=${cell}`), state.values);
}

async function evaluate() {
  evaluation.mount(byId("evaluation"), state);
  const button = byId("evaluation").querySelector("button");
  if (last === null || !button) return void byId("evaluation").remove();
  button.click();
  while (button.disabled) await new Promise((resolve) => setTimeout(resolve, 50));
}

byId("print").addEventListener("click", () => window.print());
await Promise.all([
  made(byId("period"), () => drawPeriod(byId("period"), state.values, span)),
  cell === null ? null : weekmap.mount(byId("week"), state),
  made(byId("model-card"), model),
]);
/** @type {HTMLButtonElement} */ (byId("print")).disabled = false;
byId("ready").textContent = "The evaluation is still being made …";
await evaluate();
byId("ready").textContent = "";
