// The timeline: history and future, ticks in local time, marks of anomalies, and a slider over all of it.

import { clockText, dayText, offsetOf } from "./core/words.js";
/** @import { GridMessage } from "../../../types.d.ts" */

const DAY = 86400;
const THUMB = 12;
const STEPS = [900, 3600, 7200, 10800, 21600, 43200, DAY, 2 * DAY, 7 * DAY, 14 * DAY, 28 * DAY, 84 * DAY];
const MONDAY = 4 * DAY;

export class Timeline {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLInputElement} slider
   * @param {(time: number) => void} moved
   */
  constructor(canvas, slider, moved) {
    this.canvas = canvas;
    this.slider = slider;
    this.reach = "all";
    /** @type {GridMessage | null} */
    this.location = null;
    this.time = 0;
    slider.addEventListener("input", () => moved(Number(slider.value)));
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  /** @param {GridMessage} location */
  setLocation(location) {
    const first = this.location?.name !== location.name;
    this.location = location;
    if (first && location.span) this.reach = location.span.stop - location.span.first > 15 * DAY ? "week" : "all";
    this.slider.disabled = !location.span;
    this.show(this.time);
  }

  /** @param {string | undefined} reach */
  setReach(reach) {
    this.reach = reach ?? "all";
    this.show(this.time);
  }

  /**
   * What the timeline covers: all, or the local day or week that holds the time; nothing without a location.
   * @returns {[number, number]}
   */
  window() {
    if (!this.location?.span) return [0, 0];
    const { first, stop } = this.location.span;
    if (this.reach === "all") return [first, stop];
    const zone = this.location.time_zone;
    const length = this.reach === "day" ? DAY : 7 * DAY;
    const anchor = this.reach === "day" ? 0 : MONDAY;
    const local = this.time + offsetOf(this.time, zone);
    const start = Math.floor((local - anchor) / length) * length + anchor;
    const begin = start - offsetOf(start - offsetOf(this.time, zone), zone);
    return [begin, begin + length];
  }

  /** @param {number} time */
  clamp(time) {
    if (!this.location?.span) return time;
    const { first, stop } = this.location.span;
    return Math.min(stop, Math.max(first, time));
  }

  /** @param {number} time */
  show(time) {
    this.time = time;
    if (!this.location?.span) return this.draw();
    const [low, high] = this.window();
    this.slider.min = String(Math.floor(low));
    this.slider.max = String(Math.ceil(high));
    this.slider.step = "1";
    this.slider.value = String(Math.round(time));
    const zone = this.location.time_zone;
    this.slider.setAttribute("aria-valuetext", `${dayText(time, zone)}, ${clockText(time, zone)}`);
    this.draw();
  }

  draw() {
    const { canvas } = this;
    const ratio = devicePixelRatio;
    const width = canvas.clientWidth;
    const height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const ctx = canvas.getContext("2d");
    if (!ctx || !this.location?.span || width === 0) return;
    ctx.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    /** @param {string} name */
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    const [low, high] = this.window();
    /** @param {number} time */
    const x = (time) => THUMB / 2 + ((time - low) / (high - low)) * (width - THUMB);
    /** @param {number} value */
    const clip = (value) => Math.min(width - THUMB / 2, Math.max(THUMB / 2, value));
    /**
     * @param {number} from
     * @param {number} to
     * @param {string} fill
     */
    const band = (from, to, fill, top = 14, size = 12) => {
      const left = clip(x(from));
      const right = clip(x(to));
      if (right <= left) return;
      ctx.fillStyle = fill;
      ctx.fillRect(left, top, right - left, size);
    };
    const { first, last, stop } = this.location.span;
    band(low, high, colour("raised"));
    band(last, stop, colour("grid"));
    band(first, last, colour("free"));
    this.drawTicks(ctx, low, high, x, colour, width);
    for (const event of this.location.events) {
      ctx.fillStyle = event.acknowledged ? colour("quiet") : colour("anomaly");
      const left = x(event.start);
      const size = Math.max(2, x(event.stop) - left);
      if (left + size < THUMB / 2 || left > width - THUMB / 2) continue;
      ctx.fillRect(left, 14, size, 12);
      const middle = left + size / 2;
      ctx.beginPath();
      ctx.moveTo(middle - 4, 0);
      ctx.lineTo(middle + 4, 0);
      ctx.lineTo(middle, 7);
      ctx.fill();
    }
    ctx.fillStyle = colour("ink");
    if (last >= low && last <= high) ctx.fillRect(x(last) - 0.75, 10, 1.5, 20);
  }

  /**
   * @param {CanvasRenderingContext2D} ctx
   * @param {number} low
   * @param {number} high
   * @param {(time: number) => number} x
   * @param {(name: string) => string} colour
   * @param {number} width
   */
  drawTicks(ctx, low, high, x, colour, width) {
    const zone = this.location?.time_zone ?? "UTC";
    const step = STEPS.find((s) => (high - low) / s <= Math.max(2, width / 92)) ?? 168 * DAY;
    ctx.font = "11px system-ui, sans-serif";
    ctx.textAlign = "center";
    ctx.textBaseline = "top";
    const offset = offsetOf(low, zone);
    for (let local = Math.ceil((low + offset - MONDAY) / step) * step + MONDAY; ; local += step) {
      let time = local - offset;
      time = local - offsetOf(time, zone);
      if (time > high) return;
      const at = x(time);
      ctx.fillStyle = colour("line");
      ctx.fillRect(at, 26, 1, 6);
      const clock = clockText(time, zone, false);
      const day = clock === "00:00";
      ctx.fillStyle = colour(day || step >= DAY ? "ink" : "quiet");
      const label = day || step >= DAY ? dayText(time, zone) : clock;
      const half = ctx.measureText(label).width / 2;
      if (at - half >= 0 && at + half <= width) ctx.fillText(label, at, 36);
    }
  }
}
