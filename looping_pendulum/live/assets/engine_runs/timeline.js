/** Under the slider of the time: what the reference's string does, and the moments of every run. */

import { html } from "../elements.js";
import { language, text } from "../texts.js";
import { MOMENT_SHAPES, REFERENCE, dashOf, make, momentShape, nameOf, swatch } from "./shapes.js";

/** @import { EngineRun, RunsData } from "./motion.js" */

const [ROW, BAND_HEIGHT] = [20, 18];
/** Half of the slider's thumb [px], so that moments stand where the slider does. */
const INSET = 8;
/** Room at the left from which on a run's name fits there [px]. */
const ROOM_FOR_NAMES = 100;
const LONGEST_NAME = 20;
const WIDTH_OF_LETTER = 6.5;

/** An SVG that is laid out anew when its room changes. */
export class Timeline {
  /** @param {RunsData} data @param {HTMLElement} box @param {HTMLElement} slider @param {(time: number) => void} onTime */
  constructor(data, box, slider, onTime) {
    this.data = data;
    this.box = box;
    this.slider = slider;
    this.onTime = onTime;
    /** @type {Map<string, SVGElement>} */
    this.rows = new Map();
    /** @type {SVGElement | null} */
    this.cursor = null;
    this.room = "";
    this.x = (/** @type {number} */ t) => t;
  }

  layout() {
    const { data, box } = this;
    const [outer, track] = [box.getBoundingClientRect(), this.slider.getBoundingClientRect()];
    const room = [outer.width, track.left - outer.left, track.width, language()].join();
    if (room === this.room) return;
    this.room = room;
    const left = track.left - outer.left + INSET;
    const wide = track.width - 2 * INSET;
    this.x = (/** @type {number} */ t) => left + (Math.min(t, data.duration) / data.duration) * wide;
    const height = BAND_HEIGHT + 6 + ROW * data.runs.length;
    const svg = make("svg", { viewBox: `0 0 ${outer.width} ${height}`, height, role: "group", "aria-label": text("moments") });
    this.band(svg, left);
    data.runs.forEach((run, i) => this.row(svg, run, BAND_HEIGHT + 6 + ROW * (i + 0.5), left));
    this.cursor = make("line", { class: "cursor", y1: 0, y2: height }, svg);
    box.replaceChildren(svg);
  }

  /** @param {Element} svg @param {number} left */
  band(svg, left) {
    const { modes, runs, duration } = this.data;
    if (left > ROOM_FOR_NAMES) make("text", { x: 0, y: 13, class: "soft" }, svg, text("stringOfReference"));
    modes.forEach(({ from, mode }, i) => {
      const [x, end] = [this.x(from), this.x(modes[i + 1]?.from ?? runs[0].end ?? duration)];
      const box = make("rect", { x, y: 1, width: Math.max(end - x, 0.5), height: BAND_HEIGHT - 3, class: mode }, svg);
      make("title", {}, box, text(`mode.${mode}`));
      const words = text(`band.${mode}`);
      if (end - x > WIDTH_OF_LETTER * words.length) make("text", { x: (x + end) / 2, y: 13, "text-anchor": "middle" }, svg, words);
    });
  }

  /** @param {Element} svg @param {EngineRun} run @param {number} y @param {number} left */
  row(svg, run, y, left) {
    const group = make("g", { "data-run": run.id }, svg);
    if (!run.gap) this.rows.set(run.id, group);
    if (left > ROOM_FOR_NAMES) {
      const name = nameOf(run);
      const shortened = name.length > LONGEST_NAME ? `${name.slice(0, LONGEST_NAME - 1)}…` : name;
      make("title", {}, make("text", { x: 0, y: y + 4, ...(run.id === REFERENCE ? {} : { lang: "en" }) }, group, shortened), name);
    } else {
      const small = swatch(run);
      for (const [name, value] of Object.entries({ y: y - 7, width: 30, viewBox: "7 0 30 14" })) small.setAttribute(name, String(value));
      group.append(small);
    }
    if (run.gap) {
      make("text", { x: left, y: y + 4, class: "gap" }, group, text("notRun"));
      return;
    }
    const dash = dashOf(run).join(" ") || "none";
    const style = `stroke:${run.colour};stroke-width:1.5;stroke-dasharray:${dash};opacity:.55`;
    make("path", { d: `M${this.x(0)},${y}H${this.x(run.end ?? 0)}`, style }, group);
    for (const { kind, t, words } of run.events) {
      const attributes = { class: "mark", transform: `translate(${this.x(t)},${y})`, "data-kind": kind, "data-time": t };
      const place = make("g", attributes, group);
      make("circle", { r: 9, style: "fill:transparent" }, place);
      momentShape(kind, run.colour, place);
      make("title", { lang: "en" }, place, `${run.name}: ${words} (${t.toFixed(4)} s)`);
      place.addEventListener("click", () => this.onTime(t));
    }
  }

  /** @param {number} time @param {Set<string>} shown */
  draw(time, shown) {
    this.cursor?.setAttribute("x1", String(this.x(time)));
    this.cursor?.setAttribute("x2", String(this.x(time)));
    for (const [id, row] of this.rows) row.style.opacity = shown.has(id) ? "1" : "0.25";
  }
}

/** Say what the shapes mean, those that occur. @param {RunsData} data @param {HTMLElement} parent */
export function fillKey(data, parent) {
  const present = new Set(data.runs.flatMap(({ events }) => events.map(({ kind }) => kind)));
  parent.replaceChildren();
  for (const kind of /** @type {import("./motion.js").KindOfMoment[]} */ (Object.keys(MOMENT_SHAPES))) {
    if (!present.has(kind)) continue;
    const svg = make("svg", { width: 14, height: 14, viewBox: "-7 -7 14 14" });
    momentShape(kind, "var(--ink)", svg);
    parent.append(html("span", {}, svg, text(`moment.${kind}`)));
  }
}
