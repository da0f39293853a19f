/** The tools of a bench, which are laid over the stage: a ruler, a protractor and a stopwatch. */

import { colours, disc, polyline, write } from "./canvas.js";
import { makeMovable } from "./dragging.js";
import { html } from "./elements.js";
import { fixed, text } from "./texts.js";

/** @import { Context } from "./canvas.js" */
/** @import { Stage } from "./stage.js" */
/** @import { Stopwatch } from "./stopwatch.js" */
/** @typedef {"ruler" | "protractor"} Name */
/** @typedef {number[]} Point place in the plane [m], or on the canvas [px] */
/**
 * @typedef {{start: Point[], unit: string, most: number, measure: (points: Point[]) => number,
 *   whole: (points: Point[]) => Point, draw: (c: Context, points: Point[], words: string, scale: number) => void}} Kind
 *   `start`: its points when it is switched on, as shares of the stage from the left and from above; `measure`: in `unit`, at most
 *   `most`; `whole`: where it is taken to be moved as a whole; `draw`: with points on the canvas
 */

const CENTIMETRES = 100;
/** What an arrow key moves a point by [px]. */
const STEP = 1;
/** Half the width of the ruler, the radius of the protractor's arc, and that of a point to be moved [px]. */
const [HALF_WIDTH, ARC, HANDLE] = [11, 34, 6];
/** Least distance of a ruler's marks [px]. */
const LEAST_MARKS = 4;
/** How near to the stage's edge a point may come [px]. */
const EDGE = 12;

/** @type {Record<Name, Kind>} */
const KINDS = {
  ruler: {
    start: [[0.2, 0.85], [0.5, 0.85]],
    unit: "cm",
    most: 1000,
    measure: ([a, b]) => CENTIMETRES * Math.hypot(b[0] - a[0], b[1] - a[1]),
    whole: ([a, b]) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2],
    draw: drawRuler,
  },
  protractor: {
    start: [[0.35, 0.6], [0.35, 0.3], [0.55, 0.6]],
    unit: "°",
    most: 180,
    measure: (points) => (Math.abs(angleBetween(points)) * 180) / Math.PI,
    whole: ([corner]) => corner,
    draw: drawProtractor,
  },
};

/** Angle at the first of three points, from the second to the third, turning as the axes do [rad]. @param {Point[]} points */
function angleBetween([corner, first, second]) {
  const [ax, ay, bx, by] = [first[0] - corner[0], first[1] - corner[1], second[0] - corner[0], second[1] - corner[1]];
  return Math.atan2(ax * by - ay * bx, ax * bx + ay * by);
}

/** A ruler or protractor: its points, and a handle for each that moves alone and for the whole. */
class Tool {
  /** @param {Name} name @param {Bench} bench */
  constructor(name, bench) {
    this.name = name;
    this.kind = KINDS[name];
    this.bench = bench;
    /** In the plane [m]; none while the tool is off. @type {Point[]} */
    this.points = [];
    const all = this.kind.start.map((_, i) => i);
    // The corner of a protractor is where the whole is taken
    const single = name === "ruler" ? all : all.slice(1);
    this.handles = [all, ...single.map((i) => [i])].map((moved, i) => {
      const handle = html("div", { id: `${name}-${i}`, className: "handle", tabIndex: 0, hidden: true });
      for (const [key, value] of [["role", "slider"], ["aria-valuemin", "0"], ["aria-valuemax", String(this.kind.most)]]) {
        handle.setAttribute(key, value);
      }
      makeMovable(handle, STEP, (right, down) => this.move(moved, right, down));
      return { handle, moved };
    });
  }

  /** @param {number[]} moved places of the points @param {number} right @param {number} down [px] */
  move(moved, right, down) {
    const { view, enlarged } = this.bench.stage;
    const scale = view.scale * enlarged;
    for (const i of moved) this.points[i] = [this.points[i][0] + right / scale, this.points[i][1] - down / scale];
    this.bench.onChange();
  }

  /** What it measures, in words. */
  get words() {
    const { measure, unit } = this.kind;
    return `${fixed(measure(this.points), 1)}${unit === "°" ? "" : "\u00a0"}${unit}`;
  }

  /** Draw it, and put its handles where it is. @param {Context} c */
  draw(c) {
    const { stage } = this.bench;
    const { view, enlarged } = stage;
    const { width, height } = stage.size;
    const isOn = this.bench.isOn(this.name);
    if (!isOn) this.points = [];
    else if (!this.points.length) this.points = this.kind.start.map(([x, y]) => stage.toPlane(x * width, y * height));
    const inside = (/** @type {number} */ x, /** @type {number} */ most) => Math.min(Math.max(x, EDGE), most - EDGE);
    const places = this.points.map(([x, y]) => [inside(view.x(x), width), inside(view.y(y), height)]);
    // What the stage no longer shows, or was drawn beyond its edge, comes back
    this.points = places.map(([x, y]) => stage.toPlane(x, y));
    for (const { handle, moved } of this.handles) {
      handle.hidden = !isOn;
      if (!isOn) continue;
      const [x, y] = moved.length > 1 ? this.kind.whole(places) : places[moved[0]];
      handle.style.transform = `translate(${x * enlarged}px, ${y * enlarged}px) translate(-50%, -50%)`;
      handle.setAttribute("aria-valuetext", this.words);
      handle.setAttribute("aria-valuenow", this.kind.measure(this.points).toFixed(1));
    }
    if (isOn) this.kind.draw(c, places, this.words, view.scale / CENTIMETRES);
  }

  relabel() {
    this.handles.forEach(({ handle }, i) => {
      handle.setAttribute("aria-label", i ? text("toolEnd", { tool: text(this.name), number: i }) : text("toolWhole", { tool: text(this.name) }));
    });
  }
}

/** All tools, each with its switch. */
export class Bench {
  /** @param {(id: string) => HTMLElement} element @param {Stage} stage @param {Stopwatch} stopwatch
   * @param {() => void} onChange to be called when the stage is to be drawn anew */
  constructor(element, stage, stopwatch, onChange) {
    this.stage = stage;
    this.onChange = onChange;
    this.isOn = (/** @type {string} */ name) => /** @type {HTMLInputElement} */ (element(`show-${name}`)).checked;
    this.tools = [new Tool("ruler", this), new Tool("protractor", this)];
    this.stopwatch = stopwatch;
    element("tools").append(...this.tools.flatMap(({ handles }) => handles.map(({ handle }) => handle)));
    for (const name of ["ruler", "protractor", "stopwatch"]) element(`show-${name}`).addEventListener("change", onChange);
  }

  relabel() {
    for (const tool of this.tools) tool.relabel();
    this.stopwatch.relabel();
  }

  /** Draw over the stage. */
  draw() {
    const c = /** @type {Context} */ (this.stage.canvas.getContext("2d"));
    for (const tool of this.tools) if (tool.points.length || this.isOn(tool.name)) tool.draw(c);
    this.stopwatch.show(this.isOn("stopwatch"));
  }
}

/** @param {Context} c @param {Point[]} ends @param {string} words @param {number} scale pixels in a centimetre */
function drawRuler(c, [[ax, ay], [bx, by]], words, scale) {
  const { ink, yellow, panel } = colours();
  const length = Math.hypot(bx - ax, by - ay);
  c.save();
  c.translate(ax, ay);
  c.rotate(Math.atan2(by - ay, bx - ax));
  c.beginPath();
  c.rect(0, -HALF_WIDTH, length, 2 * HALF_WIDTH);
  c.globalAlpha = 0.35;
  c.fillStyle = yellow;
  c.fill();
  c.globalAlpha = 1;
  c.strokeStyle = ink;
  c.lineWidth = 1;
  c.stroke();
  const every = [1, 5, 10, 50].find((step) => step * scale >= LEAST_MARKS) ?? 100;
  for (let mark = 0; mark * scale <= length; mark += every) {
    const deep = mark % (10 * every) === 0 ? 12 : mark % (5 * every) === 0 ? 8 : 5;
    polyline(c, [[mark * scale, -HALF_WIDTH], [mark * scale, -HALF_WIDTH + deep]], { colour: ink, width: 1 });
  }
  for (const end of [0, length]) disc(c, [end, 0], HANDLE, { fill: panel, line: ink, width: 1.5 });
  c.restore();
  write(c, words, (ax + bx) / 2, (ay + by) / 2 - (ay === by || Math.abs(bx - ax) > Math.abs(by - ay) ? 22 : 0), {
    colour: ink, size: 14, bold: true, align: "center", clear: true,
  });
}

/** @param {Context} c @param {Point[]} points the corner, and the ends of both arms @param {string} words */
function drawProtractor(c, points, words) {
  const { ink, yellow, panel } = colours();
  const [[x, y], first, second] = points;
  const from = Math.atan2(first[1] - y, first[0] - x);
  const turn = angleBetween(points);
  c.beginPath();
  c.moveTo(x, y);
  c.arc(x, y, ARC, from, from + turn, turn < 0);
  c.closePath();
  c.globalAlpha = 0.35;
  c.fillStyle = yellow;
  c.fill();
  c.globalAlpha = 1;
  polyline(c, [first, [x, y], second], { colour: ink, width: 1.5 });
  for (const point of points) disc(c, point, HANDLE, { fill: panel, line: ink, width: 1.5 });
  const [distance, middle] = [ARC + 22, from + turn / 2];
  write(c, words, x + distance * Math.cos(middle), y + distance * Math.sin(middle), { colour: ink, size: 14, bold: true, align: "center", clear: true });
}
