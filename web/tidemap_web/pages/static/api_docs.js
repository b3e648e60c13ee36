// The documentation of the API: what a link leads to is opened, and every operation can be tried.

import { byId, reason } from "./dom.js";

const SHOWN = 20_000;

/** What is linked to is within an element that has to be opened. */
function openLinked() {
  const linked = document.getElementById(decodeURIComponent(window.location.hash.slice(1)));
  if (linked instanceof HTMLDetailsElement) linked.open = true;
}
window.addEventListener("hashchange", openLinked);
openLinked();

byId("main").addEventListener("submit", async (event) => {
  const form = event.target;
  if (!(form instanceof HTMLFormElement) || !form.dataset.path) return;
  event.preventDefault();
  const said = form.querySelector("output");
  if (!said) return;
  const { address, options } = requestOf(form);
  said.textContent = "…";
  try {
    said.replaceChildren(...shown(address, options, await answerOf(await fetch(address, options))));
  } catch (error) {
    said.textContent = reason(error);
  }
});

/**
 * The request that a form is for: empty fields are left out.
 * @param {HTMLFormElement} form
 * @returns {{ address: string, options: { method: string, headers: Record<string, string>, body?: string } }}
 */
function requestOf(form) {
  let path = form.dataset.path ?? "";
  const query = new URLSearchParams();
  /** @type {Record<string, string>} */
  const headers = { Accept: "application/json" };
  for (const field of form.querySelectorAll("input")) {
    if (field.dataset.in === "path") path = path.replace(`{${field.name}}`, encodeURIComponent(field.value));
    else if (field.value && field.dataset.in === "query") query.set(field.name, field.value);
    else if (field.value) headers[field.name] = field.value;
  }
  const key = /** @type {HTMLInputElement} */ (document.getElementById("with-key")).value.trim();
  if (key) headers.Authorization = `Bearer ${key}`;
  const body = form.querySelector("textarea")?.value;
  if (body) headers["Content-Type"] = "application/json";
  const address = path + (query.size ? `?${query}` : "");
  return { address, options: { method: form.dataset.method ?? "GET", headers, ...(body ? { body } : {}) } };
}

/**
 * An answer in words; a stream without end is not waited for.
 * @param {Response} answer
 */
async function answerOf(answer) {
  const head = `${answer.status} ${answer.statusText}`;
  const type = answer.headers.get("content-type") ?? "";
  if (type.startsWith("text/event-stream")) {
    answer.body?.cancel();
    return `${head}\na stream of events, ${type}`;
  }
  if (!/json|text/.test(type)) return `${head}\n${(await answer.blob()).size} bytes, ${type}`;
  const text = await answer.text();
  const whole = type.includes("json") ? JSON.stringify(JSON.parse(text), null, 2) : text;
  return `${head}\n${whole.length > SHOWN ? `${whole.slice(0, SHOWN)}\n… ${whole.length} characters in all` : whole}`;
}

/**
 * The same for a shell, without the key, and what came.
 * @param {string} address
 * @param {{ method: string, headers: Record<string, string>, body?: string }} options
 * @param {string} text
 */
function shown(address, { method, headers, body }, text) {
  const quoted = (/** @type {string} */ value) => `'${value.replaceAll("'", "'\\''")}'`;
  const sent = Object.entries({ ...headers, ...(headers.Authorization ? { Authorization: "Bearer tm_…" } : {}) });
  const parts = [`curl -X ${method} ${quoted(window.location.origin + address)}`, ...sent.map(([name, value]) => `-H ${quoted(`${name}: ${value}`)}`)];
  return [parts.concat(body ? `-d ${quoted(body)}` : []).join(" \\\n  "), text].map((lines, i) => {
    const made = Object.assign(document.createElement("pre"), { textContent: lines, tabIndex: 0 });
    made.setAttribute("aria-label", i ? "Answer" : "Request");
    return made;
  });
}
