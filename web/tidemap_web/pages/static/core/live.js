// The stream of events of a page. It reconnects by itself, and says since when there is no connection.

import { signIn } from "./api.js";
import { now } from "./clock.js";
/** @import { LiveMessage } from "../../../../types.d.ts" */

const ENDED = 4401;
const PAUSES_MS = [250, 500, 1000, 2000];
const CHECK_MS = 15_000;
const ANSWER_MS = 5_000;

export class Live {
  /** @param {string} query what is wanted, such as `?location=lab` */
  constructor(query = "") {
    this.address = `${window.location.origin.replace("http", "ws")}/api/v1/events${query}`;
    /** @type {number | null} since when there is no connection */
    this.since = null;
    this.tried = 0;
    /** @type {WebSocket | null} */
    this.socket = null;
    /** @type {Set<(message: LiveMessage) => void>} */
    this.readers = new Set();
    /** @type {Set<(since: number | null) => void>} */
    this.watchers = new Set();
    window.addEventListener("pagehide", () => this.leave());
    window.addEventListener("pageshow", (event) => event.persisted && this.open());
    window.addEventListener("online", () => this.since !== null && this.open());
    setInterval(() => this.check(), CHECK_MS);
    this.open();
  }

  /**
   * Call `read` with every message.
   * @param {(message: LiveMessage) => void} read
   */
  onMessage(read) {
    this.readers.add(read);
  }

  /**
   * Call `report` with the time when the connection was lost, and with null when it is back: what was missed is to be
   * asked for then.
   * @param {(since: number | null) => void} report
   */
  onConnection(report) {
    this.watchers.add(report);
  }

  open() {
    this.leave();
    const socket = new WebSocket(this.address);
    this.socket = socket;
    let opened = false;
    socket.onopen = () => {
      opened = true;
      this.tried = 0;
      if (this.since !== null) this.report(null);
    };
    socket.onmessage = (event) => {
      const message = JSON.parse(event.data);
      for (const read of this.readers) read(message);
    };
    socket.onclose = (event) => {
      if (this.socket !== socket) return;
      if (event.code === ENDED) signIn();
      else this.lose(!opened);
    };
  }

  /** @param {boolean} refused whether it never was open: the key may have ended meanwhile */
  async lose(refused) {
    this.leave();
    if (this.since === null) this.report(now());
    const pause = PAUSES_MS[Math.min(this.tried++, PAUSES_MS.length - 1)];
    if (refused) await answers("/api/v1/locations?limit=1").then((status) => status === 401 && signIn());
    setTimeout(() => this.since !== null && this.socket === null && this.open(), pause);
  }

  /** Close the socket without a word. */
  leave() {
    const socket = this.socket;
    this.socket = null;
    socket?.close();
  }

  /** A server that is stuck keeps its sockets open and says nothing. */
  async check() {
    const asked = this.socket;
    if (asked?.readyState !== WebSocket.OPEN) return;
    if ((await answers("/healthz")) === 0 && this.socket === asked) this.lose(false);
  }

  /** @param {number | null} since */
  report(since) {
    this.since = since;
    for (const each of this.watchers) each(since);
  }
}

/**
 * The status that an address answers with, 0 without an answer.
 * @param {string} address
 */
async function answers(address) {
  try {
    return (await fetch(address, { cache: "no-store", signal: AbortSignal.timeout(ANSWER_MS) })).status;
  } catch {
    return 0;
  }
}
