// The scene: viser's client in a frame, the socket to the session that draws it, and signs over it.

import { byId as $ } from "../dom.js";
/** @import { State } from "../core/state.js" */
/** @import { FrameMessage, GridMessage, Handlers, NoticeMessage, ViewState } from "../../../../types.d.ts" */

const ENDED = 4401;
const REQUEST = /** @type {const} */ ([
  "location", "time", "live", "confidence", "order", "floor", "dim", "low", "high", "layout", "predicted", "observed",
]);

export class SceneView {
  /**
   * @param {State<ViewState>} state
   * @param {{ token: string, scene: string, ratio: string | null }} how
   */
  constructor(state, { token, scene, ratio }) {
    this.state = state;
    this.token = token;
    this.address = ratio === null ? scene : `${scene}&fixedDpr=${encodeURIComponent(ratio)}`;
    this.tried = 0;
    /** @type {WebSocket | null} */
    this.socket = null;
    /** @type {(event: KeyboardEvent) => void} */
    this.keys = () => {};
    /** the camera that the scene has, so that it is not sent back */
    this.pose = "";
    state.subscribe((changed) => this.changed(changed));
  }

  connect() {
    const address = new URL(`/view/control/${this.token}`, window.location.href);
    address.protocol = address.protocol.replace("http", "ws");
    this.socket = new WebSocket(address);
    this.socket.addEventListener("open", () => {
      this.tried = 0;
      this.ask();
      this.select();
      this.pose = "";
      this.putCamera();
      this.load();
    });
    this.socket.addEventListener("message", (event) => {
      const message = JSON.parse(event.data);
      this.handlers[/** @type {keyof Handlers} */ (message.kind)]?.(message);
    });
    this.socket.addEventListener("close", (event) => this.lost(event.code));
    this.loading("Connecting", null);
  }

  /** @param {number} code */
  async lost(code) {
    this.tried += 1;
    const status = code === ENDED ? 401 : (await fetch("/view/sessions").catch(() => null))?.status;
    if (top && (status === 401 || status === 403)) {
      top.location.assign(`/login?next=${encodeURIComponent(top.location.pathname + top.location.search)}`);
      return;
    }
    this.loading(null, null);
    notice("No connection", "The server does not answer. Trying again …");
    setTimeout(() => this.connect(), Math.min(8000, 500 * 2 ** this.tried));
  }

  /** Open viser's client anew: in a frame of its own, for it keeps its colours to itself. */
  load() {
    const fresh = /** @type {HTMLIFrameElement} */ ($("scene").cloneNode());
    fresh.src = `${this.address}#${this.token}`;
    fresh.addEventListener("load", () => fresh.contentWindow?.addEventListener("keydown", (event) => this.keys(event), true));
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
    picked: (message) => this.state.change({ cell: message.cell }, "push"),
    refused: (message) => console.warn(`The viewer did not understand the page: ${message.detail}`),
    notice: (message) => {
      this.loading(null, null);
      this.state.change({ frame: null, playing: false });
      explain(message, this.state.values.location ?? "lab");
    },
  };

  /** @param {FrameMessage} frame */
  framed(frame) {
    $("notice").hidden = true;
    if (frame.drawn && !frame.loading) this.loading(null, null);
    this.state.change({ frame, ...(frame.live && this.state.values.live ? { time: frame.time } : {}) });
  }
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
 */
function explain({ reason, detail }, name) {
  const origin = window.location.origin;
  const form = `{"name": "lab", "kind": "grid3d", "interval_s": 300, "time_zone": "Europe/London",\n  "grid": {"resolution_m": 0.2, "shape": [60, 40, 12]}}`;
  /** @type {Record<string, [string, string, string?]>} */
  const said = {
    "no-grids": ["No grid yet", "The viewer shows locations of kind grid2d and grid3d. Make one, or run “tidemap demo”:",
      `curl ${origin}/api/v1/locations --json '${form}'`],
    "no-observations": ["Nothing observed yet", `Post what a robot saw in ${name}; cells are numbers or [i, j, k]:`,
      `curl ${origin}/api/v1/locations/${name}/observations --json '{\n  "observations": [{"time": "…Z", "occupied": [[0, 0, 0]], "free": [[1, 0, 0]]}]}'`],
    "not-found": ["No such grid", `${detail} Choose another location.`],
    "no-grid": ["Not a grid", `${name} is a state, which has no scene. It has a page of its own: ${origin}/locations/${encodeURIComponent(name)}`],
    deleted: ["This location was deleted", `${name} and all that was known of it have been deleted, or renamed. Choose another location.`],
  };
  notice(...(said[reason] ?? ["This did not work", detail]));
}
