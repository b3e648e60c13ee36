// The transport: the moment in words and as it is typed, steps, playing, anomalies, and the keys for all of them.

import { all, byId as $ } from "../dom.js";
import { now } from "../core/clock.js";
import { SPEEDS, loopOf, next, otherSpeed, speedOf } from "../core/playing.js";
import { EXAMPLES, readMoment, zoneOf } from "../core/time.js";
import { windowOf } from "../core/window.js";
import { clockText, dateText, durationText, zoneText } from "../core/words.js";
import { pan, zoom } from "./timeline.js";
/** @import { State } from "../core/state.js" */
/** @import { ViewState } from "../../../../types.d.ts" */

const HOUR = 3600;
const DAY = 86400;
const SAID_MS = 4000;

export class Transport {
  /**
   * @param {State<ViewState>} state
   * @param {(view: "slanted" | "above") => void} aim
   */
  constructor(state, aim) {
    this.state = state;
    this.aim = aim;
    this.before = 0;
    this.owed = 0;
    this.said = 0;
    state.subscribe((changed) => this.show(changed));
  }

  /**
   * Go to a moment, within what the timeline offers.
   * @param {number} time
   * @param {"push" | "replace"} entry
   */
  go(time, entry = "push") {
    const { grid } = this.state.values;
    if (!grid?.span) return;
    const bounded = Math.min(grid.span.stop, Math.max(grid.span.first, time));
    this.state.change({ time: bounded, live: false, span: this.spanWith(bounded) }, entry);
  }

  /**
   * What was zoomed to, moved so that it holds a moment.
   * @param {number} time
   * @returns {[number, number] | null}
   */
  spanWith(time) {
    const { span } = this.state.values;
    if (!span || (time >= span[0] && time <= span[1])) return span;
    const half = (span[1] - span[0]) / 2;
    return [time - half, time + half];
  }

  /**
   * @param {number} seconds
   * @param {boolean} repeated whether a key is held down
   */
  step(seconds, repeated = false) {
    const { time } = this.state.values;
    if (time !== null) this.go(time + seconds, repeated ? "replace" : "push");
  }

  /** @param {number} direction */
  anomaly(direction) {
    const { events, time } = this.state.values;
    if (time === null) return;
    const starts = events.map((event) => event.start).sort((a, b) => a - b);
    const found = direction > 0 ? starts.find((start) => start > time + 1) : starts.findLast((start) => start < time - 1);
    if (found !== undefined) this.go(found);
    else this.say(starts.length ? `There is no ${direction > 0 ? "later" : "earlier"} anomaly.` : "There is no anomaly here.");
  }

  /** @param {string} text */
  say(text) {
    $("said").textContent = text;
    clearTimeout(this.said);
    this.said = setTimeout(() => ($("said").textContent = ""), SAID_MS);
  }

  live() {
    this.state.change({ live: true, playing: false, time: this.state.values.grid?.span?.last ?? null, span: null }, "push");
  }

  /** @param {boolean} on */
  play(on) {
    if (on && !this.state.values.grid?.span) return;
    this.state.change({ playing: on });
    this.owed = 0;
    this.before = performance.now();
    if (on) requestAnimationFrame((now) => this.tick(now));
  }

  /**
   * One frame at a time: what was not drawn yet is waited for, and caught up with.
   * @param {number} now
   */
  tick(now) {
    const { playing, frame, time, live, grid, loop } = this.state.values;
    if (!playing || !grid?.span) return;
    const speed = speedOf($("speed").value, grid.interval_s);
    this.owed += Math.min(0.5, (now - this.before) / 1000) * speed;
    this.before = now;
    const ready = frame === null || frame.time === time || live;
    // By whole samples where they are slow: within one nothing changes.
    if (ready && this.owed >= Math.min(grid.interval_s, speed)) {
      this.go(next(time ?? grid.span.stop, this.owed, loop, grid.span), "replace");
      this.owed = 0;
    }
    requestAnimationFrame((later) => this.tick(later));
  }

  /** Go round in what the timeline covers, or no longer go round. */
  toggleLoop() {
    const { grid, loop } = this.state.values;
    if (!grid?.span) return;
    const [low, high] = windowOf(this.state.values);
    this.state.change({ loop: loop ? null : loopOf(low, high, grid.span, grid.interval_s) }, "push");
  }

  /**
   * Let the loop begin or end at the moment that is shown.
   * @param {"begin" | "end"} edge
   */
  loopFrom(edge) {
    const { grid, loop, time } = this.state.values;
    if (!grid?.span || time === null) return;
    const [low, high] = loop ?? windowOf(this.state.values);
    const [one, other] = edge === "begin" ? [time, Math.max(high, time)] : [Math.min(low, time), time];
    this.state.change({ loop: loopOf(one, other, grid.span, grid.interval_s) }, "push");
  }

  /** @param {1 | -1} direction */
  speed(direction) {
    $("speed").value = otherSpeed($("speed").value, direction, this.state.values.grid?.interval_s ?? 1);
    this.say(`${$("speed").selectedOptions[0].text}`);
  }

  /** @param {string} text */
  typed(text) {
    const { grid, time } = this.state.values;
    if (!grid?.span) return;
    const zone = zoneOf(this.state.values.zone, grid.time_zone);
    const found = readMoment(text, { shown: time ?? grid.span.last, now: now(), zone });
    if (found === null) return this.say(`Not understood. Try: ${EXAMPLES}.`);
    if (found < grid.span.first || found > grid.span.stop) this.say("That is outside of what the timeline offers; this is the nearest moment.");
    this.go(found);
  }

  /** @param {Set<string>} changed */
  show(changed) {
    const { values } = this.state;
    $("live").setAttribute("aria-pressed", String(values.live));
    $("play").setAttribute("aria-pressed", String(values.playing));
    $("loop").setAttribute("aria-pressed", String(values.loop !== null));
    $("play-sign").textContent = values.playing ? "❚❚" : "▶";
    if (changed.has("events")) for (const id of /** @type {const} */ (["previous", "next"])) $(id).setAttribute("aria-disabled", String(!values.events.length));
    for (const button of all("[data-reach]")) button.setAttribute("aria-pressed", String(!values.span && button.dataset.reach === reachOf(values)));
    this.showMoment();
  }

  showMoment() {
    const { grid, time, zone: choice } = this.state.values;
    if (!grid?.span || time === null) {
      $("date").textContent = "–";
      for (const id of ["clock", "zone", "tense"]) $(id).textContent = "";
      return;
    }
    const zone = zoneOf(choice, grid.time_zone);
    $("date").textContent = dateText(time, zone);
    $("clock").textContent = clockText(time, zone);
    $("zone").textContent = zoneText(time, zone);
    const ahead = time - grid.span.last;
    $("tense").textContent = ahead > 1 ? `forecast, +${durationText(ahead)}` : ahead < -1 ? `${durationText(-ahead)} before last` : "newest";
    $("tense").classList.toggle("ahead", ahead > 1);
  }

  /**
   * What a key does; true where it does something.
   * @param {KeyboardEvent} event
   */
  key(event) {
    const interval = this.state.values.grid?.interval_s ?? 0;
    const { time, grid } = this.state.values;
    const big = event.shiftKey ? DAY : HOUR;
    /** @type {Record<string, () => void>} */
    const actions = {
      " ": () => this.play(!this.state.values.playing),
      ",": () => this.step(-interval, event.repeat),
      ".": () => this.step(interval, event.repeat),
      ArrowLeft: () => this.step(-big, event.repeat),
      ArrowRight: () => this.step(big, event.repeat),
      Home: () => this.go(grid?.span?.first ?? 0),
      End: () => this.go(grid?.span?.stop ?? 0),
      "+": () => zoom(this.state, 0.5, time ?? 0),
      "-": () => zoom(this.state, 2, time ?? 0),
      PageUp: () => pan(this.state, -0.5),
      PageDown: () => pan(this.state, 0.5),
      "[": () => this.loopFrom("begin"),
      "]": () => this.loopFrom("end"),
      "\\": () => this.toggleLoop(),
      "<": () => this.speed(-1),
      ">": () => this.speed(1),
      l: () => this.live(),
      p: () => this.anomaly(-1),
      n: () => this.anomaly(1),
      t: () => $("typed").focus(),
      1: () => this.aim("slanted"),
      2: () => this.aim("above"),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action || !grid) return false;
    action();
    return true;
  }
}

/** @param {ViewState} view */
function reachOf(view) {
  if (view.reach) return view.reach;
  const [low, high] = windowOf(view);
  return view.grid?.span && low === view.grid.span.first && high >= view.grid.span.stop ? "all" : "week";
}

/**
 * @param {State<ViewState>} state
 * @param {(view: "slanted" | "above") => void} aim
 */
export function mount(state, aim) {
  const transport = new Transport(state, aim);
  $("play").addEventListener("click", () => transport.play(!state.values.playing));
  $("live").addEventListener("click", () => transport.live());
  $("previous").addEventListener("click", () => transport.anomaly(-1));
  $("next").addEventListener("click", () => transport.anomaly(1));
  $("time").addEventListener("pointerdown", () => transport.play(false));
  for (const button of all("[data-step]")) button.addEventListener("click", () => transport.step(Number(button.dataset.step)));
  for (const button of all("[data-reach]")) {
    button.addEventListener("click", () => state.change({ reach: /** @type {any} */ (button.dataset.reach), span: null }));
  }
  $("loop").addEventListener("click", () => transport.toggleLoop());
  $("speed").replaceChildren(...SPEEDS.map(([value, text]) => new Option(text, value, value === "3600", value === "3600")));
  $("typed").title = EXAMPLES;
  $("typed-form").addEventListener("submit", (event) => {
    event.preventDefault();
    transport.typed($("typed").value);
    $("typed").select();
  });
  return transport;
}
