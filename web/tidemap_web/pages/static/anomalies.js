// The anomalies of all locations.

import { Live } from "./core/live.js";
import * as anomalies from "./parts/anomalies.js";
import * as connection from "./parts/connection.js";
import { byId } from "./dom.js";

const live = new Live("?kind=anomaly,location,attention");
connection.mount(byId("connection"), live);
anomalies.mount(byId("anomalies"), live);
