/** Stored runs on the stage: masses, strings and paths of all that are shown, tracked points, the wound strings side by side. */

import { colours, disc, nameMasses, polyline } from "../canvas.js";
import { drawRod, drawString } from "../wound_string.js";
import { countUpTo, placeOf } from "./motion.js";
import { REFERENCE, dashOf, drawMarker } from "./shapes.js";

/** @import { Context } from "../canvas.js" */
/** @import { View } from "../stage.js" */
/** @import { EngineRun, Place, RunsData } from "./motion.js" */
/** @typedef {{run: EngineRun, colour: string, place: Place}} Drawn a run at the chosen time */

/** Distance between wound strings on the enlarged rod, in rod radii. */
const LANE = 0.055;
/** Half height of the enlarged view, in rod radii. */
const LEAST_VIEW = 2.2;
const PALE = 0.35;
/** Radii of a tracked point, and of the latest one [px]. */
const [POINT, LATEST_POINT] = [2.4, 6.5];
/** Time for which the first tracked point is the latest one, where no second tells the time between frames [s]. */
const FRAME = 0.02;

/** Draws runs, whose paths it computes once. */
export class StageRuns {
  /** @param {RunsData} data */
  constructor(data) {
    this.data = data;
    /** Every drawn place of a run [m]. @type {Map<string, number[][]>} */
    this.paths = new Map(data.runs.map((run) => [run.id, pathOf(data, run)]));
    const places = [...this.paths.values()].flat().filter(([x]) => !Number.isNaN(x));
    const heavy = data.runs.flatMap((run) => run.heavy?.length ? [[run.heavy[0], run.heavy[1] - Math.max(...run.drop.map(Number))], run.heavy] : []);
    const points = Object.values(data.trial?.stage ?? {}).flatMap(({ x, y }) => y.map((value, i) => [x?.[i] ?? 0, value ?? 0]));
    const all = [...places, ...heavy, ...points];
    const least = (/** @type {number} */ axis) => all.reduce((low, place) => Math.min(low, place[axis]), 0);
    const most = (/** @type {number} */ axis) => all.reduce((high, place) => Math.max(high, place[axis]), 0);
    /** Two places between which all others are [m]. */
    this.corners = [[least(0), least(1)], [most(0), most(1)]];
    /** Each turn of an enlarged string lies outside the one before it. */
    this.pitch = LANE * (data.runs.length + 1);
    const mostAngle = data.runs.flatMap((run) => run.angle ?? []).reduce((/** @type {number} */ high, angle) => Math.max(high, angle ?? 0), 0);
    this.halfHeight = Math.max(LEAST_VIEW, 1.15 * this.woundRadius(mostAngle, data.runs.length));
  }

  /** Runs at a time, those that have places. @param {EngineRun[]} shown @param {Map<string, string>} colourOf @param {number} time */
  at(shown, colourOf, time) {
    return shown.flatMap((run) => {
      const place = placeOf(this.data, run, time);
      return place && place.x !== null ? [{ run, place, colour: colourOf.get(run.id) ?? "" }] : [];
    });
  }

  /** @param {Context} c @param {View} view @param {Drawn[]} drawn @param {number} time @param {boolean} slack of the reference */
  draw(c, view, drawn, time, slack) {
    const { ground } = colours();
    for (const one of drawn) this.path(c, view, one, time);
    for (const one of drawn) {
      c.globalAlpha = one.place.ended ? PALE : 1;
      if (!this.data.string) continue;
      const { run, place, colour } = one;
      const ends = { light: [Number(place.x), Number(place.y)], heavy: [place.heavyX, place.heavyY], angle: place.angle ?? 0 };
      const isReference = run.id === REFERENCE;
      drawString(c, view, this.data.radius, ends, { colour, width: isReference ? 2 : 1.2, slack: slack && isReference });
    }
    for (const { run, place, colour } of drawn) {
      c.globalAlpha = place.ended ? PALE : 1;
      const [heavy, light] = run.id === REFERENCE ? [14, 9] : [10, 6];
      drawMarker(c, run, view.x(place.heavyX), view.y(place.heavyY), heavy, colour, ground);
      drawMarker(c, run, view.x(Number(place.x)), view.y(Number(place.y)), light, colour, ground);
    }
    c.globalAlpha = 1;
    if (!drawn.length) return;
    const [{ place }] = drawn;
    const [angle, r] = [place.angle ?? 0, this.data.radius];
    const [light, heavy] = [[view.x(Number(place.x)), view.y(Number(place.y))], [view.x(place.heavyX), view.y(place.heavyY)]];
    nameMasses(c, light, heavy, [view.x(r * Math.cos(angle)), view.y(r * Math.sin(angle))]);
  }

  /** @param {Context} c @param {View} view @param {Drawn} drawn @param {number} time */
  path(c, view, { run, colour }, time) {
    const path = this.paths.get(run.id) ?? [];
    const done = path.slice(0, Math.floor(time * this.data.rate) + 1);
    const width = run.id === REFERENCE ? 3 : 1.8;
    polyline(c, done.map(([x, y]) => [view.x(x), view.y(y)]), { colour, width, dash: dashOf(run), alpha: 0.55 });
  }

  /** Tracked points of both masses up to the time, the latest large while it is younger than two frames.
   * @param {Context} c @param {View} view @param {number} time */
  points(c, view, time) {
    const { ink, ground } = colours();
    const heavyX = this.data.runs[0].heavy[0];
    for (const { t, x, y } of Object.values(this.data.trial?.stage ?? {})) {
      const count = countUpTo(t, time);
      for (let i = 0; i < count; i++) {
        const latest = i === count - 1 && time - t[i] < 2 * (i ? t[i] - t[i - 1] : FRAME);
        const at = [view.x(x?.[i] ?? heavyX), view.y(Number(y[i]))];
        // Hollow, so that they show on a line of the same colour
        disc(c, at, latest ? LATEST_POINT : POINT, { fill: latest ? "transparent" : ground, line: ink, width: latest ? 2 : 1 });
      }
    }
  }

  /** Radius of an enlarged string at an angle, in rod radii. @param {number} angle @param {number} lane */
  woundRadius(angle, lane) {
    return 1 + LANE * (lane + 0.7) + (this.pitch * Math.max(angle, 0)) / (2 * Math.PI);
  }

  /** The rod enlarged, the wound strings beside each other.
   * @param {Context} c @param {Drawn[]} drawn @param {import("../wound_string.js").Place} place */
  rod(c, drawn, place) {
    const { radius } = this.data;
    const strings = drawn.map(({ run, place: { angle, length, ended }, colour }, lane) => ({
      angle: angle ?? 0,
      length: (length ?? 0) / radius,
      radiusAt: (/** @type {number} */ a) => this.woundRadius(a, lane),
      colour,
      width: run.id === REFERENCE ? 3 : 2,
      dash: dashOf(run),
      alpha: ended ? PALE : 1,
    }));
    drawRod(c, place, Math.min(place.width, place.height) / (2 * this.halfHeight), strings, drawn[0]?.place.turns ?? null);
  }
}

/** Places of the light mass, at the data's rate [m]; NaN where they are unknown. @param {RunsData} data @param {EngineRun} run */
function pathOf(data, run) {
  return Array.from({ length: run.count }, (_, i) => {
    const place = placeOf(data, run, i / data.rate);
    return [place?.x ?? NaN, place?.y ?? NaN];
  });
}
