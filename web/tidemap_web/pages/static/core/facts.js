// Facts of a cell, or of a door or a room, in words.

import { durationText } from "./words.js";
/** @import { CellFacts, MarkerFacts } from "../../../../types.d.ts" */

/** @typedef {Pick<CellFacts, "probability" | "verdict" | "observed" | "observed_time">} Facts */

/** @param {Facts} facts */
export const probabilityText = ({ probability, verdict }) => (probability === null ? "–" : `${probability.toFixed(3)}, ${verdict}`);

/**
 * @param {Facts} facts
 * @param {number} time that is shown
 */
export function lastSeenText({ observed, observed_time }, time) {
  const seen = observed === null ? "never by then" : observed ? "occupied" : "free";
  return `${seen}, ${observed_time === null ? "–" : `${durationText(time - observed_time)} before`}`;
}

/**
 * @param {Facts} facts
 * @param {number} time
 */
function bothText(facts, time) {
  const predicted = facts.probability === null ? "no model yet" : `probability ${facts.probability.toFixed(2)}, ${facts.verdict}`;
  const seen = facts.observed === null ? "never seen by then" : `last seen ${lastSeenText(facts, time)}`;
  return `${predicted} · ${seen}`;
}

/**
 * @param {CellFacts} cell
 * @param {number} time
 */
export const cellText = (cell, time) => `[${cell.index.join(", ")}] · ${bothText(cell, time)}`;

/**
 * @param {MarkerFacts} marker
 * @param {number} time
 */
export const markerText = (marker, time) => `${marker.name} · ${bothText(marker, time)}`;
