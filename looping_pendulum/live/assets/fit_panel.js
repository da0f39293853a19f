/** The fit of a trial: its button, its result in words, and the study file for `identify`. */

import { controlOf, settingsOf, tidy } from "./controls.js";
import { durationOf } from "./shown_run.js";
import { fixed, shown, text } from "./texts.js";

/** @typedef {import("./controls.js").State} State */
/** @typedef {import("./trial/fit.js").FitResult} FitResult */
/** @typedef {import("./trial_panel.js").TrialPanel} TrialPanel */
/** @typedef {{name: string, unit: string, value: number, words: () => string}} FittedNumber in the unit that is shown */

/** Correlation of neighbouring residuals above which they are no noise: of a hundred points' noise, one in a thousand has more. */
const MAX_CORRELATION = 0.3;
const CENTIMETRES = 100;
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
    /** What the last fit left, and of which file. @type {{file: unknown, isNoise: boolean, alike: number, after: number} | null} */
    this.fitted = null;
    this.button = /** @type {HTMLButtonElement} */ (element("trial-fit"));
    this.button.addEventListener("click", () => this.start());
  }

  start() {
    const settings = settingsOf(this.current());
    const duration = durationOf(settings.release);
    const [light, heavy] = [this.trial.points("light", false), this.trial.points("heavy", false)].map((points) =>
      points.filter(([t]) => t >= 0 && t <= duration),
    );
    if (settings.release !== "looping") this.say(() => text("fitNeedsLoop"));
    else if (light.length < 10) this.say(() => text("fitNeedsPoints", { count: light.length }));
    else {
      this.button.disabled = true;
      this.say(() => text("fitWorks"));
      this.worker ??= this.startWorker();
      this.worker.onmessage = ({ data }) => this.take(/** @type {FitResult} */ (data));
      this.worker.onerror = () => {
        this.button.disabled = false;
        this.say(() => text("fitFails"));
      };
      /** @type {import("./trial/fit.js").FitTask} */
      const task = { settings, light, heavy, duration };
      this.worker.postMessage({ fit: task });
    }
  }

  /** @param {() => string} words @param {FittedNumber[]} rows */
  say(words, rows = []) {
    this.message = () => {
      this.element("fit-message").textContent = words();
      this.element("fit-table").replaceChildren(...rows.map(({ name, unit, words }) => {
        const axis = AXIS.exec(name)?.[1];
        const label = axis ? text("axisInFile", { axis }) : text(`setting.${name}`);
        return Object.assign(document.createElement("li"), { textContent: `${label}: ${words()}${unit ? ` ${unit}` : ""}` });
      }));
    };
    this.message();
  }

  /** Say what was said last in the language of the page, if it still stands there. */
  relabel() {
    if (this.element("fit-message").textContent) this.message?.();
  }

  /** @param {FitResult} result */
  take({ parameters, before, after, alike, converged }) {
    this.button.disabled = false;
    this.fitted = { file: this.trial.file, isNoise: alike <= MAX_CORRELATION, alike, after };
    const { isNoise } = this.fitted;
    const rows = parameters.map(({ name, value, error }) => {
      const { unit, factor } = AXIS.test(name) ? { unit: "cm", factor: 1e-2 } : controlOf(name);
      return { name, unit, ...rounded(value / factor, error / factor) };
    });
    this.say(() => {
      const [more, less] = [before, after].map((x) => shown((CENTIMETRES * x).toPrecision(2)));
      const noise = isNoise ? text("fitNoise") : text("fitNotNoise", { alike: fixed(alike, 2) });
      return [text("fitDone", { before: more, after: less }), noise, converged ? "" : text("fitNotConverged")].join(" ").trim();
    }, rows);
    const values = Object.fromEntries(rows.map(({ name, value }) => [name, value]));
    for (const axis of ["x", "y"]) {
      /** @type {HTMLInputElement} */ (this.element(`trial-origin-${axis}`)).value = shown(values[`origin_${axis}`]);
    }
    this.onFitted(values);
  }
}

/** A value and its standard error, with two digits of the error. @param {number} value @param {number} error */
function rounded(value, error) {
  if (!(error > 0 && error < Infinity)) {
    return { value: Number(value.toPrecision(6)), words: () => text("notDetermined", { value: Number(value.toPrecision(4)) }) };
  }
  const digits = Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(error))));
  return { value: Number(value.toFixed(digits)), words: () => `${fixed(value, digits)} ± ${fixed(error, digits)}` };
}

/**
 * Return a study of the trial for `identify`, with what the page knows.
 * @param {Record<string, any>} settings
 * @param {{file: string, tracks: Record<string, string>, length: string, time: string, rate: number | null, release: number,
 *   mirrored: boolean}} trial
 */
export function studyYaml(settings, { file, tracks, length, time, rate, release, mirrored }) {
  const quoted = (/** @type {string} */ words) => JSON.stringify(words);
  const named = Object.entries(tracks).map(([mass, track]) => `${mass}: ${quoted(track)}`);
  const options = [
    ...(named.length ? [`    tracks: {${named.join(", ")}}`] : []),
    ...(length !== "m" || time !== "s" ? [`    units: {length: ${length}, time: ${time}}`] : []),
    ...(rate ? [`    frame_rate: ${rate} Hz`] : []),
    ...(mirrored ? ["    mirrored: true"] : []),
    ...(release ? [`    camera: {clock_offset: free from ${release} s}`] : []),
  ];
  const si = (/** @type {string} */ name) => tidy(settings[name]);
  return `# Written by the page live.html. Write +/- and its standard error behind each number that you have measured.
title: ${quoted(file)}
apparatus:
  light: {mass: ${si("light_mass")} kg}
  rod: {radius: ${si("rod_radius")} m}
effects:
  gravity: ${si("gravity")} m/s^2
  capstan: free
  light_drag: free
  heavy_drag: ${si("heavy_drag")} kg/m
  string_drag: ${si("string_drag")} kg/m^2
trials:
  - name: mine
    file: ${quoted(file)}
${options.map((line) => `${line}\n`).join("")}    heavy: {mass: ${si("heavy_mass")} kg}
    release: {angle: free from ${si("release_angle")} rad, free_length: free from ${si("free_length")} m, hanging_length: free from ${si("hanging_length")} m}
`;
}
