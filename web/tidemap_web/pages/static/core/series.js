// The question for the series of a cell, with no more points than are of use.

/**
 * Over a stretch of time by whole samples, from a multiple of its step on, so that it stays the same as time goes on.
 * @param {{ path: string, cell: number | null, interval: number }} of
 * @param {[number, number]} stretch
 * @param {number} most
 * @returns {{ question: string, step: number }}
 */
export function seriesQuestion({ path, cell, interval }, [low, high], most) {
  const step = Math.max(1, Math.ceil((high - low) / interval / most)) * interval;
  const start = Math.floor(low / step) * step;
  return { question: `${path}/series?cell=${cell}&start=${start}&stop=${high}&step=${step}`, step };
}
