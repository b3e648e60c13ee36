// The server's clock, as far as the page knows it: ages are counted by it, however wrong the browser's own is.

let ahead = 0;

/** Unix seconds by the server's clock. */
export const now = () => Date.now() / 1000 + ahead;

/**
 * What the server's clock says at this moment.
 * @param {number} time
 */
export function setClock(time) {
  ahead = time - Date.now() / 1000;
}
