// The list of locations: rows follow what happens.

import { Live } from "./core/live.js";
import * as connection from "./parts/connection.js";
import * as fragment from "./parts/fragment.js";
import { byId } from "./dom.js";

const live = new Live();
connection.mount(byId("connection"), live);

/** Whether something of this location is on this page. */
const isShown = (/** @type {string} */ name) => document.getElementById(`at-${name}`) !== null;
fragment.mount("locations", live, (message) => message.kind === "location" || isShown(message.location));
