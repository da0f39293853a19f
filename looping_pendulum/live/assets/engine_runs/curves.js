/** Stored runs in the plots: their curves with the moments on them, tracked points, and where each run is now. */

import { colours, disc, polyline, write } from "../canvas.js";
import { text } from "../texts.js";
import { hasEnded, placeOf } from "./motion.js";
import { REFERENCE, dashOf, drawMoment } from "./shapes.js";

/** @import { Context } from "../canvas.js" */
/** @import { Plot } from "../plots.js" */
/** @import { EngineRun, Place, RunsData } from "./motion.js" */

/** Plot -> list of a run that it shows, what one unit of the plot is worth, and where the quantity stands in a place.
 * @type {Record<string, {list: "drop" | "angle" | "light_tension" | "heavy_tension" | "distance", factor: number,
 *   value: (place: Place) => number | null}>} */
const QUANTITIES = {
  drop: { list: "drop", factor: 100, value: ({ drop }) => drop },
  turns: { list: "angle", factor: 1 / (2 * Math.PI), value: ({ angle }) => angle },
  "pull-light": { list: "light_tension", factor: 1, value: ({ lightTension }) => lightTension },
  "pull-heavy": { list: "heavy_tension", factor: 1, value: ({ heavyTension }) => heavyTension },
  distance: { list: "distance", factor: 1000, value: ({ distance }) => distance },
};
/** Smallest distance that is drawn [mm]. */
const FLOOR = 1e-3;
/** Share of the values, at either end, that may be a short spike: a light mass at the rod, a jerk. */
const SPIKES = 0.005;
const POINT = 1.8;

/** Lowest and highest value that a plot shows, so that a short spike does not flatten the rest.
 * @param {RunsData} data @param {string} plot @returns {[number, number]} */
export function rangeOf(data, plot) {
  const { list, factor } = QUANTITIES[plot];
  const lists = [...data.runs.map((run) => run[list] ?? []), data.trial?.panels[list]?.v ?? []];
  const values = lists.flatMap((one) => one.flatMap((v) => (v === null ? [] : [v * factor]))).sort((a, b) => a - b);
  if (!values.length) return [0, 1];
  const last = values.length - 1;
  if (plot === "distance") return [FLOOR, Math.max(10 ** Math.ceil(Math.log10(Math.max(values[last], 1e-2))), 1e-2)];
  const [least, most] = [values[Math.ceil(SPIKES * last)], values[Math.floor((1 - SPIKES) * last)]];
  return [least < 0.6 * values[0] ? values[0] : 1.15 * least, most > 0.6 * values[last] ? values[last] : 1.15 * most];
}

/** @param {Context} c @param {Plot} plot @param {RunsData} data @param {EngineRun[]} shown @param {Map<string, string>} colourOf
 * @param {boolean} measured whether tracked points are shown, too */
export function drawCurves(c, plot, data, shown, colourOf, measured) {
  const { list, factor, value } = QUANTITIES[plot.kind.id];
  let known = false;
  for (const run of shown) {
    const values = run[list];
    if (!values?.some((v) => v !== null)) continue;
    known = true;
    const colour = colourOf.get(run.id) ?? "";
    const style = { colour, width: run.id === REFERENCE ? 3 : 1.8, dash: dashOf(run) };
    polyline(c, values.map((v, i) => [plot.x(i / data.rate), v === null ? NaN : plot.y(v * factor)]), style);
    for (const { kind, t } of run.events) {
      const place = placeOf(data, run, t);
      const at = place && t <= data.duration ? value(place) : null;
      if (at !== null) drawMoment(c, kind, plot.x(t), plot.y(at * factor), colour);
    }
  }
  const points = data.trial?.panels[list];
  if (measured && points) drawPoints(c, plot, points, factor, data.duration);
  if (known) return;
  const { width, height } = plot.size;
  write(c, text("unknownToRuns"), width / 2, height / 2, { colour: colours().soft, align: "center" });
}

/** @param {Context} c @param {Plot} plot @param {{t: number[], v: (number | null)[]}} points @param {number} factor
 * @param {number} end */
function drawPoints(c, plot, { t, v }, factor, end) {
  const { ink, ground } = colours();
  c.globalAlpha = 0.7;
  t.forEach((time, i) => {
    const value = v[i];
    if (value !== null && time <= end) disc(c, [plot.x(time), plot.y(value * factor)], POINT, { fill: ground, line: ink });
  });
  c.globalAlpha = 1;
}

/** What a plot shows of each run at a time, where that is known. @param {string} plot @param {RunsData} data @param {EngineRun[]} shown
 * @param {number} time */
export function valuesAt(plot, data, shown, time) {
  const { factor, value } = QUANTITIES[plot];
  return shown.flatMap((run) => {
    const place = hasEnded(run, time) ? null : placeOf(data, run, time);
    const found = place && value(place);
    return found === null ? [] : [{ run, value: found * factor }];
  });
}

/** Where each run is at a time. @param {Context} c @param {Plot} plot @param {RunsData} data @param {EngineRun[]} shown
 * @param {Map<string, string>} colourOf @param {number} time */
export function drawDots(c, plot, data, shown, colourOf, time) {
  for (const { run, value } of valuesAt(plot.kind.id, data, shown, time)) {
    disc(c, [plot.x(time), plot.y(value)], 4, { fill: colourOf.get(run.id) ?? "", line: colours().ground });
  }
}
