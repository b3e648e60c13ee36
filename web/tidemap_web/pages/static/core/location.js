// What a location's page shows: the location as it is now, and the cell that is chosen. Parts of the page subscribe.

/** @typedef {"cell" | "first" | "last" | "revision"} Fact */

export class LocationState {
  /** @param {DOMStringMap} facts of the page's element that names the location */
  constructor(facts) {
    this.name = facts.location ?? "";
    this.zone = facts.zone ?? "UTC";
    this.isGrid = facts.kind !== "state";
    this.interval = Number(facts.interval);
    this.confidence = Number(facts.confidence);
    this.revision = Number(facts.revision);
    this.first = numberOf(facts.first);
    this.last = numberOf(facts.last);
    /** @type {number | null} */
    this.cell = this.isGrid ? null : 0;
    this.path = `/locations/${encodeURIComponent(this.name)}`;
    /** @type {Set<(changed: Set<Fact>) => void>} */
    this.subscribers = new Set();
  }

  /**
   * Call `report` with the names of what has changed.
   * @param {(changed: Set<Fact>) => void} report
   */
  subscribe(report) {
    this.subscribers.add(report);
  }

  /** @param {Partial<Record<Fact, number | null>>} values */
  change(values) {
    const names = /** @type {Fact[]} */ (Object.keys(values));
    const changed = new Set(names.filter((name) => this[name] !== values[name]));
    if (!changed.size) return;
    Object.assign(this, values);
    for (const report of this.subscribers) report(changed);
  }
}

/**
 * A number of a page's data, null where it is left empty.
 * @param {string | undefined} text
 */
export const numberOf = (text) => (text === undefined || text === "" ? null : Number(text));
