// One location's page.

import { ask } from "./core/api.js";
import { Live } from "./core/live.js";
import { LocationState, numberOf } from "./core/location.js";
import { byId, reason } from "./dom.js";
import * as anomalies from "./parts/anomalies.js";
import * as changed from "./parts/changed.js";
import * as connection from "./parts/connection.js";
import * as evaluation from "./parts/evaluation.js";
import * as fragment from "./parts/fragment.js";
import { History } from "./parts/history.js";
import * as modelCard from "./parts/model_card.js";
import * as settings from "./parts/settings.js";
import * as spectrum from "./parts/spectrum.js";
import * as weekmap from "./parts/weekmap.js";

const section = byId("history");
const state = new LocationState(section.dataset);
const live = new Live(`?location=${encodeURIComponent(state.name)}`);
const asked = new URLSearchParams(window.location.search);
if (state.isGrid && asked.has("cell")) choose(Number(asked.get("cell")));

connection.mount(byId("connection"), live);
changed.mount(byId("notice"), state, live);
changed.mountUpdate(byId("jobs"), state);
anomalies.mount(byId("anomalies"), live, state.name);
fragment.mount("facts", live, (message) => message.kind !== "job");
fragment.mount("work", live, (message) => message.kind === "job");
evaluation.mount(byId("evaluation"), state);
settings.mount(byId("settings-form"), state);
weekmap.mount(byId("week"), state);

const history = new History(section, byId("chart"), state, live);
const moment = numberOf(asked.get("time") ?? undefined);
if (moment === null || Number.isNaN(moment)) history.load();
else history.choose("week", [moment - 43200, moment + 43200]);

/** @param {number} cell */
function choose(cell) {
  const input = document.getElementById("cell");
  if (input instanceof HTMLInputElement) input.value = String(cell);
  const query = new URLSearchParams(window.location.search);
  query.set("cell", String(cell));
  window.history.replaceState(null, "", `?${query}`);
  state.change({ cell });
}

async function showModel() {
  const [rhythms, card] = [byId("spectrum"), byId("model-card")];
  if (state.cell === null) return (rhythms.textContent = card.textContent = "Choose a cell above.");
  if (!state.revision) return (rhythms.textContent = card.textContent = "There is no model yet. It is made when enough has been observed.");
  try {
    const cell = state.cell;
    const model = await ask(`${state.path}/model?cell=${cell}`);
    if (cell !== state.cell) return;
    spectrum.draw(rhythms, model, state);
    modelCard.draw(card, model, state);
  } catch (error) {
    rhythms.textContent = card.textContent = reason(error);
  }
}

state.subscribe((names) => (names.has("cell") || names.has("revision")) && showModel());
live.onConnection((since) => since === null && showModel());
showModel();

// The viewer and the page show the same cell; each says what is chosen in it.
const viewer = document.querySelector("iframe.viewer");
const share = () => {
  if (viewer instanceof HTMLIFrameElement) viewer.contentWindow?.postMessage({ kind: "cell", cell: state.cell }, window.location.origin);
};
viewer?.addEventListener("load", share);
state.subscribe((names) => names.has("cell") && share());

document.getElementById("cell-form")?.addEventListener("submit", (event) => {
  event.preventDefault();
  choose(Number(byId("cell").value));
});
window.addEventListener("message", (event) => {
  if (event.origin === window.location.origin && event.data?.kind === "cell") choose(event.data.cell);
});
document.body.addEventListener("htmx:afterSwap", () => {
  const { first, last, revision } = byId("facts").dataset;
  state.change({ first: numberOf(first), last: numberOf(last), revision: Number(revision) });
});
