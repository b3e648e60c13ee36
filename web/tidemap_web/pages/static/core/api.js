// Questions to the server's HTTP API; errors carry the problem's own words.

/** Go to the sign-in page, and from there back to this one: to the whole of it, where this is a frame in a page. */
export function signIn() {
  const { location } = window.top ?? window;
  location.assign(`/login?next=${encodeURIComponent(location.pathname + location.search)}`);
}

/**
 * @param {string} path
 * @param {RequestInit} options
 * @returns {Promise<any>}
 */
export async function ask(path, options = {}) {
  const answer = await answered(path, options);
  return answer.status === 204 ? null : answer.json();
}

/**
 * A file, with the name that the server gives it.
 * @param {string} path
 * @param {string} mediaType
 * @returns {Promise<{ content: Blob, name: string }>}
 */
export async function askFile(path, mediaType) {
  const answer = await answered(path, { headers: { Accept: mediaType } });
  const name = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition") ?? "")?.[1] ?? "tidemap";
  return { content: await answer.blob(), name };
}

/**
 * An answer that is no problem.
 * @param {string} path
 * @param {RequestInit} options
 */
async function answered(path, options) {
  const answer = await fetched(path, options);
  if (answer.status === 401) signIn();
  if (answer.ok) return answer;
  let problem = { status: answer.status, detail: `The server answered ${answer.status}.` };
  try {
    problem = { ...problem, ...(await answer.json()) };
  } catch {
    // not JSON: the status has to do
  }
  throw Object.assign(new Error(said(problem)), { problem });
}

/**
 * @param {string} path
 * @param {RequestInit} options
 */
async function fetched(path, options) {
  try {
    return await fetch(`/api/v1${path}`, { headers: { Accept: "application/json" }, ...options });
  } catch (error) {
    throw new Error("The server did not answer. This is tried again as soon as it does.", { cause: error });
  }
}

/**
 * What is wrong, field by field where the problem names them.
 * @param {{ detail: string, errors?: { field: string, message: string }[] }} problem
 */
const said = ({ detail, errors }) => errors?.map(({ field, message }) => `${field}: ${message}`).join("; ") ?? detail;

/**
 * @param {string} path
 * @param {object} body
 * @param {"POST" | "PATCH"} method
 */
export function post(path, body, method = "POST") {
  const headers = { Accept: "application/json", "Content-Type": "application/json" };
  return ask(path, { method, headers, body: JSON.stringify(body) });
}
