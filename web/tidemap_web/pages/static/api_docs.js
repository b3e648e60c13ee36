// The interactive documentation of the API. Where its HTML keeps some people out, it is put right as it comes.

import { byId } from "./dom.js";

/* global SwaggerUIBundle */
const host = byId("api");

/** Headings of tags and schemas are the second level, below the API's name, which is in a landmark then. */
function amend() {
  for (const heading of host.querySelectorAll(":is(h3.opblock-tag, .models h4):not([aria-level])")) heading.setAttribute("aria-level", "2");
  for (const about of host.querySelectorAll(".information-container:not([role])")) {
    about.setAttribute("role", "region");
    about.setAttribute("aria-label", "About the API");
  }
}

new MutationObserver(amend).observe(host, { childList: true, subtree: true });
SwaggerUIBundle({
  url: host.dataset.openapi,
  dom_id: "#api",
  // Links to operations would stand within the buttons that open these.
  deepLinking: false,
  presets: [SwaggerUIBundle.presets.apis, SwaggerUIBundle.SwaggerUIStandalonePreset],
});
