/** The fit of a trial: its button, and its result in words. */

import { controlOf, settingsOf } from "./controls.js";
import { html } from "./elements.js";
import { ShownRun } from "./shown_run.js";
import { fixed, shown, text, withUnit } from "./texts.js";
import { typicalDistance } from "./trial/distance.js";
import { studyYaml } from "./trial/study.js";
import { DRAGS, MEASURED, inMillimetres } from "./trial_panel.js";

/** @import { State } from "./controls.js" */
/** @import { FitResult } from "./trial/fit.js" */
/** @import { TrialPanel } from "./trial_panel.js" */
/** @typedef {{name: string, unit: string, value: number, words: () => string}} FittedNumber in the unit that is shown */

const MIN_POINTS = 10;
const AXIS = /^origin_([xy])$/;

/** Has a worker fit the trial, and shows what it found. */
export class FitPanel {
  /**
   * @param {(id: string) => HTMLElement} element
   * @param {TrialPanel} trial
   * @param {() => Worker} startWorker
   * @param {() => State} current
   * @param {(values: Record<string, number>) => void} onFitted takes the fitted settings, in the units that are shown
   */
  constructor(element, trial, startWorker, current, onFitted) {
    this.element = element;
    this.trial = trial;
    this.startWorker = startWorker;
    this.current = current;
    this.onFitted = onFitted;
    /** @type {Worker | null} */
    this.worker = null;
    /** What is said: a text, or what a fit gave. @type {(() => void) | null} */
    this.message = null;
    /** What the last fit left, and of which file; the typical distance after it [m].
     * @type {{file: unknown, isNoise: boolean, tests: FitResult["tests"], after: number} | null} */
    this.fitted = null;
    /** Typical distance before the fit [m]. */
    this.before = NaN;
    /**
     * What a fit changed of what was measured before the trial: the fitted and the measured value.
     * @type {Record<string, [number, number]>}
     */
    this.corrected = {};
    this.button = /** @type {HTMLButtonElement} */ (element("trial-fit"));
    this.button.addEventListener("click", () => this.start());
  }

  /** The settings; of what was measured and a fit has changed, what was measured. */
  get settings() {
    const settings = settingsOf(this.current());
    for (const [name, [fitted, measured]] of Object.entries(this.corrected)) {
      if (settings[name] === fitted) settings[name] = measured;
    }
    return settings;
  }

  /** The trial as a study for `identify`. */
  study() {
    const { settings, trial } = this;
    const { file, options, camera } = trial;
    return studyYaml(settings, { file: file?.name ?? "", ...options, start: trial.trial?.start, camera, known: trial.errorsOf(settings) });
  }

  /** Of the trial's points from the run of the settings [m]. */
  typicalDistance() {
    return typicalDistance(this.trial.points("light"), new ShownRun(settingsOf(this.current())));
  }

  start() {
    const { settings } = this;
    const count = this.trial.points("light").filter(([t]) => t >= 0).length;
    if (settings.release !== "looping") this.say(() => text("fitNeedsLoop"));
    else if (count < MIN_POINTS) this.say(() => text("fitNeedsPoints", { count }));
    else {
      this.button.disabled = true;
      this.before = this.typicalDistance();
      this.say(() => text("fitWorks"));
      this.worker ??= this.startWorker();
      this.worker.onmessage = ({ data }) => this.take(/** @type {FitResult} */ (data));
      this.worker.onerror = () => {
        this.button.disabled = false;
        this.say(() => text("fitFails"));
      };
      /** @type {import("./trial/fit.js").FitTask} */
      const task = { settings, channels: this.trial.channels, camera: this.trial.camera, known: this.trial.errorsOf(settings) };
      this.worker.postMessage({ fit: task });
    }
  }

  /** @param {() => string} words @param {FittedNumber[]} rows */
  say(words, rows = []) {
    this.message = () => {
      this.element("fit-message").textContent = words();
      const listed = rows.map(({ name, unit, words }) => html("li", {}, `${labelOf(name)}: ${withUnit(words(), unit)}`));
      this.element("fit-table").replaceChildren(...listed);
    };
    this.message();
  }

  /** Say what was said last in the language of the page, if it still stands there. */
  relabel() {
    if (this.element("fit-message").textContent) this.message?.();
  }

  /** @param {FitResult} result */
  take({ parameters, tests, outliers, converged }) {
    this.button.disabled = false;
    const rows = parameters.map(({ name, value, error }) => {
      const { unit, factor } = unitOf(name);
      return { name, unit, ...rounded(value / factor, error / Math.abs(factor)) };
    });
    const values = Object.fromEntries(rows.map(({ name, value }) => [name, value]));
    for (const [name, { id }] of Object.entries(OF_CAMERA)) {
      /** @type {HTMLInputElement} */ (this.element(id)).value = shown(values[name]);
    }
    const { settings: measured } = this;
    const known = this.trial.errorsOf(measured);
    /** @type {Record<string, any>} */
    const stated = { ...measured, ...this.trial.camera };
    const contradictions = () => contradictionsInWords(parameters, stated, known);
    const value = (/** @type {string} */ wanted) => parameters.find(({ name }) => name === wanted)?.value ?? stated[wanted];
    this.trial.scale = value("scale");
    this.trial.tilt = value("tilt");
    values.mass_ratio = Number((value("heavy_mass") / value("light_mass")).toPrecision(6));
    this.onFitted(values);
    const after = this.typicalDistance();
    this.fitted = { file: this.trial.file, isNoise: !tests.pattern && !tests.larger, tests, after };
    this.say(() => {
      const [more, less] = [this.before, after].map(inMillimetres);
      const parts = [text("fitDone", { before: more, after: less }), ...contradictions(), remainderInWords(tests)];
      if (outliers) parts.push(text("fitOutliers", { count: outliers }));
      if (!converged) parts.push(text("fitNotConverged"));
      return parts.join(" ");
    }, rows);
    const fitted = settingsOf(this.current());
    this.corrected = Object.fromEntries(Object.keys({ ...MEASURED, ...DRAGS }).map((name) => [name, [fitted[name], measured[name]]]));
  }
}

const [HEAVY_MASS, SCALE, TILT] = [{ unit: "g", factor: 1e-3 }, { unit: "", factor: 1 }, { unit: "°", factor: Math.PI / 180 }];
/** A stated value that the fit leaves by more of its standard errors is named. */
const MAX_CONTRADICTION = 3;

/** What is fitted of the camera, and the fields that have it; the file's clock runs ahead by the time of the release.
 * @type {Record<string, {id: string, unit: string, factor: number}>} */
const OF_CAMERA = {
  origin_x: { id: "trial-origin-x", unit: "cm", factor: 1e-2 },
  origin_y: { id: "trial-origin-y", unit: "cm", factor: 1e-2 },
  clock_offset: { id: "trial-release", unit: "s", factor: -1 },
};

/** The unit in which a fitted number is shown. @param {string} name @returns {{unit: string, factor: number}} */
function unitOf(name) {
  const other = { heavy_mass: HEAVY_MASS, scale: SCALE, tilt: TILT }[name];
  return OF_CAMERA[name] ?? other ?? controlOf(name);
}

/** What was stated with an error, and contradicts the trial, in one sentence; none: nothing does.
 * @param {import("./trial/fit.js").FittedParameter[]} parameters @param {Record<string, any>} stated @param {Record<string, number>} known */
function contradictionsInWords(parameters, stated, known) {
  const far = parameters.filter(({ name, value }) => known[name] > 0 && Math.abs(value - stated[name]) > MAX_CONTRADICTION * known[name]);
  const listed = far.map(({ name, value, error }) => {
    const { unit, factor } = unitOf(name);
    const [found, said] = [[value, error], [stated[name], known[name]]].map(([one, its]) => withUnit(rounded(one / factor, its / factor).words(), unit));
    return text("fitStated", { what: labelOf(name), found, said });
  });
  return listed.length ? [text("fitContradicts", { values: listed.join("; ") })] : [];
}

/** What a fitted number is. @param {string} name */
function labelOf(name) {
  const axis = AXIS.exec(name)?.[1];
  if (axis) return text("axisInFile", { axis });
  if (name === "clock_offset") return text("releaseInFile");
  if (name === "scale" || name === "tilt") return text(name === "scale" ? "scaleOfFile" : "tiltOfFile");
  return name === "heavy_mass" ? text("heavyMass") : text(`setting.${name}`);
}

/** Whether what is left is noise, and if not, what to do. @param {FitResult["tests"]} tests */
export function remainderInWords({ ratio, larger, pattern, place }) {
  const excess = text("fitLarger", { percent: fixed(100 * (ratio - 1), 0) });
  const why = [...(pattern ? [text("fitPattern")] : []), ...(larger ? [excess] : [])].join(", ");
  if (!place) return text(why ? "fitNotNoise" : "fitNoise", { why, where: "" });
  const { direction, sliding, time } = place;
  const where = text("fitWhere", { what: text(`misfit.${direction}`), when: text(sliding ? "whileSliding" : "whileNotSliding"), time: fixed(time, 2) });
  return text("fitNotNoise", { why, where });
}

/** A value and its standard error, with two digits of the error. @param {number} value @param {number} error */
export function rounded(value, error) {
  if (!(error > 0 && error < Infinity)) {
    return { value: Number(value.toPrecision(6)), words: () => text("notDetermined", { value: Number(value.toPrecision(4)) }) };
  }
  const digits = Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(error))));
  return { value: Number(value.toFixed(digits)), words: () => `${fixed(value, digits)} ± ${fixed(error, digits)}` };
}
