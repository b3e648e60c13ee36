// What is under the pointer in the scene: the session is asked as the pointer moves, one question at a time.

import { markerText, cellText } from "../core/facts.js";
/** @import { State } from "../core/state.js" */
/** @import { HoverMessage, ViewState } from "../../../../types.d.ts" */

const AWAY = 14;

export class Pointer {
  /**
   * @param {HTMLElement} tip
   * @param {State<ViewState>} state
   * @param {(at: [number, number]) => void} ask
   */
  constructor(tip, state, ask) {
    this.tip = tip;
    this.state = state;
    this.ask = ask;
    /** @type {[number, number] | null} where it is, in shares of the scene */
    this.at = null;
    /** @type {[number, number] | null} that was asked about, while there is no answer */
    this.asked = null;
    // What is there may have changed meanwhile.
    state.subscribe((changed) => changed.has("frame") && this.inquire());
  }

  /** @param {Window} scene */
  watch(scene) {
    this.asked = null;
    scene.addEventListener("pointermove", (event) => {
      if (event.buttons || event.pointerType === "touch") return this.left();
      this.at = [share(event.clientX, scene.innerWidth), share(event.clientY, scene.innerHeight)];
      this.inquire();
    });
    for (const name of ["pointerdown", "pointerleave", "blur"]) scene.addEventListener(name, () => this.left());
    scene.document.documentElement.addEventListener("pointerleave", () => this.left());
  }

  inquire() {
    if (!this.at || this.asked) return;
    this.asked = this.at;
    this.ask(this.at);
  }

  left() {
    this.at = null;
    this.tip.hidden = true;
  }

  /** @param {HoverMessage} message */
  answer({ cell, marker }) {
    const asked = this.asked;
    this.asked = null;
    if (!this.at) return;
    if (this.at !== asked) this.inquire();
    const time = this.state.values.frame?.time ?? 0;
    this.tip.hidden = !cell && !marker;
    if (marker) this.tip.textContent = markerText(marker, time);
    else if (cell) this.tip.textContent = cellText(cell, time);
    if (!this.tip.hidden) this.stand(this.at);
  }

  /**
   * Beside the pointer, within the scene.
   * @param {[number, number]} at
   */
  stand([across, down]) {
    const room = /** @type {HTMLElement} */ (this.tip.parentElement);
    const [x, y] = [across * room.clientWidth, down * room.clientHeight];
    const left = x + AWAY + this.tip.offsetWidth > room.clientWidth ? x - AWAY - this.tip.offsetWidth : x + AWAY;
    this.tip.style.left = `${Math.max(0, left)}px`;
    this.tip.style.top = `${Math.max(0, Math.min(room.clientHeight - this.tip.offsetHeight, y + AWAY))}px`;
  }
}

/**
 * @param {number} part
 * @param {number} whole
 */
const share = (part, whole) => Math.min(1, Math.max(0, part / whole));
