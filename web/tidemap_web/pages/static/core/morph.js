// Bring what is on a page up to date with what the server sent: what is the same stays, with focus and selection.

/**
 * Make the children of `old` those of `fresh`. Elements are the same where their ids are, else where they stand.
 * @param {Element} old
 * @param {Element | DocumentFragment} fresh
 */
export function morph(old, fresh) {
  const focused = document.activeElement;
  arrange(old, fresh);
  // What is moved loses the focus.
  if (focused instanceof HTMLElement && focused.isConnected) focused.focus({ preventScroll: true });
}

/**
 * @param {Element} old
 * @param {Element | DocumentFragment} fresh
 */
function arrange(old, fresh) {
  const known = new Map([...old.children].filter((child) => child.id).map((child) => [child.id, child]));
  /** @type {ChildNode | null} */
  let at = old.firstChild;
  for (const wanted of Array.from(fresh.childNodes)) {
    const found = same(known, at, wanted);
    if (!found) {
      old.insertBefore(wanted, at);
      continue;
    }
    if (found === at) at = at.nextSibling;
    else old.insertBefore(found, at);
    update(found, wanted);
  }
  while (at) {
    const next = at.nextSibling;
    at.remove();
    at = next;
  }
}

/**
 * The node on the page that a wanted one is another version of.
 * @param {Map<string, Element>} known
 * @param {ChildNode | null} at
 * @param {ChildNode} wanted
 */
function same(known, at, wanted) {
  if (wanted instanceof Element && wanted.id) return known.get(wanted.id);
  const anonymous = at !== null && !(at instanceof Element && at.id);
  return anonymous && at.nodeName === wanted.nodeName ? at : undefined;
}

/**
 * @param {ChildNode} old
 * @param {ChildNode} wanted
 */
function update(old, wanted) {
  if (old.isEqualNode(wanted)) return;
  if (!(old instanceof Element) || !(wanted instanceof Element)) {
    old.nodeValue = wanted.nodeValue;
    return;
  }
  for (const { name } of Array.from(old.attributes)) if (!wanted.hasAttribute(name)) old.removeAttribute(name);
  for (const { name, value } of wanted.attributes) if (old.getAttribute(name) !== value) old.setAttribute(name, value);
  arrange(old, wanted);
}
