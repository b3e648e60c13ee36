// What a page has: its elements by id and by selector, and the words of an error.

/**
 * An element that the page's template has.
 * @type {<Id extends string>(id: Id) => Id extends keyof import("../../../types.d.ts").Controls ? import("../../../types.d.ts").Controls[Id] : HTMLElement}
 */
export const byId = (id) => /** @type {any} */ (document.getElementById(id));

/**
 * All elements that a selector finds.
 * @param {string} selector
 * @returns {HTMLElement[]}
 */
export const all = (selector) => [...document.querySelectorAll(selector)].filter((found) => found instanceof HTMLElement);

/**
 * The element that was meant by an event: its target, or what that is in.
 * @param {Event} event
 * @param {string} selector
 */
export function closest(event, selector) {
  const found = event.target instanceof Element ? event.target.closest(selector) : null;
  return found instanceof HTMLElement ? found : null;
}

/**
 * What went wrong.
 * @param {unknown} error
 */
export const reason = (error) => (error instanceof Error ? error.message : String(error));
