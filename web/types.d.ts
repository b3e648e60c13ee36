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
  span: Span | null;
  events: Mark[];
}

/** The facts of the selected cell. */
export interface CellFacts {
  cell: number;
  index: number[];
  position_m: number[];
  probability: number | null;
  observed: number | null;
  observed_time: number | null;
}

/** What is on the screen. */
export interface FrameMessage {
  time: number;
  live: boolean;
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
  frame(message: FrameMessage): void;
  refused(message: { detail: string }): void;
  notice(message: NoticeMessage): void;
}

/** What the page wants to see. */
export interface ViewRequest {
  location: string | null;
  time: number | null;
  live: boolean;
  confidence: number | null;
  order: number | null;
  floor: number;
  dim: boolean;
}

/** The elements of the pages that are no plain ones, by id. */
export interface Controls {
  marks: HTMLCanvasElement;
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
}

/** One cell over time. */
export interface Series {
  time: number[];
  probability: (number | null)[];
  state: (number | null)[];
  observed: (number | null)[];
}

/** What a chart shows. */
export interface ChartState {
  series: Series;
  events: Mark[];
  last: number;
  confidence: number;
  step: number;
}

/** An anomaly as the API lists it. */
export interface Anomaly {
  start: string;
  stop: string;
  cells: number[];
}

/** A component of a spectrum as the API lists it. */
export interface Component {
  amplitude: number;
  phase: number;
  period_s: number | null;
  gate: string | null;
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
  selection: { reason: string } | null;
}

/** As much of a chart of uPlot as is used. */
export interface Plot {
  ctx: CanvasRenderingContext2D;
  bbox: { left: number; top: number; width: number; height: number };
  cursor: { idx?: number | null };
  select: { left: number; width: number };
  valToPos(value: number, scale: string, canvas: boolean): number;
  posToVal(position: number, scale: string): number;
  setSelect(box: { left: number; width: number; top: number; height: number }, fire: boolean): void;
  setSize(size: { width: number; height: number }): void;
  destroy(): void;
}

declare global {
  const uPlot: new (options: object, data: unknown[], host: HTMLElement) => Plot;
  const htmx: { trigger(target: string, event: string): void };
}
