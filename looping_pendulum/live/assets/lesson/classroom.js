/** A class: what everyone predicted and measured in the lesson, one line each, and how that is distributed. */

import { parsed } from "../controls.js";
import { html } from "../elements.js";
import { make } from "../engine_runs/shapes.js";
import { copyText, save } from "../export.js";
import { ticks } from "../canvas.js";
import { shown, text, withUnit } from "../texts.js";
import { STEPS } from "./steps.js";
import { isAnswer } from "./work.js";

/** @typedef {{said: string, found: string, measured: string}} Result an option, or a number as text; "" for what is not known */
/** @typedef {{name: string, results: Map<string, Result>}} Pupil `results`: by the name of the step */
/** @import { Step } from "./steps.js" */

/** What begins the line of a pupil. */
const BEGINNING = "looping-pendulum class";
const LONGEST_NAME = 40;
/** A drawing, its axis, a dot, and a bar [px]. */
const [WIDTH, INSET, DOT, BAR] = [420, 24, 5, 26];

/** A pupil's line. @param {Pupil} pupil */
export function lineOf({ name, results }) {
  const parts = [...results].map(([step, { said, found, measured }]) => `${step}=${[said, found, measured].join("/").replace(/\/+$/, "")}`);
  return [BEGINNING, name.replace(/[;\s]+/g, " ").trim().slice(0, LONGEST_NAME), ...parts].join("; ");
}

/**
 * Read the lines of a class, the last one of each name; which names have several, and how many; and how many others are no pupil's.
 * @param {string} lines
 * @returns {{pupils: Pupil[], repeats: [string, number][], others: number}}
 */
export function readClass(lines) {
  /** @type {Map<string, Pupil>} */
  const pupils = new Map();
  /** @type {Map<string, number>} */
  const counts = new Map();
  let others = 0;
  for (const line of lines.split(/\r?\n/).filter((one) => one.trim())) {
    const [beginning, name = "", ...parts] = line.split(";").map((part) => part.trim());
    const results = new Map(parts.flatMap((part) => resultOf(part)));
    if (beginning !== BEGINNING || !results.size) {
      others += 1;
      continue;
    }
    // Those without a name are different ones
    pupils.set(name || `${pupils.size + 1}`, { name, results });
    if (name) counts.set(name, (counts.get(name) ?? 0) + 1);
  }
  return { pupils: [...pupils.values()], repeats: [...counts].filter(([, count]) => count > 1), others };
}

/** @param {string} part of a line @returns {[string, Result][]} empty: it is of no step */
function resultOf(part) {
  const [name, answers = ""] = part.split("=");
  const step = STEPS.find((one) => one.name === name);
  if (!step) return [];
  const [said = "", found = "", measured = ""] = answers.split("/").map((answer) => (isAnswer(step, answer) ? answer : ""));
  return said || measured ? [[name, { said, found, measured }]] : [];
}

/** The pupil's own line, and the lines of a class. */
export class Classroom {
  /** @param {(id: string) => HTMLElement} element @param {() => Map<string, Result>} results of the lesson on this page
   * @param {() => void} onTyped to be called when there is more to be kept */
  constructor(element, results, onTyped) {
    this.element = element;
    this.results = results;
    this.onTyped = onTyped;
    this.name = /** @type {HTMLInputElement} */ (element("class-name"));
    this.lines = /** @type {HTMLTextAreaElement} */ (element("class-lines"));
    // Of a field for text browsers bring the caret into sight, even under the stage that a phone keeps above
    this.lines.addEventListener("focus", () => this.lines.scrollIntoView({ block: "nearest" }));
    const files = /** @type {HTMLInputElement} */ (element("class-files"));
    for (const field of [this.name, this.lines]) field.addEventListener("input", () => this.changed());
    files.addEventListener("change", () => this.add(files.files));
    this.lines.addEventListener("dragover", (event) => event.preventDefault());
    this.lines.addEventListener("drop", (event) => {
      if (!event.dataTransfer?.files.length) return; // text falls where it is dropped
      event.preventDefault();
      event.stopPropagation(); // elsewhere on the page it would be a trial
      this.add(event.dataTransfer.files);
    });
    element("class-copy").addEventListener("click", () => this.copy());
    element("class-save").addEventListener("click", () => {
      save(`${this.name.value.trim() || "lesson"}.txt`, new Blob([`${this.line}\n`], { type: "text/plain" }));
    });
  }

  get line() {
    return lineOf({ name: this.name.value, results: this.results() });
  }

  /** @param {FileList | null} files */
  async add(files) {
    const texts = await Promise.all([...(files ?? [])].map((file) => file.text()));
    this.lines.value = [this.lines.value.trimEnd(), ...texts.map((one) => one.trimEnd())].filter(Boolean).join("\n");
    this.changed();
  }

  changed() {
    this.show();
    this.onTyped();
  }

  /** The lines of the class, which are to be there again when the page is opened anew. */
  get record() {
    return this.lines.value;
  }

  /** Take up what was kept. @param {unknown} name @param {unknown} lines */
  restore(name, lines) {
    if (typeof name === "string") this.name.value = name.slice(0, LONGEST_NAME);
    if (typeof lines !== "string" || !lines) return;
    this.lines.value = lines;
    /** @type {HTMLDetailsElement} */ (this.element("class")).open = true;
  }

  async copy() {
    this.say("class-copied", text((await copyText(this.line)) ? "classCopied" : "classNotCopied"));
  }

  /** @param {string} id @param {string} words */
  say(id, words) {
    this.element(id).textContent = words;
  }

  /** Write the pupil's line, and draw the class. */
  show() {
    const hasResults = this.results().size > 0;
    this.say("class-line", hasResults ? this.line : text("classNothing"));
    for (const id of ["class-copy", "class-save"]) /** @type {HTMLButtonElement} */ (this.element(id)).disabled = !hasResults;
    const { pupils, repeats, others } = readClass(this.lines.value);
    const found = pupils.length ? text("classCount", { count: pupils.length }) : "";
    const names = repeats.map(([name, count]) => `${name} (${count})`).join(", ");
    const repeated = names && text("classRepeats", { names });
    this.say("class-message", [found, repeated, others ? text("classOthers", { count: others }) : ""].filter(Boolean).join(" "));
    this.element("class-results").replaceChildren(...STEPS.flatMap((step, place) => {
      const results = pupils.flatMap(({ results: own }) => own.get(step.name) ?? []);
      return results.length ? [figureOf(step, place, results)] : [];
    }));
  }
}

/** What a class said of a step. @param {Step} step @param {number} place @param {Result[]} results */
function figureOf(step, place, results) {
  const name = text(`lesson.${step.name}.title`);
  const caption = [text("lessonStep", { number: place + 1, name }), text(`lesson.${step.name}.question`)].join(". ");
  return html("figure", {}, html("figcaption", {}, caption), step.options.length ? barsOf(step, results) : axisOf(step, results));
}

/** A bar for each answer; the one that the runs say is marked. @param {Step} step @param {Result[]} results */
function barsOf({ name, options }, results) {
  const counts = options.map((option) => results.filter(({ said }) => said === option).length);
  const most = Math.max(...counts, 1);
  const words = options.map((option, i) => [text(`lesson.${name}.${option}`), counts[i]].join(": "));
  const svg = make("svg", { viewBox: `0 0 ${WIDTH} ${2 * BAR * options.length}`, role: "img", "aria-label": words.join("; ") });
  options.forEach((option, i) => {
    const isFound = results.some(({ found }) => found === option);
    make("text", { x: 0, y: BAR * (2 * i + 0.7) }, svg, isFound ? `${words[i]} ✓ ${text("classComputed")}` : words[i]);
    make("rect", { x: 0, y: BAR * (2 * i + 1), width: Math.max((WIDTH * counts[i]) / most, 1), height: BAR * 0.7, class: isFound ? "found" : "" }, svg);
  });
  return svg;
}

/** All numbers on one axis: predictions above it, measurements below, and a line where the runs say. @param {Step} step @param {Result[]} results */
function axisOf({ unit }, results) {
  const numbersOf = (/** @type {keyof Result} */ key) => results.map((result) => parsed(result[key])).filter((x) => x > 0).sort((a, b) => a - b);
  const [said, found, measured] = [numbersOf("said"), numbersOf("found"), numbersOf("measured")];
  const all = [...said, ...found, ...measured];
  const [least, most] = [Math.min(...all), Math.max(...all)];
  const room = (most - least || most) / 10;
  const [low, high] = [least - room, most + room];
  const x = (/** @type {number} */ value) => INSET + ((value - low) / (high - low)) * (WIDTH - 2 * INSET);
  const [above, below] = [stacked(said.map(x)), stacked(measured.map(x))];
  const levels = (/** @type {{level: number}[]} */ dots) => Math.max(0, ...dots.map(({ level }) => level + 1));
  const axis = BAR + 2 * DOT * levels(above);
  const height = axis + BAR + (measured.length ? BAR + 2 * DOT * levels(below) : 0);
  const row = (/** @type {string} */ words, /** @type {number[]} */ values) =>
    values.length ? [`${words} (${values.length}): ${shown(least3(values))}`] : [];
  const label = [...row(text("classPredicted"), said), ...row(text("classMeasured"), measured)].join("; ");
  const svg = make("svg", { viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "aria-label": label });
  make("line", { x1: INSET / 2, x2: WIDTH - INSET / 2, y1: axis, y2: axis, class: "axis" }, svg);
  for (const tick of ticks(low, high)) {
    make("line", { x1: x(tick), x2: x(tick), y1: axis, y2: axis + 4, class: "axis" }, svg);
    make("text", { x: x(tick), y: axis + 17, "text-anchor": "middle", class: "soft" }, svg, withUnit(shown(tick), unit));
  }
  for (const value of new Set(found)) make("line", { x1: x(value), x2: x(value), y1: 16, y2: height, class: "found" }, svg);
  if (found.length) make("text", { x: x(found[0]), y: 12, "text-anchor": "middle" }, svg, text("classComputed"));
  for (const { at, level } of above) make("circle", { cx: at, cy: axis - DOT * (2 * level + 1) - 1, r: DOT - 1, class: "said" }, svg);
  for (const { at, level } of below) {
    make("rect", { x: at - DOT + 1, y: axis + BAR + 2 * DOT * level, width: 2 * DOT - 2, height: 2 * DOT - 2, class: "measured" }, svg);
  }
  make("text", { x: 0, y: 12, class: "soft" }, svg, `● ${text("classPredicted")}`);
  if (measured.length) make("text", { x: 0, y: height - 4, class: "soft" }, svg, `■ ${text("classMeasured")}`);
  return svg;
}

/** Least, median and largest of sorted numbers. @param {number[]} values */
const least3 = (values) => [values[0], values[Math.floor(values.length / 2)], values[values.length - 1]].join(" … ");

/** Dots that would lie on one another, upon one another. @param {number[]} places sorted [px] @returns {{at: number, level: number}[]} */
function stacked(places) {
  /** @type {number[]} */
  const ends = [];
  return places.map((at) => {
    let level = ends.findIndex((end) => end <= at - 2 * DOT);
    if (level < 0) level = ends.length;
    ends[level] = at;
    return { at, level };
  });
}
