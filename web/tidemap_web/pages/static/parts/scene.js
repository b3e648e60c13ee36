// The scene: viser's client in a frame, the socket to the session that draws it, and signs over it.

import { signIn } from "../core/api.js";
import { now } from "../core/clock.js";
import { zoneOf } from "../core/time.js";
import { clockText } from "../core/words.js";
import { Heartbeat } from "../core/heartbeat.js";
import { byId as $ } from "../dom.js";
import { Pointer } from "./pointer.js";
/** @import { State } from "../core/state.js" */
/** @import { FrameMessage, GridMessage, Handlers, NoticeMessage, ViewState } from "../../../../types.d.ts" */

const ENDED = 4401;
const TOO_MANY = 1013;
const RETRY_MS = 8000;
const CHECK_MS = 5000;
const REQUEST = /** @type {const} */ ([
  "location", "time", "live", "confidence", "order", "floor", "dim", "low", "high", "crop", "layout", "predicted", "observed",
]);

export class SceneView {
  /**
   * @param {State<ViewState>} state
   * @param {{ token: string, scene: string, ratio: string | null, keyed: boolean }} how
   */
  constructor(state, { token, scene, ratio, keyed }) {
    this.state = state;
    this.keyed = keyed;
    this.token = token;
    this.address = ratio === null ? scene : `${scene}&fixedDpr=${encodeURIComponent(ratio)}`;
    this.tried = 0;
    /** @type {number | null} since when there is no connection */
    this.since = null;
    /** @type {WebSocket | null} */
    this.socket = null;
    /** @type {(event: KeyboardEvent) => void} */
    this.keys = () => {};
    /** the camera that the scene has, so that it is not sent back */
    this.pose = "";
    this.pointer = new Pointer($("pointed"), state, (at) => this.send({ kind: "hover", at }));
    this.heartbeat = new Heartbeat({ ask: () => this.send({ kind: "ping" }), silent, give: () => this.drop() });
    state.subscribe((changed) => this.changed(changed));
  }

  connect() {
    const address = new URL(`/view/control/${this.token}`, window.location.href);
    address.protocol = address.protocol.replace("http", "ws");
    const socket = new WebSocket(address);
    this.socket = socket;
    socket.addEventListener("open", () => {
      this.heartbeat.start();
      this.tried = 0;
      this.since = null;
      this.ask();
      this.select();
      this.pose = "";
      this.putCamera();
      this.load();
    });
    socket.addEventListener("message", (event) => {
      this.heartbeat.heard();
      const message = JSON.parse(event.data);
      this.handlers[/** @type {keyof Handlers} */ (message.kind)]?.(message);
    });
    socket.addEventListener("close", (event) => socket === this.socket && this.lost(event.code));
    this.loading("Connecting", null);
  }

  /** Give a connection up that nobody answers on. */
  drop() {
    const socket = this.socket;
    this.socket = null;
    socket?.close();
    this.lost(0);
  }

  /** @param {number} code */
  async lost(code) {
    this.tried += 1;
    this.heartbeat.stop();
    if (code === TOO_MANY) return setTimeout(() => this.connect(), RETRY_MS);
    const status = code === ENDED ? 401 : await sessionsStatus();
    if (status === 401 || status === 403) return signIn();
    this.loading(null, null);
    this.since ??= now();
    notice("No connection", `The server has not answered since ${clockText(this.since, zoneOf("mine", "UTC"))}. Trying again …`);
    setTimeout(() => this.connect(), Math.min(RETRY_MS, 500 * 2 ** this.tried));
  }

  /** Open viser's client anew: in a frame of its own, for it keeps its colours to itself. */
  load() {
    const fresh = /** @type {HTMLIFrameElement} */ ($("scene").cloneNode());
    fresh.src = `${this.address}#${this.token}`;
    fresh.addEventListener("load", () => {
      fresh.contentWindow?.addEventListener("keydown", (event) => this.keys(event), true);
      if (fresh.contentWindow) this.pointer.watch(fresh.contentWindow);
    });
    $("scene").replaceWith(fresh);
    this.loading("Loading the 3D scene", null);
  }

  /** @param {object} message */
  send(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  ask() {
    const { values } = this.state;
    this.send({ kind: "view", ...Object.fromEntries(REQUEST.map((name) => [name, values[name]])) });
  }

  select() {
    this.send({ kind: "select", cell: this.state.values.cell });
  }

  /** Put the camera where the address says. */
  putCamera() {
    const { camera } = this.state.values;
    if (!camera || String(camera) === this.pose) return;
    this.pose = String(camera);
    this.send({ kind: "aim", view: "pose", pose: camera });
  }

  /** @param {"slanted" | "above"} view */
  aim(view) {
    this.send({ kind: "aim", view });
    this.state.change({ camera: null }, "replace");
  }

  /** @param {Set<string>} changed */
  changed(changed) {
    const { live } = this.state.values;
    if (REQUEST.some((name) => changed.has(name) && (name !== "time" || !live || changed.has("live")))) this.ask();
    if (changed.has("cell")) this.select();
    if (changed.has("camera")) this.putCamera();
  }

  /**
   * Say what is loaded, and how far that is from 0 to 1; null: it is not known how far, or nothing is.
   * @param {string | null} what
   * @param {number | null} done
   */
  loading(what, done) {
    $("loading").hidden = what === null;
    if (what === null) return;
    $("loading-what").textContent = done === null ? `${what} …` : `${what}: ${Math.round(100 * done)} %`;
    if (done === null) $("loading-bar").removeAttribute("value");
    else $("loading-bar").value = done;
  }

  /** @type {Handlers} */
  handlers = {
    grids: (message) => {
      const names = message.items.map((item) => item.name);
      const select = $("location");
      if ([...select.options].map((option) => option.value).join() !== names.join()) {
        select.replaceChildren(...names.map((name) => new Option(name, name)));
      }
      select.disabled = names.length === 0;
      select.value = this.state.values.location ?? names[0] ?? "";
    },
    location: (message) => {
      $("location").value = message.name;
      document.title = `${message.name} · Tidemap`;
      this.state.change({ grid: message, location: message.name }, "replace");
    },
    events: (message) => this.state.change({ events: message.items }),
    frame: (message) => this.framed(message),
    progress: (message) => this.loading(message.done === null ? null : `Loading ${message.what}`, message.done),
    camera: (message) => {
      this.pose = String(message.pose);
      this.state.change({ camera: message.pose }, "replace");
    },
    picked: ({ cell, marker }) => this.state.change({ marker, ...(marker === null ? { cell } : {}) }, "push"),
    hovered: (message) => this.pointer.answer(message),
    markers: (message) => this.state.change({ markers: message.items }),
    refused: (message) => console.warn(`The viewer did not understand the page: ${message.detail}`),
    notice: (message) => {
      this.loading(null, null);
      this.state.change({ frame: null, playing: false });
      explain(message, this.state.values.location ?? "lab", this.keyed);
    },
  };

  /** @param {FrameMessage} frame */
  framed(frame) {
    $("notice").hidden = true;
    if (frame.drawn && !frame.loading) this.loading(null, null);
    this.state.change({ frame, ...(frame.live && this.state.values.live ? { time: frame.time } : {}) });
  }
}

/** What the server answers to who may open the viewer; undefined where it does not answer. */
async function sessionsStatus() {
  const answer = await fetch("/view/sessions", { signal: AbortSignal.timeout(CHECK_MS) }).catch(() => null);
  return answer?.status;
}

/** @param {number | null} since when the server has not answered, null when it does */
function silent(since) {
  $("silent").hidden = since === null;
  if (since === null) return;
  $("silent").textContent = `No answer since ${clockText(since, zoneOf("mine", "UTC"))}. What you see is from then; this page goes on asking.`;
}

/**
 * @param {string} title
 * @param {string} text
 */
function notice(title, text, code = "") {
  $("notice-title").textContent = title;
  $("notice-text").textContent = text;
  $("notice-code").textContent = code;
  $("notice-code").hidden = code === "";
  $("notice").hidden = false;
}

/**
 * @param {NoticeMessage} message
 * @param {string} name
 * @param {boolean} keyed whether the server wants keys
 */
function explain({ reason, detail }, name, keyed) {
  const origin = window.location.origin;
  const curl = (/** @type {string} */ path) =>
    `curl ${origin}/api/v1/locations${path} \\\n${keyed ? '  -H "Authorization: Bearer $TIDEMAP_KEY" \\\n' : ""}  --json`;
  /** @type {Record<string, [string, string, string?]>} */
  const said = {
    "no-grids": ["No grid yet", "The viewer shows locations of kind grid2d and grid3d. Make one, or run “tidemap demo”:",
      `${curl("")} '{"name": "lab", "kind": "grid3d",\n  "interval_s": 300, "time_zone": "Europe/London",\n  "grid": {"resolution_m": 0.2, "shape": [60, 40, 12]}}'`],
    "no-observations": ["Nothing observed yet", `Post what a robot saw in ${name}; cells are numbers or indices such as [1, 0, 0]:`,
      `${curl(`/${encodeURIComponent(name)}/observations`)} "{\\"observations\\": [{\n  \\"time\\": $(date +%s), \\"occupied\\": [0], \\"free\\": [1, 2]}]}"`],
    "not-found": ["No such grid", `${detail} Choose another location.`],
    "no-grid": ["Not a grid", `${name} is a state, which has no scene. It has a page of its own: ${origin}/locations/${encodeURIComponent(name)}`],
    "too-many": ["Too many viewers", detail],
    deleted: ["This location was deleted", `${name} and all that was known of it have been deleted, or renamed. Choose another location.`],
  };
  notice(...(said[reason] ?? ["This did not work", detail]));
}
