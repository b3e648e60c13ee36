// The legend that a page shows, as a picture needs it.

import { all } from "../dom.js";
/** @import { Legend } from "./picture.js" */

/**
 * The legends that are visible among those that a selector finds.
 * @param {string} selector
 * @returns {Legend[]}
 */
export function legendsOf(selector) {
  return all(selector).filter(isShown).map((key) => ({
    title: titleOf(key),
    swatches: swatchesOf(key),
    ramp: rampOf(key),
  }));
}

/** @param {HTMLElement} element */
const isShown = (element) => element.checkVisibility();

/**
 * The first line, without what is hidden.
 * @param {HTMLElement} key
 */
function titleOf(key) {
  const line = key.firstElementChild;
  return line instanceof HTMLElement && !line.querySelector("i") ? oneLine(line.innerText) : "";
}

/** @param {string} text */
const oneLine = (text) => text.replaceAll(/\s+/g, " ").trim();

/**
 * Colours with the words beside them.
 * @param {HTMLElement} key
 */
function swatchesOf(key) {
  return [...key.querySelectorAll("i")].flatMap((mark) => {
    const item = mark.parentElement;
    if (!item || !isShown(item) || item.matches(".bar-fill")) return [];
    return [{ colour: colourOf(mark), text: wordsOf(item) }];
  });
}

/**
 * Without the counts of the moment, with which a legend would grow and shrink in a film.
 * @param {HTMLElement} item
 */
function wordsOf(item) {
  const counts = new Set([...item.querySelectorAll("output")].flatMap((each) => [...each.childNodes]));
  const texts = document.createTreeWalker(item, NodeFilter.SHOW_TEXT);
  const words = [];
  while (texts.nextNode()) if (!counts.has(/** @type {ChildNode} */ (texts.currentNode))) words.push(texts.currentNode.nodeValue);
  return oneLine(words.join(""));
}

/** @param {HTMLElement} mark */
function colourOf(mark) {
  const { backgroundColor, backgroundImage, borderTopColor } = getComputedStyle(mark);
  return mark.matches(".line, .dash") ? borderTopColor : (coloursIn(backgroundImage).at(-1) ?? backgroundColor);
}

/**
 * @param {HTMLElement} key
 * @returns {Legend["ramp"]}
 */
function rampOf(key) {
  const ramp = [...key.querySelectorAll(".ramp")].find((each) => each instanceof HTMLElement && isShown(each));
  const bar = ramp?.querySelector(".bar-fill");
  if (!ramp || !bar) return null;
  const texts = [...ramp.querySelectorAll(".ticks span")].map((each) => oneLine(each.textContent ?? ""));
  return { colours: coloursIn(getComputedStyle(bar).backgroundImage), texts };
}

/** @param {string} gradient as a browser computes it */
const coloursIn = (gradient) => gradient.match(/rgba?\([^)]*\)/g) ?? [];
