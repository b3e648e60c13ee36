// The colours of the pages, as the style sheet has them in this scheme.

const NAMES = ["ink", "quiet", "line", "grid", "predicted", "occupied", "free", "uncertain", "anomaly", "future", "seen", "loop", "paper", "raised", "accent"];

/** @returns {Record<string, string>} */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

/**
 * What a probability says at a confidence: 1 occupied, 0 free, 2 uncertain; null where there is none.
 * @param {number | null} probability
 * @param {number} confidence
 */
export function verdictOf(probability, confidence) {
  if (probability === null) return null;
  if (probability > confidence) return 1;
  return probability < 1 - confidence ? 0 : 2;
}
