// One location's page.

import { ask } from "./core/api.js";
import { Live } from "./core/live.js";
import { keepLocation, locationState, numberOf, readLocation, writeLocation } from "./core/location.js";
import { byId, closest, reason } from "./dom.js";
import * as anomalies from "./parts/anomalies.js";
import * as changed from "./parts/changed.js";
import * as connection from "./parts/connection.js";
import * as embedded from "./parts/embedded.js";
import * as evaluation from "./parts/evaluation.js";
import * as fragment from "./parts/fragment.js";
import { History } from "./parts/history.js";
import * as modelCard from "./parts/model_card.js";
import * as settings from "./parts/settings.js";
import * as takeChart from "./parts/take_chart.js";
import * as spectrum from "./parts/spectrum.js";
import * as weekmap from "./parts/weekmap.js";

const section = byId("history");
const state = locationState(section.dataset);
state.change(readLocation(window.location.search, state.values));
const { name, path, isGrid } = state.values;
const live = new Live(`?location=${encodeURIComponent(name)}`, path);

keepLocation(state);
connection.mount(byId("connection"), live);
changed.mount(byId("notice"), state, live);
changed.mountUpdate(byId("jobs"), state);
anomalies.mount(byId("anomalies"), live, name);
fragment.mount("facts", live, (message) => message.kind !== "job");
fragment.mount("work", live, (message) => message.kind === "job" || message.kind === "observation");
evaluation.mount(byId("evaluation"), state);
settings.mount(byId("settings-form"), state);
weekmap.mount(byId("week"), state);
takeChart.mount(byId("take"), state);
new History(section, byId("chart"), state, live);
const viewer = document.querySelector("iframe.viewer");
if (viewer instanceof HTMLIFrameElement) embedded.host(viewer, state);
const lead = () => document.getElementById("alone")?.setAttribute("href", `/view/${writeLocation(state.values, `?location=${encodeURIComponent(name)}`)}`);
state.subscribe((names) => (names.has("cell") || names.has("time")) && lead());
lead();

async function showModel() {
  const [rhythms, card] = [byId("spectrum"), byId("model-card")];
  const { cell, revision } = state.values;
  if (cell === null) return (rhythms.textContent = card.textContent = "Choose a cell above.");
  if (!revision) return (rhythms.textContent = card.textContent = "There is no model yet. It is made when enough has been observed.");
  try {
    const model = await ask(`${path}/model?cell=${cell}`);
    if (cell !== state.values.cell) return;
    spectrum.draw(rhythms, model, state.values);
    modelCard.draw(card, model, state.values);
  } catch (error) {
    rhythms.textContent = card.textContent = reason(error);
  }
}

state.subscribe((names) => (names.has("cell") || names.has("revision")) && showModel());
live.onConnection((since) => since === null && showModel());
showModel();

const showCell = () => isGrid && state.values.cell !== null && (byId("cell").value = String(state.values.cell));
state.subscribe((names) => names.has("cell") && showCell());
showCell();
document.getElementById("cell-form")?.addEventListener("submit", (event) => {
  event.preventDefault();
  state.change({ cell: Number(byId("cell").value) }, "push");
});

// An anomaly of this page leads to its moment in this page: in the scene and in the chart.
byId("anomalies").addEventListener("click", (event) => {
  const link = closest(event, "a[data-time]");
  if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
  event.preventDefault();
  const cell = numberOf(link.dataset.cell);
  state.change({ time: Number(link.dataset.time), ...(cell === null ? {} : { cell }) }, "push");
  (viewer ?? section).scrollIntoView({ block: "start", behavior: "smooth" });
});

document.body.addEventListener("htmx:afterSwap", () => {
  const { first, last, revision } = byId("facts").dataset;
  state.change({ first: numberOf(first), last: numberOf(last), revision: Number(revision) });
});
