/** A curve of one's own over the points that were measured: a formula that is typed, and a straight line between two times. */

import { colours, disc, polyline } from "./canvas.js";
import { parsed } from "./controls.js";
import { rounded } from "./fit_panel.js";
import { FormulaError, readFormula, rmsDistance, straightLine } from "./formula.js";
import { Plot } from "./plots.js";
import { fixed, shown, text, written } from "./texts.js";

/** @import { DrawnRun, Sample } from "./shown_run.js" */
/** @import { TextKey } from "./texts.js" */
/** @import { Evaluated } from "./formula.js" */
/** @typedef {[number, number][]} Points time [s] and value [cm] */
/**
 * @typedef {{run: DrawnRun, lesson: import("./lesson/panel.js").LessonPanel, trial: import("./trial_panel.js").TrialPanel,
 *   say: (id: string, words: string | (() => string)) => void, change: () => void}} CurvePage
 */

const CENTIMETRES = 100;
const UNIT = "cm";
/** Points of the run itself in a second, where nothing was measured. */
const POINTS_PER_SECOND = 60;
/** Pieces of which a curve is drawn. */
const PIECES = 400;
/** Quantity -> its title, colour, what a run has of it, and what was measured, in centimetres.
 * @type {Record<string, {title: TextKey, colour: string, down?: boolean, value: (s: Sample) => number,
 *   measured: (page: CurvePage) => Points}>} */
const QUANTITIES = {
  drop: {
    title: "plot.drop",
    colour: "blue",
    down: true,
    value: (s) => CENTIMETRES * s.drop,
    measured: ({ run, trial }) => channel(trial, "heavy_y").map(([t, y]) => [t, CENTIMETRES * (run.at(0).heavy[1] - y)]),
  },
  x: { title: "column.lightX", colour: "orange", value: (s) => CENTIMETRES * s.light[0], measured: (page) => coordinate(page, 0) },
  y: { title: "column.lightY", colour: "orange", value: (s) => CENTIMETRES * s.light[1], measured: (page) => coordinate(page, 1) },
  distance: {
    title: "ownDistance",
    colour: "orange",
    value: (s) => CENTIMETRES * Math.hypot(...s.light),
    measured: ({ lesson, trial }) => (lesson.points ?? trial.points("light")).map(([t, ...place]) => [t, CENTIMETRES * Math.hypot(...place)]),
  },
};

/** @param {import("./trial_panel.js").TrialPanel} trial @param {string} name @returns {Points} time and value [s, m] */
function channel(trial, name) {
  const found = trial.channel(name);
  return found ? found.t.map((t, i) => [t, found.value[i]]) : [];
}

/** What was measured of M1; while the lesson shows points, those. @param {CurvePage} page @param {0 | 1} axis @returns {Points} */
function coordinate({ lesson, trial }, axis) {
  const points = lesson.points ? lesson.points.map(([t, ...place]) => [t, place[axis]]) : channel(trial, ["light_x", "light_y"][axis]);
  return points.map(([t, value]) => [t, CENTIMETRES * value]);
}

/** The plot with the points, the formula and the line. */
export class OwnCurve {
  /** @param {(id: string) => HTMLElement} element @param {CurvePage} page @param {import("./plots.js").Times} times */
  constructor(element, page, times) {
    this.element = element;
    this.page = page;
    this.select = /** @type {HTMLSelectElement} */ (element("own-quantity"));
    this.select.append(...Object.keys(QUANTITIES).map((name) => new Option("", name)));
    /** The formula as a function; null while there is none. @type {Evaluated | null} */
    this.formula = null;
    /** The straight line; null while it is not asked for. @type {{from: number, to: number, y: Evaluated} | null} */
    this.line = null;
    /** @type {Points} */
    this.points = [];
    this.plot = new Plot(element("own-plot"), this.kind, times);
    for (const id of ["own-quantity", "own-formula", "own-line", "own-from", "own-to"]) element(id).addEventListener("input", () => page.change());
    element("own-curve").addEventListener("toggle", () => page.change());
  }

  get isOpen() {
    return /** @type {HTMLDetailsElement} */ (this.element("own-curve")).open;
  }

  get quantity() {
    return QUANTITIES[this.select.value];
  }

  /** What is drawn of the quantity that is chosen. @returns {import("./plots.js").Kind} */
  get kind() {
    const { title, colour, down, value } = this.quantity;
    return {
      id: "own", title, down, digits: 1, lines: [{ name: title, colour, value }],
      also: () => this.points.map(([, one]) => one),
      over: (c) => this.draw(c),
    };
  }

  relabel() {
    for (const option of this.select.options) option.text = text(QUANTITIES[option.value].title);
  }

  /** Read what is typed, draw it over the points, and say how far it is from them. @param {DrawnRun} run */
  show(run) {
    if (!this.isOpen) return;
    const { quantity } = this;
    const measured = quantity.measured(this.page).filter(([t]) => t >= 0 && t <= run.end);
    const count = Math.floor(run.end * POINTS_PER_SECOND);
    const ofRun = Array.from({ length: count + 1 }, (_, i) => run.at(i / POINTS_PER_SECOND));
    this.points = measured.length ? measured : ofRun.map((s) => [s.t, quantity.value(s)]);
    const what = measured.length ? "ownMeasured" : "ownOfRun";
    const of = () => text(what, { count: this.points.length });
    this.read(of);
    this.fitLine(run.end, measured.length > 0);
    this.plot.kind = this.kind;
    this.plot.show(run, null, null);
    this.plot.box.setAttribute("aria-label", text("plotLabel", { title: text(quantity.title) }));
  }

  /** @param {string} id */
  typed(id) {
    return /** @type {HTMLInputElement} */ (this.element(id)).value.trim();
  }

  /** @param {() => string} of which points */
  read(of) {
    const { page } = this;
    const typed = this.typed("own-formula");
    this.formula = null;
    let fault = () => "";
    try {
      if (typed) this.formula = readFormula(typed);
    } catch (error) {
      if (!(error instanceof FormulaError)) throw error;
      const { key, place, found } = error;
      fault = () => text(key, { place, found: found ? `“${found}”` : text("formulaEnd") });
    }
    this.element("own-formula").setAttribute("aria-invalid", String(!this.formula && typed !== ""));
    page.say("own-fault", fault);
    const y = this.formula;
    const without = y && this.points.find(([t]) => !Number.isFinite(y(t)));
    page.say("own-result", () => {
      if (!y) return of();
      if (without) return text("ownNoValue", { time: fixed(without[0], 3) });
      return text("ownRms", { rms: distance(rmsDistance(this.points, y)), of: of() });
    });
  }

  /** @param {number} end of the run [s] @param {boolean} isMeasured whether the points have errors */
  fitLine(end, isMeasured) {
    const { page } = this;
    this.line = null;
    const isAsked = /** @type {HTMLInputElement} */ (this.element("own-line")).checked;
    const [from, to] = [["own-from", 0], ["own-to", end]].map(([id, whole]) => {
      const time = parsed(this.typed(String(id)));
      return Number.isNaN(time) ? Number(whole) : time;
    });
    const points = this.points.filter(([t]) => t >= from && t <= to);
    const times = { from: fixed(from, 3), to: fixed(to, 3) };
    if (!isAsked || new Set(points.map(([t]) => t)).size < 2) {
      page.say("own-line-result", isAsked ? () => text("ownFewPoints", times) : "");
      return;
    }
    const { slope, intercept, rms, slopeError, interceptError } = straightLine(points);
    this.line = { from, to, y: (t) => slope * t + intercept };
    const inWords = (/** @type {number} */ value, /** @type {number} */ error) =>
      isMeasured && Number.isFinite(error) ? rounded(value, error).words() : shown(Number(value.toPrecision(4)));
    page.say("own-line-result", () => text("ownLineFound", {
      ...times, slope: inWords(slope, slopeError), intercept: inWords(intercept, interceptError), rms: distance(rms), unit: UNIT,
    }));
  }

  /** @param {import("./canvas.js").Context} c */
  draw(c) {
    const { plot, points, formula, line } = this;
    const { ink, ground, green, pink } = colours();
    const place = (/** @type {Evaluated} */ y) => (/** @type {number} */ t) => [plot.x(t), plot.y(y(t))];
    for (const [t, value] of points) disc(c, [plot.x(t), plot.y(value)], 2, { fill: ground, line: ink });
    if (formula) {
      const drawn = Array.from({ length: PIECES + 1 }, (_, i) => place(formula)((i / PIECES) * plot.end));
      polyline(c, drawn, { colour: green, width: 2.5 });
    }
    if (line) polyline(c, [line.from, Math.min(line.to, plot.end)].map(place(line.y)), { colour: pink, width: 2.5, dash: [8, 5] });
  }

  /** @param {number} time @param {number | null} probe */
  drawTime(time, probe) {
    if (this.isOpen) this.plot.draw(time, probe);
  }
}

/** A distance in words, to three digits or a hundredth of a millimetre. @param {number} length [cm] */
const distance = (length) => (length < 10 ? fixed(length, length < 1 ? 3 : 2) : written(length, 3));
