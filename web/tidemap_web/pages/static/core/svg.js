// Small drawings.

const SVG = "http://www.w3.org/2000/svg";

/**
 * An element of a drawing, with what is in it.
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 * @param {(Node | string)[]} children
 * @returns {SVGElement}
 */
export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  made.append(...children);
  return made;
}

/**
 * A scale from [low, high] to [start, stop].
 * @param {number} low
 * @param {number} high
 * @param {number} start
 * @param {number} stop
 * @returns {(value: number) => number}
 */
export const scale = (low, high, start, stop) => (value) => start + ((value - low) / (high - low || 1)) * (stop - start);
