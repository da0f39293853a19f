/** Quantities over time, with one cursor for all. */

import { colours, disc, fitted, polyline, ticks, write } from "./canvas.js";
import { html } from "./elements.js";
import { oncePerRun } from "./shown_run.js";
import { fixed, shown, text, written } from "./texts.js";

/** @import { DrawnRun, Sample } from "./shown_run.js" */
/** @import { TextKey } from "./texts.js" */
/** @import { Context } from "./canvas.js" */
/** @import { EngineRuns } from "./engine_runs/engine_runs.js" */
/**
 * @typedef {{id: string, title: TextKey, down?: boolean, stacked?: boolean, log?: boolean, runs?: boolean, digits: number,
 *   lines: {name: TextKey, colour: string, value: (s: Sample, run: DrawnRun) => number}[], also?: () => number[],
 *   over?: (c: Context, plot: Plot) => void}} Kind keys of a title and of lines' names; `runs`: whether it is only on pages with, or only on
 *   pages without, stored runs; `also`: values that have room, too; `over`: draws over the lines
 * @typedef {{onTime: (time: number) => void, onProbe: (time: number | null) => void, time: () => number}} Times the time is set; values are
 *   looked at, or no longer; the time that is shown [s]
 */

/** What an arrow key moves the hairline by, and with Shift [s]. */
const [STEP, LARGE_STEP] = [2e-3, 2e-2];
/** Height of a row of values beside the hairline, and room beside it [px]. */
const [ROW, INSET] = [16, 6];
const EDGE = { left: 44, right: 10, top: 26, bottom: 22 };

/** @type {Kind[]} */
export const KINDS = [
  {
    id: "drop", title: "plot.drop", down: true, digits: 1,
    lines: [{ name: "plot.drop", colour: "blue", value: (s) => 100 * s.drop }],
  },
  {
    id: "turns", title: "plot.turns", digits: 2,
    lines: [{ name: "plot.turns", colour: "orange", value: (s) => s.turns }],
  },
  {
    id: "pull", title: "plot.pull", digits: 2, runs: false,
    lines: [
      { name: "line.pull2", colour: "blue", value: (s) => s.heavyTension },
      { name: "line.pull1", colour: "orange", value: (s) => s.lightTension },
    ],
  },
  {
    id: "pull-light", title: "plot.pull1", digits: 2, runs: true,
    lines: [{ name: "line.pull1", colour: "orange", value: (s) => s.lightTension }],
  },
  {
    id: "pull-heavy", title: "plot.pull2", digits: 2, runs: true,
    lines: [{ name: "line.pull2", colour: "blue", value: (s) => s.heavyTension }],
  },
  { id: "distance", title: "plot.distance", digits: 3, log: true, runs: true, lines: [] },
  {
    id: "energy", title: "plot.energy", stacked: true, digits: 0,
    lines: [
      { name: "line.height", colour: "sky", value: (s, run) => 1e3 * (s.energies.potential - lowest(run)) },
      { name: "line.motion", colour: "yellow", value: (s) => 1e3 * s.energies.kinetic },
      { name: "line.lost", colour: "blue", value: (s) => 1e3 * s.energies.lost },
    ],
  },
];

/** Plots of a page with or without stored runs. @param {boolean} withRuns */
export function kindsOf(withRuns) {
  return KINDS.filter(({ runs }) => runs === undefined || runs === withRuns);
}

/** Lowest potential energy of a run [J], from which it is counted. */
const lowest = oncePerRun(({ samples }) => Math.min(...samples.map(({ energies }) => energies.potential)));

/** One plot: a canvas for what does not move with the time, and one above it for the cursor. */
export class Plot {
  /**
   * @param {HTMLElement} box
   * @param {Kind} kind
   * @param {Times} times
   */
  constructor(box, kind, times) {
    this.box = box;
    this.kind = kind;
    /** Stored runs, the reference's among them, which are drawn in place of the page's own. @type {EngineRuns | null} */
    this.runs = null;
    this.size = { width: 0, height: 0 };
    const [still, canvas] = [html("canvas"), html("canvas")];
    box.append(still, canvas);
    this.still = still;
    this.canvas = canvas;
    /** @type {DrawnRun | null} */
    this.run = null;
    this.end = 1;
    this.x = (/** @type {number} */ t) => t;
    this.y = (/** @type {number} */ v) => v;
    /** Time at which values are looked at here by keys [s]. @type {number | null} */
    this.read = null;
    this.listenToPointer(times);
    this.listenToKeys(times);
  }

  /** What is under the pointer is read; where it is pressed, the time is set. @param {Times} times */
  listenToPointer({ onTime, onProbe }) {
    const { canvas } = this;
    const timeAt = (/** @type {PointerEvent} */ event) => {
      const share = (event.clientX - canvas.getBoundingClientRect().left - EDGE.left) / (canvas.clientWidth - EDGE.left - EDGE.right);
      return Math.min(Math.max(share, 0), 1) * this.end;
    };
    const follow = (/** @type {PointerEvent} */ event) => {
      onProbe(timeAt(event));
      if (event.buttons) onTime(timeAt(event));
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      follow(event);
    });
    canvas.addEventListener("pointermove", follow);
    // What a finger has chosen stays to be read when it no longer covers it
    canvas.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && onProbe(null));
    // The arrow keys go on to step through time
    canvas.addEventListener("mousedown", (event) => event.preventDefault());
  }

  /** @param {Times} times */
  listenToKeys({ onTime, onProbe, time }) {
    const { box } = this;
    box.tabIndex = 0;
    box.setAttribute("role", "slider");
    for (const name of ["aria-valuemin", "aria-valuenow"]) box.setAttribute(name, "0");
    const read = (/** @type {number} */ at) => {
      this.read = Math.min(Math.max(at, 0), this.end);
      this.describe(this.read);
      onProbe(this.read);
    };
    box.addEventListener("focus", () => read(time()));
    box.addEventListener("blur", () => {
      this.read = null;
      onProbe(null);
    });
    box.addEventListener("keydown", (event) => {
      const at = this.read ?? time();
      const step = event.shiftKey ? LARGE_STEP : STEP;
      /** @type {Record<string, number>} */
      const places = { ArrowRight: at + step, ArrowLeft: at - step, ArrowUp: at + step, ArrowDown: at - step, Home: 0, End: this.end };
      if (event.key === "Enter") onTime(at);
      else if (Object.hasOwn(places, event.key)) read(places[event.key]);
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
  }

  /** Tell screen readers what is to be read at a time. @param {number} time */
  describe(time) {
    const values = this.readings(time).map(({ name, value }) => [name, value].filter(Boolean).join(" "));
    this.box.setAttribute("aria-valuenow", time.toFixed(3));
    this.box.setAttribute("aria-valuetext", text("plotReads", { time: fixed(time, 3), values: values.join(", ") }));
  }

  /** What the lines say at a time; a single one needs no name. @param {number} time */
  readings(time) {
    const { kind, run, runs } = this;
    const inWords = (/** @type {number} */ value) => (Number.isFinite(value) ? fixed(value, kind.digits) : "–");
    if (runs) return runs.readings(kind.id, time).map(({ name, value }) => ({ name, value: inWords(value) }));
    if (!run) return [];
    const sample = run.at(time);
    return kind.lines.map(({ name, value }) => ({ name: kind.lines.length > 1 ? text(name) : "", value: inWords(value(sample, run)) }));
  }

  /** Draw all that does not move with the time. @param {DrawnRun} run @param {DrawnRun | null} ghost @param {EngineRuns | null} runs */
  show(run, ghost, runs) {
    this.run = run;
    const { c, width, height } = fitted(this.still);
    this.size = { width, height };
    const { grid, soft, ink } = colours();
    const { kind } = this;
    this.runs = kind.stacked ? null : runs;
    this.end = runs ? runs.duration : Math.max(run.end, ghost ? ghost.end : 0);
    const [low, high] = this.limits(ghost ? [run, ghost] : [run]);
    const share = (/** @type {number} */ v) => kind.log ? Math.log(Math.max(v, low) / low) / Math.log(high / low) : (v - low) / (high - low);
    const tall = height - EDGE.top - EDGE.bottom;
    this.x = (/** @type {number} */ t) => EDGE.left + (t / this.end) * (width - EDGE.left - EDGE.right);
    this.y = (/** @type {number} */ v) => EDGE.top + tall * (kind.down ? share(v) : 1 - share(v));
    for (const v of kind.log ? decades(low, high) : ticks(low, high)) {
      polyline(c, [[EDGE.left, this.y(v)], [width - EDGE.right, this.y(v)]], { colour: grid, width: 1 });
      write(c, written(v, 6), EDGE.left - 6, this.y(v), { colour: soft, size: 11, align: "right" });
    }
    for (const t of ticks(0, this.end)) write(c, `${shown(t)} s`, this.x(t), height - 9, { colour: soft, size: 11, align: "center" });
    write(c, text(kind.title), 6, 13, { colour: ink, size: 13, bold: true });
    c.save();
    c.beginPath();
    c.rect(EDGE.left, EDGE.top - 3, width - EDGE.left - EDGE.right + 3, tall + 6);
    c.clip();
    if (kind.stacked) this.areas(c, run);
    if (ghost && !kind.stacked) this.curves(c, ghost, true);
    if (this.runs) this.runs.drawCurves(c, this);
    else if (!kind.stacked) this.curves(c, run, false);
    kind.over?.(c, this);
    c.restore();
    this.legend(c, width);
    this.box.setAttribute("aria-valuemax", this.end.toFixed(3));
    this.describe(this.read ?? 0);
  }

  /** @param {DrawnRun[]} runs @returns {[number, number]} */
  limits(runs) {
    const { lines, stacked, log } = this.kind;
    if (log) return this.runs ? this.runs.range(this.kind.id) : [1e-3, 1];
    const ranges = runs.flatMap((run) =>
      stacked ? [run.range((s) => lines.reduce((sum, { value }) => sum + value(s, run), 0))] : lines.map(({ value }) => run.range((s) => value(s, run))),
    );
    if (this.runs) ranges.push(this.runs.range(this.kind.id));
    ranges.push(...(this.kind.also?.() ?? []).map((value) => /** @type {[number, number]} */ ([value, value])));
    const [low, high] = [Math.min(0, ...ranges.map(([first]) => first)), Math.max(...ranges.map(([, last]) => last))];
    const span = Math.max(high - low, 1e-6);
    return [low < 0 ? low - 0.04 * span : low, high + 0.05 * span];
  }

  /** @param {Context} c @param {DrawnRun} run @param {boolean} pale */
  curves(c, run, pale) {
    for (const { value, colour } of this.kind.lines) {
      const style = pale ? { colour: colours().soft, width: 1.5, dash: [5, 4] } : { colour: colourOf(colour), width: 2.2 };
      polyline(c, run.samples.map((s) => [this.x(s.t), this.y(value(s, run))]), style);
    }
  }

  /** @param {Context} c @param {DrawnRun} run */
  areas(c, run) {
    let below = run.samples.map(() => 0);
    for (const { value, colour } of this.kind.lines) {
      const above = run.samples.map((s, i) => below[i] + value(s, run));
      c.beginPath();
      run.samples.forEach((s, i) => c.lineTo(this.x(s.t), this.y(above[i])));
      for (let i = run.samples.length - 1; i >= 0; i--) c.lineTo(this.x(run.samples[i].t), this.y(below[i]));
      c.closePath();
      c.fillStyle = colourOf(colour);
      c.fill();
      polyline(c, run.samples.map((s, i) => [this.x(s.t), this.y(above[i])]), { colour: colours().ink, width: 1 });
      below = above;
    }
  }

  /** @param {Context} c @param {number} width */
  legend(c, width) {
    const { lines } = this.kind;
    if (lines.length < 2) return;
    let x = width - EDGE.right;
    for (const { name, colour } of [...lines].reverse()) {
      const words = text(name);
      write(c, words, x, 13, { colour: colours().soft, size: 11, align: "right" });
      x -= c.measureText(words).width + 13;
      c.fillStyle = colourOf(colour);
      c.fillRect(x, 8, 9, 9);
      x -= 8;
    }
  }

  /** Draw the cursor, and the hairline with its values. @param {number} time @param {number | null} probe time of the hairline */
  draw(time, probe) {
    const { c, height } = fitted(this.canvas);
    if (!this.run) return;
    this.cursor(c, height, this.run, time);
    if (probe !== null && probe <= this.end) this.hairline(c, height, probe);
  }

  /** @param {Context} c @param {number} height @param {number} time */
  hairline(c, height, time) {
    const { ink, panel, line } = colours();
    const x = this.x(time);
    polyline(c, [[x, EDGE.top], [x, height - EDGE.bottom]], { colour: ink, width: 1, dash: [3, 3] });
    const rows = [{ name: "t", value: `${fixed(time, 3)} s` }, ...this.readings(time)];
    c.font = "600 12px system-ui, sans-serif";
    const wide = Math.max(...rows.map(({ name, value }) => c.measureText(`${name} ${value}`).width)) + 2 * INSET;
    const left = x + INSET + wide < this.size.width ? x + INSET : x - INSET - wide;
    c.beginPath();
    c.rect(left, EDGE.top, wide, ROW * rows.length + 4);
    c.fillStyle = panel;
    c.fill();
    c.strokeStyle = line;
    c.lineWidth = 1;
    c.stroke();
    rows.forEach(({ name, value }, i) => {
      const y = EDGE.top + 10 + ROW * i;
      write(c, name, left + INSET, y, { colour: ink });
      write(c, value, left + wide - INSET, y, { colour: ink, bold: true, align: "right" });
    });
  }

  /** @param {Context} c @param {number} height @param {DrawnRun} run @param {number} time */
  cursor(c, height, run, time) {
    const { ink, ground } = colours();
    const x = this.x(Math.min(time, this.end));
    for (const [colour, width] of /** @type {[string, number][]} */ ([[ground, 3.5], [ink, 1.5]])) {
      polyline(c, [[x, EDGE.top], [x, height - EDGE.bottom]], { colour, width });
    }
    if (this.runs) this.runs.drawDots(c, this, time);
    if (this.runs || this.kind.stacked || time > run.end) return;
    for (const { value, colour } of this.kind.lines) {
      disc(c, [x, Math.max(this.y(value(run.at(time), run)), EDGE.top)], 4, { fill: colourOf(colour), line: ground });
    }
  }
}

/** Powers of ten in a range, each second one of many. @param {number} low @param {number} high */
function decades(low, high) {
  const count = Math.round(Math.log10(high / low));
  const all = Array.from({ length: count + 1 }, (_, i) => Number((low * 10 ** i).toPrecision(3)));
  return all.filter((_, i) => count < 6 || i % 2 === count % 2);
}

/** @param {string} name */
function colourOf(name) {
  return colours()[/** @type {keyof ReturnType<typeof colours>} */ (name)];
}
