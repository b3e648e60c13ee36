// Questions to the server's HTTP API; errors carry the problem's own words.

/**
 * @param {string} path
 * @param {RequestInit} options
 * @returns {Promise<any>}
 */
export async function ask(path, options = {}) {
  const answer = await fetch(`/api/v1${path}`, { headers: { Accept: "application/json" }, ...options });
  if (answer.status === 401) {
    window.location.assign(`/login?next=${encodeURIComponent(window.location.pathname + window.location.search)}`);
  }
  if (answer.ok) return answer.json();
  let problem = { status: answer.status, detail: `The server answered ${answer.status}.` };
  try {
    problem = { ...problem, ...(await answer.json()) };
  } catch {
    // not JSON: the status has to do
  }
  throw Object.assign(new Error(problem.detail), { problem });
}

/**
 * @param {string} path
 * @param {object} body
 */
export function post(path, body) {
  const headers = { Accept: "application/json", "Content-Type": "application/json" };
  return ask(path, { method: "POST", headers, body: JSON.stringify(body) });
}
