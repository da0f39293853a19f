/** How runs and their moments look: lines and markers of the project's palette, a shape for each kind of moment. */

import { text } from "../texts.js";

/** @import { EngineRun, Moment } from "./motion.js" */

const NAMESPACE = "http://www.w3.org/2000/svg";
export const REFERENCE = "reference";

/** Kind of a moment -> its shape, within 6 px of the origin. @type {Record<Moment["kind"], string>} */
export const MOMENT_SHAPES = {
  stop: "M-4.5,0a4.5,4.5 0 1,0 9,0a4.5,4.5 0 1,0 -9,0Z",
  stick: "M-4.5,0a4.5,4.5 0 1,0 9,0a4.5,4.5 0 1,0 -9,0Z",
  slip: "M-4,-5L5,0L-4,5Z",
  slack: "M-6,0C-3,-6 -3,-6 0,0S3,6 6,0",
  taut: "M0,-6V6",
  halt: "M-4.5,-4.5H4.5V4.5H-4.5Z",
  rod: "M-4.5,-4.5L4.5,4.5M-4.5,4.5L4.5,-4.5",
  broke: "M0,-6L5.5,4.5H-5.5Z",
  other: "M0,-5L5,0L0,5L-5,0Z",
};
const FILLED = new Set(["stick", "slip", "halt"]);
/** Marker of a run, by Matplotlib's letter -> its shape, of radius 1. @type {Record<string, string>} */
const MARKERS = {
  o: "M-1,0a1,1 0 1,0 2,0a1,1 0 1,0 -2,0Z",
  s: "M-0.85,-0.85H0.85V0.85H-0.85Z",
  D: "M0,-1.2L1.2,0L0,1.2L-1.2,0Z",
  "^": "M0,-1.2L1.1,0.8H-1.1Z",
  v: "M0,1.2L1.1,-0.8H-1.1Z",
  P: "M-0.4,-1.1H0.4V-0.4H1.1V0.4H0.4V1.1H-0.4V0.4H-1.1V-0.4H-0.4Z",
};

/**
 * Make an SVG element; text goes in as text, never as markup.
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 * @param {Element | null} parent
 * @param {string | null} words
 */
export function make(name, attributes = {}, parent = null, words = null) {
  const made = document.createElementNS(NAMESPACE, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  if (words !== null) made.textContent = words;
  parent?.append(made);
  return made;
}

/** Shape of a moment; stick, slip and halt are filled, the others hollow or lines.
 * @param {Moment["kind"]} kind @param {string} colour @param {Element} parent */
export function momentShape(kind, colour, parent) {
  const style = `stroke:${colour};stroke-width:2;fill:${FILLED.has(kind) ? colour : "none"}`;
  return make("path", { d: MOMENT_SHAPES[kind], style }, parent);
}

/** The same on a canvas. @param {CanvasRenderingContext2D} c @param {Moment["kind"]} kind @param {number} x @param {number} y
 * @param {string} colour */
export function drawMoment(c, kind, x, y, colour) {
  c.save();
  c.translate(x, y);
  const shape = new Path2D(MOMENT_SHAPES[kind]);
  c.strokeStyle = c.fillStyle = colour;
  c.lineWidth = 2;
  if (FILLED.has(kind)) c.fill(shape);
  c.stroke(shape);
  c.restore();
}

/** A mass as the run's marker; the reference's is hollow.
 * @param {CanvasRenderingContext2D} c @param {EngineRun} run @param {number} x @param {number} y @param {number} r
 * @param {string} colour @param {string} edge */
export function drawMarker(c, run, x, y, r, colour, edge) {
  const hollow = run.id === REFERENCE;
  c.save();
  c.translate(x, y);
  c.scale(r, r);
  const shape = new Path2D(MARKERS[run.marker]);
  c.lineWidth = (hollow ? 2.6 : 1.2) / r;
  c.strokeStyle = hollow ? colour : edge;
  c.fillStyle = colour;
  if (!hollow) c.fill(shape);
  c.stroke(shape);
  c.restore();
}

/** @param {EngineRun} run */
export const nameOf = ({ id, name }) => (id === REFERENCE ? text("reference") : name);

/** Strokes and gaps of a run's line [px]; none for an unbroken one. @param {EngineRun} run */
export function dashOf({ dashes }) {
  return dashes[1] ? dashes.map((length) => 1.6 * length) : [];
}

/** A run's line and marker, as the list shows it. @param {EngineRun} run */
export function swatch(run) {
  const svg = make("svg", { width: 44, height: 14, viewBox: "0 0 44 14", "aria-hidden": "true", class: "swatch" });
  const hollow = run.id === REFERENCE;
  const dash = dashOf(run).join(" ") || "none";
  make("path", { d: "M0,7H44", style: `stroke:${run.colour};stroke-width:${hollow ? 3 : 2};stroke-dasharray:${dash}` }, svg);
  const style = `stroke:${run.colour};stroke-width:${hollow ? 0.4 : 0.15};fill:${hollow ? "var(--ground)" : run.colour}`;
  make("path", { d: MARKERS[run.marker], transform: "translate(22 7) scale(6)", style }, svg);
  return svg;
}
