/** The apparatus: both masses, string, rod, trails, forces and tracked points, beside the rod enlarged. */

import { drawArrows, weightLength } from "./arrows.js";
import { colours, disc, fitted, nameMasses, polyline, write } from "./canvas.js";
import { fixed, shown, text, written } from "./texts.js";
import { drawRod, drawString } from "./wound_string.js";

/** @import { DrawnRun, Sample } from "./shown_run.js" */
/** @import { Context } from "./canvas.js" */
/** @typedef {{left: number, right: number, low: number, high: number}} Box */
/** @typedef {{x: (x: number) => number, y: (y: number) => number, scale: number}} View from metres to pixels */
/**
 * @typedef {{run: DrawnRun, ghost: DrawnRun | null, time: number, arrows: import("./arrows.js").ShownArrows, points: {light: number[][], heavy: number[][]},
 *   now: {light: number[] | null, heavy: number[] | null}, runs: import("./engine_runs/engine_runs.js").EngineRuns | null,
 *   film: import("./film/panel.js").FilmPanel | null, untilNow?: boolean}} Scene
 *   `film`: drawn under all else. `untilNow`: without the path that is still to come. `runs`: stored runs, the reference's among them, which are drawn in place of the page's own; null without any
 */

/** The box stays as it is while the motion fills more than this share of it. */
const LEAST_FILLED = 0.6;
/** Room beside the motion, in which a mass at its edge and its name are whole [px]. */
const MARGIN = 26;
/** Radius of wound string on the enlarged rod: its gain in one turn, in rod radii. */
const GAIN_PER_TURN = 0.11;
const LEAST_TURNS_SHOWN = 5;
const [LIGHT_SIZE, HEAVY_SIZE] = [9, 14];
/** Radius of the arc of the angle at the release [px]. */
const ARC = 30;
/** Highest power of ten on the scale of the bars. */
const MOST_DECADES = 6;
/** Width of the enlarged rod with one string, and with those of several runs [px]. */
const [SIDE, LARGE_SIDE] = [170, 260];
const NARROW_SIDE = 128;

/** Where a stage is larger than this, as on a projector, all on it is drawn larger, words and lines, too [px]. */
const [USUAL_WIDTH, USUAL_HEIGHT] = [900, 480];

/** Draws scenes, and knows where on the canvas things are. */
export class Stage {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    /** @type {Box | null} */
    this.box = null;
    /** Whether the scale stays as it is, since something is dragged. */
    this.frozen = false;
    /** Of the drawing [px]. */
    this.size = { width: 0, height: 0 };
    /** Pixels of CSS in one of the drawing. */
    this.enlarged = 1;
    /** @type {View} */
    this.view = { x: (x) => x, y: (y) => y, scale: 1 };
  }

  /** @param {Scene} scene */
  draw(scene) {
    const { c, width: wide, height: high } = fitted(this.canvas);
    this.enlarged = Math.max(1, Math.min(wide / USUAL_WIDTH, high / USUAL_HEIGHT));
    c.scale(this.enlarged, this.enlarged);
    const [width, height] = [wide, high].map((size) => size / this.enlarged);
    const { run, ghost, time, runs } = scene;
    this.size = { width, height };
    const side = Math.min(runs ? LARGE_SIDE : SIDE, Math.max(NARROW_SIDE, (runs ? 0.32 : 0.22) * width));
    if (!(width > side && height > 0)) return; // the page is being laid out, or has no room
    // The weight of a heavy mass has room below it
    this.fit(scene, width - side, scene.arrows.forces ? height - weightLength(height) : height);
    const { view } = this;
    scene.film?.draw(c, view);
    if (ghost) this.apparatus(c, ghost, time, true);
    this.trackedPoints(c, scene);
    if (runs) runs.drawStage(c, view, time);
    else this.apparatus(c, run, time, false, scene.untilNow);
    const sample = run.at(time);
    const [light, heavy] = [sample.light, sample.heavy].map(([x, y]) => [view.x(x), view.y(y)]);
    drawArrows(c, run, sample, { light, heavy }, scene.arrows, height);
    if (!runs) this.names(c, run, sample);
    if (scene.untilNow || (time === 0 && !runs)) this.angle(c, run, time);
    disc(c, [view.x(0), view.y(0)], Math.max(run.settings.rod_radius * view.scale, 3), { fill: colours().soft });
    this.scaleBar(c, height);
    if (run.release === "drop") return;
    const place = { left: width - side, width: side, height: Math.min(side, 0.5 * height) };
    if (runs) runs.drawRod(c, place, time);
    else this.rod(c, run, sample, place);
    if (scene.arrows.forces) holding(c, sample, { left: width - side, width: side, top: Math.min(side, 0.5 * height), height });
  }

  /** Choose which part of the plane is seen. @param {Scene} scene @param {number} width @param {number} height */
  fit({ run, ghost, points, runs }, width, height) {
    const box = boxOf(ghost ? [run, ghost] : [run], [...points.light, ...points.heavy, ...(runs?.corners ?? [])]);
    if (!this.box || (!this.frozen && !fills(box, this.box))) this.box = box;
    const { left, right, low, high } = this.box;
    const [wide, tall] = [width, height].map((size) => Math.max(size - 2 * MARGIN, 1));
    const scale = Math.min(wide / (right - left), tall / (high - low));
    this.view = {
      x: (x) => width / 2 + (x - (left + right) / 2) * scale,
      y: (y) => height / 2 - (y - (low + high) / 2) * scale,
      scale,
    };
  }

  /** Place of a pointer in the drawing [px]. @param {PointerEvent} event */
  placeOf(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top].map((distance) => distance / this.enlarged);
  }

  /** Place in the drawing [px] -> place in the plane [m]. @param {number} px @param {number} py */
  toPlane(px, py) {
    const { x, y, scale } = this.view;
    return [(px - x(0)) / scale, (y(0) - py) / scale];
  }

  /** @param {Context} c @param {DrawnRun} run @param {number} time @param {boolean} pale @param {boolean} untilNow */
  apparatus(c, run, time, pale, untilNow = false) {
    const { view } = this;
    const { ink, soft, blue, orange } = colours();
    const sample = run.at(time);
    const whole = run.samples.map(({ light: [x, y] }) => [view.x(x), view.y(y)]);
    const done = whole.slice(0, Math.floor((time / run.end) * (whole.length - 1)) + 1);
    const dash = pale ? [5, 5] : [];
    if (!untilNow) polyline(c, whole, { colour: pale ? soft : orange, width: pale ? 1.5 : 1.2, dash, alpha: pale ? 0.8 : 0.45 });
    const [lx, ly] = [view.x(sample.light[0]), view.y(sample.light[1])];
    const [hx, hy] = [view.x(sample.heavy[0]), view.y(sample.heavy[1])];
    if (!pale) polyline(c, [...done, [lx, ly]], { colour: orange, width: 2.5 });
    if (run.release !== "drop") {
      c.globalAlpha = pale ? 0.6 : 1;
      const style = { colour: pale ? soft : ink, width: pale ? 1 : 2, slack: sample.mode.endsWith("slack") };
      drawString(c, view, run.settings.rod_radius, { ...sample, angle: sample.wrapAngle }, style);
    }
    c.globalAlpha = pale ? 0.5 : 1;
    const { panel } = colours();
    disc(c, [hx, hy], HEAVY_SIZE, { fill: pale ? panel : blue, line: pale ? soft : panel, width: 1.5 });
    disc(c, [lx, ly], LIGHT_SIZE, { fill: pale ? panel : orange, line: pale ? soft : panel, width: 1.5 });
    c.globalAlpha = 1;
  }

  /** @param {Context} c @param {DrawnRun} run @param {Sample} sample */
  names(c, { settings: { rod_radius: r } }, { light, heavy, wrapAngle }) {
    const place = (/** @type {number[]} */ [x, y]) => [this.view.x(x), this.view.y(y)];
    nameMasses(c, place(light), place(heavy), place([r * Math.cos(wrapAngle), r * Math.sin(wrapAngle)]));
  }

  /** The rod enlarged: each turn lies outside the one before. @param {Context} c @param {DrawnRun} run @param {Sample} sample
   * @param {import("./wound_string.js").Place} place */
  rod(c, run, { wrapAngle: angle, freeLength, turns }, place) {
    const most = Math.max(LEAST_TURNS_SHOWN, run.samples[run.samples.length - 1].turns);
    const scale = (0.42 * Math.min(place.width, place.height)) / (1.1 + GAIN_PER_TURN * most);
    const radiusAt = (/** @type {number} */ a) => 1.05 + (GAIN_PER_TURN * Math.max(a, 0)) / (2 * Math.PI);
    const string = { angle, length: freeLength / run.settings.rod_radius, radiusAt, colour: colours().ink, width: 1.6 };
    drawRod(c, place, scale, [string], turns);
  }

  /** The angle of the string at the release, from straight up. @param {Context} c @param {DrawnRun} run @param {number} time */
  angle(c, run, time) {
    if (run.release === "vertical" || run.release === "drop") return;
    const { view } = this;
    const { soft, ink } = colours();
    const { rod_radius: r, release_angle: angle } = run.settings;
    const { light, wrapAngle } = run.at(0);
    const [x, y] = [view.x(r * Math.cos(wrapAngle)), view.y(r * Math.sin(wrapAngle))];
    polyline(c, [[x, y], [x, y - ARC - 10]], { colour: soft, width: 1.2, dash: [4, 4] });
    // Where the string was let go, if it has left it
    if (time > 0) polyline(c, [[x, y], [view.x(light[0]), view.y(light[1])]], { colour: soft, width: 1.2, dash: [4, 4] });
    c.beginPath();
    c.arc(x, y, ARC, -Math.PI / 2, -Math.PI / 2 - angle, true);
    c.strokeStyle = soft;
    c.lineWidth = 1.5;
    c.stroke();
    const distance = ARC + 6;
    const words = `${shown(Number(((angle * 180) / Math.PI).toPrecision(5)))}°`;
    write(c, words, x - distance * Math.sin(angle / 2), y - distance * Math.cos(angle / 2), { colour: ink, align: "right", clear: true });
  }

  /** @param {Context} c @param {Scene} scene */
  trackedPoints(c, { points, now }) {
    const { view } = this;
    const { green, ink, panel } = colours();
    c.globalAlpha = 0.7;
    for (const [x, y] of [...points.light, ...points.heavy]) disc(c, [view.x(x), view.y(y)], 2, { fill: green });
    c.globalAlpha = 1;
    for (const place of [now.light, now.heavy]) {
      if (place) disc(c, [view.x(place[0]), view.y(place[1])], 6, { fill: panel, line: ink, width: 2 });
    }
  }

  /** @param {Context} c @param {number} height */
  scaleBar(c, height) {
    const { soft } = colours();
    const metres = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2].find((m) => m * this.view.scale > 44) ?? 2;
    polyline(c, [[12, height - 12], [12 + metres * this.view.scale, height - 12]], { colour: soft });
    write(c, `${Math.round(metres * 100)} cm`, 12, height - 16, { colour: soft, baseline: "bottom", clear: true });
  }
}

/**
 * Smallest box that holds all places of runs, and points [m].
 * @param {DrawnRun[]} runs
 * @param {number[][]} points
 * @returns {Box}
 */
function boxOf(runs, points) {
  const r = Math.max(...runs.map(({ settings }) => settings.rod_radius));
  const box = { left: -r, right: r, low: -r, high: r };
  const places = runs.flatMap(({ samples }) => samples.flatMap(({ light, heavy }) => [light, heavy]));
  for (const [x, y] of [...places, ...points]) {
    box.left = Math.min(box.left, x);
    box.right = Math.max(box.right, x);
    box.low = Math.min(box.low, y);
    box.high = Math.max(box.high, y);
  }
  return box;
}

/** Whether a box is inside another and nearly as large. @param {Box} inner @param {Box} outer */
function fills(inner, outer) {
  const inside = inner.left >= outer.left && inner.right <= outer.right && inner.low >= outer.low && inner.high <= outer.high;
  const wide = (inner.right - inner.left) / (outer.right - outer.left);
  const high = (inner.high - inner.low) / (outer.high - outer.low);
  return inside && Math.max(wide, high) > LEAST_FILLED;
}

/**
 * What friction must hold beside the most that it can hold, as bars: how many times the smaller pull the larger one is, on a scale of
 * powers of ten.
 * @param {Context} c
 * @param {Sample} sample
 * @param {{left: number, width: number, top: number, height: number}} place
 */
function holding(c, { holding: pair, mode }, { left, width, top, height }) {
  const { soft, ink, line, pink, green } = colours();
  const base = height - 58;
  const tall = base - top - 32;
  if (tall < 30 || !pair) return;
  const title = text(mode === "sticking" ? "frictionHolds" : "frictionSlides");
  write(c, title, left + width / 2, top + 14, { colour: ink, size: 12, align: "center", bold: true, clear: true });
  const decades = Math.min(Math.max(Math.ceil(Math.max(pair.bound, pair.needed) / Math.LN10), 1), MOST_DECADES);
  const y = (/** @type {number} */ exponent) => base - (tall * Math.min(exponent / Math.LN10, decades)) / decades;
  const axis = left + 0.36 * width;
  for (let decade = 0; decade <= decades; decade += Math.ceil((12 * decades) / tall)) {
    const at = y(decade * Math.LN10);
    polyline(c, [[axis, at], [left + width - 8, at]], { colour: line, width: 1 });
    write(c, written(10 ** decade, 1), axis - 4, at, { colour: soft, size: 10, align: "right" });
  }
  const bar = 0.13 * width;
  for (const [share, value, colour, name] of [[0.16, pair.needed, pink, text("mustHold")], [0.7, pair.bound, green, text("canHold")]]) {
    const x = axis + Number(share) * (left + width - axis);
    c.beginPath();
    c.rect(x - bar / 2, y(Number(value)), bar, base - y(Number(value)));
    c.fillStyle = String(colour);
    c.fill();
    c.strokeStyle = ink;
    c.lineWidth = 1;
    c.stroke();
    write(c, String(name), x, base + 11, { colour: soft, size: 11, align: "center" });
    write(c, ratio(Math.exp(Number(value))), x, base + 25, { colour: ink, size: 12, align: "center" });
  }
  [text("largerPull"), text("smallerPull")].forEach((words, i) => {
    write(c, words, left + width / 2, base + 40 + 12 * i, { colour: soft, size: 10, align: "center" });
  });
}

/** @param {number} value */
function ratio(value) {
  const most = 10 ** MOST_DECADES;
  return value < 100 ? fixed(value, 2) : value < most ? written(value, 2) : `> ${written(most, 1)}`;
}
