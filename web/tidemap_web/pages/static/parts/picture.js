// A picture of what is shown, to be taken along: above it what and when, below it the legend and the scale.

/** @typedef {{ title: string, swatches: { colour: string, text: string }[], ramp: { colours: string[], texts: string[] } | null }} Legend */
/** @typedef {{ paper: string, ground: string, ink: string, quiet: string }} Palette `ground` is behind what is drawn */
/**
 * @typedef {object} Caption
 * @property {string} title
 * @property {string} when
 * @property {string} detail
 * @property {Legend[]} legends
 * @property {{ metres: number, pixels: number } | null} scale in CSS pixels
 * @property {string} foot
 */

const PAD = 14;
const LINE = 22;
const HEAD = 62;
const SWATCH = 12;
const RAMP = 180;
const FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif';

/**
 * @param {HTMLCanvasElement} source is drawn as large as it fits
 * @param {{ width: number, height: number, ratio: number }} box for it in CSS pixels, and device pixels in one
 * @param {Caption} caption
 * @param {Palette} palette
 * @returns {HTMLCanvasElement} not transparent
 */
export function picture(source, { width, height, ratio }, caption, palette) {
  const canvas = document.createElement("canvas");
  const ruler = pen(canvas);
  const rows = rowsOf(ruler, caption.legends, width - 2 * PAD);
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round((HEAD + height + 2 * PAD + LINE * (rows.length + 1)) * ratio);
  const ctx = pen(canvas);
  ctx.scale(ratio, ratio);
  ctx.fillStyle = palette.paper;
  ctx.fillRect(0, 0, width, canvas.height / ratio);
  drawHead(ctx, caption, width, palette);
  ctx.fillStyle = palette.ground;
  ctx.fillRect(0, HEAD, width, height);
  const fit = Math.min(width / source.width, height / source.height);
  const [wide, high] = [fit * source.width, fit * source.height];
  ctx.drawImage(source, (width - wide) / 2, HEAD + (height - high) / 2, wide, high);
  rows.forEach((row, i) => drawRow(ctx, row, HEAD + height + PAD + (i + 0.5) * LINE, palette));
  drawFoot(ctx, caption, width, HEAD + height + PAD + (rows.length + 0.5) * LINE, palette);
  return canvas;
}

/**
 * @param {HTMLCanvasElement} canvas
 * @returns {CanvasRenderingContext2D}
 */
function pen(canvas) {
  const ctx = canvas.getContext("2d", { alpha: false });
  if (!ctx) throw new Error("This browser draws no pictures.");
  return ctx;
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Caption} caption
 * @param {number} width
 * @param {Palette} palette
 */
function drawHead(ctx, { title, when, detail }, width, { ink, quiet }) {
  ctx.textBaseline = "middle";
  ctx.fillStyle = ink;
  ctx.font = `650 18px ${FONT}`;
  ctx.textAlign = "left";
  ctx.fillText(title, PAD, 22);
  ctx.textAlign = "right";
  ctx.fillText(when, width - PAD, 22);
  ctx.fillStyle = quiet;
  ctx.font = `13px ${FONT}`;
  ctx.fillText(detail, width - PAD, 45);
}

/** @typedef {{ x: number, legend: Legend }} Item */

/**
 * The legends in rows, each as many as fit.
 * @param {CanvasRenderingContext2D} ctx
 * @param {Legend[]} legends
 * @param {number} width
 * @returns {Item[][]}
 */
function rowsOf(ctx, legends, width) {
  /** @type {Item[][]} */
  const rows = [];
  let used = Infinity;
  for (const legend of legends) {
    const needed = widthOf(ctx, legend);
    if (used + needed > width) {
      rows.push([]);
      used = 0;
    }
    rows[rows.length - 1].push({ x: PAD + used, legend });
    used += needed + 2 * PAD;
  }
  return rows;
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Legend} legend
 */
function widthOf(ctx, { title, swatches, ramp }) {
  ctx.font = `13px ${FONT}`;
  const texts = swatches.reduce((sum, { text }) => sum + SWATCH + 6 + ctx.measureText(text).width + PAD, 0);
  return ctx.measureText(title).width + PAD + texts + (ramp ? RAMP + 2 * PAD + rampTexts(ctx, ramp.texts) : 0);
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {string[]} texts
 */
const rampTexts = (ctx, texts) => ctx.measureText(`${texts[0]} ${texts.at(-1)}`).width;

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Item[]} row
 * @param {number} y
 * @param {Palette} palette
 */
function drawRow(ctx, row, y, { ink, quiet }) {
  ctx.font = `13px ${FONT}`;
  ctx.textAlign = "left";
  for (const { x, legend } of row) {
    ctx.fillStyle = ink;
    ctx.fillText(legend.title, x, y);
    let at = x + ctx.measureText(legend.title).width + PAD;
    if (legend.ramp) at = drawRamp(ctx, legend.ramp, at, y, quiet);
    for (const { colour, text } of legend.swatches) {
      ctx.fillStyle = colour;
      ctx.fillRect(at, y - SWATCH / 2, SWATCH, SWATCH);
      ctx.fillStyle = quiet;
      ctx.fillText(text, at + SWATCH + 6, y);
      at += SWATCH + 6 + ctx.measureText(text).width + PAD;
    }
  }
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {{ colours: string[], texts: string[] }} ramp
 * @param {number} x
 * @param {number} y
 * @param {string} quiet
 * @returns {number} where it ends
 */
function drawRamp(ctx, { colours, texts }, x, y, quiet) {
  const [low, high] = [texts[0] ?? "", texts.at(-1) ?? ""];
  ctx.fillStyle = quiet;
  ctx.fillText(low, x, y);
  const left = x + ctx.measureText(low).width + 6;
  const gradient = ctx.createLinearGradient(left, 0, left + RAMP, 0);
  colours.forEach((colour, i) => gradient.addColorStop(i / Math.max(1, colours.length - 1), colour));
  ctx.fillStyle = gradient;
  ctx.fillRect(left, y - SWATCH / 2, RAMP, SWATCH);
  ctx.fillStyle = quiet;
  ctx.fillText(high, left + RAMP + 6, y);
  return left + RAMP + 6 + ctx.measureText(high).width + PAD;
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {Caption} caption
 * @param {number} width
 * @param {number} y
 * @param {Palette} palette
 */
function drawFoot(ctx, { scale, foot }, width, y, { ink, quiet }) {
  ctx.font = `13px ${FONT}`;
  ctx.textAlign = "right";
  ctx.fillStyle = quiet;
  ctx.fillText(foot, width - PAD, y);
  if (!scale) return;
  ctx.fillStyle = ink;
  ctx.fillRect(PAD, y - 1, scale.pixels, 2);
  for (const end of [0, scale.pixels]) ctx.fillRect(PAD + end - 1, y - 5, 2, 10);
  ctx.textAlign = "left";
  ctx.fillText(`${scale.metres} m at the middle of the view`, PAD + scale.pixels + 8, y);
}
