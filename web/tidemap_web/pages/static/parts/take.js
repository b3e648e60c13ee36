// What the viewer gives along: a picture of the scene, a loop as an animated picture, the cell's series as a table.

import { askFile } from "../core/api.js";
import { seriesQuestion } from "../core/series.js";
import { fileName, momentsOf, save, scaleBar } from "../core/taking.js";
import { zoneOf } from "../core/time.js";
import { animatedWebp } from "../core/webp.js";
import { windowOf } from "../core/window.js";
import { clockText, dateText, durationText, zoneText } from "../core/words.js";
import { byId as $, reason } from "../dom.js";
import { legendsOf } from "./legend.js";
import { picture } from "./picture.js";
/** @import { State } from "../core/state.js" */
/** @import { SceneWindow, ViewState } from "../../../../types.d.ts" */

const DARK = { paper: "#1a1d22", ground: "#141414", ink: "#e8eaed", quiet: "#b6bec8" };
const BAR_PX = 140;
const FRAME_MS = 160;
const LAST_MS = 900;
const SETTLED_MS = 120;
const DRAWN_MS = 30_000;
const QUALITY = 0.85;
const FILM_PX = 960;
const ROWS = 20_000;

/**
 * @param {State<ViewState>} state
 */
export function mount(state) {
  /** @type {AbortController | null} */
  let filming = null;
  const say = (/** @type {string} */ text) => ($("take-said").textContent = text);
  /** @param {() => Promise<void>} work */
  const tried = (work) => () => work().then(() => say(""), (error) => say(reason(error)));

  $("take-picture").addEventListener("click", tried(async () => {
    save(await encoded(drawn(state.values, stage()), "image/png"), nameOf(state.values, "png"));
  }));
  $("take-table").addEventListener("click", tried(async () => {
    const { content, name } = await askFile(seriesOf(state.values), "text/csv");
    save(content, name);
  }));
  $("take-loop").addEventListener("click", tried(async () => {
    if (filming) return filming.abort();
    filming = new AbortController();
    $("take-loop").textContent = "Stop";
    try {
      save(await film(state, filming.signal, say), nameOf(state.values, "webp"));
    } finally {
      filming = null;
      $("take-loop").textContent = "Loop";
    }
  }));
  state.subscribe(() => {
    const { cell, location, frame } = state.values;
    $("take-table").disabled = cell === null || !frame?.selected;
    for (const id of /** @type {const} */ (["take-picture", "take-loop"])) $(id).disabled = !frame;
    $("take-report").href = `/locations/${encodeURIComponent(location ?? "")}/report${cell === null ? "" : `?cell=${cell}`}`;
  });
}

/**
 * @param {ViewState} view
 * @param {string} ending
 */
const nameOf = ({ location, grid, time, zone }, ending) =>
  fileName([location ?? "scene"], time, zoneOf(zone, grid?.time_zone ?? "UTC"), ending);

/**
 * The question for the series of the cell over what the timeline covers.
 * @param {ViewState} view
 */
function seriesOf(view) {
  const { location, cell, grid } = view;
  const path = `/locations/${encodeURIComponent(location ?? "")}`;
  return seriesQuestion({ path, cell, interval: grid?.interval_s ?? 1 }, windowOf(view), ROWS).question;
}

const scene = () => {
  const frame = /** @type {HTMLIFrameElement} */ ($("scene"));
  const found = /** @type {SceneWindow | null} */ (/** @type {unknown} */ (frame.contentWindow));
  if (!found?.__viserMutable?.canvas) throw new Error("The scene is not there yet.");
  return { window: found, ...found.__viserMutable, canvas: found.__viserMutable.canvas };
};

/**
 * What is the same in all pictures of a film: their size, the legend and the scale.
 * @param {number} most pixels that it is wide at most
 */
function stage(most = Infinity) {
  const { canvas, camera, cameraControl } = scene();
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const perMetre = camera && cameraControl ? height / (2 * cameraControl.distance * Math.tan((camera.fov * Math.PI) / 360)) : 0;
  return {
    box: { width, height, ratio: Math.min(canvas.width, most) / width },
    scale: perMetre > 0 ? scaleBar(perMetre, BAR_PX) : null,
    legends: legendsOf(".keys .key"),
  };
}

/**
 * The scene with its caption.
 * @param {ViewState} view
 * @param {ReturnType<typeof stage>} how
 */
const drawn = (view, { box, ...how }) => picture(scene().canvas, box, { ...captionOf(view), ...how }, DARK);

/** @param {ViewState} view */
function captionOf({ location, grid, frame, time, zone }) {
  const shown = zoneOf(zone, grid?.time_zone ?? "UTC");
  const moment = time ?? frame?.time ?? 0;
  const ahead = moment - (grid?.span?.last ?? moment);
  const model = frame?.revision ? `revision ${frame.revision} (${frame.estimator}, order ${frame.order}), confidence ${frame.confidence.toFixed(2)}` : "no model yet";
  return {
    title: location ?? "",
    when: `${dateText(moment, shown)}, ${clockText(moment, shown)}`,
    detail: [zoneText(moment, shown), ahead > 1 ? `forecast, +${durationText(ahead)}` : "", model].filter(Boolean).join(" · "),
    foot: `${frame ? `lines on the floor every ${frame.lines_m} m · ` : ""}Tidemap`,
  };
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {string} type
 * @returns {Promise<Blob>}
 */
function encoded(canvas, type) {
  return new Promise((resolve, reject) => {
    canvas.toBlob((blob) => (blob?.type === type ? resolve(blob) : reject(new Error(`This browser makes no pictures of ${type}.`))), type, QUALITY);
  });
}

/**
 * The loop, or what the timeline covers, picture by picture, each after the scene has been drawn.
 * @param {State<ViewState>} state
 * @param {AbortSignal} stopped
 * @param {(text: string) => void} say
 * @returns {Promise<Blob>}
 */
async function film(state, stopped, say) {
  const { grid, loop, time, live } = state.values;
  if (!grid?.span) throw new Error("Nothing has been observed yet.");
  const moments = momentsOf(loop ?? windowOf(state.values), grid.interval_s, grid.span);
  const pictures = [];
  const how = stage(FILM_PX);
  let size = { width: 0, height: 0 };
  try {
    for (const [i, moment] of moments.entries()) {
      say(`Picture ${i + 1} of ${moments.length} …`);
      state.change({ time: moment, live: false, playing: false });
      await shown(state, moment, stopped);
      const canvas = drawn(state.values, how);
      size = { width: canvas.width, height: canvas.height };
      pictures.push(new Uint8Array(await (await encoded(canvas, "image/webp")).arrayBuffer()));
    }
  } finally {
    state.change({ time, live });
  }
  return animatedWebp(pictures, { ...size, duration_ms: FRAME_MS, last_ms: LAST_MS });
}

/**
 * When the scene shows a moment: the server has sent it, and the scene has taken all of it and drawn it.
 * @param {State<ViewState>} state
 * @param {number} moment
 * @param {AbortSignal} stopped
 */
async function shown(state, moment, stopped) {
  const until = performance.now() + DRAWN_MS;
  const ready = () => {
    const { frame } = state.values;
    return frame?.time === moment && frame.drawn && !frame.loading && scene().messageQueue.length === 0;
  };
  while (!ready()) {
    if (performance.now() > until) throw new Error("The scene was not drawn in time.");
    await pause(20, stopped);
  }
  await pause(SETTLED_MS, stopped);
  scene().requestRender();
  await new Promise((resolve) => scene().window.requestAnimationFrame(() => requestAnimationFrame(resolve)));
}

/**
 * @param {number} length in milliseconds
 * @param {AbortSignal} stopped
 */
async function pause(length, stopped) {
  await new Promise((resolve) => setTimeout(resolve, length));
  if (stopped.aborted) throw new Error("Stopped.");
}
