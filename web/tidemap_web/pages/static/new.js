// A new location: a form, then the lines to post with, which turn green when the first post arrives.

import { post } from "./core/api.js";
import { Live } from "./core/live.js";
import { byId, reason } from "./dom.js";
import * as connection from "./parts/connection.js";

const live = new Live("?kind=observation");
connection.mount(byId("connection"), live);

const form = byId("new-form");
const zone = form.elements.namedItem("time_zone");
if (zone instanceof HTMLInputElement && zone.value === "UTC") zone.value = Intl.DateTimeFormat().resolvedOptions().timeZone;
form.addEventListener("change", showGrid);
showGrid();
form.addEventListener("submit", (event) => {
  event.preventDefault();
  create();
});

/** Fields of grids alone are there for grids alone. */
function showGrid() {
  byId("grid-fields").hidden = new FormData(form).get("kind") === "state";
}

async function create() {
  const said = byId("problem");
  try {
    const made = await post("/locations", body(new FormData(form)));
    said.textContent = "";
    ready(made.name, made.kind);
  } catch (error) {
    said.textContent = reason(error);
  }
}

/** @param {FormData} data */
function body(data) {
  const text = (/** @type {string} */ name) => String(data.get(name) ?? "");
  const kind = text("kind");
  const wanted = { name: text("name").trim(), kind, interval_s: Number(text("interval_s")), time_zone: text("time_zone").trim() };
  if (kind === "state") return wanted;
  const sides = kind === "grid2d" ? ["nx", "ny"] : ["nx", "ny", "nz"];
  return { ...wanted, grid: { resolution_m: Number(text("resolution_m")), shape: sides.map((side) => Number(text(side))) } };
}

/**
 * @param {string} name
 * @param {string} kind
 */
function ready(name, kind) {
  form.hidden = true;
  const shown = byId("ready");
  const kinds = kind === "state" ? [kind] : [kind, "grid"];
  for (const code of shown.querySelectorAll("[data-of]")) {
    if (!(code instanceof HTMLElement)) continue;
    code.hidden = !kinds.includes(code.dataset.of ?? "");
    const text = code.querySelector("code");
    if (text) text.textContent = (text.textContent ?? "").replaceAll("NAME", name);
  }
  const link = byId("to-location");
  link.setAttribute("href", `/locations/${encodeURIComponent(name)}`);
  link.textContent = name;
  shown.hidden = false;
  byId("arrival").focus();
  live.onMessage((message) => {
    if (message.location !== name) return;
    byId("arrival").textContent = "The first post has arrived.";
    byId("arrival").className = "arrival arrived";
  });
}
