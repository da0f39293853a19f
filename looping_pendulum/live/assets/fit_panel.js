/** The fit of a trial: its button, and its result in words. */

import { CONTROLS, settingsOf } from "./controls.js";
import { text } from "./texts.js";
import { studyYaml } from "./trial/study.js";
import { MEASURED } from "./trial_panel.js";

/** @typedef {import("./controls.js").State} State */
/** @typedef {import("./trial/fit.js").FitResult} FitResult */
/** @typedef {import("./trial_panel.js").TrialPanel} TrialPanel */

const MIN_POINTS = 10;
const CENTIMETRES = 100;

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
    return studyYaml(settings, { file: file?.name ?? "", ...options, camera, known: trial.errorsOf(settings) });
  }

  start() {
    const { settings } = this;
    const count = this.trial.points("light").filter(([t]) => t >= 0).length;
    if (settings.release !== "looping") this.say(text("fitNeedsLoop"));
    else if (count < MIN_POINTS) this.say(text("fitNeedsPoints", { count }));
    else {
      this.button.disabled = true;
      this.say(text("fitWorks"));
      this.worker ??= this.startWorker();
      this.worker.onmessage = ({ data }) => this.take(/** @type {FitResult} */ (data));
      this.worker.onerror = () => {
        this.button.disabled = false;
        this.say(text("fitFails"));
      };
      /** @type {import("./trial/fit.js").FitTask} */
      const task = { settings, channels: this.trial.channels, camera: this.trial.camera, known: this.trial.errorsOf(settings) };
      this.worker.postMessage({ fit: task });
    }
  }

  /** @param {string} words */
  say(words) {
    this.element("fit-message").textContent = words;
    this.element("fit-table").replaceChildren();
  }

  /** @param {FitResult} result */
  take({ parameters, before, after, tests, outliers, converged }) {
    this.button.disabled = false;
    const [more, less] = [before, after].map((x) => (CENTIMETRES * x).toPrecision(2));
    const parts = [text("fitDone", { before: more, after: less }), remainderInWords(tests)];
    if (outliers) parts.push(text("fitOutliers", { count: outliers }));
    if (!converged) parts.push(text("fitNotConverged"));
    this.say(parts.join(" "));
    /** @type {Record<string, number>} */
    const values = {};
    for (const { name, value, error } of parameters) {
      const { label, unit, factor } = SHOWN_OF_CAMERA[name] ?? CONTROLS.find((one) => one.name === name) ?? HEAVY_MASS;
      const shown = rounded(value / factor, error / Math.abs(factor));
      values[name] = shown.value;
      const item = document.createElement("li");
      item.textContent = `${label}: ${shown.words}${unit ? ` ${unit}` : ""}`;
      this.element("fit-table").append(item);
    }
    for (const [name, { id }] of Object.entries(SHOWN_OF_CAMERA)) {
      /** @type {HTMLInputElement} */ (this.element(id)).value = String(values[name]);
    }
    const { settings: measured } = this;
    const value = (/** @type {string} */ wanted) => parameters.find(({ name }) => name === wanted)?.value ?? measured[wanted];
    values.mass_ratio = Number((value("heavy_mass") / value("light_mass")).toPrecision(6));
    this.onFitted(values);
    const fitted = settingsOf(this.current());
    this.corrected = Object.fromEntries(Object.keys(MEASURED).map((name) => [name, [fitted[name], measured[name]]]));
  }
}

const HEAVY_MASS = { label: text("heavyMass"), unit: "g", factor: 1e-3 };

/** What is fitted of the camera, and the fields that have it; the file's clock runs ahead by the time of the release.
 * @type {Record<string, {id: string, label: string, unit: string, factor: number}>} */
const SHOWN_OF_CAMERA = {
  origin_x: { id: "trial-origin-x", label: text("originX"), unit: "cm", factor: 1e-2 },
  origin_y: { id: "trial-origin-y", label: text("originY"), unit: "cm", factor: 1e-2 },
  clock_offset: { id: "trial-release", label: text("releaseTime"), unit: "s", factor: -1 },
};

/** Whether what is left is noise, and if not, what to do. @param {FitResult["tests"]} tests */
function remainderInWords({ ratio, larger, pattern }) {
  const excess = text("fitLarger", { percent: (100 * (ratio - 1)).toFixed(0) });
  const why = [...(pattern ? [text("fitPattern")] : []), ...(larger ? [excess] : [])].join(", ");
  return why ? text("fitNotNoise", { why }) : text("fitNoise");
}

/** A value and its standard error, with two digits of the error. @param {number} value @param {number} error */
function rounded(value, error) {
  if (!(error > 0 && error < Infinity)) return { value: Number(value.toPrecision(6)), words: `${Number(value.toPrecision(4))} (not determined)` };
  const digits = Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(error))));
  return { value: Number(value.toFixed(digits)), words: `${value.toFixed(digits)} ± ${error.toFixed(digits)}` };
}
