// What the scripts of the pages handle: messages of the viewer's session, answers of the API, and two vendored scripts.

/** The stretch of a location's timeline in Unix seconds: history from `first` to `last`, forecast to `stop`. */
export interface Span {
  first: number;
  last: number;
  stop: number;
}

/** An anomaly on a timeline. */
export interface Mark {
  start: number;
  stop: number;
  observed?: number;
  acknowledged?: boolean;
}

/** The chosen grid, as the viewer's session describes it. */
export interface GridMessage {
  name: string;
  time_zone: string;
  interval_s: number;
  confidence: number;
  first_update: number;
  shape: number[];
  frame: string;
  resolution_m: number;
  origin_m: number[];
  span: Span | null;
}

/** The facts of the selected cell. */
export interface CellFacts {
  cell: number;
  index: number[];
  position_m: number[];
  probability: number | null;
  verdict: "free" | "occupied" | "uncertain" | null;
  observed: number | null;
  observed_time: number | null;
}

/** A door or a room in the scene of its building. */
export interface MarkerFacts {
  name: string;
  probability: number | null;
  verdict: "free" | "occupied" | "uncertain" | null;
  observed: number | null;
  observed_time: number | null;
  /** In the left grid and in the right one, as CSS. */
  colors: [string, string];
}

/** What is under the pointer. */
export interface HoverMessage {
  at: [number, number];
  cell: CellFacts | null;
  marker: MarkerFacts | null;
}

/** A message of the stream of events. */
export interface LiveMessage {
  kind: "observation" | "anomaly" | "update" | "job" | "location" | "attention";
  location: string;
  id: number;
  time: string;
  change?: "created" | "changed" | "deleted" | "acknowledged" | "snoozed" | "muted" | "unmuted";
  called?: string | null;
}

/** What is on the screen. */
export interface FrameMessage {
  time: number;
  live: boolean;
  drawn: boolean;
  loading: boolean;
  confidence: number;
  revision: number;
  estimator: string;
  order: number;
  fresh_s: number;
  lines_m: number;
  cells: number;
  predicted: number;
  observed: number;
  unexpected: number;
  missing: number;
  stale: number;
  /** Sensors whose way is shown. */
  sensors: number;
  selected: CellFacts | null;
}

/** Why there is nothing to show. */
export interface NoticeMessage {
  reason: string;
  detail: string;
}

/** What the page does with each kind of message. */
export interface Handlers {
  grids(message: { items: { name: string; kind: string }[] }): void;
  location(message: GridMessage): void;
  events(message: { items: Mark[] }): void;
  frame(message: FrameMessage): void;
  progress(message: { what: string; done: number | null }): void;
  camera(message: { pose: number[] | null }): void;
  picked(message: { cell: number | null; marker: string | null }): void;
  hovered(message: HoverMessage): void;
  markers(message: { items: MarkerFacts[] }): void;
  refused(message: { detail: string }): void;
  notice(message: NoticeMessage): void;
}

/** What the viewer shows: what is chosen, what the server has said of it, and what the page does. */
export interface ViewState {
  location: string | null;
  time: number | null;
  live: boolean;
  confidence: number | null;
  order: number | null;
  floor: number;
  dim: boolean;
  /** Heights that are shown, in grid steps. */
  low: number | null;
  high: number | null;
  /** First and last cells that are shown along x, and along y. */
  crop: number[] | null;
  layout: "beside" | "overlay" | "difference";
  predicted: "probability" | "verdict" | "entropy" | "day";
  observed: "seen" | "age";
  cell: number | null;
  markers: MarkerFacts[];
  /** The door or room that was clicked in the scene. */
  marker: string | null;
  /** Position and what it looks at, in metres, and how wide it sees; null: as the server aims it. */
  camera: number[] | null;
  zone: "location" | "mine" | "UTC";
  reach: "day" | "week" | "all" | null;
  /** What the timeline was zoomed to. */
  span: [number, number] | null;
  /** What playing goes round in. */
  loop: [number, number] | null;
  grid: GridMessage | null;
  frame: FrameMessage | null;
  events: Mark[];
  playing: boolean;
}

/** What a location's page shows: the location as it is now, and what is chosen of it. */
export interface LocationView extends Shared {
  name: string;
  isGrid: boolean;
  path: string;
  zone: string;
  interval: number;
  confidence: number;
  revision: number;
  first: number | null;
  last: number | null;
}

/** What a location's page and the viewer in it show both; `time` is null where it is that of the newest observation. */
export interface Shared {
  cell: number | null;
  time: number | null;
  span: [number, number] | null;
}

/** The elements of the pages that are no plain ones, by id. */
export interface Controls {
  time: HTMLInputElement;
  scene: HTMLIFrameElement;
  location: HTMLSelectElement;
  confidence: HTMLInputElement;
  floor: HTMLInputElement;
  dim: HTMLInputElement;
  order: HTMLInputElement;
  "order-auto": HTMLInputElement;
  speed: HTMLSelectElement;
  cell: HTMLInputElement;
  play: HTMLButtonElement;
  low: HTMLInputElement;
  high: HTMLInputElement;
  typed: HTMLInputElement;
  "crop-x-first": HTMLInputElement;
  "crop-x-last": HTMLInputElement;
  "crop-y-first": HTMLInputElement;
  "crop-y-last": HTMLInputElement;
  "crop-all": HTMLButtonElement;
  "predicted-layer": HTMLSelectElement;
  "observed-layer": HTMLSelectElement;
  "zone-layer": HTMLSelectElement;
  series: HTMLCanvasElement;
  "take-picture": HTMLButtonElement;
  "take-loop": HTMLButtonElement;
  "take-table": HTMLButtonElement;
  "take-report": HTMLAnchorElement;
  "loading-bar": HTMLProgressElement;
  "settings-form": HTMLFormElement;
  "new-form": HTMLFormElement;
}

/** One cell over time. */
export interface Series {
  time: number[];
  probability: (number | null)[];
  state: (number | null)[];
  observed: (number | null)[];
}

/** As much of the frame with viser's client as is used. */
export interface SceneWindow extends Window {
  __viserMutable?: {
    canvas: HTMLCanvasElement | null;
    camera: { fov: number } | null;
    cameraControl: { distance: number } | null;
    messageQueue: unknown[];
    requestRender(): void;
  };
}

/** How much was observed in the steps from `time` on, each of `step_s`. */
export interface Density {
  time: number[];
  step_s: number;
  step_samples: number;
  measurements: number[];
  samples: number[];
  cells: number;
}

/** What a chart shows. */
export interface ChartState {
  series: Series & { step: number };
  events: (Mark & { probability: number })[];
  outliers: [number, number][];
  last: number;
  confidence: number;
  span: [number, number];
  /** The moment that the page shows. */
  moment(): number | null;
}

/** An anomaly as the API lists it. */
export interface Anomaly {
  start: string;
  stop: string;
  cells: number[];
  probability: number;
}

/** A component of a spectrum as the API lists it. */
export interface Component {
  amplitude: number;
  phase: number;
  period_s: number | null;
  gate: string | null;
}

/** How well a candidate predicted, as the API answers it. */
export interface Score {
  estimator: string;
  order: number;
  error: number;
  brier: number;
  log_loss: number;
  n: number;
}

/** Answers to how well a location is predicted. */
export interface Evaluation {
  results: Score[];
  best: { estimator: string; order: number } | null;
  reliability: { probability: number; observed: number; n: number }[];
  horizons: {
    horizon_s: number;
    conditioned: { log_loss: number | null; error: number | null };
    rhythm: { log_loss: number | null; error: number | null };
    persistence: { log_loss: number | null; error: number | null };
  }[];
}

/** The model of a cell as the API answers it. */
export interface Model {
  estimator: string;
  link: string;
  time_zone: string | null;
  order: number;
  start: string;
  stop: string;
  samples: number;
  mean: number | null;
  components: Component[];
  outliers: [number, number][];
  accuracy: number | null;
  compression: { samples: number; history_bytes: number; spectrum_bytes: number };
  selection: { reason: string; scores: Score[] } | null;
}

/** As much of a chart of uPlot as is used. */
export interface Plot {
  scales: { x: { min: number; max: number } };
  ctx: CanvasRenderingContext2D;
  over: HTMLElement;
  bbox: { left: number; top: number; width: number; height: number };
  cursor: { idx?: number | null };
  select: { left: number; width: number };
  valToPos(value: number, scale: string, canvas: boolean): number;
  posToVal(position: number, scale: string): number;
  setSelect(box: { left: number; width: number; top: number; height: number }, fire: boolean): void;
  redraw(rebuild: boolean, recalculate: boolean): void;
  setSize(size: { width: number; height: number }): void;
  destroy(): void;
}

declare global {
  const uPlot: new (options: object, data: unknown[], host: HTMLElement) => Plot;
  const htmx: {
    ajax(method: string, address: string, how: { target: string; swap: string }): Promise<void>;
    defineExtension(name: string, extension: object): void;
  };
}
