// What a location's page gives along: a picture of the chart, the series that it shows as a table, and the report.

import { askFile } from "../core/api.js";
import { colours } from "../core/colours.js";
import { seriesQuestion } from "../core/series.js";
import { fileName, save } from "../core/taking.js";
import { timeText, zoneText } from "../core/words.js";
import { reason } from "../dom.js";
import { legendsOf } from "./legend.js";
import { picture } from "./picture.js";
/** @import { State } from "../core/state.js" */
/** @import { LocationView } from "../../../../types.d.ts" */

const ROWS = 20_000;

/**
 * @param {HTMLElement} element with a button for each, and a link
 * @param {State<LocationView>} state
 */
export function mount(element, state) {
  const report = element.querySelector("a");
  const said = element.querySelector("output");
  element.addEventListener("click", async (event) => {
    const kind = event.target instanceof HTMLElement ? event.target.dataset.take : undefined;
    if (!kind || !said) return;
    try {
      await (kind === "table" ? takeTable(state.values) : takePicture(state.values));
      said.textContent = "";
    } catch (error) {
      said.textContent = reason(error);
    }
  });
  const show = () => {
    const { cell, span, path, isGrid } = state.values;
    const query = new URLSearchParams([...(isGrid && cell !== null ? [["cell", String(cell)]] : []),
      ...(span ? [["start", String(Math.floor(span[0]))], ["stop", String(Math.ceil(span[1]))]] : [])]);
    if (report) report.href = `${path}/report?${query}`;
  };
  state.subscribe(show);
  show();
}

/** @param {LocationView} view */
async function takeTable(view) {
  const { cell, span, first, last } = view;
  if (cell === null || last === null) throw new Error("Choose a cell that has been observed.");
  const { content, name } = await askFile(seriesQuestion(view, span ?? [first ?? last, last], ROWS).question, "text/csv");
  save(content, name);
}

/** @param {LocationView} view */
async function takePicture(view) {
  const canvas = document.querySelector("#chart canvas");
  if (!(canvas instanceof HTMLCanvasElement)) throw new Error("There is no chart yet.");
  const { name, cell, isGrid, span, zone, revision, confidence } = view;
  const [start, stop] = span ?? [0, 0];
  const { paper, ink, quiet } = colours();
  const made = picture(canvas, { width: canvas.clientWidth, height: canvas.clientHeight, ratio: canvas.width / canvas.clientWidth }, {
    title: isGrid ? `${name}, cell ${cell}` : name,
    when: `${timeText(start, zone)} to ${timeText(stop, zone)}`,
    detail: `${zoneText(stop, zone)} · revision ${revision}, confidence ${confidence.toFixed(2)}`,
    legends: legendsOf(".legend").flatMap(({ swatches }) => swatches.map((each) => ({ title: "", swatches: [each], ramp: null }))),
    scale: null,
    foot: "Tidemap",
  }, { paper, ground: paper, ink, quiet });
  const content = await new Promise((resolve) => made.toBlob(resolve, "image/png"));
  save(content, fileName(isGrid ? [name, String(cell)] : [name], start, zone, "png"));
}
