// A heartbeat: a server that is stuck keeps its sockets open and says nothing, so it is asked whether it is there.

import { now } from "./clock.js";

const ASK_MS = 2500;
const ANSWER_MS = 4000;
const GIVE_UP_MS = 25_000;

export class Heartbeat {
  /**
   * `ask` asks the other side; `silent` hears since when there has been no answer (Unix seconds), and null when there is
   * one again; `give` gives up where none comes for long.
   * @param {{ ask: () => void, silent: (since: number | null) => void, give: () => void }} how
   */
  constructor({ ask, silent, give }) {
    this.ask = ask;
    this.silent = silent;
    this.give = give;
    this.last = 0;
    /** @type {number | null} when it was asked, while there is no answer */
    this.asked = null;
    this.said = false;
    this.timer = 0;
  }

  start() {
    this.stop();
    this.heard();
    this.timer = setInterval(() => this.beat(), ASK_MS);
  }

  stop() {
    clearInterval(this.timer);
    this.asked = null;
    this.say(false);
  }

  /** Something came: it is there. */
  heard() {
    this.last = now();
    this.asked = null;
    this.say(false);
  }

  beat() {
    const time = performance.now();
    if (this.asked === null) {
      this.asked = time;
      this.ask();
    } else if (time - this.asked > GIVE_UP_MS) {
      this.stop();
      this.give();
    } else if (time - this.asked > ANSWER_MS) this.say(true);
  }

  /** @param {boolean} silent */
  say(silent) {
    if (silent === this.said) return;
    this.said = silent;
    this.silent(silent ? this.last : null);
  }
}
